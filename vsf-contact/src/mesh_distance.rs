//! The only file that names parry.

use nalgebra::{Point3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQueryWithLocation;
use parry3d_f64::shape::TriMesh;

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
    /// `None` without triangles.
    pub fn new(triangles: &[Triangle]) -> Option<Self> {
        let vertices = triangles.iter().flatten().map(to_parry).collect();
        let faces = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
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

fn to_parry(p: &Point3<f64>) -> Vector {
    Vector::new(p.x, p.y, p.z)
}
