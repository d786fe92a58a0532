//! What a camera sees of a soft object, and how stiff the points are that were never touched.
//!
//! A field is known where the arm has been. This crate carries it on to the rest of the object
//! (Yao & Hauser, section III-D), so that touches of new places can be predicted:
//!
//! | part | what it does |
//! | --- | --- |
//! | [`RgbdView`], [`PointCloud`] | a color and depth image to colored world points, thinned, cleaned, with normals |
//! | [`OcclusionGrid`] | what is surface, hidden or free in the object's box: the rest points |
//! | [`Seen`], [`Features`] | what the view says about each point, as numbers to learn from |
//! | [`Regressor`] | stiffness from features, with a variance: [`KnnRegressor`], [`Ridge`], [`GaussianProcess`] |
//! | [`Calibrated`] | variances that hold on samples that were held out |
//! | [`Extrapolation`] | a belief about all points from one about the touched ones |
//! | [`fit_level`] | the stiffness of a whole object by its readings alone |
//! | [`LearnedPrior`] | what other objects teach about a new one, on disk |
//!
//! The result is a [`vsf_core::Belief`], thus a prior for any estimator: later touches correct it.
//!
//! ```
//! use vsf_core::nalgebra::{Isometry3, Point3};
//! use vsf_vision::{Bounds, Camera, OcclusionGrid, RgbdView, Visibility};
//!
//! // A camera at the origin looks along z at a wall 1 m away.
//! let camera = Camera { fx: 50.0, fy: 50.0, cx: 31.5, cy: 23.5, X_WC: Isometry3::identity() };
//! let (color, depth) = (vec![90; 64 * 48 * 3], vec![1000; 64 * 48]);
//! let view = RgbdView::new(camera, (64, 48), &color, &depth, 0.001)?;
//! let bounds = Bounds::new(Point3::new(-0.1, -0.1, 0.8), Point3::new(0.1, 0.1, 1.2))?;
//!
//! let surface = view.cloud(&bounds).downsampled(0.02)?;
//! let grid = OcclusionGrid::new(&view, &bounds, [10, 10, 40])?;
//! let (points, visible) = grid.rest_points(&surface);
//! assert!(points[..visible].iter().all(|p| (p.z - 1.0).abs() < 1e-3));
//! assert!(points[visible..].iter().all(|p| p.z > 1.0)); // behind the wall, nothing before it
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Rejected: a regressor of torques. Torques are sums over hundreds of points that depend on the
//! arm's way; stiffness belongs to the place and can be carried to another one.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod bounds;
mod calibrated;
mod camera;
mod cholesky;
mod cloud;
mod error;
mod extrapolation;
mod features;
mod gp;
mod knn;
mod lab;
mod learned;
mod level;
mod neighbors;
mod normals;
mod occlusion;
mod regressor;
mod ridge;
mod seen;

pub use bounds::Bounds;
pub use calibrated::{Calibrated, variance_scale};
pub use camera::{Camera, RgbdView, Sight};
pub use cloud::PointCloud;
pub use error::VisionError;
pub use extrapolation::Extrapolation;
pub use features::{Features, Scaler};
pub use gp::{GaussianProcess, GpConfig};
pub use knn::{KnnConfig, KnnRegressor, Width};
pub use lab::lab;
pub use learned::{LearnedPrior, RegressorSpec};
pub use level::fit_level;
pub use neighbors::{Neighbor, Neighbors};
pub use occlusion::{OcclusionGrid, Visibility};
pub use regressor::{Predictions, Regressor, Samples};
pub use ridge::Ridge;
pub use seen::Seen;
