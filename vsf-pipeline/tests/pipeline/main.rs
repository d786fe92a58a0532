//! Tests in one program: in several, each would compile what it takes of the libraries anew.

#![allow(clippy::panic, clippy::unwrap_used)]

mod baseline;
mod hyper;
mod live;
mod malformed;
mod readings;
mod robust;
mod scene;
mod stored;
mod val_sensors;
mod vision;
mod warnings;
