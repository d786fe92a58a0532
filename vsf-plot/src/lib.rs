//! Pictures of stiffness fields and of torque predictions.
//!
//! Data goes in, the bytes of a file come out; the caller writes the file:
//!
//! | picture | type | formats |
//! | --- | --- | --- |
//! | stiffness of a point cloud | [`FieldView`] | PNG, SVG |
//! | measured and predicted torques | [`TorquePlot`] | SVG |
//! | curves over a common axis | [`CurvePlot`] | PNG, SVG |
//!
//! No system font or display is needed. Equal input gives equal bytes on every machine with the same
//! floating-point arithmetic. Files name the program, `vsf`, and its version: a PNG as its `Software`, an
//! SVG in a comment. Input that cannot be drawn truthfully (NaN, no points, lengths that do not match)
//! gives a [`PlotError`] that names the place.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod camera;
mod canvas;
mod color;
mod curves;
mod decimate;
mod error;
mod field;
mod layout;
mod panel;
mod raster;
mod scene;
mod ticks;
mod torque;
mod vector;
mod wire_box;

/// What files say of the program that wrote them.
const MADE_BY: &str = concat!("vsf ", env!("CARGO_PKG_VERSION"));

pub use color::{ColorLimit, Rgb, stiffness_color};
pub use curves::{Curve, CurvePlot};
pub use error::PlotError;
pub use field::FieldView;
pub use torque::{JointTrace, TorquePlot};
