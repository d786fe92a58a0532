//! Jointed stems and branches: rigid segments, each on a torsional spring in three axes.
//!
//! Pushes are slow, so the plant is always in equilibrium, except for a little damping. A step finds the equilibrium by a
//! few linearizations. In each, contacts are solved one after the other until the forces are within their friction cones.

use crate::arm::{Touch, WorldCapsule};
use crate::material::Element;
use crate::object::{Meeting, Object, Physics, Site};
use crate::plant_contact::{Contact, Hold, closest};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Lever that converts a bend \[rad\] into the displacement \[m\] of the material law.
const LEVER: f64 = 0.5;

/// Time constant with which a free bend recovers \[s\].
const DAMPING: f64 = 0.02;

/// Linearizations per step.
const ROUNDS: usize = 3;

/// Largest bend per linearization \[rad\].
const LARGEST_BEND: f64 = 0.15;

/// A rigid piece along the z axis of its frame, on a joint at its beginning.
pub(crate) struct Segment {
    pub parent: Option<usize>,
    /// Frame of the joint in the frame of the parent, at rest.
    mount: Isometry3<f64>,
    pub length: f64,
    pub radius: f64,
    element: Element,
    bend: UnitQuaternion<f64>,
    pub pose: Isometry3<f64>,
    /// Pose after the last step.
    pub last: Isometry3<f64>,
    rest: Isometry3<f64>,
}

impl Segment {
    pub fn ends(&self, pose: &Isometry3<f64>) -> [Point3<f64>; 2] {
        [
            pose.translation.vector.into(),
            pose * Point3::new(0.0, 0.0, self.length),
        ]
    }
}

pub(crate) struct Plant {
    pub segments: Vec<Segment>,
    pub physics: Physics,
    pub holds: Vec<Hold>,
    /// Compliance of every joint in this linearization [rad/(N m)], and its turn.
    pub compliance: Vec<f64>,
    pub turns: Vec<Vector3<f64>>,
}

impl Plant {
    /// Draws a plant in front of an arm whose base is at `base`.
    pub fn draw(base: &Point3<f64>, physics: &Physics, rng: &mut Pcg64Mcg) -> Self {
        let mut plant = Self {
            segments: Vec::new(),
            physics: physics.clone(),
            holds: Vec::new(),
            compliance: Vec::new(),
            turns: Vec::new(),
        };
        let foot =
            base + Vector3::new(rng.random_range(0.5..0.6), rng.random_range(-0.1..0.1), 0.0);
        let stems = rng.random_range(8..14);
        let lean = rng.random_range(0.1..0.4);
        for stem in 0..stems {
            let heading = std::f64::consts::TAU * (f64::from(stem) + rng.random_range(0.0..0.7))
                / f64::from(stems);
            let out = Vector3::new(heading.cos(), heading.sin(), 0.0);
            let place = foot + out * rng.random_range(0.015..0.09);
            let axis = Vector3::z().cross(&out) * (lean * rng.random_range(0.3..1.2));
            let mount = Isometry3::from_parts(
                Translation3::from(place.coords),
                UnitQuaternion::from_scaled_axis(axis),
            );
            let height = rng.random_range(9..13);
            let radius = rng.random_range(0.006..0.009);
            plant.shoot(None, mount, height, radius, 1, rng);
        }
        plant.place();
        for s in &mut plant.segments {
            s.rest = s.pose;
            s.last = s.pose;
        }
        plant
    }

    /// Grows a shoot of `count` segments with side shoots.
    fn shoot(
        &mut self,
        parent: Option<usize>,
        mount: Isometry3<f64>,
        count: usize,
        radius: f64,
        side_shoots: usize,
        rng: &mut Pcg64Mcg,
    ) {
        let (mut parent, mut mount) = (parent, mount);
        for k in 0..count {
            let taper = 1.0 - 0.45 * k as f64 / count as f64;
            let radius = radius * taper;
            let length = rng.random_range(0.034..0.044);
            // Bending stiffness of a rod, softened at its thick end, uneven.
            let rod = (radius / 0.008_f64).powf(3.0) * (0.04 / length);
            let stiffness = rod * rng.random_range(0.6..1.5) / (LEVER * LEVER);
            let id = self.segments.len();
            self.segments.push(Segment {
                parent,
                mount,
                length,
                radius,
                element: Element::new(stiffness, rng),
                bend: UnitQuaternion::identity(),
                pose: Isometry3::identity(),
                last: Isometry3::identity(),
                rest: Isometry3::identity(),
            });
            if side_shoots > 0 && k >= 2 && rng.random::<f64>() < 0.85 {
                let heading: f64 = rng.random_range(0.0..std::f64::consts::TAU);
                let tilt = rng.random_range(0.6..1.2);
                let axis = Vector3::new(heading.cos(), heading.sin(), 0.0) * tilt;
                let off = Isometry3::from_parts(
                    Translation3::new(0.0, 0.0, length * rng.random_range(0.5..1.0)),
                    UnitQuaternion::from_scaled_axis(axis),
                );
                let leafy = radius * rng.random_range(1.0..1.7);
                self.shoot(
                    Some(id),
                    off,
                    rng.random_range(2..5),
                    leafy,
                    side_shoots - 1,
                    rng,
                );
            }
            let mut curve = || rng.random_range(-0.1..0.1);
            let axis = Vector3::new(curve(), curve(), 0.0);
            mount = Isometry3::from_parts(
                Translation3::new(0.0, 0.0, length),
                UnitQuaternion::from_scaled_axis(axis),
            );
            parent = Some(id);
        }
    }

