//! Recursive estimators of a stiffness field from linear observations `tau = W K + noise`.
//!
//! | estimator | belief | cost of an update |
//! | --- | --- | --- |
//! | [`DiagonalKalman`] | independent points (eq. 6-7) | `O(d² n)` for n contacts, d channels |
//! | [`MemoryReplay`] | that of the wrapped estimator, which takes in past observations again (Alg. 1) | `1 + T_replay` updates |
//! | [`DualReplay`] | independent points, constant field; tends to the constrained optimum | two updates, `O(d n)` per replay |
//! | [`RobustNoise`] | that of the wrapped estimator, with the noise of outliers inflated | one more prediction |
//! | [`CovarianceFilter`] | exact: touched points, correlated; the constrained optimum | `O(d n²)`, n points ever touched |
//! | [`InformationFilter`] | the same in terms of the precision matrix (eq. 5), an oracle | `O(n³)` |
//! | [`BatchMap`] | the constrained optimum over all observations, offline | `O(n³)` once, for n touched points |
//!
//! All but [`BatchMap`] implement [`vsf_core::Estimator`] and are interchangeable. They keep `K >= 0` by
//! projection (eq. 5, last line); the mean of the covariance filter is, after every sample, the optimum
//! that [`BatchMap`] finds. The exact estimators take a [`FieldPrior`], which may correlate points. The
//! others treat points as independent.
//!
//! # Which one
//! - All data at once, offline: [`BatchMap`].
//! - Sample by sample, up to a few thousand touched points: [`CovarianceFilter`].
//! - More points, in a control loop: [`MemoryReplay`] or [`DualReplay`]. [`MemoryReplay`] is good after few
//!   readings, but counts a past reading as often as it is drawn. [`DualReplay`] counts it once and
//!   converges to the optimum: soon where the noise is as large as the prior uncertainty of a reading, late
//!   where readings are much more precise. In the example `long_run` of this workspace, the former is ahead
//!   at first and the latter afterward.
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
//! # Saving and restoring
//! With the feature `serde` every estimator but [`InformationFilter`] can be written in any serde format
//! and read back. ([`CovarianceFilter`] has the same posterior as [`InformationFilter`].) A restored
//! estimator continues as if nothing had happened, bit for bit if the format preserves floats exactly
//! (postcard does, serde_json with its feature `float_roundtrip`). States that no estimator could have
//! reached are refused. The layout belongs to one version of this crate. Contacts are not saved: build a
//! new session around the restored estimator, between two touches.
//!
#![cfg_attr(feature = "serde", doc = "```")]
#![cfg_attr(not(feature = "serde"), doc = "```ignore")]
//! use vsf_core::{Belief, Estimator, Noise, Observation};
//! use vsf_filter::{DiagonalKalman, MemoryReplay, ReplayConfig};
//!
//! let prior = Belief::<f32>::uniform(2, 0.0, 100.0)?;
//! let mut filter = MemoryReplay::new(DiagonalKalman::new(prior), ReplayConfig::default())?;
//! let mut obs = Observation::new(Noise::uniform(1, 0.01)?);
//! obs.rebuild(2, &[0, 1], &[5.0], |_, w| w[0] = 1.0)?;
//! filter.update(&obs)?;
//!
//! let saved: Vec<u8> = postcard::to_allocvec(&filter)?;
//! let mut restored: MemoryReplay<DiagonalKalman<f32>> = postcard::from_bytes(&saved)?;
//!
//! assert_eq!(restored.update(&obs)?, filter.update(&obs)?);
//! assert_eq!(restored.belief(), filter.belief());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Reference
//! S. Yao, K. Hauser, *Estimating Tactile Models of Heterogeneous Deformable Objects in Real Time*,
//! ICRA 2023, sections III-B-c and III-C.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod aging;
mod batch;
mod cholesky;
mod dense;
mod diagonal;
mod dual;
mod exchange;
mod kernel;
mod key_heap;
mod lanes;
mod limit;
mod prior;
mod replay;
mod reservoir;
mod robust;
#[cfg(feature = "serde")]
mod state;
mod truncated;
mod values;

pub use batch::{BatchFit, BatchMap, HeldOut};
pub use dense::{CovarianceFilter, InformationFilter, JointEstimator, Projection};
pub use diagonal::{DiagonalForm, DiagonalKalman};
pub use dual::{DualConfig, DualReplay};
pub use prior::{FieldPrior, Matern, Smoothness};
pub use replay::{MemoryReplay, ReplayConfig, ReplayVariance, Revisit};
pub use robust::{RobustLoss, RobustNoise};
