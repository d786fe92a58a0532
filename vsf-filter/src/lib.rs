//! Recursive estimators of a stiffness field from linear observations `tau = W K + noise`.
//!
//! | estimator | belief | cost of an update |
//! | --- | --- | --- |
//! | [`DiagonalKalman`] | independent points (eq. 6-7) | `O(d² n)` for n contacts, d channels |
//! | [`MemoryReplay`] | as the estimator inside it, which sees past observations again (Alg. 1) | `1 + T_replay` updates |
//! | [`BatchMap`] | the constrained optimum over all observations, offline | `O(n³)` once, for n touched points |
//!
//! The first two keep `K >= 0` by projection (eq. 5, last line) and implement
//! [`vsf_core::Estimator`], so that either can stand wherever the other does.
//!
//! ```
//! use vsf_core::{Belief, Estimator, Noise, Observation};
//! use vsf_filter::{DiagonalKalman, MemoryReplay, ReplayConfig};
//!
//! // Two springs, one force gauge: the first reading feels spring 0, the second both.
//! let prior = Belief::<f64>::uniform(2, 0.0, 100.0)?;
//! let mut filter = MemoryReplay::new(DiagonalKalman::new(prior), ReplayConfig::default())?;
//! let mut obs = Observation::new(Noise::uniform(1, 0.01)?);
//! for (points, force) in [(&[0u32][..], 2.0), (&[0, 1][..], 5.0)] {
//!     obs.rebuild(2, points, &[force], |_, w| w[0] = 1.0)?;
//!     filter.update(&obs)?;
//! }
//! let k = filter.belief().mean();
//! assert!((k[0] - 2.0).abs() < 0.01 && (k[1] - 3.0).abs() < 0.01);
//! # Ok::<(), vsf_core::CoreError>(())
//! ```
//!
//! # Reference
//! S. Yao, K. Hauser, *Estimating Tactile Models of Heterogeneous Deformable Objects in Real Time*,
//! ICRA 2023, sections III-B-c and III-C.

#![forbid(unsafe_code)]

mod batch;
mod diagonal;
mod kernel;
mod prior;
mod replay;
mod reservoir;

pub use batch::{BatchFit, BatchMap, HeldOut};
pub use diagonal::{DiagonalForm, DiagonalKalman};
pub use prior::{FieldPrior, Matern, Smoothness};
pub use replay::{MemoryReplay, ReplayConfig, ReplayVariance, Revisit};