    /// Computes poses from bends; parents come before their children.
    fn place(&mut self) {
        for i in 0..self.segments.len() {
            let s = &self.segments[i];
            let frame = s
                .parent
                .map_or(s.mount, |p| self.segments[p].pose * s.mount);
            self.segments[i].pose = frame * s.bend;
        }
    }

    /// Computes the compliances and turns of the joints as they are without contacts.
    fn linearize(&mut self, dt: f64) {
        self.compliance.clear();
        self.turns.clear();
        for s in &self.segments {
            let u = s.bend.scaled_axis() * LEVER;
            let e = &s.element;
            let r = self.physics.material.response(e, &u, dt);
            let damping = e.stiffness * DAMPING / dt;
            let force = r.force - (u - e.u) * damping;
            let compliance = 1.0 / ((r.slope + damping) * LEVER * LEVER);
            let frame = s.pose.rotation * s.bend.inverse();
            self.compliance.push(compliance);
            self.turns.push(frame * force * (LEVER * compliance));
        }
    }

    /// Turns the joints.
    fn turn(&mut self) {
        let largest = self.turns.iter().map(Vector3::norm).fold(0.0, f64::max);
        let ease = if largest > LARGEST_BEND {
            LARGEST_BEND / largest
        } else {
            1.0
        };
        for (s, turn) in self.segments.iter_mut().zip(&self.turns) {
            let frame = s.pose.rotation * s.bend.inverse();
            let local = frame.inverse() * turn * ease;
            s.bend = UnitQuaternion::from_scaled_axis(local) * s.bend;
        }
        self.place();
    }

    /// Adds the torque of a force at `point` of segment `of` to the turns of the joints below it.
    pub fn push(&mut self, of: usize, point: &Point3<f64>, force: &Vector3<f64>) {
        let mut next = Some(of);
        while let Some(i) = next {
            let s = &self.segments[i];
            let arm = point.coords - s.pose.translation.vector;
            self.turns[i] += arm.cross(force) * self.compliance[i];
            next = s.parent;
        }
    }

    /// Displacement of a point of segment `of` by the turns.
    pub fn moved(&self, of: usize, point: &Point3<f64>) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        let mut next = Some(of);
        while let Some(i) = next {
            let s = &self.segments[i];
            sum += self.turns[i].cross(&(point.coords - s.pose.translation.vector));
            next = s.parent;
        }
        sum
    }

    /// Compliance of a point along `direction`: its displacement along a unit force [m/N].
    pub fn give(&self, of: usize, point: &Point3<f64>, direction: &Vector3<f64>) -> f64 {
        let mut sum = 0.0;
        let mut next = Some(of);
        while let Some(i) = next {
            let s = &self.segments[i];
            let arm = point.coords - s.pose.translation.vector;
            sum += arm.cross(direction).norm_squared() * self.compliance[i];
            next = s.parent;
        }
        sum
    }
}

#[cfg(test)]
impl Plant {
    /// Largest torque of a joint's spring that the touches do not balance, and largest torque of a spring \[N m\]; at rest.
    pub(crate) fn imbalance(&self, touches: &[Touch]) -> (f64, f64) {
        let spring = |s: &Segment| {
            let frame = s.pose.rotation * s.bend.inverse();
            frame * s.bend.scaled_axis() * (s.element.stiffness * LEVER * LEVER)
        };
        let springs: Vec<_> = self.segments.iter().map(spring).collect();
        let mut left = springs.clone();
        for touch in touches {
            let on_plant = |s: &Segment| {
                let [a, b] = s.ends(&s.pose);
                WorldCapsule {
                    link: 0,
                    a,
                    b,
                    radius: s.radius,
                }
                .distance(&touch.point)
                .0
                .abs()
            };
            let nearest = (0..left.len()).min_by(|&i, &j| {
                on_plant(&self.segments[i]).total_cmp(&on_plant(&self.segments[j]))
            });
            let mut next = nearest;
            while let Some(i) = next {
                let s = &self.segments[i];
                let arm = touch.point.coords - s.pose.translation.vector;
                left[i] += arm.cross(&touch.force);
                next = s.parent;
            }
        }
        let largest = |v: &[Vector3<f64>]| v.iter().map(Vector3::norm).fold(0.0, f64::max);
        (largest(&left), largest(&springs))
    }
}

