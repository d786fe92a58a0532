//! Closed forms against dense samples of their surfaces, differences and other properties.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::sync::LazyLock;
use vsf_contact::{ContactError, GridOptions, Sdf, ShapeSdf, UnionSdf, link_sdfs};
use vsf_core::{Collider, Shape};
use vsf_testkit::check_sdf;

fn shapes() -> Vec<Shape> {
    let half_extents = Vector3::new(0.05, 0.08, 0.03);
    vec![
        Shape::Sphere { radius: 0.05 },
        Shape::Capsule {
            radius: 0.03,
            half_length: 0.06,
        },
        Shape::RoundCone {
            radius_bottom: 0.05,
            radius_top: 0.02,
            half_length: 0.06,
        },
        Shape::RoundCone {
            radius_bottom: 0.02,
            radius_top: 0.05,
            half_length: 0.02,
        },
        Shape::Cylinder {
            radius: 0.04,
            half_length: 0.06,
            rounding: 0.0,
        },
        Shape::Cylinder {
            radius: 0.04,
            half_length: 0.06,
            rounding: 0.015,
        },
        Shape::Box {
            half_extents,
            rounding: 0.0,
        },
        Shape::Box {
            half_extents,
            rounding: 0.02,
        },
    ]
}

fn pose() -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(0.1, -0.2, 0.3),
        UnitQuaternion::from_euler_angles(0.4, -0.9, 1.7),
    )
}

#[test]
fn shapes_and_their_union_keep_the_promises_of_a_distance() {
    let along = |i: usize| Translation3::new(0.03 * i as f64, 0.0, 0.0);
    let parts: Vec<ShapeSdf> = (shapes().iter().enumerate())
        .map(|(i, shape)| ShapeSdf::new(shape, &(along(i) * pose())).unwrap())
        .collect();
    parts.iter().for_each(|part| check_sdf(part));
    check_sdf(&UnionSdf::new(parts));
}

/// Whether a point in the shape's frame is inside, straight from the definition of the shape: a
/// core grown by balls, which are tried one by one.
fn is_inside(shape: &Shape, p: &Point3<f64>) -> bool {
    let steps = 2000;
    let on_axis = |z: f64, r: f64| (p - Point3::new(0.0, 0.0, z)).norm() < r;
    match *shape {
        Shape::Sphere { radius } => on_axis(0.0, radius),
        Shape::Capsule {
            radius,
            half_length,
        } => (0..=steps).any(|i| {
            let t = f64::from(i) / f64::from(steps);
            on_axis(half_length * (2.0 * t - 1.0), radius)
        }),
        Shape::RoundCone {
            radius_bottom,
            radius_top,
            half_length,
        } => (0..=steps).any(|i| {
            let t = f64::from(i) / f64::from(steps);
            let radius = radius_bottom + t * (radius_top - radius_bottom);
            on_axis(half_length * (2.0 * t - 1.0), radius)
        }),
        Shape::Cylinder {
            radius,
            half_length,
            rounding,
        } => {
            let r = p.x.hypot(p.y);
            let core = Vector3::new(r.min(radius - rounding), 0.0, {
                let h = half_length - rounding;
                p.z.clamp(-h, h)
            });
            let away = (Vector3::new(r, 0.0, p.z) - core).norm();
            away < rounding || (r < radius - rounding && p.z.abs() < half_length - rounding)
        }
        Shape::Box {
            half_extents,
            rounding,
        } => {
            let e = half_extents.add_scalar(-rounding);
            let core = p.coords.zip_map(&e, |x, e| x.clamp(-e, e));
            (p.coords - core).norm() < rounding || p.coords.abs() < e
        }
        _ => unreachable!(),
    }
}

/// Directions spread evenly over the sphere (a spherical Fibonacci lattice).
fn directions(n: usize) -> Vec<Vector3<f64>> {
    (0..n)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
            let (s, c) = (i as f64 * 2.399_963_229_728_653).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vector3::new(r * c, r * s, z)
        })
        .collect()
}

/// The surface by bisection of `is_inside` along rays from the center (all shapes are convex).
fn surface(shape: &Shape) -> Vec<Point3<f64>> {
    directions(20_000)
        .iter()
        .map(|d| {
            let (mut inside, mut outside) = (0.0, 0.3);
            for _ in 0..40 {
                let middle = 0.5 * (inside + outside);
                if is_inside(shape, &Point3::from(middle * d)) {
                    inside = middle;
                } else {
                    outside = middle;
                }
            }
            Point3::from(inside * d)
        })
        .collect()
}

