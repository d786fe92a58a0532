//! Signed distance fields and stick-slip contact of a robot with a point cloud

mod bake;
mod error;
mod links;
mod sdf;

pub use bake::{GridOptions, GridReport};
pub use error::ContactError;
pub use links::{LinkSdf, LinkSdfs, link_sdfs};
pub use sdf::{Sdf, SdfSample};
