//! Collision shapes as triangles.

use super::numbers::{Numbers, check_near};
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use vsf::core::nalgebra::{Point3, Vector3};
use vsf::core::{Collider, Shape, TriMesh, bounds};

/// Most triangles of all meshes together.
const MOST: usize = 60_000;
/// Steps of a quarter turn about z, and from the equator to a pole.
const STEPS: usize = 6;

/// The surface of a link, in the frame of the link.
#[derive(Serialize)]
pub struct Surface {
    link: usize,
    /// x, y, z of each vertex [m].
    vertices: Numbers,
    /// Three vertices of each triangle, counter-clockwise from outside.
    faces: Numbers,
}

/// Triangles with their vertices.
struct Triangles {
    vertices: Vec<Point3<f64>>,
    faces: Vec<[u32; 3]>,
}

/// Surfaces of the colliders, meshes with no more triangles than browsers turn smoothly; `links`
/// are the names for messages.
pub fn surfaces(colliders: &[Collider], links: &[&str]) -> anyhow::Result<Vec<Surface>> {
    let is_mesh = |c: &&Collider| matches!(c.shape, Shape::Mesh(_));
    let meshes = colliders.iter().filter(is_mesh).count();
    let surface = |collider: &Collider| {
        let name = || format!("a vertex of link {:?}", links[collider.link]);
        let Some(triangles) = triangles(&collider.shape, MOST / meshes.max(1)) else {
            return Ok(None);
        };
        let vertices: Vec<_> = (triangles.vertices.iter())
            .map(|p_S| collider.X_LS * p_S)
            .collect();
        vertices.iter().try_for_each(|p| check_near(p, name))?;
        Ok(Some(Surface {
            link: collider.link,
            vertices: Numbers::f32(vertices.iter().flat_map(|p| [p.x, p.y, p.z])),
            faces: Numbers::u32(triangles.faces.into_flattened()),
        }))
    };
    colliders
        .iter()
        .filter_map(|c| surface(c).transpose())
        .collect()
}

/// `None` for a shape that is not known here.
fn triangles(shape: &Shape, most: usize) -> Option<Triangles> {
    Some(match *shape {
        Shape::Mesh(ref mesh) => coarse(mesh, most),
        Shape::Sphere { radius } => convex(|n, _| n * radius),
        Shape::Capsule {
            radius,
            half_length,
        } => convex(|n, side| n * radius + Vector3::z() * (side.z * half_length)),
        Shape::RoundCone {
            radius_bottom,
            radius_top,
            half_length,
        } => {
            let slope = (radius_bottom - radius_top) / (2.0 * half_length);
            convex(|n, _| {
                if n.z > slope {
                    n * radius_top + Vector3::z() * half_length
                } else {
                    n * radius_bottom - Vector3::z() * half_length
                }
            })
        }
        Shape::Cylinder {
            radius,
            half_length,
            rounding,
        } => convex(|n, side| {
            let around = Vector3::new(side.x, side.y, 0.0) * (radius - rounding);
            n * rounding + around + Vector3::z() * (side.z * (half_length - rounding))
        }),
        Shape::Box {
            half_extents,
            rounding,
        } => convex(|n, side| {
            let core = half_extents.add_scalar(-rounding);
            let corner = Vector3::new(side.x, side.y, side.z).map(f64::signum);
            n * rounding + core.component_mul(&corner)
        }),
        _ => return None,
    })
}

/// A convex surface about the z axis, by its point with the outward normal `n`: `point(n, side)`,
/// where `side` has the direction around z and the side of the equator, which `n` loses at the
/// poles. Normals on the borders of octants come twice, once for each side.
fn convex(point: impl Fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64>) -> Triangles {
    let quarter = |k: usize| k as f64 / STEPS as f64 * FRAC_PI_2;
    let mut vertices = Vec::new();
    for half in [-1.0, 1.0] {
        for ring in 0..=STEPS {
            let up = if half < 0.0 {
                quarter(ring) - FRAC_PI_2
            } else {
                quarter(ring)
            };
            for side in 0..4 {
                for step in 0..=STEPS {
                    // A hair inside of the octant, so that signs are those of the octant.
                    let inside = quarter(step).clamp(1e-12, FRAC_PI_2 - 1e-12);
                    let around = side as f64 * FRAC_PI_2 + inside;
                    let (sin, cos) = around.sin_cos();
                    let n = Vector3::new(up.cos() * cos, up.cos() * sin, up.sin());
                    vertices.push(Point3::from(point(&n, &Vector3::new(cos, sin, half))));
                }
            }
        }
    }
    let (rings, columns) = (2 * (STEPS + 1), 4 * (STEPS + 1));
    let at = |ring: usize, column: usize| (ring * columns + column % columns) as u32;
    let mut faces = Vec::new();
    // The middle of the flat ends, if there are any.
    let last = vertices.len() - 1;
    let poles = [0, last].map(|k| {
        vertices.push(Point3::new(0.0, 0.0, vertices[k].z));
        vertices.len() as u32 - 1
    });
    for column in 0..columns {
        faces.push([poles[0], at(0, column + 1), at(0, column)]);
        for ring in 1..rings {
            let (a, b) = (at(ring - 1, column), at(ring - 1, column + 1));
            let (c, d) = (at(ring, column), at(ring, column + 1));
            faces.extend([[a, b, c], [b, d, c]]);
        }
        faces.push([poles[1], at(rings - 1, column), at(rings - 1, column + 1)]);
    }
    faces.retain(|f| area(&vertices, f) > 0.0);
    Triangles { vertices, faces }
}

