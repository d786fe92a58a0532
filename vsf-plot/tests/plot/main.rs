//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::unwrap_used)]

mod errors;
mod val_field;
mod val_torque;
