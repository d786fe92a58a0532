//! Runs of slip steps against the same steps one by one.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::Arc;
use vsf_contact::{
    ContactConfig, GridOptions, LinkSdf, Sdf, SdfSample, ShapeSdf, StickSlip, link_sdfs,
};
use vsf_core::{ContactModel, Contacts, LinkChains, Posture, RestPoints, Shape};
use vsf_robots::kinova_gen3;

/// Stick and slip of section III-B-a, step by step. `None` when the point detaches, and a flag for
/// a crease: whether the normal ever turned so much in one step.
fn slip(
    sdf: &dyn Sdf,
    config: &ContactConfig,
    start_L: Point3<f64>,
    rest_L: Point3<f64>,
) -> (Option<Point3<f64>>, bool) {
    let project = |mut p: Point3<f64>| {
        let mut s = sdf.sample(&p);
        for _ in 0..4 {
            p -= s.normal * (s.distance - config.threshold);
            let SdfSample { distance, normal } = sdf.sample(&p);
            s = SdfSample { distance, normal };
        }
        (p, s.normal)
    };
    let (mut p, mut n) = project(start_L);
    let mut crease = false;
    for _ in 0..config.max_slip_iterations {
        let u = p - rest_L;
        let normal = u.dot(&n);
        if normal < 0.0 {
            return (None, crease);
        }
        let tangent = u - n * normal;
        let length = tangent.norm();
        if length <= config.friction * normal + 1e-9 {
            break;
        }
        let next = project(p - tangent * (config.slip_step.min(length) / length));
        crease |= (next.1 - n).norm() > 0.15;
        if (next.0 - rest_L).norm() >= u.norm() {
            break;
        }
        (p, n) = next;
    }
    (Some(p), crease)
}

/// A small random motion.
fn small(rng: &mut Pcg64Mcg) -> Isometry3<f64> {
    let mut c = |size: f64| Vector3::from_fn(|_, _| size * (2.0 * rng.random::<f64>() - 1.0));
    Isometry3::from_parts(Translation3::from(c(1e-3)), UnitQuaternion::new(c(1e-2)))
}

/// Moves a link about in a cloud and compares every step of every contact, each from the place
/// where the step before has led. Returns the differences, and the share of contacts in creases.
fn differences(sdf: Arc<dyn Sdf>, seed: u64) -> (Vec<f64>, f64) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let (lower, upper) = sdf.bounds();
    let reach = (upper - lower).add_scalar(6e-3);
    let mut place = || {
        let share = Vector3::from_fn(|_, _| rng.random::<f64>() - 0.5);
        nalgebra::center(&lower, &upper) + share.component_mul(&reach)
    };
    let rest: Vec<_> = (0..3000).map(|_| place()).collect();
    let rest = RestPoints::new(
        rest.into_iter()
            .filter(|p| sdf.distance(p) > -0.012)
            .collect(),
    );
    let rest = rest.unwrap();
    let config = ContactConfig::default();
    let links: Arc<[LinkSdf]> = vec![LinkSdf { link: 0, sdf }].into();
    let mut model = StickSlip::new(links.clone(), config).unwrap();
    let chains = LinkChains::new(0, vec![Vec::new()]).unwrap();
    let mut posture = Posture::new(Arc::new(chains));
    let (mut before, mut after) = (Contacts::new(), Contacts::new());
    let mut X_WL = Isometry3::identity();
    posture.parts_mut().1[0] = X_WL;
    model.step(&rest, &posture, &mut before).unwrap();
    // One direction for a while, so that points slide.
    let mut drift = small(&mut rng);
    let (mut differences, mut creases) = (Vec::new(), 0);
    for step in 0..60 {
        if step % 15 == 0 {
            drift = small(&mut rng);
        }
        let X_before = X_WL;
        X_WL = small(&mut rng) * drift * X_WL;
        posture.parts_mut().1[0] = X_WL;
        model.step(&rest, &posture, &mut after).unwrap();
        for (k, &point) in before.points().iter().enumerate() {
            let p_W = rest.positions()[point as usize];
            let start_L = X_before.inverse_transform_point(&(p_W + before.displacements()[k]));
            let rest_L = X_WL.inverse_transform_point(&p_W);
            let (expected, crease) = slip(&*links[0].sdf, &config, start_L, rest_L);
            creases += usize::from(crease);
            let found = after.points().binary_search(&point).ok();
            if let (Some(expected), Some(i), false) = (expected, found, crease) {
                let p_L = X_WL.inverse_transform_point(&(p_W + after.displacements()[i]));
                differences.push((p_L - expected).norm());
            }
        }
        std::mem::swap(&mut before, &mut after);
    }
    let all = differences.len() + creases;
    (differences, creases as f64 / all as f64)
}

/// All but a hundredth of the contacts end within two slip steps of where single steps end: within
/// one along the way, and not more to the side. The others slip over a sharper edge, or detach a
/// moment earlier or later.
fn check(name: &str, sdf: Arc<dyn Sdf>, seed: u64) -> f64 {
    let (mut d, creases) = differences(sdf, seed);
    d.sort_by(f64::total_cmp);
    let at = |q: f64| d[(q * (d.len() - 1) as f64) as usize] / ContactConfig::default().slip_step;
    let (p99, worst) = (at(0.99), at(1.0));
    eprintln!("{name}: {} contacts, p99 {p99:.2} slip steps", d.len());
    assert!(d.len() > 10_000 && creases < 0.25, "{name}: {creases}");
    assert!(p99 < 2.0, "{name}: {p99}");
    worst
}

fn shape(shape: &Shape) -> Arc<dyn Sdf> {
    Arc::new(ShapeSdf::new(shape, &Isometry3::identity()).unwrap())
}

#[test]
fn runs_on_smooth_shapes_end_where_single_steps_do() {
    for seed in 0..3 {
        let worst = check("ball", shape(&Shape::Sphere { radius: 0.04 }), seed);
        assert!(worst < 1.01, "{worst}");
        let capsule = Shape::Capsule {
            radius: 0.03,
            half_length: 0.05,
        };
        check("capsule", shape(&capsule), seed);
        let block = Shape::Box {
            half_extents: Vector3::new(0.03, 0.04, 0.06),
            rounding: 0.01,
        };
        check("box", shape(&block), seed);
    }
}

#[test]
fn runs_on_the_gen3_end_where_single_steps_do() {
    let robot = kinova_gen3().unwrap();
    let links = link_sdfs(robot.colliders(), &GridOptions::default()).unwrap();
    for l in links.links {
        let name = robot.links()[l.link].name().to_owned();
        check(&name, l.sdf, l.link as u64);
    }
}
