//! Stick-slip contact against closed forms and the invariants that the model promises.

use crate::common::Floor;
use approx::assert_relative_eq;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use vsf_contact::{ContactConfig, LinkSdf, Sdf, SdfSample, StickSlip};
use vsf_core::{ContactModel, Contacts, CoreError, LinkChains, Posture, RestPoints};

const RADIUS: f64 = 0.05;

/// A ball around the origin of its link.
struct Ball(f64);

impl Sdf for Ball {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        let r = p_B.coords.norm();
        let normal = p_B.coords.try_normalize(0.0).unwrap_or(Vector3::x());
        SdfSample {
            distance: r - self.0,
            normal,
        }
    }
    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let r = Vector3::repeat(self.0);
        (Point3::from(-r), Point3::from(r))
    }
}

/// Below two planes that rise at 45 degrees from the y axis: a notch. Counts its samples.
struct Notch(Arc<AtomicUsize>);

impl Sdf for Notch {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        self.0.fetch_add(1, Relaxed);
        let side = if p_B.x < 0.0 { -1.0 } else { 1.0 };
        let normal = Vector3::new(-side, 0.0, 1.0).normalize();
        SdfSample {
            distance: p_B.coords.dot(&normal),
            normal,
        }
    }
    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        (Point3::new(-1.0, -1.0, -1.0), Point3::new(1.0, 1.0, 1.0))
    }
}

fn model_of(shapes: Vec<Arc<dyn Sdf>>, config: ContactConfig) -> StickSlip {
    let links = shapes.into_iter().enumerate();
    let links: Vec<LinkSdf> = links.map(|(link, sdf)| LinkSdf { link, sdf }).collect();
    StickSlip::new(links, config).unwrap()
}

fn balls(n: usize, config: ContactConfig) -> StickSlip {
    let shapes = (0..n).map(|_| Arc::new(Ball(RADIUS)) as Arc<dyn Sdf>);
    model_of(shapes.collect(), config)
}

fn posture(poses: &[Isometry3<f64>]) -> Posture {
    let chains = LinkChains::new(0, vec![Vec::new(); poses.len()]).unwrap();
    let mut posture = Posture::new(Arc::new(chains));
    posture.parts_mut().1.copy_from_slice(poses);
    posture
}

fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

fn points(p: &[[f64; 3]]) -> RestPoints {
    RestPoints::new(p.iter().map(|p| Point3::from(*p)).collect()).unwrap()
}

fn step(model: &mut StickSlip, rest: &RestPoints, poses: &[Isometry3<f64>]) -> Contacts {
    let mut out = Contacts::new();
    model.step(rest, &posture(poses), &mut out).unwrap();
    out
}

/// Random points in a cube of half edge 0.1 m around the origin.
fn cloud(n: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
    let mut c = || 0.2 * rng.random::<f64>() - 0.1;
    (0..n).map(|_| Point3::new(c(), c(), c())).collect()
}

/// Poses of `n` balls at a time: they come closer along a diagonal and turn.
fn sweep(n: usize, t: f64) -> Vec<Isometry3<f64>> {
    let pose = |l: usize| {
        let s = if l.is_multiple_of(2) { 1.0 } else { -1.0 };
        let shift = Vector3::new(s * (0.14 - 0.17 * t), 0.06 * t * l as f64, 0.03 * t);
        let turn = Vector3::new(0.3, -0.5 * s, 0.7) * t;
        Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::new(turn))
    };
    (0..n).map(pose).collect()
}

fn angle(u: &Vector3<f64>, n: &Vector3<f64>) -> f64 {
    u.cross(n).norm().atan2(u.dot(n))
}

