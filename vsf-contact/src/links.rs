use crate::{ContactError, GridOptions, GridReport, GridSdf, Sdf, ShapeSdf, UnionSdf};
use std::collections::BTreeMap;
use std::sync::Arc;
use vsf_core::{Collider, Shape, TriMesh};

/// The shape of one link, in the frame of the link: the union of its colliders. Clones share the field.
#[derive(Clone)]
pub struct LinkSdf {
    /// Index of the link.
    pub link: usize,
    /// Its signed distance field.
    pub sdf: Arc<dyn Sdf>,
}

/// The shapes of a robot's links, with reports on the grids made from meshes.
#[derive(Debug)]
#[non_exhaustive]
pub struct LinkSdfs {
    /// One entry per link that has a collider, ordered by link.
    pub links: Vec<LinkSdf>,
    /// One entry per mesh collider.
    pub grids: Vec<LinkGrid>,
}

/// The grid made from a mesh collider.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LinkGrid {
    /// Position in the list of colliders.
    pub collider: usize,
    /// Index of the link.
    pub link: usize,
    /// Name of the mesh's file, if it is known.
    pub source: Option<String>,
    /// Quality of the grid.
    pub report: GridReport,
}

#[derive(Default)]
struct Parts {
    shapes: Vec<ShapeSdf>,
    grids: Vec<GridSdf>,
}

/// Makes the signed distance fields of the links that carry `colliders`.
///
/// Analytic shapes stay exact. Meshes become grids in the frame of the link, see [`GridSdf::bake`].
/// The field of a link is the union of its colliders.
///
/// # Errors
/// [`ContactError::Collider`] names the collider whose shape, pose or grid is out of range.
pub fn link_sdfs(colliders: &[Collider], options: &GridOptions) -> Result<LinkSdfs, ContactError> {
    options.check()?;
    let mut by_link: BTreeMap<usize, Parts> = BTreeMap::new();
    let mut grids = Vec::new();
    for (collider, c) in colliders.iter().enumerate() {
        let link = c.link;
        let named = |source| ContactError::Collider {
            collider,
            link,
            source: Box::new(source),
        };
        let parts = by_link.entry(link).or_default();
        if let Shape::Mesh(mesh_S) = &c.shape {
            let vertices_L = mesh_S.vertices().iter().map(|v| c.X_LS * v).collect();
            let mesh_L = TriMesh::new(vertices_L, mesh_S.faces().to_vec());
            let mesh_L = mesh_L.map_err(|e| named(e.into()))?;
            let (grid, report) = GridSdf::bake(&mesh_L, options).map_err(named)?;
            parts.grids.push(grid);
            grids.push(LinkGrid {
                collider,
                link,
                source: mesh_S.source().map(str::to_owned),
                report,
            });
        } else {
            parts
                .shapes
                .push(ShapeSdf::new(&c.shape, &c.X_LS).map_err(named)?);
        }
    }
    let links = by_link
        .into_iter()
        .map(|(link, parts)| LinkSdf {
            link,
            sdf: united(parts),
        })
        .collect();
    Ok(LinkSdfs { links, grids })
}

/// The cheapest form of the union.
fn united(mut parts: Parts) -> Arc<dyn Sdf> {
    // The largest ones are nearest most often; many others then need no look.
    let volume = |shape: &ShapeSdf| {
        let (lower, upper) = shape.bounds();
        (upper - lower).product()
    };
    (parts.shapes).sort_by(|a, b| volume(b).total_cmp(&volume(a)));
    if parts.grids.is_empty() {
        return Arc::new(UnionSdf::new(parts.shapes));
    }
    if parts.shapes.is_empty() && parts.grids.len() == 1 {
        return Arc::new(parts.grids.remove(0));
    }
    let mut all: Vec<Box<dyn Sdf>> = Vec::new();
    if !parts.shapes.is_empty() {
        all.push(Box::new(UnionSdf::new(parts.shapes)));
    }
    all.extend(parts.grids.into_iter().map(|g| Box::new(g) as Box<dyn Sdf>));
    Arc::new(UnionSdf::new(all))
}

impl std::fmt::Debug for LinkSdf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (lower, upper) = self.sdf.bounds();
        f.debug_struct("LinkSdf")
            .field("link", &self.link)
            .field("lower", &lower)
            .field("upper", &upper)
            .finish_non_exhaustive()
    }
}
