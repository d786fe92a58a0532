//! Known-answer worlds and conformance suites for tests.
//!
//! [`check_estimator`] is one suite that every [`vsf_core::Estimator`] must pass, also those
//! defined outside this workspace; [`LinearWorld`] makes the problems. Failures panic with the
//! name of the property, as test helpers do.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod estimator;
mod world;

pub use estimator::{EstimatorOptions, check_estimator};
pub use world::{LinearWorld, Reading, normal};
