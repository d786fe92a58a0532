//! Traits and plain data of volumetric stiffness field (VSF) estimation.
//!
//! A robot arm touches a soft object. The object is a cloud of points `p_i`, each held by a
//! spring of unknown stiffness `K_i >= 0`. The external joint torques are linear in `K`:
//! `tau = W K + noise`, with columns `w_i = -J^T u_i` (Yao & Hauser, eq. 1-4). This crate holds
//! the types that all parts of such a system share, and computes no physics:
//!
//! | role | trait | output |
//! | --- | --- | --- |
//! | contact | [`ContactModel`] | [`Contacts`]: touched points and their displacements |
//! | sensing | [`Sensor`] | [`Observation`]: columns `w_i`, reading `tau`, noise |
//! | estimation | [`Estimator`] | [`Belief`]: mean and variance of every `K_i` |
//!
//! A [`Session`] owns one of each. After warm-up its own code allocates nothing during a step. Its parts
//! may allocate: a buffer of past observations grows until its budget is full.
//!
//! The traits are dyn-safe, so that a program can choose implementations at run time. Only
//! [`Observation`], [`Belief`], [`Sensor`] and [`Estimator`] are generic over the [`Scalar`] (`f32` or
//! `f64`); geometry and kinematics are always `f64`. Rejected: a type parameter for an array or
//! GPU backend. It would spread through every signature, while a GPU estimator is simply one
//! more [`Estimator`].
//!
//! The feature `serde` saves and restores [`Belief`], [`Noise`], [`SymmetricFactor`], [`Observation`]
//! and [`FilterHealth`]. Deserialized values are checked like the arguments of the constructors.
//!
//! Units are SI (meters, radians, newtons, newton meters). The world frame has z up. Names carry
//! their frame: `p_W` is a point in world coordinates, `X_WL` the pose of link L in world.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod belief;
mod blocks;
mod contact;
mod error;
mod estimator;
mod geometry;
mod health;
mod linalg;
mod median;
mod noise;
mod observation;
mod points;
mod posture;
mod scalar;
mod sensor;
mod session;
#[cfg(feature = "serde")]
mod state;

pub use belief::Belief;
pub use blocks::Block;
pub use contact::{ContactModel, Contacts};
pub use error::{CoreError, OtherError};
pub use estimator::{Estimator, Prediction, UpdateReport};
pub use geometry::{Collider, Shape, TriMesh};
pub use health::FilterHealth;
pub use linalg::SymmetricFactor;
pub use median::{median, median_of};
pub use noise::Noise;
pub use observation::Observation;
pub use points::{Cell, RestPoints, bounds};
pub use posture::{JointScrew, LinkChains, Posture};
pub use scalar::{PerScalar, Scalar};
pub use sensor::Sensor;
pub use session::{MOST_READING, Session};

/// The version of nalgebra whose `Point3`, `Vector3` and `Isometry3` appear in public signatures.
pub use nalgebra;
