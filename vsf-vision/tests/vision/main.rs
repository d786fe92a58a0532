//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::unwrap_used)]

mod conformance;
mod val_camera;
mod val_extrapolation;
mod val_knn;
mod val_neighbors;
mod val_recording;
