use crate::{CoreError, median};
use nalgebra::{Point3, Vector3};

/// Mean number of points per cell of the broad-phase grid, if the cloud filled its box evenly.
const POINTS_PER_CELL: f64 = 8.0;
/// On either side of every axis, one point in this many may be a stray, outside of the grid.
const POINTS_PER_STRAY: usize = 100;
/// Most strays on each side. They are visited one by one.
const MOST_STRAYS: usize = 64;
/// Points nearer than this share of a cell's edge count as rounded copies of one point in [`RestPoints::spacing`].
const SAME_PLACE: f64 = 1e-3;
/// Rank of the neighbor whose distance [`RestPoints::clustering`] compares with that of the nearest.
const NEIGHBORS: usize = 8;

/// The rest positions `p_i` of a stiffness field (m, world frame), indexed for range queries.
///
/// The index is a uniform grid, and an octree of [`Block`](crate::Block)s over its cells. The few points that lie
/// far from all others are [strays](Self::strays) outside the grid, which would otherwise put all other points into
/// one cell.
///
/// Memory: 24 bytes per position, 4 per entry of the grid, and at most 2 per point for the cells.
#[derive(Debug, Clone)]
pub struct RestPoints {
    positions: Vec<Point3<f64>>,
    pub(crate) min: Point3<f64>,
    pub(crate) cell: f64,
    pub(crate) dims: [usize; 3],
    starts: Vec<u32>,
    order: Vec<u32>,
    strays: Vec<u32>,
}

/// A non-empty cell of the grid, with the points in it.
#[derive(Debug, Clone, Copy)]
pub struct Cell<'a> {
    /// Center of the cube.
    pub center: Point3<f64>,
    /// Half the length of the cube's diagonal (m): no point of the cell is farther from `center`.
    pub radius: f64,
    /// Indices of the points in the cell, increasing.
    pub points: &'a [u32],
}

impl RestPoints {
    /// Largest magnitude of a coordinate (m); larger numbers cannot be meters. The limit also holds for robot bases,
    /// meshes and boxes.
    pub const FARTHEST: f64 = 1e6;

    /// Checks that `n` points are supported. Indices are `u32`.
    ///
    /// # Errors
    /// More than `u32::MAX - 1` points.
    pub fn check_count(n: usize) -> Result<(), CoreError> {
        let max = u32::MAX as usize - 1;
        if n <= max {
            return Ok(());
        }
        Err(CoreError::TooMany {
            what: "rest points",
            got: n,
            max,
        })
    }

    /// Takes the positions (m) and builds the index, in O(N).
    ///
    /// # Errors
    /// A coordinate that is not finite or beyond [`FARTHEST`](Self::FARTHEST), or more than `u32::MAX - 1` points.
    pub fn new(positions: Vec<Point3<f64>>) -> Result<Self, CoreError> {
        let n = positions.len();
        Self::check_count(n)?;
        for (index, p) in positions.iter().enumerate() {
            if let Some(&value) = p.iter().find(|c| !c.is_finite()) {
                return Err(CoreError::NotFinite {
                    what: "rest points",
                    index,
                    value,
                });
            }
            if let Some(&value) = p.iter().find(|c| c.abs() > Self::FARTHEST) {
                return Err(CoreError::TooFar { index, value });
            }
        }
        let (lower, upper) = bulk(&positions);
        let near = |p: &&Point3<f64>| within(p, &lower, &upper);
        let (min, max) = bounds(positions.iter().filter(near));
        let strays = (0u32..).zip(&positions);
        let strays = strays.filter(|(_, p)| !near(p)).map(|(i, _)| i).collect();
        let (cell, dims) = Self::layout(&(max - min), n);
        let mut grid = Self {
            positions,
            min,
            cell,
            dims,
            starts: Vec::new(),
            order: Vec::new(),
            strays,
        };
        grid.fill();
        Ok(grid)
    }

    /// Edge of a cell and number of cells per axis: about `POINTS_PER_CELL` points each, at most n/2 + 1 cells.
    fn layout(extent: &Vector3<f64>, n: usize) -> (f64, [usize; 3]) {
        let longest = extent.max();
        if n == 0 || longest <= 0.0 {
            return (1.0, [1; 3]);
        }
        // Flat and thin clouds count the dimensions in which they extend.
        let broad: Vec<f64> = extent
            .iter()
            .copied()
            .filter(|e| *e > 1e-6 * longest)
            .collect();
        let volume: f64 = broad.iter().map(|e| e / longest).product();
        let per_dimension = 1.0 / broad.len() as f64;
        let mut cell = longest * (volume * POINTS_PER_CELL / n as f64).powf(per_dimension);
        if !cell.is_normal() {
            return (1.0, [1; 3]);
        }
        loop {
            let dims = [0, 1, 2].map(|k| ((extent[k] / cell) as usize).saturating_add(1));
            let cells = dims.iter().try_fold(1usize, |a, d| a.checked_mul(*d));
            if cells.is_some_and(|c| c <= n / 2 + 1) {
                return (cell, dims);
            }
            cell *= 1.26;
        }
    }

