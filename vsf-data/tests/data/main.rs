//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used)]

mod common;
mod csv;
mod errors;
mod hostile;
mod mcap;
mod roundtrip;
mod val_numpy;
mod val_recordings;
mod val_signal;
