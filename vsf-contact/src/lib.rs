//! Signed distance fields and stick-slip contact of a robot with a point cloud

mod bake;
mod cache;
mod closing;
mod config;
mod error;
mod grid_sdf;
mod lattice;
mod links;
mod mesh_distance;
mod mesh_sdf;
mod sdf;
mod shape_sdf;
mod stick_slip;
mod union;
mod winding;

pub use bake::{GridError, GridOptions, GridReport};
pub use cache::CacheUse;
pub use config::ContactConfig;
pub use error::ContactError;
pub use grid_sdf::GridSdf;
pub use links::{LinkGrid, LinkSdf, LinkSdfs, link_sdfs};
pub use mesh_sdf::{MeshOpenness, MeshSdf};
pub use sdf::{Sdf, SdfSample};
pub use shape_sdf::ShapeSdf;
pub use stick_slip::StickSlip;
pub use union::UnionSdf;