    fn fill(&mut self) {
        let cells = self.dims.iter().product::<usize>();
        let mut starts = vec![0u32; cells + 1];
        let mut strays = self.strays.iter().peekable();
        let ids: Vec<(u32, u32)> = (0u32..)
            .zip(&self.positions)
            .filter(|(i, _)| strays.next_if_eq(&i).is_none())
            .map(|(i, p)| (i, self.cell_of(p) as u32))
            .collect();
        for &(_, c) in &ids {
            starts[c as usize + 1] += 1;
        }
        for c in 0..cells {
            starts[c + 1] += starts[c];
        }
        let mut next = starts.clone();
        let mut order = vec![0u32; ids.len()];
        for (i, c) in ids {
            order[next[c as usize] as usize] = i;
            next[c as usize] += 1;
        }
        self.starts = starts;
        self.order = order;
    }

    fn coordinate(&self, k: usize, value: f64) -> usize {
        // A negative or NaN quotient casts to 0, a large one is clamped.
        (((value - self.min[k]) / self.cell) as usize).min(self.dims[k] - 1)
    }

    fn cell_of(&self, p: &Point3<f64>) -> usize {
        self.index([0, 1, 2].map(|k| self.coordinate(k, p[k])))
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.dims[1] + y) * self.dims[2] + z
    }

    /// Indices of the points in a cell of the grid, increasing.
    pub(crate) fn cell_points(&self, at: [usize; 3]) -> &[u32] {
        let c = self.index(at);
        &self.order[self.starts[c] as usize..self.starts[c + 1] as usize]
    }

    /// Number of points `N`.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Rest positions (m).
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.positions
    }

    /// Indices of outliers, increasing, at most 384. No cell and no [`Block`](crate::Block) contains them.
    ///
    /// The bounding box of the cloud without its outermost points (1 %, at most 64, on each side of every axis) is widened
    /// by its longest edge on all sides. Points outside of that are outliers.
    pub fn strays(&self) -> &[u32] {
        &self.strays
    }

    /// Lower and upper corner of the axis-aligned bounding box; both the origin if there are no points.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        bounds(&self.positions)
    }

    /// Typical distance between neighbors (m); 0 if all points are at the same place.
    ///
    /// This is the median distance to the nearest point at another place, over at most 1000 points spread over the cloud.
    /// Points closer than a thousandth of a grid cell's edge count as at the same place. That is about 2e-3 of the mean
    /// distance if the points fill their box.
    pub fn spacing(&self) -> f64 {
        let (same, widest) = (SAME_PLACE * self.cell, self.widest());
        let nearest = |i| self.around(i, 1, same, widest).first().copied();
        median(self.sampled().filter_map(nearest).collect()).unwrap_or(0.0)
    }

    /// How clustered the points are: the distance to the eighth nearest point divided by that to the nearest.
    ///
    /// This is the median over the same sample of points as in [`spacing`](Self::spacing). Neighbors at exactly the same
    /// place do not count. It is about 2 if points fill a body or a surface, 4 along a line, and far more if they come in
    /// pairs or clusters, for example after merging scans of one object. `None` for fewer than 9 places.
    pub fn clustering(&self) -> Option<f64> {
        let widest = self.widest();
        let ratio = |i| match self.around(i, NEIGHBORS, 0.0, widest)[..] {
            [nearest, .., last] if nearest > 0.0 => Some(last / nearest),
            _ => None,
        };
        median(self.sampled().filter_map(ratio).collect())
    }

    fn widest(&self) -> f64 {
        let (lower, upper) = self.bounds();
        (upper - lower).norm()
    }

    /// At most 1000 points spread over the cloud.
    fn sampled(&self) -> impl Iterator<Item = usize> {
        let step = self.len().div_ceil(1000).max(1);
        (0..self.len()).step_by(step)
    }

    /// Distances to the `count` nearest points that are farther away than `same`, in increasing order; empty if there are
    /// fewer. Searches boxes of growing size. `widest` bounds all distances.
    fn around(&self, i: usize, count: usize, same: f64, widest: f64) -> Vec<f64> {
        let p = &self.positions[i];
        let mut reach = self.cell;
        let mut found = Vec::new();
        while self.len() > count {
            found.clear();
            let half = Vector3::repeat(reach);
            self.for_cells_in(&(p - half), &(p + half), |cell| {
                let others = cell
                    .points
                    .iter()
                    .map(|&o| (self.positions[o as usize] - p).norm());
                found.extend(others.filter(|distance| *distance > same));
            });
            // Of many in one place the nearest alone are put in order.
            if found.len() > count {
                found.select_nth_unstable_by(count, f64::total_cmp);
                found.truncate(count);
            }
            found.sort_unstable_by(f64::total_cmp);
            let enough = found.get(count - 1).is_some_and(|last| *last <= reach);
            if enough || reach >= widest {
                break;
            }
            reach *= 2.0;
        }
        if found.len() < count {
            found.clear();
        }
        found
    }

    /// Visits the non-empty cells that overlap the box `[lo, hi]`, in a fixed order.
    ///
    /// Each [stray](Self::strays) in the box is visited as a cell of its own. The cost is proportional to the
    /// number of cells in the box plus the number of strays.
    pub fn for_cells_in<'a>(
        &'a self,
        lo: &Point3<f64>,
        hi: &Point3<f64>,
        mut visit: impl FnMut(Cell<'a>),
    ) {
        for stray in &self.strays {
            let center = self.positions[*stray as usize];
            if within(&center, lo, hi) {
                visit(Cell {
                    center,
                    radius: 0.0,
                    points: std::slice::from_ref(stray),
                });
            }
        }
        let size = Vector3::new(
            self.dims[0] as f64,
            self.dims[1] as f64,
            self.dims[2] as f64,
        );
        let max = self.min + size * self.cell;
        if self.is_empty() || (0..3).any(|k| hi[k] < self.min[k] || lo[k] > max[k]) {
            return;
        }
        let from = [0, 1, 2].map(|k| self.coordinate(k, lo[k]));
        let to = [0, 1, 2].map(|k| self.coordinate(k, hi[k]));
        for x in from[0]..=to[0] {
            for y in from[1]..=to[1] {
                for z in from[2]..=to[2] {
                    let points = self.cell_points([x, y, z]);
                    if points.is_empty() {
                        continue;
                    }
                    let corner = Vector3::new(x as f64, y as f64, z as f64);
                    visit(Cell {
                        center: self.min + corner.add_scalar(0.5) * self.cell,
                        radius: 0.5 * 3f64.sqrt() * self.cell * (1.0 + 1e-9),
                        points,
                    });
                }
            }
        }
    }
}

