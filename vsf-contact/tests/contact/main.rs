//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::panic, clippy::unwrap_used)]

mod common;
mod conformance;
mod val_batch;
mod val_cache;
mod val_golden_sdf;
mod val_grid;
mod val_peer;
mod val_runs;
mod val_shapes;
mod val_stick_slip;
