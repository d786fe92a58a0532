use crate::closing::closing_sheet;
use crate::lattice::Lattice;
use crate::mesh_distance::{Closest, MeshDistance, Triangle, place};
use crate::winding::WindingTree;
use crate::{ContactError, Sdf, SdfSample};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::collections::HashMap;
use vsf_core::{RestPoints, TriMesh, bounds};

/// Cells of the lattice that looks for openings along the diagonal of the mesh.
const CLOSING_CELLS: f64 = 128.0;
/// The diagonal of the mesh in lengths of the longest edge of its pieces.
const LONGEST_EDGE: f64 = 16.0;
const CLOSING_MAX_NODES: usize = 4_000_000;
/// Within this distance of the surface \[m\] the normal is that of the face.
const ON_SURFACE: f64 = 1e-9;
/// Least diagonal of a mesh (m).
const SMALLEST: f64 = 1e-6;

/// The exact signed distance of a triangle mesh, which may be open.
///
/// It is slow, some microseconds per sample, and serves as the reference from which a
/// [`GridSdf`](crate::GridSdf) is baked.
///
/// A point is inside where the generalized winding number exceeds 1/2, so the mesh need not be
/// watertight. The openings of a mesh are closed by a sheet where the winding number is 1/2. The
/// distance is that to the mesh or to the sheet. Without the sheet it would jump from `+d` to `-d` in the
/// middle of an opening. With it the field stays 1-Lipschitz, except at gaps narrower than
/// [`MeshOpenness::sheet_spacing`].
///
/// On faces inside of the body (inner structure of a link) the distance is 0 too.
pub struct MeshSdf {
    surface: MeshDistance,
    winding: WindingTree,
    lower: Point3<f64>,
    upper: Point3<f64>,
    openness: MeshOpenness,
    pub(crate) triangles: Vec<Triangle>,
}

/// How far a mesh is from being the closed surface of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct MeshOpenness {
    /// Number of edges at which the orientations of the adjacent faces do not cancel: open edges, and
    /// edges of faces turned the wrong way. 0 for a closed mesh.
    pub boundary_edges: usize,
    /// Number of edges of the mesh; vertices at the same place count as one.
    pub edges: usize,
    /// Share of the nodes of a lattice around the mesh where the winding number lies between 0.1 and
    /// 0.9, so that inside or outside is a guess; 0 for a closed mesh.
    pub unsure_share: f64,
    /// Area of the sheet that closes the openings \[m²\].
    pub sheet_area: f64,
    /// Spacing of the lattice on which the sheet was found \[m\].
    pub sheet_spacing: f64,
}

impl MeshSdf {
    /// Creates the signed distance field of a mesh.
    ///
    /// This takes about a second for a body of 4000 faces, up to a minute where long open faces cross at random.
    ///
    /// # Errors
    /// [`ContactError::EmptyMesh`] when no face has an area, [`ContactError::MeshSize`] when the mesh is too small or
    /// too far away.
    pub fn new(mesh: &TriMesh) -> Result<Self, ContactError> {
        let corners = mesh
            .faces()
            .iter()
            .map(|f| f.map(|i| mesh.vertices()[i as usize]));
        let triangles: Vec<Triangle> = corners.filter(|t| area(t) > 0.0).collect();
        let empty = ContactError::EmptyMesh {
            faces: mesh.faces().len(),
        };
        if triangles.is_empty() {
            return Err(empty);
        }
        let (lower, upper) = bounds(triangles.iter().flatten());
        let (boundary_edges, edges) = count_edges(&triangles);

        let diagonal = (upper - lower).norm();
        let farthest = lower.coords.amax().max(upper.coords.amax());
        if !(diagonal >= SMALLEST && farthest <= RestPoints::FARTHEST) {
            return Err(ContactError::MeshSize {
                extent: diagonal,
                farthest,
            });
        }
        let mut pieces = triangles.clone();
        cut_long(&mut pieces, diagonal / LONGEST_EDGE);
        let winding = WindingTree::new(pieces);
        let surface = MeshDistance::new(&triangles).ok_or(empty)?;

        let openness = MeshOpenness {
            boundary_edges,
            edges,
            unsure_share: 0.0,
            sheet_area: 0.0,
            sheet_spacing: diagonal / CLOSING_CELLS,
        };
        let mut sdf = Self {
            surface,
            winding,
            lower,
            upper,
            openness,
            triangles,
        };
        if boundary_edges > 0 {
            sdf.close()?;
        }
        Ok(sdf)
    }

    /// Adds the sheet over the openings.
    fn close(&mut self) -> Result<(), ContactError> {
        let spacing = self.openness.sheet_spacing;
        let margin = Vector3::repeat(2.0 * spacing);
        let (from, to) = (self.lower - margin, self.upper + margin);
        let lattice = Lattice::covering(&from, &to, spacing, CLOSING_MAX_NODES)?;
        let (w, d) = at_nodes(&lattice, &self.surface, &self.winding);
        let sheet = closing_sheet(&lattice, &w, &d);
        let unsure = w.iter().filter(|w| is_unsure(**w)).count();
        self.openness.unsure_share = unsure as f64 / w.len() as f64;
        self.openness.sheet_area = sheet.iter().fold(0.0, |sum, t| sum + area(t));
        for v in sheet.iter().flatten() {
            (self.lower, self.upper) = (self.lower.inf(v), self.upper.sup(v));
        }
        if let Some(surface) = MeshDistance::new(&[&self.triangles[..], &sheet].concat()) {
            self.surface = surface;
        }
        Ok(())
    }