#[test]
fn a_ball_pressed_into_a_half_space_displaces_radially() {
    let (spacing, depth) = (1e-3, 5e-3);
    let coordinates = |n: i32| (-n..=n).map(move |i| f64::from(i) * spacing);
    let mut lattice = Vec::new();
    for x in coordinates(30) {
        for y in coordinates(30) {
            lattice.extend((0..8).map(|k| [x, y, -spacing * (f64::from(k) + 0.5)]));
        }
    }
    let rest = points(&lattice);
    let config = ContactConfig::default();
    let mut model = balls(1, config);
    let center = Vector3::new(0.0, 0.0, RADIUS - depth);
    let out = step(&mut model, &rest, &[at(0.0, 0.0, center.z)]);
    let offset = RADIUS + config.threshold;
    let expected: Vec<u32> = (0..rest.len() as u32)
        .filter(|&i| (rest.positions()[i as usize].coords - center).norm() < offset)
        .collect();
    assert_eq!(out.points(), expected);
    let mut force = Vector3::zeros();
    for (i, u) in out.points().iter().zip(out.displacements()) {
        let r = rest.positions()[*i as usize].coords - center;
        assert_relative_eq!(*u, r.normalize() * (offset - r.norm()), epsilon = 1e-12);
        force -= u;
    }
    // Integral of (offset/r - 1) z over the cap, in spherical shells: with c the height of the
    // center, a shell has the moment pi (r^2 - c^2) r / r.
    let (c, n) = (center.z, 100_000);
    let h = (offset - c) / f64::from(n);
    let shell = |r: f64| (offset / r - 1.0) * std::f64::consts::PI * (r * r - c * c) * r;
    let integral: f64 = (0..n)
        .map(|i| shell(c + h * (f64::from(i) + 0.5)) * h)
        .sum();
    let total = force.z * spacing.powi(3);
    assert_relative_eq!(total, integral, max_relative = 0.02);
    assert!(force.xy().norm() < 1e-9 * force.z);
}

/// The displacement of a point that the floor lifts by 1 cm and then drags along x.
fn drag(friction: f64, distance: f64, steps: usize) -> (Vector3<f64>, ContactConfig) {
    let config = ContactConfig {
        friction,
        ..ContactConfig::default()
    };
    let mut model = model_of(vec![Arc::new(Floor)], config);
    let rest = points(&[[0.0; 3]]);
    step(&mut model, &rest, &[at(0.0, 0.0, 0.008)]);
    let mut u = Vector3::zeros();
    for i in 1..=steps {
        let x = distance * i as f64 / steps as f64;
        u = step(&mut model, &rest, &[at(x, 0.0, 0.008)]).displacements()[0];
    }
    (u, config)
}

#[test]
fn a_point_sticks_up_to_the_cone_and_slips_at_it() {
    // Pressed 1 cm deep: the cone is reached at x = nu_f * 1 cm.
    for friction in [0.05, 0.15, 0.8] {
        let edge = friction * 0.01;
        for share in [0.5, 0.99, 0.999_99] {
            let (u, _) = drag(friction, share * edge, 7);
            assert_relative_eq!(u, Vector3::new(share * edge, 0.0, 0.01), epsilon = 1e-12);
        }
        let (u, config) = drag(friction, edge + 1e-5, 1);
        assert_relative_eq!(u.x, edge + 1e-5 - config.slip_step, epsilon = 1e-12);
        for (distance, steps) in [(0.0123, 1), (0.0123, 13), (0.0123, 1000)] {
            let (u, config) = drag(friction, distance, steps);
            assert_relative_eq!(u.z, 0.01, epsilon = 1e-12);
            assert!(u.x <= edge + 1e-8 && u.x >= edge - config.slip_step, "{u}");
        }
    }
}

#[test]
fn no_friction_leaves_no_tangential_part_and_huge_friction_all() {
    for steps in [1, 10, 333] {
        let (u, _) = drag(0.0, 0.0123, steps);
        assert_relative_eq!(u, Vector3::new(0.0, 0.0, 0.01), epsilon = 2e-9);
        for friction in [1e6, 1e200, f64::MAX] {
            let (u, _) = drag(friction, 0.5, steps);
            assert_relative_eq!(u, Vector3::new(0.5, 0.0, 0.01), epsilon = 1e-12);
        }
    }
}

#[test]
fn slip_iterations_are_counted() {
    let rest = points(&[[0.0; 3]]);
    for max_slip_iterations in [0, 1, 7] {
        let config = ContactConfig {
            max_slip_iterations,
            ..ContactConfig::default()
        };
        let mut model = model_of(vec![Arc::new(Floor)], config);
        step(&mut model, &rest, &[at(0.0, 0.0, 0.008)]);
        let u = step(&mut model, &rest, &[at(0.02, 0.0, 0.008)]).displacements()[0];
        let slip = f64::from(max_slip_iterations) * config.slip_step;
        assert_relative_eq!(u.x, 0.02 - slip, epsilon = 1e-12);
    }
}

