use crate::RestPoints;
use nalgebra::{Point3, Vector3};

/// A node of the octree over the cells of [`RestPoints`].
///
/// It is a cube of `2^level` cells along each edge, clipped at the border of the grid. The tree is
/// implicit and takes no memory.
///
/// A search descends from [`RestPoints::root`] and skips blocks whose bounding ball
/// ([`RestPoints::ball`]) is out of reach, so that its cost depends on what it finds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block {
    corner: [u32; 3],
    level: u8,
}

impl Block {
    /// Whether the block is a single cell, which has no children.
    pub fn is_cell(&self) -> bool {
        self.level == 0
    }
}

impl RestPoints {
    /// The root block, which contains all points except [strays](RestPoints::strays).
    pub fn root(&self) -> Block {
        let longest = self.dims.iter().fold(1, |a, &b| a.max(b));
        Block {
            corner: [0; 3],
            level: longest.next_power_of_two().trailing_zeros() as u8,
        }
    }

    /// Center and radius (m) of a bounding ball of the points of a block.
    pub fn ball(&self, block: &Block) -> (Point3<f64>, f64) {
        let from = Vector3::from_fn(|k, _| f64::from(block.corner[k]));
        let to = Vector3::from_fn(|k, _| self.end(block, k) as f64);
        let half = (0.5 * self.cell) * (to - from);
        let center = self.min + self.cell * from + half;
        // The sorting into cells rounds.
        let rounding = 1e-9 * self.cell + 1e-15 * center.coords.amax();
        (center, half.norm() + rounding)
    }

    /// The children of a block, half as large along each edge: up to eight, none for a single cell.
    pub fn children(&self, block: &Block) -> impl Iterator<Item = Block> {
        let parent = *block;
        let octants = if parent.is_cell() { 0..0 } else { 0..8u32 };
        octants.filter_map(move |octant| {
            let level = parent.level - 1;
            let corner = [0, 1, 2].map(|k| parent.corner[k] + ((octant >> k & 1) << level));
            let inside = (0..3).all(|k| (corner[k] as usize) < self.dims[k]);
            inside.then_some(Block { corner, level })
        })
    }

    /// Calls `visit` with the indices of the points in each non-empty cell of a block.
    pub fn block_points<'a>(&'a self, block: &Block, mut visit: impl FnMut(&'a [u32])) {
        let [x, y, z] = [0, 1, 2].map(|k| block.corner[k] as usize..self.end(block, k));
        for i in x {
            for j in y.clone() {
                for k in z.clone() {
                    let points = self.cell_points([i, j, k]);
                    if !points.is_empty() {
                        visit(points);
                    }
                }
            }
        }
    }

    /// First cell behind a block along an axis.
    fn end(&self, block: &Block, axis: usize) -> usize {
        let end = u64::from(block.corner[axis]) + (1 << block.level);
        self.dims[axis].min(end as usize)
    }
}
