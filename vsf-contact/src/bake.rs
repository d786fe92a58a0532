use crate::cache::{self, CacheUse};
use crate::lattice::Lattice;
use crate::mesh_sdf::is_unsure;
use crate::{ContactError, GridSdf, MeshOpenness, MeshSdf, Sdf};
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::path::PathBuf;
use vsf_core::{CoreError, TriMesh};

/// Cells along the diagonal of the first grid that the automatic resolution tries.
const FIRST_CELLS: f64 = 64.0;
/// Number of points at which the error is measured, and their largest distance from the surface. Few under a fuzzer,
/// which bakes again whenever the cache rejects a file.
const SAMPLES: usize = if cfg!(fuzzing) { 100 } else { 20_000 };
const NEAR: f64 = 0.01;
/// Winding number below which a point lies behind faces that are turned over. An open sheet alone
/// reaches -1/2.
const TURNED: f64 = -0.6;

/// Largest margin of a grid (m).
const MAX_MARGIN: f64 = 1000.0;

/// Options for baking meshes into grids.
#[derive(Debug, Clone, PartialEq)]
pub struct GridOptions {
    /// Spacing of the grid \[m\], > 0. `None` (default) refines the grid until the measured
    /// [`GridError::p99`] is at most `max_error`.
    pub resolution: Option<f64>,
    /// Target error of the automatic resolution \[m\], > 0, default 0.5 mm.
    pub max_error: f64,
    /// How far the grid extends beyond the body \[m\], > 0, at most 1000, default 15 mm. Farther out the distance
    /// is a lower bound, see [`GridSdf`].
    pub margin: f64,
    /// Maximum number of nodes of one grid (4 bytes each), >= 64, default 4 million. Baking that many
    /// takes about 10 s on one thread.
    pub max_nodes: usize,
    /// Folder in which finished grids are cached, created if missing. `None` (default): no cache.
    pub cache_dir: Option<PathBuf>,
}

impl Default for GridOptions {
    fn default() -> Self {
        Self {
            resolution: None,
            max_error: 0.5e-3,
            margin: 0.015,
            max_nodes: 4_000_000,
            cache_dir: None,
        }
    }
}

impl GridOptions {
    /// Checks that all fields lie in their documented ranges.
    ///
    /// # Errors
    /// [`CoreError::Parameter`] names the first value out of range.
    pub fn check(&self) -> Result<(), CoreError> {
        let positive = |name, value: f64| {
            if value > 0.0 && value.is_finite() {
                Ok(())
            } else {
                Err(CoreError::Parameter {
                    name,
                    value,
                    range: "> 0 m",
                })
            }
        };
        positive("grid resolution", self.resolution.unwrap_or(1.0))?;
        positive("grid max_error", self.max_error)?;
        positive("grid margin", self.margin)?;
        if self.margin > MAX_MARGIN {
            return Err(CoreError::Parameter {
                name: "grid margin",
                value: self.margin,
                range: "at most 1000 m",
            });
        }
        if self.max_nodes < 64 {
            let value = self.max_nodes as f64;
            return Err(CoreError::Parameter {
                name: "grid max_nodes",
                value,
                range: ">= 64",
            });
        }
        Ok(())
    }
}

/// Quality of a grid made from a mesh.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct GridReport {
    /// Spacing of the nodes \[m\].
    pub resolution: f64,
    /// Number of nodes; each takes 4 bytes.
    pub nodes: usize,
    /// Error relative to the exact distance.
    pub error: GridError,
    /// Whether `error.p99` is at most [`GridOptions::max_error`]. False when the given resolution is
    /// too coarse, or when [`GridOptions::max_nodes`] stopped the refinement.
    pub reached: bool,
    /// How open the mesh is.
    pub openness: MeshOpenness,
    /// How the cache was used.
    pub cache: CacheUse,
}

/// Errors of a grid, measured at random points near the mesh.
///
/// Of 20,000 points within 1 cm of the mesh, the errors count those that are surely inside or outside
/// (winding number below 0.1 or above 0.9).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct GridError {
    /// Root mean square of the distance error \[m\].
    pub rms: f64,
    /// 99th percentile of the distance error \[m\].
    pub p99: f64,
    /// Largest distance error \[m\] at these points. Elsewhere, in rare corners, it may be larger.
    pub max: f64,
    /// Median angle between the grid's normal and the exact one \[rad\].
    pub normal_median: f64,
    /// 95th percentile of that angle \[rad\]. It stays large, since edges have no single normal.
    pub normal_p95: f64,
    /// Share of the 20,000 points that are surely inside or outside.
    pub sure_share: f64,
    /// Share of the 20,000 points that would be inside if faces were turned over (winding number below
    /// -0.6). 0 when all faces are counter-clockwise seen from outside, as they should be.
    pub turned_share: f64,
}

impl GridSdf {
    /// Makes the grid of a mesh, or reads it from the cache.
    ///
    /// Magnitudes and signs are those of [`MeshSdf`]. Runs on the current rayon pool; the result
    /// is bit-equal for any number of threads. Cost: about 3 us of one thread per node.
    ///
    /// # Errors
    /// Options out of range; a mesh without area, too small or too far away; more nodes than [`GridOptions::max_nodes`] at
    /// the given resolution, or at the coarsest that is tried. An unusable cache is not an error, see
    /// [`GridReport::cache`].
    pub fn bake(mesh: &TriMesh, options: &GridOptions) -> Result<(Self, GridReport), ContactError> {
        options.check()?;
        let make = || {
            let exact = MeshSdf::new(mesh)?;
            refine(&exact, options)
        };
        match &options.cache_dir {
            None => make(),
            Some(folder) => cache::read_or(folder, mesh, options, make),
        }
    }
}