/// However fine the slip step, a point slips as far: back to the friction cone.
#[test]
fn a_finer_slip_step_converges() {
    let rest = points(&[[0.0; 3]]);
    let edge = ContactConfig::default().friction * 0.01;
    for slip_step in [1e-3, 1e-4, 3e-5, 1e-5, 1e-7] {
        let config = ContactConfig::default().with_slip_step(slip_step);
        let reach = f64::from(config.max_slip_iterations) * slip_step;
        assert!(
            (0.02..0.02 + 1.001 * slip_step).contains(&(reach + 1e-12)),
            "{reach}"
        );
        let mut model = model_of(vec![Arc::new(Floor)], config);
        step(&mut model, &rest, &[at(0.0, 0.0, 0.008)]);
        let u = step(&mut model, &rest, &[at(0.02, 0.0, 0.008)]).displacements()[0];
        assert!(
            u.x <= edge + 1e-8 && u.x >= edge - slip_step,
            "{slip_step}: {u}"
        );
    }
    let sticky = ContactConfig {
        max_slip_iterations: 0,
        ..ContactConfig::default()
    };
    assert_eq!(sticky.with_slip_step(1e-6).max_slip_iterations, 0);
}

#[test]
fn a_point_wedged_in_a_notch_stays() {
    // The rest place lies straight below the notch; each flank sends the point to the other one.
    let samples = Arc::new(AtomicUsize::new(0));
    let notch = Arc::new(Notch(samples.clone()));
    let mut model = model_of(vec![notch], ContactConfig::default());
    let rest = points(&[[0.003, 0.0, 0.0]]);
    let mut last = step(&mut model, &rest, &[at(0.0, 0.0, 0.02)]);
    for _ in 0..5 {
        let out = step(&mut model, &rest, &[at(0.0, 0.0, 0.02)]);
        assert!(out.displacements()[0].norm() <= last.displacements()[0].norm() + 1e-12);
        last = out;
    }
    samples.store(0, Relaxed);
    assert_eq!(step(&mut model, &rest, &[at(0.0, 0.0, 0.02)]), last);
    // One slip is tried and taken back, not all that are allowed.
    assert!(samples.load(Relaxed) < 10, "{samples:?}");
}

#[test]
fn a_link_that_retreats_leaves_points_at_rest_and_may_come_back() {
    let mut model = model_of(vec![Arc::new(Floor)], ContactConfig::default());
    let rest = points(&[[0.01, 0.0, 0.0]]);
    let mut there = |z: f64| step(&mut model, &rest, &[at(0.0, 0.0, z)]).len();
    assert_eq!(there(-0.0021), 0);
    assert_eq!(there(-0.0019), 1);
    assert_eq!(there(0.01), 1);
    assert_eq!(there(-0.0019), 1);
    assert_eq!(there(-0.0021), 0);
    assert_eq!(there(-0.0019), 1);
    // Left in one jump, and met again at once elsewhere.
    assert_eq!(there(0.01), 1);
    assert_eq!(there(-1.0), 0);
    assert_eq!(there(0.02), 1);
}

#[test]
fn a_sticky_point_follows_until_it_is_pulled_too_far() {
    let config = ContactConfig {
        adhesion: 3e-3,
        ..ContactConfig::default()
    };
    let rest = points(&[[0.0, 0.0, 0.0]]);
    let mut model = model_of(vec![Arc::new(Floor)], config);
    // The surface rises to 1 cm above the point, then falls by a millimeter a step.
    for k in 0..=20 {
        let height = 0.01 - 1e-3 * f64::from(k);
        let contacts = step(&mut model, &rest, &[at(0.0, 0.0, height)]);
        let above = height + config.threshold;
        if above >= -config.adhesion - 1e-9 {
            let u = contacts.displacements()[0];
            assert_relative_eq!(u, Vector3::new(0.0, 0.0, above), epsilon = 1e-9);
        } else {
            assert!(contacts.is_empty(), "{above}");
        }
    }
}

