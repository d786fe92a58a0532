use crate::{Bounds, PointCloud, RgbdView, Sight};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use vsf_core::CoreError;

/// What one view shows of a cell of the box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visibility {
    /// The camera sees through it: nothing is there.
    Free,
    /// The seen surface passes through it.
    Surface,
    /// It lies behind the seen surface or outside the picture: the object may be there.
    Occluded,
}

/// A uniform grid over the object's box that stores what one view shows of each cell.
///
/// A cell is classified by the pixel that its center projects to: in front of the surface there, on it
/// (within half the cell's diagonal), or behind it. Cells on a ray that met nothing are free.
///
/// Rejected: walking along the ray of every pixel. Where pixels are finer than cells, the result is the
/// same; where they are coarser, holes remain between the rays.
#[derive(Debug, Clone)]
pub struct OcclusionGrid {
    bounds: Bounds,
    dims: [usize; 3],
    cells: Vec<Visibility>,
}

impl OcclusionGrid {
    /// Default number of cells along each edge of the box, as in the paper (section IV-A).
    pub const CELLS: [usize; 3] = [100; 3];

    /// Classifies all cells. Work is spread over the threads of the current rayon pool.
    ///
    /// # Errors
    /// No cells along an edge, or more than 2^30 cells in all.
    pub fn new(view: &RgbdView, bounds: &Bounds, dims: [usize; 3]) -> Result<Self, CoreError> {
        const MAX: usize = 1 << 30;
        if dims.contains(&0) {
            return Err(CoreError::Parameter {
                name: "cells along an edge",
                value: 0.0,
                range: ">= 1",
            });
        }
        let got = dims.iter().fold(1usize, |a, d| a.saturating_mul(*d));
        if got > MAX {
            return Err(CoreError::TooMany {
                what: "cells",
                got,
                max: MAX,
            });
        }
        let mut grid = Self {
            bounds: *bounds,
            dims,
            cells: Vec::new(),
        };
        let reach = 0.5 * grid.edges().norm();
        let decide = |i| match view.sight(&grid.center(i)) {
            Sight::Outside => Visibility::Occluded,
            Sight::NoReturn => Visibility::Free,
            Sight::Surface { behind, .. } if behind < -reach => Visibility::Free,
            Sight::Surface { behind, .. } if behind <= reach => Visibility::Surface,
            Sight::Surface { .. } => Visibility::Occluded,
        };
        grid.cells = (0..got).into_par_iter().map(decide).collect();
        Ok(grid)
    }

    /// Edge lengths of a cell (m).
    pub fn edges(&self) -> Vector3<f64> {
        let [x, y, z] = self.dims.map(|d| d as f64);
        self.bounds.size().component_div(&Vector3::new(x, y, z))
    }

    /// Center of cell `i`; z varies fastest and x slowest.
    pub fn center(&self, i: usize) -> Point3<f64> {
        let [_, ny, nz] = self.dims;
        let at = Vector3::new(
            (i / (ny * nz)) as f64,
            (i / nz % ny) as f64,
            (i % nz) as f64,
        );
        self.bounds.min() + self.edges().component_mul(&at.add_scalar(0.5))
    }

    /// Visibility of every cell; z varies fastest and x slowest.
    pub fn cells(&self) -> &[Visibility] {
        &self.cells
    }

    /// Centers of the cells of one kind.
    pub fn centers(&self, of: Visibility) -> impl Iterator<Item = Point3<f64>> {
        let cells = self.cells.iter().enumerate();
        cells
            .filter(move |(_, c)| **c == of)
            .map(|(i, _)| self.center(i))
    }

    /// The rest points of a field (section IV-A) and how many of them lie on the surface. The rest points
    /// are the points of the surface, then the centers of the cells behind it; free space has none.
    pub fn rest_points(&self, surface: &PointCloud) -> (Vec<Point3<f64>>, usize) {
        let mut points = surface.positions.clone();
        points.extend(self.centers(Visibility::Occluded));
        (points, surface.len())
    }
}
