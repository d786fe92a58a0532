//! Test suites for your own implementations of the traits, and worlds with known answers.
//!
//! Each suite tests one part for everything that its trait promises. Like a test, it panics with the name of the property
//! that does not hold:
//!
//! | suite | tests |
//! | --- | --- |
//! | [`check_estimator`] | a [`vsf_core::Estimator`] |
//! | [`check_sensor`] | a [`vsf_core::Sensor`] |
//! | [`check_contact`] | a [`vsf_core::ContactModel`] |
//! | `check_sdf` (feature `shapes`) | a `vsf_contact::Sdf`, the shape of a link |
//! | `check_regressor` (feature `regressors`) | a `vsf_vision::Regressor`, stiffness from features |
//! | `check_effect` (feature `effects`) | a `vsf_gap::Effect` and its compensators |
//!
//! The parts of this workspace pass the same suites. [`LinearWorld`] makes problems with a known answer.
//!
//! This crate belongs under `[dev-dependencies]`. Suites that need more than `vsf-core` are features for that reason alone;
//! `check_effect` needs the diagnosis and everything below it. Rejected: a suite in each crate, which would put tests into
//! programs.

#![forbid(unsafe_code)]
// Suites fail by panics, as tests do.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod contact;
#[cfg(feature = "effects")]
mod effect;
mod estimator;
mod property;
#[cfg(feature = "regressors")]
mod regressor;
#[cfg(feature = "shapes")]
mod sdf;
mod sensor;
mod world;

pub use contact::check_contact;
#[cfg(feature = "effects")]
pub use effect::{check_effect, sites};
pub use estimator::{EstimatorOptions, check_estimator};
#[cfg(feature = "regressors")]
pub use regressor::check_regressor;
#[cfg(feature = "shapes")]
pub use sdf::check_sdf;
pub use sensor::check_sensor;
pub use world::{LinearWorld, Reading, normal};