#[test]
fn refining_the_time_step_converges() {
    let rest = RestPoints::new(cloud(4000, 3)).unwrap();
    let last = |steps: usize| {
        let mut model = balls(1, ContactConfig::default());
        let mut out = Contacts::new();
        for i in 0..=steps {
            let t = i as f64 / steps as f64;
            let turn = UnitQuaternion::new(Vector3::new(0.2, 0.1, 0.6) * t);
            let to = Translation3::new(-0.16 + 0.2 * t, 0.02 * t, 0.0);
            out = step(&mut model, &rest, &[Isometry3::from_parts(to, turn)]);
        }
        let mut u = vec![Vector3::zeros(); rest.len()];
        for (i, d) in out.points().iter().zip(out.displacements()) {
            u[*i as usize] = *d;
        }
        u
    };
    let runs: Vec<_> = [25, 100, 400, 1600].map(last).into();
    let rms = |a: &[Vector3<f64>], b: &[Vector3<f64>]| {
        let sum: f64 = a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum();
        let all: f64 = b.iter().map(Vector3::norm_squared).sum();
        (sum / all).sqrt()
    };
    let differences: Vec<f64> = runs.windows(2).map(|w| rms(&w[0], &w[1])).collect();
    eprintln!("relative differences {differences:?}");
    assert!(differences.windows(2).all(|d| d[1] < 0.6 * d[0]));
    assert!(differences[2] < 0.02);
}

#[test]
fn threads_do_not_change_a_bit() {
    let rest = RestPoints::new(cloud(30_000, 5)).unwrap();
    let run = |parallel: bool, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let config = ContactConfig {
                parallel,
                ..ContactConfig::default()
            };
            let mut model = balls(3, config);
            let mut steps = Vec::new();
            for i in 0..=20 {
                steps.push(step(&mut model, &rest, &sweep(3, f64::from(i) / 20.0)));
            }
            steps
        })
    };
    let serial = run(false, 1);
    assert!(serial.iter().map(Contacts::len).max().unwrap() > 3000);
    for threads in [1, 2, 3] {
        assert_eq!(serial, run(true, threads));
    }
}

#[test]
fn the_deepest_link_owns_a_point_and_hands_it_over() {
    let rest = points(&[[0.0; 3]]);
    let level = RADIUS + 0.002;
    // Both reach the point at once; the second is deeper.
    let mut model = balls(2, ContactConfig::default());
    let out = step(
        &mut model,
        &rest,
        &[at(-0.045, 0.0, 0.0), at(0.0, 0.044, 0.0)],
    );
    assert_eq!(out.links(), [1]);
    assert_relative_eq!(
        out.displacements()[0],
        Vector3::new(0.0, 0.044 - level, 0.0),
        epsilon = 1e-12
    );
    // The owner leaves: the point is at rest, where the other link meets it in the same step.
    let out = step(
        &mut model,
        &rest,
        &[at(-0.045, 0.0, 0.0), at(0.0, 0.5, 0.0)],
    );
    assert_eq!(out.links(), [0]);
    assert_relative_eq!(
        out.displacements()[0],
        Vector3::new(level - 0.045, 0.0, 0.0),
        epsilon = 1e-12
    );

    // The first link carries the point to x = 2 cm, where the second runs into it from behind.
    let mut model = balls(2, ContactConfig::default());
    let (far, first) = (at(0.0, 0.5, 0.0), at(0.02 - level, 0.0, 0.0));
    let out = step(&mut model, &rest, &[first, far]);
    assert_eq!(out.links(), [0]);
    // Less than a slip step deep: the owner keeps it.
    let shallow = at(0.02 - level + 0.9e-4, 0.0, 0.0);
    assert_eq!(step(&mut model, &rest, &[first, shallow]).links(), [0]);
    let deep = at(0.03 - level, 0.0, 0.0);
    let out = step(&mut model, &rest, &[first, deep]);
    assert_eq!(out.links(), [1]);
    assert_relative_eq!(
        out.displacements()[0],
        Vector3::new(0.03, 0.0, 0.0),
        epsilon = 1e-12
    );
}

#[test]
fn a_contact_lies_on_its_owner_and_is_pushed_outwards() {
    let rest = RestPoints::new(cloud(5000, 11)).unwrap();
    let config = ContactConfig::default();
    let mut model = balls(3, config);
    for i in 0..=40 {
        let poses = sweep(3, f64::from(i) / 40.0);
        let out = step(&mut model, &rest, &poses);
        for k in 0..out.len() {
            let (u, n) = (out.displacements()[k], out.normals()[k]);
            let p = rest.positions()[out.points()[k] as usize] + u;
            let from_center = p - Point3::from(poses[out.links()[k] as usize].translation.vector);
            let distance = from_center.norm() - RADIUS;
            assert!((distance - config.threshold).abs() < 2e-6, "{distance}");
            assert!(angle(&n, &from_center) < 1e-2);
            assert!(u.dot(&n) >= 0.0 && u.norm() < 0.2);
        }
        // Every other point is out of reach.
        let mut next = 0;
        for (i, p) in rest.positions().iter().enumerate() {
            if out.points().get(next) == Some(&(i as u32)) {
                next += 1;
                continue;
            }
            for X_WL in &poses {
                assert!(
                    (p - Point3::from(X_WL.translation.vector)).norm() >= RADIUS + config.threshold
                );
            }
        }
    }
}

