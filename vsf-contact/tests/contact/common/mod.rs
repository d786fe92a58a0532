//! Shapes made for the tests.

use nalgebra::{Point3, Vector3};
use std::collections::HashMap;
use vsf_contact::{Sdf, SdfSample};
use vsf_core::TriMesh;

/// Everything below z = 0, with a box of 1 m around it: a body from outside of the crate, which knows nothing of batches.
pub struct Floor;

impl Sdf for Floor {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        SdfSample {
            distance: p_B.z,
            normal: Vector3::z(),
        }
    }
    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        (Point3::new(-1.0, -1.0, -1.0), Point3::new(1.0, 1.0, 0.0))
    }
}

/// A cube of half edge `h`, outward faces; faces 0 and 1 are the top.
pub fn cube(h: f64) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let corner = |i: u32| {
        let at = |bit: u32| if i >> bit & 1 == 1 { h } else { -h };
        Point3::new(at(0), at(1), at(2))
    };
    let quads = [
        [4, 5, 7, 6],
        [0, 2, 3, 1],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let faces = quads
        .iter()
        .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
        .collect();
    ((0..8).map(corner).collect(), faces)
}

/// A sphere of triangles: an octahedron, every face split in four `depth` times.
pub fn ball(radius: f64, depth: u32) -> TriMesh {
    let mut vertices: Vec<Point3<f64>> = [
        [1, 0, 0],
        [-1, 0, 0],
        [0, 1, 0],
        [0, -1, 0],
        [0, 0, 1],
        [0, 0, -1],
    ]
    .map(|v| Point3::from(v.map(f64::from)))
    .to_vec();
    let mut faces = vec![
        [0, 2, 4],
        [2, 1, 4],
        [1, 3, 4],
        [3, 0, 4],
        [2, 0, 5],
        [1, 2, 5],
        [3, 1, 5],
        [0, 3, 5u32],
    ];
    for _ in 0..depth {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let m = nalgebra::center(&vertices[a as usize], &vertices[b as usize]);
                vertices.push(Point3::from(m.coords.normalize()));
                vertices.len() as u32 - 1
            })
        };
        faces = faces
            .iter()
            .flat_map(|&[a, b, c]| {
                let (d, e, f) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
            })
            .collect();
    }
    let vertices = vertices.iter().map(|v| v * radius).collect();
    TriMesh::new(vertices, faces).unwrap()
}