/// Refines the grid until its error is small enough.
fn refine(exact: &MeshSdf, options: &GridOptions) -> Result<(GridSdf, GridReport), ContactError> {
    let (lower, upper) = exact.bounds();
    let samples = samples_near(exact);
    let margin = Vector3::repeat(options.margin);
    let (from, to) = (lower - margin, upper + margin);
    let mut spacing = options
        .resolution
        .unwrap_or((to - from).norm() / FIRST_CELLS);
    let mut best = None;
    loop {
        let lattice = Lattice::covering(&from, &to, spacing, options.max_nodes);
        let lattice = match (lattice, best) {
            (Ok(lattice), _) => lattice,
            (Err(_), Some(done)) => return Ok(done),
            (Err(error), None) => return Err(error),
        };
        let grid = GridSdf {
            lattice,
            values: bake_values(&lattice, exact),
            lower,
            upper,
        };
        let error = measure(&grid, &samples);
        let reached = error.p99 <= options.max_error;
        let report = GridReport {
            resolution: spacing,
            nodes: lattice.len(),
            error,
            reached,
            openness: *exact.openness(),
            cache: CacheUse::Off,
        };
        if reached || options.resolution.is_some() {
            return Ok((grid, report));
        }
        // The error is roughly proportional to the spacing.
        spacing *= (0.9 * options.max_error / error.p99).clamp(0.4, 0.9);
        best = Some((grid, report));
    }
}

fn bake_values(lattice: &Lattice, exact: &MeshSdf) -> Vec<f32> {
    let [nx, ny, _] = lattice.dims;
    let near = 2.0 * exact.openness().sheet_spacing;
    let mut values = vec![0.0; lattice.len()];
    values
        .par_chunks_mut(nx)
        .enumerate()
        .for_each(|(row, values)| {
            let (mut within, mut inside) = (f64::MAX, None);
            for (i, value) in values.iter_mut().enumerate() {
                let p = lattice.node(i, row % ny, row / ny);
                let distance = exact.unsigned_distance(&p, within);
                // The next node cannot be farther than this; a tight bound makes the search quick.
                within = 1.001 * (distance + lattice.spacing);
                // Far from the surface the side is that of the node before; openings too narrow for
                // the sheet are near the surface.
                let known = inside.filter(|_| distance > near + lattice.spacing);
                let is_inside = known.unwrap_or_else(|| exact.winding_number(&p) > 0.5);
                inside = Some(is_inside);
                *value = if is_inside { -distance } else { distance } as f32;
            }
        });
    values
}

/// Points near the mesh that are surely inside or outside, with the exact sample, and the shares of [`GridError`].
struct Samples {
    points: Vec<(Point3<f64>, f64, Vector3<f64>)>,
    sure_share: f64,
    turned_share: f64,
}

fn samples_near(exact: &MeshSdf) -> Samples {
    let mut areas = 0.0;
    let cumulative: Vec<f64> = exact
        .triangles
        .iter()
        .map(|[a, b, c]| {
            areas += 0.5 * (b - a).cross(&(c - a)).norm();
            areas
        })
        .collect();
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    let candidates: Vec<Point3<f64>> = (0..SAMPLES)
        .map(|_| {
            let pick = areas * rng.random::<f64>();
            let t = cumulative
                .partition_point(|c| *c < pick)
                .min(cumulative.len() - 1);
            let [a, b, c] = exact.triangles[t];
            let (mut u, mut v) = (rng.random::<f64>(), rng.random::<f64>());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let direction = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0f64));
            let offset = NEAR * rng.random::<f64>() / direction.norm().max(1e-3);
            a + u * (b - a) + v * (c - a) + offset * direction
        })
        .collect();
    let windings: Vec<f64> = candidates
        .par_iter()
        .map(|p| exact.winding_number(p))
        .collect();
    let points: Vec<_> = (candidates.par_iter().zip(&windings))
        .filter(|(_, w)| !is_unsure(**w))
        .map(|(p, _)| {
            let s = exact.sample(p);
            (*p, s.distance, s.normal)
        })
        .collect();
    let turned = windings.iter().filter(|w| **w < TURNED).count();
    Samples {
        sure_share: points.len() as f64 / SAMPLES as f64,
        turned_share: turned as f64 / SAMPLES as f64,
        points,
    }
}

fn measure(grid: &GridSdf, samples: &Samples) -> GridError {
    let (mut errors, mut angles): (Vec<f64>, Vec<f64>) = samples
        .points
        .iter()
        .map(|(p, distance, normal)| {
            let s = grid.sample(p);
            ((s.distance - distance).abs(), s.normal.angle(normal))
        })
        .unzip();
    errors.sort_by(f64::total_cmp);
    angles.sort_by(f64::total_cmp);
    // A mesh without a sure side anywhere has no measured error, which must not pass for 0.
    let at = |sorted: &[f64], share: f64| {
        let last = sorted.len().saturating_sub(1);
        let index = (share * last as f64).round() as usize;
        sorted.get(index).copied().unwrap_or(f64::MAX)
    };
    let square_sum: f64 = errors.iter().map(|e| e * e).sum();
    let rms = match errors.len() {
        0 => f64::MAX,
        n => (square_sum / n as f64).sqrt(),
    };
    GridError {
        rms,
        p99: at(&errors, 0.99),
        max: at(&errors, 1.0),
        normal_median: at(&angles, 0.5),
        normal_p95: at(&angles, 0.95),
        sure_share: samples.sure_share,
        turned_share: samples.turned_share,
    }
}