#[test]
fn padding_equals_a_thicker_link() {
    let rest = RestPoints::new(cloud(3000, 7)).unwrap();
    for padding in [-1.5e-3, 4e-3] {
        let config = ContactConfig {
            padding,
            ..ContactConfig::default()
        };
        let mut padded = balls(2, config);
        let thick = (0..2).map(|_| Arc::new(Ball(RADIUS + padding)) as Arc<dyn Sdf>);
        let mut thick = model_of(thick.collect(), ContactConfig::default());
        for i in 0..=20 {
            let poses = sweep(2, f64::from(i) / 20.0);
            let (a, b) = (
                step(&mut padded, &rest, &poses),
                step(&mut thick, &rest, &poses),
            );
            assert_eq!((a.points(), a.links()), (b.points(), b.links()));
            for (u, v) in a.displacements().iter().zip(b.displacements()) {
                assert_relative_eq!(*u, *v, epsilon = 1e-9);
            }
        }
    }
}

#[test]
fn reset_forgets_everything() {
    let rest = RestPoints::new(cloud(2000, 9)).unwrap();
    let mut model = balls(2, ContactConfig::default());
    let fresh = step(&mut model.clone(), &rest, &sweep(2, 0.8));
    for i in 0..=8 {
        step(&mut model, &rest, &sweep(2, f64::from(i) / 8.0));
    }
    assert_ne!(step(&mut model, &rest, &sweep(2, 0.8)), fresh);
    model.reset();
    assert_eq!(step(&mut model, &rest, &sweep(2, 0.8)), fresh);
    // Another cloud is welcome after a reset, and only then.
    let other = RestPoints::new(cloud(2001, 9)).unwrap();
    let mut out = Contacts::new();
    let error = model.step(&other, &posture(&sweep(2, 0.8)), &mut out);
    let (got, expected) = (2001, 2000);
    let what = "rest points";
    assert_eq!(
        error,
        Err(CoreError::Length {
            what,
            got,
            expected
        })
    );
    model.reset();
    assert!(
        model
            .step(&other, &posture(&sweep(2, 0.8)), &mut out)
            .is_ok()
    );
}

#[test]
fn links_may_jump_and_begin_around_points() {
    // Points all through the ball, one in its very center, some of them twice.
    let mut positions = cloud(2000, 13);
    positions.push(Point3::origin());
    positions.extend_from_within(..50);
    let rest = RestPoints::new(positions).unwrap();
    let mut model = balls(1, ContactConfig::default());
    for pose in [
        at(0.0, 0.0, 0.0),
        at(9.0, 0.0, 0.0),
        at(0.01, 0.0, 0.0),
        at(-0.03, 0.05, 0.0),
    ] {
        let out = step(&mut model, &rest, &[pose]);
        let center = Point3::from(pose.translation.vector);
        for (i, u) in out.points().iter().zip(out.displacements()) {
            let p = rest.positions()[*i as usize] + u;
            assert_relative_eq!((p - center).norm(), RADIUS + 0.002, epsilon = 2e-6);
        }
        let inside = |p: &&Point3<f64>| (*p - center).norm() < RADIUS + 0.002;
        assert!(out.len() >= rest.positions().iter().filter(inside).count());
        // Coincident points behave alike.
        let find = |i: u32| Some(out.displacements()[out.points().binary_search(&i).ok()?]);
        for i in 0..50 {
            assert_eq!(find(i), find(2001 + i));
        }
    }
}

#[test]
fn no_points_or_no_links_give_no_contacts() {
    let none = points(&[]);
    let mut model = balls(2, ContactConfig::default());
    assert!(step(&mut model, &none, &sweep(2, 1.0)).is_empty());
    let rest = RestPoints::new(cloud(100, 1)).unwrap();
    let mut model = balls(0, ContactConfig::default());
    assert!(step(&mut model, &rest, &sweep(2, 1.0)).is_empty());
}

