//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::panic, clippy::unwrap_used)]

mod common;
mod corrected;
mod val_diagnosis;
mod val_effects_catalogue;
mod val_effects_contact;
mod val_effects_inertia;
mod val_effects_joints;
mod val_effects_object;
mod val_noise;
mod val_pad;
mod val_phantom;
mod val_real_arms;
