//! Touch recordings and stiffness fields on disk.
//!
//! A [`Dataset`] is one folder: touch sequences of a robot arm (joint angles, torques, and optionally times and
//! velocities), the rest points of the object, a stored field, one RGB-D view, and metadata in `dataset.json`. A folder of
//! OpenVSF's `MultiModalDataset` (only `seq_*/angles.npy` and `seq_*/torques.npy`) opens with the metadata in
//! [`Overrides`].
//!
//! A [`StiffnessField`] is an `.npz` archive or a folder in OpenVSF's layout. It can be saved as a colored PLY cloud for
//! viewing. [`McapExport`] writes recordings and fields as ROS 2 messages. [`JointLog`] makes a recording of the joint
//! states in an MCAP or CSV file.
//!
//! ```
//! use vsf_data::{Dataset, Overrides, RobotRef};
//! # fn show(folder: &str) -> Result<(), vsf_data::DataError> {
//! let (dataset, warnings) = Dataset::open(folder, &Overrides {
//!     robot: Some(RobotRef::resolve("kinova_gen3", ".".as_ref())?),
//!     rate_hz: Some(70.0),
//!     ..Overrides::default()
//! })?;
//! for warning in &warnings {
//!     eprintln!("warning: {warning}");
//! }
//! for sequence in dataset.train() {
//!     for touch in sequence.touches() {
//!         for k in touch {
//!             println!("{} s: {:?}", sequence.time[k], &sequence.torques[k]);
//!         }
//!     }
//! }
//! # Ok(())
//! # }
//! ```
//!
//! Nothing is repaired on reading. Whatever a folder holds, opening it gives the data, or a [`DataError`] that names file,
//! sequence and row; never a panic, and never a shortened or zero-filled sequence. Something that can be read but that one
//! should know about comes as a [`DataWarning`].
//!
//! Arrays may be of any little-endian float or integer type of NumPy (for features also booleans), in C or Fortran order,
//! and become `f64`. Pickled objects are never executed.
//!
//! Files are written under hidden names next to their places, and renamed once all of them are complete ([`write_file`]). A
//! full disk changes nothing. A killed process leaves every file old or new. It leaves a new folder complete or absent, and
//! a folder that was being replaced as it was or as [`DataError::Interrupted`].
//!
//! Rejected: the `ndarray-npy` crate. It reads into one static type per call, so every dtype would be a trial, and it has
//! no half floats. `npyz` multiplies the lengths that a header states without a check, and panics on those of a hostile
//! one. The format is one file here. Also rejected: the `cdr` and `cdr-encoding` crates for ROS messages. They know neither
//! ROS 1 nor the bytes in front of a message, and two messages of numbers and names are less than their descriptions for
//! serde.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod camera;
mod check;
mod colormap;
mod contact_parameters;
mod csv_log;
mod dataset;
mod edits;
mod error;
mod field;
mod files;
mod json;
mod listed;
mod metadata;
mod natural;
mod npy;
mod npz;
mod overlap;
mod pcd;
mod ply;
mod points;
mod pose;
mod ros;
mod sequence;
mod signal;
mod staged;
mod table;
mod warning;

/// The program name that written files contain.
const MADE_BY: &str = concat!("vsf ", env!("CARGO_PKG_VERSION"));

pub use camera::CameraView;
pub use colormap::color;
pub use contact_parameters::ContactParameters;
pub use dataset::Dataset;
pub use error::{Advice, DataError};
pub use field::StiffnessField;
pub use files::read_text;
pub use json::{JsonError, parse_json};
pub use listed::listed;
pub use metadata::{Attachment, JointType, Overrides, RobotRef, Splits, TorqueKind};
pub use npy::NpyError;
pub use ply::ColoredPoint;
pub use points::{read_cloud, read_points};
pub use ros::{Clock, EffortPrediction, JointLog, McapExport};
pub use sequence::Sequence;
pub use signal::{Derivatives, differentiate, tare};
pub use staged::{write_file, write_files, write_folder};
pub use table::Table;
pub use warning::DataWarning;
