//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::unwrap_used)]

mod session;
mod val_points;
mod val_small_systems;