    /// The generalized winding number, accurate to 0.02: 1 inside, 0 outside.
    ///
    /// Between 0.1 and 0.9, near openings, inside or outside is a guess. A face that occurs several
    /// times counts as often.
    pub fn winding_number(&self, p_B: &Point3<f64>) -> f64 {
        self.winding.at(p_B)
    }

    /// How open the mesh is.
    pub fn openness(&self) -> &MeshOpenness {
        &self.openness
    }

    /// Unsigned distance. It is found faster if it is less than `within`.
    pub(crate) fn unsigned_distance(&self, p_B: &Point3<f64>, within: f64) -> f64 {
        self.closest(p_B, within).distance
    }

    fn closest(&self, p: &Point3<f64>, within: f64) -> Closest {
        let found = self.surface.closest(p, within);
        found
            .or_else(|| self.surface.closest(p, f64::MAX))
            .unwrap_or(Closest {
                point: self.lower,
                distance: (p - self.lower).norm(),
                face: 0,
            })
    }
}

/// Whether the winding number leaves the side open.
pub(crate) fn is_unsure(winding: f64) -> bool {
    winding > 0.1 && winding < 0.9
}

impl Sdf for MeshSdf {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        let closest = self.closest(p_B, f64::MAX);
        let inside = self.winding.at(p_B) > 0.5;
        let sign = if inside { -1.0 } else { 1.0 };
        let away = sign * (p_B - closest.point);
        let normal = if closest.distance > ON_SURFACE {
            away / closest.distance
        } else {
            let normal = self.surface.face_normal(closest.face);
            normal.unwrap_or_else(Vector3::x)
        };
        SdfSample {
            distance: sign * closest.distance,
            normal,
        }
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        (self.lower, self.upper)
    }
}

impl std::fmt::Debug for MeshSdf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MeshSdf")
            .field("faces", &self.triangles.len())
            .field("lower", &self.lower)
            .field("upper", &self.upper)
            .field("openness", &self.openness)
            .finish_non_exhaustive()
    }
}

fn area([a, b, c]: &Triangle) -> f64 {
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// Most pieces that cutting may add. Real meshes stay far below; meshes that repeat long faces stop there.
const MOST_PIECES: usize = 1 << 20;

/// Halves triangles across their longest edge until none is longer than `longest`, or [`MOST_PIECES`] were added. The
/// shape stays the same, but a tree of compact triangles is faster to query than one of slivers.
fn cut_long(triangles: &mut Vec<Triangle>, longest: f64) {
    let mut todo = std::mem::take(triangles);
    let most_of_all = todo.len() + MOST_PIECES;
    while let Some([a, b, c]) = todo.pop() {
        let edges = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
        let most = edges[0].max(edges[1]).max(edges[2]);
        if most <= longest || triangles.len() + todo.len() + 1 >= most_of_all {
            triangles.push([a, b, c]);
            continue;
        }
        let [a, b, c] = if most == edges[0] {
            [a, b, c]
        } else if most == edges[1] {
            [b, c, a]
        } else {
            [c, a, b]
        };
        let m = nalgebra::center(&a, &b);
        todo.extend([[a, m, c], [m, b, c]]);
    }
}

fn at_nodes(
    lattice: &Lattice,
    surface: &MeshDistance,
    winding: &WindingTree,
) -> (Vec<f64>, Vec<f64>) {
    let [nx, ny, _] = lattice.dims;
    (0..lattice.len())
        .into_par_iter()
        .map(|n| {
            let p = lattice.node(n % nx, n / nx % ny, n / nx / ny);
            // Farther ends cannot belong to an edge through the mesh.
            let near = surface.closest(&p, 1.01 * lattice.spacing);
            (winding.at(&p), near.map_or(f64::INFINITY, |c| c.distance))
        })
        .unzip()
}

/// Edges whose directed faces do not cancel, and all edges; vertices at one place are one.
fn count_edges(triangles: &[Triangle]) -> (usize, usize) {
    let mut places: HashMap<[u64; 3], usize> = HashMap::new();
    let mut balance: HashMap<(usize, usize), i64> = HashMap::new();
    for t in triangles {
        let [a, b, c] = t.map(|v| {
            let next = places.len();
            *places.entry(place(&v)).or_insert(next)
        });
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let turn = if p < q { 1 } else { -1 };
            *balance.entry((p.min(q), p.max(q))).or_insert(0) += turn;
        }
    }
    (balance.values().filter(|b| **b != 0).count(), balance.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small file may repeat a long face any number of times.
    #[test]
    fn cutting_is_bounded() {
        let face = [
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
        ];
        let faces = 20_000;
        let mut pieces = vec![face; faces];
        cut_long(&mut pieces, 1.0 / LONGEST_EDGE);
        assert!(pieces.len() <= faces + MOST_PIECES);
        let area = |[a, b, c]: &Triangle| 0.5 * (b - a).cross(&(c - a)).norm();
        let all: f64 = pieces.iter().map(area).sum();
        assert!((all / faces as f64 - 0.5).abs() < 1e-9, "{all}");
    }
}
