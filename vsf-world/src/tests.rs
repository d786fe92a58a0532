//! Checks of equilibria that the public functions do not show.

use crate::arm::{Arm, JOINTS, JointVector, Touch, WorldCapsule, link_masses, weight_torques};
use crate::case::{CaseSpec, Kind, Level};
use crate::effect::{EFFECTS, Effect, UNKNOWN_EFFECTS};
use crate::generate::World;
use crate::label::{difference, energy};
use crate::motion::Protocol;
use crate::object::{Meeting, Object, Physics};
use crate::plant::Plant;
use crate::sensor::GRAVITY;
use crate::springs::Springs;
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A ball that is pushed straight into a body, 5 cm deep and out again. `each` sees every step:
/// depth, touches, ball.
fn push(
    object: &mut dyn Object,
    friction: f64,
    seed: u64,
    mut each: impl FnMut(f64, &[Touch], &WorldCapsule),
) -> Vector3<f64> {
    const STEPS: usize = 60;
    const DEPTH: f64 = 0.05;
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    object.reset(&Physics::new(friction, &[]));
    let site = object.site(&Point3::origin(), &mut rng).unwrap();
    let dir = site.inward.into_inner();
    let at = |depth: f64| {
        let center = site.point + dir * (depth - 0.04);
        WorldCapsule {
            link: 7,
            a: center,
            b: center + dir * -0.01,
            radius: 0.04,
        }
    };
    let mut last = at(0.0);
    let depths = (1..=STEPS).map(|k| DEPTH * k as f64 / STEPS as f64);
    let back = depths.clone().rev().skip(1).chain([0.0, -0.01]);
    for depth in depths.chain(back) {
        let ball = at(depth);
        let shift = Isometry3::from_parts((ball.a - last.a).into(), Default::default());
        let mut motion = [Isometry3::identity(); JOINTS + 1];
        motion[7] = shift;
        let mut touches = Vec::new();
        let meeting = Meeting {
            capsules: &[ball],
            motion: &motion,
            dt: 1.0 / 70.0,
        };
        object.step(&meeting, &mut touches);
        each(depth, &touches, &ball);
        last = ball;
    }
    dir
}

fn springs(seed: u64) -> Springs {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    Springs::draw(&Point3::origin(), &Physics::new(0.15, &[]), &mut rng).unwrap()
}

#[test]
fn force_on_the_arm_is_what_the_ground_gives() {
    let mut body = springs(1);
    let mut most: f64 = 0.0;
    let mut worst: f64 = 0.0;
    // The ground's force is known only after the last step, so several pushes end at several depths.
    for end in [10, 30, 59] {
        let mut sum = Vector3::zeros();
        let mut k = 0;
        let mut ground = Vector3::zeros();
        let mut object = Probe {
            body: &mut body,
            stop: end,
            ground: &mut ground,
        };
        push(&mut object, 0.15, 5, |_, touches, _| {
            if k == end {
                sum = touches.iter().map(|t| t.force).sum();
            }
            k += 1;
        });
        most = most.max(sum.norm());
        worst = worst.max((sum - ground).norm());
    }
    assert!(most > 0.5, "{most}");
    assert!(worst < 0.005 * most, "{worst} of {most}");
}

/// The first plant from `seed` on that has a site for a push of seed 1.
fn plant(seed: u64) -> Plant {
    let physics = Physics::new(0.15, &[]);
    let mut plants = (seed..).map(|seed| {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        Plant::draw(&Point3::origin(), &physics, &mut rng)
    });
    let has_site = |p: &Plant| {
        p.site(&Point3::origin(), &mut Pcg64Mcg::seed_from_u64(1))
            .is_some()
    };
    plants.find(has_site).unwrap()
}

/// Notes the force of the ground at one step.
struct Probe<'a> {
    body: &'a mut Springs,
    stop: usize,
    ground: &'a mut Vector3<f64>,
}

impl Object for Probe<'_> {
    fn reset(&mut self, physics: &Physics) {
        self.body.reset(physics);
    }
    fn step(&mut self, arm: &Meeting<'_>, touches: &mut Vec<Touch>) {
        self.body.step(arm, touches);
        if self.stop == 0 {
            *self.ground = self.body.ground_force();
        }
        self.stop = self.stop.wrapping_sub(1);
    }
    fn recover(&mut self, seconds: f64) {
        self.body.recover(seconds);
    }
    fn site(&self, from: &Point3<f64>, rng: &mut Pcg64Mcg) -> Option<crate::object::Site> {
        self.body.site(from, rng)
    }
    fn overlap(&self, capsule: &WorldCapsule) -> usize {
        self.body.overlap(capsule)
    }
    fn covers(&self, point: &Point3<f64>) -> bool {
        self.body.covers(point)
    }
    fn bounds(&self) -> [Point3<f64>; 2] {
        self.body.bounds()
    }
    fn scale_stiffness(&mut self, factor: f64) {
        self.body.scale_stiffness(factor);
    }
}