/// Every shape with its surface, dense.
static SURFACES: LazyLock<Vec<(Shape, Vec<Point3<f64>>)>> = LazyLock::new(|| {
    let dense = |shape: Shape| {
        let surface = surface(&shape);
        (shape, surface)
    };
    shapes().into_iter().map(dense).collect()
});

fn probes(n: usize) -> Vec<Point3<f64>> {
    directions(n)
        .iter()
        .enumerate()
        .map(|(i, d)| Point3::from(d * (0.004 + 0.2 * i as f64 * 7.3 % 0.2)))
        .collect()
}

#[test]
fn distances_agree_with_dense_surface_samples() {
    for (shape, surface) in SURFACES.iter() {
        let sdf = ShapeSdf::new(shape, &pose()).unwrap();
        for p in probes(60) {
            let brute = surface
                .iter()
                .map(|s| (s - p).norm())
                .fold(f64::MAX, f64::min);
            let sign = if is_inside(shape, &p) { -1.0 } else { 1.0 };
            let d = sdf.distance(&(pose() * p));
            // No sample may be nearer than the distance; some sample lies near the foot point,
            // which the next test finds on the surface.
            assert!(
                d.abs() <= brute + 1e-6,
                "{shape:?} at {p}: {d} but a sample at {brute}"
            );
            assert!(
                brute - d.abs() < 4e-3,
                "{shape:?} at {p}: {d}, nearest sample at {brute}"
            );
            assert!(d * sign > 0.0, "{shape:?} at {p}: {d}");
        }
        for s in surface.iter().step_by(50) {
            let d = sdf.distance(&(pose() * s));
            assert!(d.abs() < 1e-6, "{shape:?}: {d} on the surface");
        }
    }
}

#[test]
fn normals_lead_to_the_surface_and_match_differences() {
    for shape in shapes() {
        let sdf = ShapeSdf::new(&shape, &pose()).unwrap();
        for p in probes(400) {
            let p = pose() * p;
            let s = sdf.sample(&p);
            let foot = p - s.distance * s.normal;
            assert!(sdf.distance(&foot).abs() < 1e-9, "{shape:?} at {p}");
            assert_eq!(s.distance, sdf.distance(&p));
            let h = 1e-6;
            let slope = |h: f64| {
                Vector3::from_fn(|a, _| sdf.distance(&(p + Vector3::ith(a, h))))
                    .add_scalar(-s.distance)
                    / h
            };
            let (forward, backward) = (slope(h), slope(-h));
            // Where both sides agree the gradient exists.
            if (forward - backward).norm() < 1e-3 {
                assert!((forward - s.normal).norm() < 1e-3, "{shape:?} at {p}");
            }
        }
    }
}

#[test]
fn degenerate_points_have_unit_normals_that_lead_to_the_surface() {
    let axis = [
        0.0, 1e-320, 1e-160, 1e-60, 1e-9, 0.06, -0.06, 0.02, 0.5, -0.5,
    ];
    for shape in shapes() {
        let sdf = ShapeSdf::new(&shape, &Isometry3::identity()).unwrap();
        for (x, z) in axis.iter().flat_map(|x| axis.map(|z| (*x, z))) {
            for p in [
                Point3::new(x, 0.0, z),
                Point3::new(0.0, x, z),
                Point3::new(x, x, x),
            ] {
                let s = sdf.sample(&p);
                assert!(
                    (s.normal.norm() - 1.0).abs() < 1e-12,
                    "{shape:?} at {p}: {s:?}"
                );
                let left = sdf.distance(&(p - s.distance * s.normal));
                assert!(left.abs() < 1e-9, "{shape:?} at {p}: {s:?} {left}");
            }
        }
    }
    let ball = ShapeSdf::new(&shapes()[0], &Isometry3::identity()).unwrap();
    assert_eq!(ball.sample(&Point3::origin()).normal, Vector3::x());
    let far = ball.sample(&Point3::new(1e100, -1e100, 1e100));
    assert!(far.distance.is_finite() && (far.normal.norm() - 1.0).abs() < 1e-12);
}

