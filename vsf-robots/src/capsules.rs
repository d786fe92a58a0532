use nalgebra::{Isometry3, Point3};
use vsf_core::Shape;

/// How far radii and centers may differ (m) within one capsule.
const TOLERANCE: f64 = 1e-6;

/// Replaces each cylinder with a sphere at both ends by a capsule, and drops the spheres.
///
/// URDF before 1.2 has no capsule, so makers write these three shapes instead. A sphere may end
/// several capsules: it lies within each, so the union of the shapes stays the same.
pub(crate) fn merge(shapes: &mut Vec<(Isometry3<f64>, Shape)>) {
    let mut covered = vec![false; shapes.len()];
    for i in 0..shapes.len() {
        let (
            X,
            Shape::Cylinder {
                radius,
                half_length,
                ..
            },
        ) = shapes[i]
        else {
            continue;
        };
        let spheres_at = |z: f64| -> Vec<usize> {
            let end = X * Point3::new(0.0, 0.0, z);
            let ends_here = |(X_S, shape): &(Isometry3<f64>, Shape)| {
                matches!(shape, Shape::Sphere { radius: r } if (r - radius).abs() <= TOLERANCE)
                    && (X_S.translation.vector - end.coords).norm() <= TOLERANCE
            };
            (0..shapes.len())
                .filter(|&k| ends_here(&shapes[k]))
                .collect()
        };
        let (bottom, top) = (spheres_at(-half_length), spheres_at(half_length));
        if bottom.is_empty() || top.is_empty() {
            continue;
        }
        for k in bottom.into_iter().chain(top) {
            covered[k] = true;
        }
        shapes[i].1 = Shape::Capsule {
            radius,
            half_length,
        };
    }
    let mut keep = covered.iter().map(|c| !c);
    shapes.retain(|_| keep.next().unwrap_or(true));
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn ball(z: f64, radius: f64) -> (Isometry3<f64>, Shape) {
        (
            Isometry3::translation(0.0, 0.0, z),
            Shape::Sphere { radius },
        )
    }

    fn rod(z: f64, radius: f64, half_length: f64) -> (Isometry3<f64>, Shape) {
        let shape = Shape::Cylinder {
            radius,
            half_length,
            rounding: 0.0,
        };
        (Isometry3::translation(0.0, 0.0, z), shape)
    }

    #[test]
    fn a_rod_between_two_balls_is_a_capsule_in_any_order() {
        let parts = [ball(0.0, 0.1), rod(0.5, 0.1, 0.5), ball(1.0, 0.1)];
        for order in [[0, 1, 2], [1, 0, 2], [2, 0, 1], [2, 1, 0]] {
            let mut shapes: Vec<_> = order.iter().map(|&i| parts[i].clone()).collect();
            merge(&mut shapes);
            let capsule = Shape::Capsule {
                radius: 0.1,
                half_length: 0.5,
            };
            assert_eq!(shapes, [(parts[1].0, capsule)]);
        }
    }

    #[test]
    fn neighbors_share_a_ball() {
        let mut shapes = vec![
            ball(0.0, 0.1),
            ball(1.0, 0.1),
            ball(2.0, 0.1),
            rod(0.5, 0.1, 0.5),
            rod(1.5, 0.1, 0.5),
        ];
        merge(&mut shapes);
        assert_eq!(shapes.len(), 2);
        assert!(matches!(shapes[0].1, Shape::Capsule { .. }));
        assert!(matches!(shapes[1].1, Shape::Capsule { .. }));
    }

    #[test]
    fn near_misses_are_left_alone() {
        let shift = Isometry3::from(Vector3::new(2e-6, 0.0, 0.0));
        let moved = (shift * ball(1.0, 0.1).0, ball(1.0, 0.1).1);
        for last in [ball(1.0, 0.100_01), ball(0.9, 0.1), moved] {
            let before = vec![ball(0.0, 0.1), rod(0.5, 0.1, 0.5), last];
            let mut after = before.clone();
            merge(&mut after);
            assert_eq!(after, before);
        }
    }
}
