//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::panic, clippy::unwrap_used)]

mod live;
mod malformed;
mod robust;
mod scene;
mod stored;
mod val_baseline;
mod val_hyper;
mod val_readings;
mod val_sensors;
mod vision;
mod warnings;