fn area(vertices: &[Point3<f64>], face: &[u32; 3]) -> f64 {
    let [a, b, c] = face.map(|i| vertices[i as usize]);
    (b - a).cross(&(c - a)).norm() / 2.0
}

/// A mesh with at most `most` triangles: vertices within a cell become one, in cells that grow until
/// few enough triangles are left.
fn coarse(mesh: &TriMesh, most: usize) -> Triangles {
    let vertices = mesh.vertices();
    let mut faces = mesh.faces().to_vec();
    let (lower, upper) = bounds(vertices);
    let mut cell = (upper - lower).norm() / 400.0;
    while faces.len() > most {
        let key = |p: &Point3<f64>| ((p - lower) / cell).map(|v| v as i64);
        let mut seen = BTreeMap::new();
        let merged: Vec<u32> = (vertices.iter().enumerate())
            .map(|(i, p)| *seen.entry(<[i64; 3]>::from(key(p))).or_insert(i as u32))
            .collect();
        faces = (mesh.faces().iter())
            .map(|f| f.map(|i| merged[i as usize]))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        cell *= 1.5;
    }
    // Vertices of no triangle go.
    let mut number = BTreeMap::new();
    let mut kept = Vec::new();
    for i in faces.iter_mut().flatten() {
        let old = *i;
        *i = *number.entry(old).or_insert_with(|| {
            kept.push(vertices[old as usize]);
            kept.len() as u32 - 1
        });
    }
    Triangles {
        vertices: kept,
        faces,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use vsf::contact::{Sdf, ShapeSdf};
    use vsf::core::nalgebra::{Isometry3, center};

    /// Six times the volume within a closed surface.
    fn six_volumes(t: &Triangles) -> f64 {
        let volume = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|i| t.vertices[i as usize].coords);
            a.dot(&b.cross(&c))
        };
        t.faces.iter().map(volume).sum()
    }

    #[test]
    fn vertices_lie_on_the_surface_and_faces_look_outward() {
        let half_extents = Vector3::new(0.05, 0.08, 0.02);
        let (radius, half_length) = (0.05, 0.1);
        for shape in [
            Shape::Sphere { radius },
            Shape::Capsule {
                radius,
                half_length,
            },
            Shape::RoundCone {
                radius_bottom: 0.06,
                radius_top: 0.03,
                half_length,
            },
            Shape::RoundCone {
                radius_bottom: 0.03,
                radius_top: 0.06,
                half_length,
            },
            Shape::Cylinder {
                radius,
                half_length,
                rounding: 0.0,
            },
            Shape::Cylinder {
                radius,
                half_length,
                rounding: 0.02,
            },
            Shape::Cylinder {
                radius,
                half_length,
                rounding: radius,
            },
            Shape::Box {
                half_extents,
                rounding: 0.0,
            },
            Shape::Box {
                half_extents,
                rounding: 0.01,
            },
        ] {
            let sdf = ShapeSdf::new(&shape, &Isometry3::identity()).unwrap();
            let t = triangles(&shape, MOST).unwrap();
            for p in &t.vertices {
                let d = sdf.sample(p).distance;
                assert!(d.abs() < 1e-9, "{shape:?}: {d} at {p}");
            }
            let mut inside: f64 = 0.0;
            for f in &t.faces {
                let [a, b, c] = f.map(|i| t.vertices[i as usize]);
                let middle = center(&center(&a, &b), &c);
                let sample = sdf.sample(&middle);
                inside = inside.min(sample.distance);
                let n = (b - a).cross(&(c - a));
                // Slivers of 1e-12 rad have no direction.
                if n.norm() > 1e-9 && sample.distance < -1e-9 {
                    assert!(n.dot(&middle.coords) > 0.0, "{shape:?}: {middle}");
                }
            }
            // As far inside as chords of 15 degrees are, or the step of a round cone.
            assert!(inside > -0.003, "{shape:?}: {inside}");
            assert!(six_volumes(&t) > 0.0);
        }
        let ball = triangles(&Shape::Sphere { radius }, MOST).unwrap();
        let volume = 16.0 * FRAC_PI_2 * radius.powi(3);
        let share = six_volumes(&ball) / volume;
        assert!(share > 0.95 && share < 1.0, "{share}");
    }

    #[test]
    fn fine_meshes_become_coarse() {
        let n = 200;
        let wave = |k: u32| f64::from(k) / f64::from(n);
        let vertices = (0..=n).flat_map(|i| {
            (0..=n).map(move |j| Point3::new(wave(i), wave(j), 0.1 * (6.0 * wave(i)).sin()))
        });
        let faces = (0..n).flat_map(|i| {
            (0..n).flat_map(move |j| {
                let k = i * (n + 1) + j;
                [[k, k + n + 1, k + 1], [k + 1, k + n + 1, k + n + 2]]
            })
        });
        let mesh = TriMesh::new(vertices.collect(), faces.collect()).unwrap();
        let whole = coarse(&mesh, 80_000);
        assert_eq!(whole.faces.len(), 80_000);
        let few = coarse(&mesh, 3000);
        assert!(
            (1000..=3000).contains(&few.faces.len()),
            "{}",
            few.faces.len()
        );
        assert!(
            few.faces
                .iter()
                .flatten()
                .all(|&i| (i as usize) < few.vertices.len())
        );
        let sum = |t: &Triangles| t.faces.iter().map(|f| area(&t.vertices, f)).sum::<f64>();
        assert!((sum(&few) / sum(&whole) - 1.0).abs() < 0.05);
    }
}