#[test]
fn plants_balance_at_every_joint() {
    let mut plant = plant(3);
    let mut most: f64 = 0.0;
    let physics = Physics::new(0.15, &[]);
    push(&mut plant, 0.15, 1, |_, touches, _| {
        most = most.max(touches.iter().map(|t| t.force.norm()).sum());
    });
    assert!(most > 0.1, "{most}");
    // Hold still at the depth where it ends, until nothing moves any more.
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    plant.reset(&physics);
    let site = plant.site(&Point3::origin(), &mut rng).unwrap();
    let a = site.point + site.inward.into_inner() * 0.01;
    let ball = WorldCapsule {
        link: 7,
        a,
        b: a + Vector3::x() * 0.01,
        radius: 0.04,
    };
    let motion = [Isometry3::identity(); JOINTS + 1];
    let mut touches = Vec::new();
    for _ in 0..200 {
        touches.clear();
        plant.step(
            &Meeting {
                capsules: &[ball],
                motion: &motion,
                dt: 0.1,
            },
            &mut touches,
        );
    }
    let (worst, largest) = plant.imbalance(&touches);
    assert!(
        largest > 0.01 && worst < 0.01 * largest,
        "{worst} of {largest}"
    );
}

#[test]
fn plants_keep_to_the_friction_cone() {
    for friction in [0.0, 0.15, 0.5] {
        check_cone(&mut plant(3), friction, 1);
    }
}

#[test]
fn springs_keep_to_the_friction_cone() {
    for friction in [0.0, 0.15, 0.5] {
        check_cone(&mut springs(2), friction, 3);
    }
}

fn check_cone(object: &mut dyn Object, friction: f64, seed: u64) {
    let mut outside = 0.0;
    let mut total = 0.0;
    push(object, friction, seed, |_, touches, ball| {
        for t in touches {
            let (_, n) = ball.distance(&t.point);
            let pressure = -t.force.dot(&n);
            let along = (t.force + n * pressure).norm();
            outside += (along - friction * pressure).max(0.0) + (-pressure).max(0.0);
            total += t.force.norm();
        }
    });
    assert!(total > 0.0);
    assert!(
        outside < 0.02 * total,
        "friction {friction}: {outside} of {total}"
    );
}

#[test]
fn springs_without_friction_give_back_the_work() {
    check_work(&mut springs(3), 4);
}

fn check_work(object: &mut dyn Object, seed: u64) {
    for (friction, least, most) in [(0.0, -0.01, 0.06), (0.5, 0.02, 1.0)] {
        let mut steps: Vec<(f64, Vector3<f64>)> = Vec::new();
        let dir = push(object, friction, seed, |depth, touches, _| {
            steps.push((depth, touches.iter().map(|t| t.force).sum()));
        });
        let work = |steps: &[(f64, Vector3<f64>)]| -> f64 {
            let one =
                |w: &[(f64, Vector3<f64>)]| -0.5 * (w[0].1 + w[1].1).dot(&dir) * (w[1].0 - w[0].0);
            steps.windows(2).map(one).sum()
        };
        let lost = work(&steps) / work(&steps[..60]);
        assert!((least..most).contains(&lost), "friction {friction}: {lost}");
    }
}

#[test]
fn val_weights_by_energy_are_those_by_leverage() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut arm = Arm::new(Isometry3::translation(0.1, 0.2, 0.3));
    for _ in 0..20 {
        let q: JointVector = std::array::from_fn(|_| rng.random_range(-2.0..2.0));
        let by_energy = weight_torques(&mut arm, &q, &link_masses(), &GRAVITY);
        arm.set(&q);
        let mut by_leverage = [0.0; JOINTS];
        for m in link_masses() {
            let touch = Touch {
                link: m.link,
                point: arm.poses()[m.link] * m.center,
                force: GRAVITY * m.mass,
            };
            crate::sensor::add(&mut by_leverage, &arm.joint_torques(&touch), 1.0);
        }
        for (a, b) in by_energy.iter().zip(by_leverage) {
            assert!((a - b).abs() < 1e-7, "{a} {b}");
        }
    }
}

#[test]
fn effects_are_called_what_the_lists_say_and_grow() {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    for name in EFFECTS.iter().chain(&UNKNOWN_EFFECTS) {
        let effect = Effect::draw(name, &mut rng, 6).unwrap();
        assert_eq!(effect.name(), *name);
        assert_ne!(effect, effect.scaled(2.0), "{name}");
        let json = serde_json::to_value(&effect).unwrap();
        assert_eq!(json["name"], *name);
        assert!(json["params"].is_object());
    }
    assert!(Effect::draw("gremlins", &mut rng, 6).is_err());
}

#[test]
fn every_effect_changes_the_torques_and_none_does_not() {
    const STRIDE: usize = 10;
    for kind in [Kind::Springs, Kind::Plant] {
        let spec = CaseSpec {
            kind,
            protocol: Protocol::Rich,
            effects: vec![],
            level: Level::Clear,
            seed: 8,
        };
        let mut world = World::draw(&spec).unwrap();
        let nominal = world.touch(&[], STRIDE);
        assert_eq!(nominal, world.touch(&[], STRIDE), "{kind:?} remembers");
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        for name in EFFECTS.iter().chain(&UNKNOWN_EFFECTS) {
            if kind == Kind::Plant && *name == "spatial_coupling" {
                continue;
            }
            let effect = Effect::draw(name, &mut rng, 6).unwrap().scaled(1.2);
            let (with, without) = world.with_and_without(&[effect], &nominal, STRIDE);
            let share = energy(&difference(&with, &without)) / energy(&without);
            assert!(
                share.is_finite() && share > 1e-5,
                "{kind:?} {name}: {share}"
            );
        }
        assert_eq!(
            nominal,
            world.touch(&[], STRIDE),
            "{kind:?} remembers effects"
        );
    }
}