fn within(p: &Point3<f64>, lower: &Point3<f64>, upper: &Point3<f64>) -> bool {
    (0..3).all(|k| lower[k] <= p[k] && p[k] <= upper[k])
}

/// Lower and upper corner of the axis-aligned bounding box of some points; both the origin if there are none.
///
/// ```
/// use vsf_core::{bounds, nalgebra::Point3};
/// let points = [Point3::new(0.0, 2.0, 0.0), Point3::new(1.0, -1.0, 0.0)];
/// assert_eq!(bounds(&points), (Point3::new(0.0, -1.0, 0.0), Point3::new(1.0, 2.0, 0.0)));
/// ```
#[must_use]
pub fn bounds<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>) -> (Point3<f64>, Point3<f64>) {
    let wider = |b: Option<(Point3<f64>, Point3<f64>)>, p: &Point3<f64>| {
        Some(b.map_or((*p, *p), |(lo, hi)| (lo.inf(p), hi.sup(p))))
    };
    let found = points.into_iter().fold(None, wider);
    found.unwrap_or((Point3::origin(), Point3::origin()))
}

/// Corners of the box outside of which points are strays, see [`RestPoints::strays`].
fn bulk(points: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let (mut lower, mut upper) = bounds(points);
    let few = (points.len() / POINTS_PER_STRAY).min(MOST_STRAYS);
    if few > 0 {
        for k in 0..3 {
            let mut along: Vec<f64> = points.iter().map(|p| p[k]).collect();
            lower[k] = *along.select_nth_unstable_by(few, f64::total_cmp).1;
            let last = along.len() - 1 - few;
            upper[k] = *along.select_nth_unstable_by(last, f64::total_cmp).1;
        }
    }
    let margin = Vector3::repeat((upper - lower).max());
    (lower - margin, upper + margin)
}