impl Object for Plant {
    fn reset(&mut self, physics: &Physics) {
        self.physics = physics.clone();
        let stiffness = self.segments.iter().map(|s| s.element.stiffness);
        self.physics.material.typical_stiffness =
            stiffness.sum::<f64>() / self.segments.len() as f64;
        self.holds.clear();
        for s in &mut self.segments {
            s.bend = UnitQuaternion::identity();
            s.pose = s.rest;
            s.last = s.rest;
            s.element.reset();
            let [a, _] = s.ends(&s.rest);
            self.physics.material.lay_fiber(&mut s.element, &a);
        }
    }

    fn step(&mut self, arm: &Meeting<'_>, touches: &mut Vec<Touch>) {
        let mut contacts: Vec<Contact> = Vec::new();
        for _ in 0..ROUNDS {
            self.linearize(arm.dt);
            contacts = self.meet(arm);
            self.solve(&mut contacts);
            self.turn();
        }
        self.remember(&contacts, arm.dt);
        touches.extend(
            contacts
                .iter()
                .filter(|c| c.force != Vector3::zeros())
                .map(|c| Touch {
                    link: arm.capsules[c.capsule].link,
                    point: c.on_arm,
                    force: -c.force,
                }),
        );
        for s in &mut self.segments {
            let u = s.bend.scaled_axis() * LEVER;
            self.physics.material.commit(&mut s.element, u, arm.dt);
            s.last = s.pose;
        }
    }

    fn recover(&mut self, seconds: f64) {
        const STEPS: usize = 10;
        let motion = Default::default();
        let arm = Meeting {
            capsules: &[],
            motion: &motion,
            dt: seconds / STEPS as f64,
        };
        self.holds.clear();
        for _ in 0..STEPS {
            self.step(&arm, &mut Vec::new());
        }
    }

    fn site(&self, from: &Point3<f64>, rng: &mut Pcg64Mcg) -> Option<Site> {
        let s = &self.segments[rng.random_range(0..self.segments.len())];
        let [a, b] = s.ends(&s.rest);
        let mid = nalgebra::center(&a, &b);
        let height = mid.z - from.z;
        if !(0.14..0.42).contains(&height) {
            return None;
        }
        let mut level = mid - from;
        level.z = 0.0;
        let aside: f64 = rng.random_range(-0.7..0.7);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * aside);
        let inward = turn * level.normalize() - Vector3::z() * rng.random_range(-0.1..0.6);
        let inward = Unit::new_normalize(inward);
        Some(Site {
            point: mid - inward.into_inner() * s.radius,
            inward,
            depth: 0.026,
        })
    }

    fn overlap(&self, c: &WorldCapsule) -> usize {
        let reaches = |s: &&Segment| {
            let (on_plant, on_arm) = closest(&s.ends(&s.rest), &[c.a, c.b]);
            (on_plant - on_arm).norm() < s.radius + c.radius
        };
        self.segments.iter().filter(reaches).count()
    }

    fn covers(&self, p: &Point3<f64>) -> bool {
        const MARGIN: f64 = 0.01;
        self.segments.iter().any(|s| {
            let [a, b] = s.ends(&s.rest);
            let whole = WorldCapsule {
                link: 0,
                a,
                b,
                radius: s.radius + MARGIN,
            };
            whole.distance(p).0 < 0.0
        })
    }

    fn bounds(&self) -> [Point3<f64>; 2] {
        let ends = self.segments.iter().flat_map(|s| s.ends(&s.rest));
        let wide = Vector3::repeat(0.02);
        ends.fold(
            [
                Point3::from(Vector3::repeat(1e3)),
                Point3::from(Vector3::repeat(-1e3)),
            ],
            |[a, b], p| [a.inf(&(p - wide)), b.sup(&(p + wide))],
        )
    }

    fn scale_stiffness(&mut self, factor: f64) {
        self.segments
            .iter_mut()
            .for_each(|s| s.element.stiffness *= factor);
    }
}
