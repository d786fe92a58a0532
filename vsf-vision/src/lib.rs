//! Extrapolates stiffness to points that were never touched, from what a camera sees of a soft object.
//!
//! A field is known only where the arm has touched. This crate extends it to the rest of the object (Yao &
//! Hauser, section III-D), so that touches at new places can be predicted:
//!
//! | part | what it does |
//! | --- | --- |
//! | [`RgbdView`], [`PointCloud`] | turn a color and depth image into colored points; thin, clean, compute normals |
//! | [`OcclusionGrid`] | divides the object's box into surface, hidden and free cells: the rest points |
//! | [`Seen`], [`Features`] | describe each point by what the view shows of it, as numbers to learn from |
//! | [`Regressor`] | predicts stiffness from features, with a variance: [`KnnRegressor`], [`Ridge`], [`GaussianProcess`] |
//! | [`Calibrated`] | scales variances so that they hold on held-out samples |
//! | [`Extrapolation`] | extends a belief about the touched points to all points |
//! | [`fit_level`] | fits the stiffness of a whole object from its readings alone |
//! | [`LearnedPrior`] | predicts a new object from fields of others; stored on disk |
//!
//! The result is a [`vsf_core::Belief`]. It can be the prior of any estimator, so that later touches
//! correct it.
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
//! Rejected: a regressor of torques. Torques are sums over hundreds of points that depend on the path of
//! the arm. Stiffness belongs to a place and can be transferred to another one.

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
