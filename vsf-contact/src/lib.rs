//! Signed distance fields and stick-slip contact of a robot with a point cloud

mod bake;
mod config;
mod error;
mod links;
mod sdf;
mod stick_slip;

pub use bake::{GridOptions, GridReport};
pub use config::ContactConfig;
pub use error::ContactError;
pub use links::{LinkSdf, LinkSdfs, link_sdfs};
pub use sdf::{Sdf, SdfSample};
pub use stick_slip::StickSlip;
