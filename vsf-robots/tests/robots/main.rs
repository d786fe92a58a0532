//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::panic, clippy::unwrap_used)]

mod common;
mod meshes;
mod shared_urdfs;
mod urdf_refusals;
mod val_closed_form;
mod val_dynamics;
mod val_golden;
mod val_joint_torques;
mod val_kinova_shapes;
mod val_noise;