#[test]
fn bad_postures_are_errors_and_change_nothing() {
    let rest = RestPoints::new(cloud(2000, 17)).unwrap();
    let mut model = balls(2, ContactConfig::default());
    let bad = [
        vec![at(0.0, f64::NAN, 0.0); 2],
        vec![at(0.0, 0.0, 0.0), at(f64::INFINITY, 0.0, 0.0)],
        vec![at(0.0, 0.0, 0.0), at(1e200, 0.0, 0.0)],
        vec![at(0.0, 0.0, 0.0)],
    ];
    let mut out = Contacts::new();
    // Before the first step, too: the size of the cloud is not taken from a failed step.
    for poses in &bad {
        let other = points(&[[0.0; 3]]);
        assert!(model.step(&other, &posture(poses), &mut out).is_err());
    }
    step(&mut model, &rest, &sweep(2, 0.8));
    let mut undisturbed = model.clone();
    for poses in &bad {
        assert!(model.step(&rest, &posture(poses), &mut out).is_err());
    }
    for t in [0.85, 0.9] {
        let poses = sweep(2, t);
        assert_eq!(
            step(&mut model, &rest, &poses),
            step(&mut undisturbed, &rest, &poses)
        );
    }
}

#[test]
fn parameters_out_of_range_are_errors() {
    let good = ContactConfig::default();
    let bad = [
        ContactConfig {
            threshold: 0.0,
            ..good
        },
        ContactConfig {
            threshold: f64::NAN,
            ..good
        },
        ContactConfig {
            adhesion: -1e-3,
            ..good
        },
        ContactConfig {
            friction: -0.1,
            ..good
        },
        ContactConfig {
            friction: f64::INFINITY,
            ..good
        },
        ContactConfig {
            slip_step: 0.0,
            ..good
        },
        ContactConfig {
            padding: -good.threshold,
            ..good
        },
    ];
    for config in bad {
        assert!(StickSlip::new(Vec::new(), config).is_err(), "{config:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_order_of_points_does_not_matter(seed in 0u64..1000, keep in 1usize..600) {
        // A subset in another order, with another grid over it, gives the same displacements.
        let all = cloud(600, seed);
        let mut order: Vec<usize> = (0..all.len()).collect();
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(seed + 1);
        for i in (1..order.len()).rev() {
            order.swap(i, rng.random_range(0..=i));
        }
        order.truncate(keep);
        let some = RestPoints::new(order.iter().map(|&i| all[i]).collect()).unwrap();
        let all = RestPoints::new(all).unwrap();
        let mut models = [0; 2].map(|_| balls(3, ContactConfig::default()));
        for i in 0..=10 {
            let poses = sweep(3, f64::from(i) / 10.0);
            let (a, b) = (step(&mut models[0], &all, &poses), step(&mut models[1], &some, &poses));
            for (k, &i) in order.iter().enumerate() {
                let find = |c: &Contacts, i: usize| {
                    let at = c.points().binary_search(&(i as u32)).ok()?;
                    Some((c.links()[at], c.displacements()[at], c.normals()[at]))
                };
                prop_assert_eq!(find(&a, i), find(&b, k));
            }
        }
    }

    #[test]
    fn moving_the_world_moves_the_contacts(
        seed in 0u64..1000,
        turn in prop::array::uniform3(-2.0..2.0f64),
        shift in prop::array::uniform3(-1.0..1.0f64),
    ) {
        let X = Isometry3::from_parts(
            Translation3::from(Vector3::from(shift)),
            UnitQuaternion::new(Vector3::from(turn)),
        );
        let here = cloud(600, seed);
        let there = RestPoints::new(here.iter().map(|p| X * p).collect()).unwrap();
        let here = RestPoints::new(here).unwrap();
        let mut models = [0; 2].map(|_| balls(3, ContactConfig::default()));
        for i in 0..=10 {
            let poses = sweep(3, f64::from(i) / 10.0);
            let moved: Vec<_> = poses.iter().map(|p| X * p).collect();
            let (a, b) = (step(&mut models[0], &here, &poses), step(&mut models[1], &there, &moved));
            prop_assert_eq!((a.points(), a.links()), (b.points(), b.links()));
            for k in 0..a.len() {
                prop_assert!((X * a.displacements()[k] - b.displacements()[k]).norm() < 1e-8);
                prop_assert!((X * a.normals()[k] - b.normals()[k]).norm() < 1e-6);
            }
        }
    }
}
