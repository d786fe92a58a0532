//! Signed distance fields and stick-slip contact of a robot with a point cloud.
//!
//! | item | purpose |
//! | --- | --- |
//! | [`Sdf`] | signed distance and normal of a body |
//! | [`ShapeSdf`] | [`Sdf`] of an analytic shape, in closed form |
//! | [`MeshSdf`] | [`Sdf`] of a mesh, exact but slow |
//! | [`GridSdf`] | [`Sdf`] baked from a mesh to a grid |
//! | [`UnionSdf`] | [`Sdf`] of the union of several bodies |
//! | [`link_sdfs`] | signed distance fields of a robot's links, from its colliders |
//! | [`StickSlip`] | contact model of section III-B-a of the paper: points stick, slip, detach |
//! | [`CellContact`] | the same with cubes ([`Cells`]) instead of points |
//!
//! Points are independent and are processed side by side in vector registers: an [`Sdf`] is evaluated for a [`Batch`] of
//! points at once. Tried and rejected: one point at a time, with an index of the parts near it. Latency of divisions and
//! mispredicted branches dominate, not the number of parts that are visited.
//!
//! Both models implement [`vsf_core::ContactModel`] and never read a belief.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod bake;
mod batch;
mod cache;
mod carry;
mod cells;
mod closing;
mod config;
mod error;
mod forms;
mod front;
mod grid_sdf;
mod lanes;
mod lattice;
mod link_pose;
mod links;
mod mesh_distance;
mod mesh_sdf;
mod rivals;
mod sdf;
mod shape_sdf;
mod slide;
mod slip;
mod stick_slip;
mod surface;
mod union;
mod winding;

pub use bake::{GridError, GridOptions, GridReport};
pub use batch::Batch;
pub use cache::CacheUse;
pub use cells::{CellContact, Cells};
pub use config::ContactConfig;
pub use error::ContactError;
pub use grid_sdf::GridSdf;
pub use links::{LinkGrid, LinkSdf, LinkSdfs, link_sdfs};
pub use mesh_sdf::{MeshOpenness, MeshSdf};
pub use sdf::{Sdf, SdfSample, thickness};
pub use shape_sdf::ShapeSdf;
pub use stick_slip::StickSlip;
pub use union::UnionSdf;
