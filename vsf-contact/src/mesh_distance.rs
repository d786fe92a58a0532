//! The only file that names parry.

use nalgebra::{Point3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQueryWithLocation;
use parry3d_f64::shape::TriMesh;
use std::collections::HashSet;

/// The corners of a triangle, counter-clockwise seen from outside.
pub(crate) type Triangle = [Point3<f64>; 3];

/// Exact unsigned distance to a set of triangles, by a bounding volume hierarchy.
pub(crate) struct MeshDistance {
    mesh: TriMesh,
}

/// A nearest point and the triangle it lies on.
pub(crate) struct Closest {
    pub point: Point3<f64>,
    pub distance: f64,
    pub face: usize,
}

impl MeshDistance {
    /// `None` without triangles. Copies of a triangle are left out, since a query near one would visit all of them.
    pub fn new(triangles: &[Triangle]) -> Option<Self> {
        let mut seen = HashSet::new();
        let triangles = triangles.iter().filter(|t| seen.insert(corners(t)));
        let vertices: Vec<Vector> = triangles.flatten().map(to_parry).collect();
        let faces = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
        let mesh = TriMesh::new(vertices, faces.collect()).ok()?;
        Some(Self { mesh })
    }

    /// The nearest point, or `None` when it is not nearer than `within`.
    pub fn closest(&self, p: &Point3<f64>, within: f64) -> Option<Closest> {
        let q = to_parry(p);
        let (projection, (face, _)) = self
            .mesh
            .project_local_point_and_get_location_with_max_dist(q, false, within)?;
        let on = projection.point;
        Some(Closest {
            point: Point3::new(on.x, on.y, on.z),
            distance: (on - q).length(),
            face: face as usize,
        })
    }

    /// Unit normal of a triangle by the order of its vertices; `None` when it has no area.
    pub fn face_normal(&self, face: usize) -> Option<Vector3<f64>> {
        let n = self.mesh.triangle(face as u32).scaled_normal();
        Vector3::new(n.x, n.y, n.z).try_normalize(0.0)
    }
}

/// What triangles with the same corners have in common.
pub(crate) fn corners(t: &Triangle) -> [[u64; 3]; 3] {
    let mut corners = t.map(|v| place(&v));
    corners.sort_unstable();
    corners
}

/// What points at the same place have in common.
pub(crate) fn place(v: &Point3<f64>) -> [u64; 3] {
    // Adding zero turns -0 into 0.
    [v.x, v.y, v.z].map(|c| (c + 0.0).to_bits())
}

fn to_parry(p: &Point3<f64>) -> Vector {
    Vector::new(p.x, p.y, p.z)
}