#[test]
fn bounds_hold_the_shape_and_touch_it() {
    for (shape, surface) in SURFACES.iter() {
        let sdf = ShapeSdf::new(shape, &Isometry3::identity()).unwrap();
        let (lower, upper) = sdf.bounds();
        let (mut l, mut u) = (upper, lower);
        for s in surface {
            (l, u) = (l.inf(s), u.sup(s));
        }
        assert!(
            l >= lower.map(|x| x - 1e-9) && u <= upper.map(|x| x + 1e-9),
            "{shape:?}"
        );
        assert!(
            (l - lower).amax() < 2e-3 && (u - upper).amax() < 2e-3,
            "{shape:?}"
        );
        let posed = ShapeSdf::new(shape, &pose()).unwrap();
        let (lower, upper) = posed.bounds();
        for s in surface.iter().map(|s| pose() * s) {
            assert!(
                s >= lower.map(|x| x - 1e-9) && s <= upper.map(|x| x + 1e-9),
                "{shape:?}"
            );
        }
    }
}

#[test]
fn links_unite_their_colliders_in_order() {
    let at = |link, x| Collider {
        link,
        X_LS: Isometry3::translation(x, 0.0, 0.0),
        shape: Shape::Sphere { radius: 0.1 },
    };
    let out = link_sdfs(
        &[at(4, 0.0), at(1, 0.0), at(4, 1.0)],
        &GridOptions::default(),
    )
    .unwrap();
    assert_eq!(out.links.iter().map(|l| l.link).collect::<Vec<_>>(), [1, 4]);
    assert!(out.grids.is_empty());
    let s = out.links[1].sdf.sample(&Point3::new(0.8, 0.0, 0.0));
    assert!((s.distance - 0.1).abs() < 1e-12 && (s.normal + Vector3::x()).norm() < 1e-12);
    let (lower, upper) = out.links[1].sdf.bounds();
    assert!((upper - lower - Vector3::new(1.2, 0.2, 0.2)).norm() < 1e-12);
}

#[test]
fn bad_colliders_are_named() {
    let mut bad = Collider {
        link: 3,
        X_LS: Isometry3::identity(),
        shape: Shape::Sphere { radius: -1.0 },
    };
    let options = GridOptions::default();
    let error = link_sdfs(std::slice::from_ref(&bad), &options).unwrap_err();
    assert!(
        matches!(
            error,
            ContactError::Collider {
                collider: 0,
                link: 3,
                ..
            }
        ),
        "{error}"
    );
    bad.shape = Shape::Sphere { radius: 1.0 };
    bad.X_LS = Isometry3::translation(f64::NAN, 0.0, 0.0);
    assert!(link_sdfs(&[bad], &options).is_err());
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let options = GridOptions {
            resolution: Some(bad),
            ..Default::default()
        };
        assert!(link_sdfs(&[], &options).is_err());
    }
}

fn point() -> impl Strategy<Value = Point3<f64>> {
    prop::array::uniform3(-0.3..0.3f64).prop_map(Point3::from)
}

proptest! {
    #[test]
    fn distances_are_1_lipschitz(p in point(), q in point(), near in 1e-6..1e-2f64) {
        let all: Vec<_> = shapes()
            .iter()
            .map(|s| ShapeSdf::new(s, &Isometry3::identity()).unwrap())
            .collect();
        let union = UnionSdf::new(all.clone());
        let close = p + near * (q - p);
        for (p, q) in [(p, q), (p, close)] {
            let bound = (p - q).norm() + 1e-12;
            for sdf in &all {
                prop_assert!((sdf.distance(&p) - sdf.distance(&q)).abs() <= bound);
            }
            prop_assert!((union.distance(&p) - union.distance(&q)).abs() <= bound);
            prop_assert_eq!(union.sample(&p).distance, union.distance(&p));
        }
    }

    #[test]
    fn a_union_is_its_nearest_part(
        p in point(),
        shifts in prop::collection::vec(point(), 1..8),
        turn in prop::array::uniform3(-2.0..2.0f64),
    ) {
        let pose = |shift: &Point3<f64>| {
            let turn = UnitQuaternion::new(Vector3::from(turn) + 5.0 * shift.coords);
            Isometry3::from_parts(Translation3::from(0.3 * shift.coords), turn)
        };
        let parts: Vec<_> = shapes()
            .iter()
            .zip(&shifts)
            .map(|(shape, shift)| ShapeSdf::new(shape, &pose(shift)).unwrap())
            .collect();
        let first_of_least = |a: &&ShapeSdf, b: &&ShapeSdf| {
            a.distance(&p).total_cmp(&b.distance(&p))
        };
        let nearest = parts.iter().min_by(first_of_least).unwrap();
        let union = UnionSdf::new(parts.clone());
        prop_assert_eq!(union.sample(&p), nearest.sample(&p));
        prop_assert_eq!(union.distance(&p), nearest.distance(&p));
    }
}
