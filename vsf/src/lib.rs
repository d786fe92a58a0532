//! Volumetric stiffness fields from joint angles and joint torques.
//!
//! A robot arm touches a soft object. The object is a cloud of points, each held by a spring of unknown stiffness. The
//! torques in the arm's joints are linear in these stiffnesses. This library estimates them while the arm moves, with their
//! uncertainty, and predicts the torques of touches that have not been made yet.
//!
//! ```
//! use std::sync::Arc;
//! use vsf::core::nalgebra::Point3;
//! use vsf::{contact::link_sdfs, prelude::*, robots::cartesian_stage};
//!
//! // A block of 10 x 5 x 2 cm, soft on the left, stiff on the right.
//! let mut points = Vec::new();
//! for (x, y, z) in (0..20).flat_map(|x| (0..10).flat_map(move |y| (0..4).map(move |z| (x, y, z)))) {
//!     points.push(Point3::new(x as f64, y as f64, -(z as f64)) * 0.005);
//! }
//! let truth: Vec<f64> = points.iter().map(|p| if p.x < 0.05 { 20.0 } else { 60.0 }).collect();
//! let rest = Arc::new(RestPoints::new(points)?);
//!
//! // A ball of 1 cm radius on three linear axes, and force sensors of 0.05 N.
//! let robot = cartesian_stage(0.01)?;
//! let chains = robot.chains().clone();
//! let links = link_sdfs(robot.colliders(), &Default::default())?.links;
//! let contact = StickSlip::new(links, Default::default())?;
//! let sensor = JointTorques::new(Noise::uniform(3, 0.05)?);
//!
//! // The real block, here simulated: a session that already knows the stiffness.
//! let known = DiagonalKalman::new(Belief::new(truth, vec![1e-6; rest.len()])?);
//! let mut block = Session::new(chains.clone(), rest.clone(), contact.clone(), sensor.clone(), known)?;
//!
//! // What we know of it: nothing but that stiffnesses are about 0 to 50 N/m.
//! let prior = Belief::<f64>::uniform(rest.len(), 0.0, 50.0)?;
//! let filter = MemoryReplay::new(DiagonalKalman::new(prior), Default::default())?;
//! let mut session = Session::new(chains, rest, contact, sensor, filter)?;
//!
//! let mut posture = robot.posture();
//! let mut reading = Prediction::default();
//! for (x, y) in (1..10).flat_map(|x| (1..5).map(move |y| (0.01 * x as f64, 0.01 * y as f64))) {
//!     block.begin_touch();
//!     session.begin_touch();
//!     for depth in 0..8 {
//!         robot.update_posture(&[x, y, -0.001 * depth as f64], &mut posture)?;
//!         block.predict(&posture, &mut reading)?;
//!         session.step(&posture, &reading.mean)?; // the update
//!     }
//! }
//!
//! // A touch that was not made before, on the stiff side.
//! block.begin_touch();
//! session.begin_touch();
//! robot.update_posture(&[0.083, 0.024, -0.006], &mut posture)?;
//! let mut predicted = Prediction::default();
//! session.predict(&posture, &mut predicted)?;
//! block.predict(&posture, &mut reading)?;
//! let (force, expected) = (predicted.mean[2], reading.mean[2]);
//! assert!((force - expected).abs() < 0.1 * expected, "{force} N, in truth {expected} N");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where things are
//!
//! This crate only re-exports; each crate can also be used alone.
//!
//! | module | crate | what it holds |
//! | --- | --- | --- |
//! | [`core`] | `vsf-core` | the traits, beliefs, observations, [`Session`](core::Session), filter health |
//! | [`robots`] | `vsf-robots` | robots from URDF, kinematics, gravity, joint-torque sensing |
//! | [`contact`] | `vsf-contact` | signed distances, stick-slip contact |
//! | [`filter`] | `vsf-filter` | the diagonal Kalman filter, memory replay, exact filters, the batch optimum |
//! | [`data`] | `vsf-data` | recordings and fields on disk |
//! | [`vision`] | `vsf-vision` | what a camera sees, and what it says of untouched points |
//! | [`plot`] | `vsf-plot` | pictures of fields and torques |
//! | [`pipeline`] | `vsf-pipeline` | from a recording to a field and its errors, what the `vsf` command runs |
//! | [`gap`] | `vsf-gap` | diagnosis of the sim-to-real gap: where it lies, which effect causes it, how far it closes |
//!
//! With the feature `serde`, estimates can be saved and restored; see [`filter`].
//!
//! The [`guide`] has a page for each of the first tasks.
//!
//! # Reference
//! S. Yao, K. Hauser, *Estimating Tactile Models of Heterogeneous Deformable Objects in Real Time*,
//! ICRA 2023.

#![forbid(unsafe_code)]

pub mod guide;
pub mod prelude;

pub use vsf_contact as contact;
pub use vsf_core as core;
pub use vsf_data as data;
pub use vsf_filter as filter;
pub use vsf_gap as gap;
pub use vsf_pipeline as pipeline;
pub use vsf_plot as plot;
pub use vsf_robots as robots;
pub use vsf_vision as vision;

/// The examples of the README compile.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
