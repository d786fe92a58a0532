//! Gaussian models of readings over windows: how much readings vary with the stiffness, the noise and the model's own
//! roughness, and how well an effect explains the rest.

mod covariance;
mod lattice;
mod matrix;
mod normal;

pub(crate) use covariance::{Errors, Parts, Spread, field_mean};
pub(crate) use matrix::{Factor, outer, times};
pub(crate) use normal::{Fit, Normal};
