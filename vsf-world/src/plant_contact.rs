//! Contacts between a plant and the arm.

use crate::object::Meeting;
use crate::plant::Plant;
use nalgebra::{Point3, Unit, Vector3};

/// Surfaces nearer than this may come into contact within a step \[m\].
const NEAR: f64 = 0.015;

/// Compliance of the surfaces themselves [m/N].
const SURFACE: f64 = 1.5e-4;

/// Sweeps over all contacts.
const SWEEPS: usize = 25;

/// State of a contact that lasts from step to step.
#[derive(Debug, Clone)]
pub(crate) struct Hold {
    segment: usize,
    capsule: usize,
    force: Vector3<f64>,
    dwell: f64,
}

/// A contact of a segment with a capsule of the arm.
#[derive(Debug, Clone)]
pub(crate) struct Contact {
    segment: usize,
    pub capsule: usize,
    /// Point on the axis of the segment.
    point: Point3<f64>,
    /// Point on the surface of the capsule.
    pub on_arm: Point3<f64>,
    /// Direction from the arm to the plant.
    normal: Unit<Vector3<f64>>,
    gap: f64,
    /// Motion of the point along the arm since the last step.
    slid: Vector3<f64>,
    /// Force on the plant.
    pub force: Vector3<f64>,
    /// Largest tension.
    tension: f64,
}

impl Plant {
    /// All contacts of this step, with the forces of the previous step as a first guess.
    pub(crate) fn meet(&mut self, arm: &Meeting<'_>) -> Vec<Contact> {
        let mut contacts = Vec::new();
        for (segment, s) in self.segments.iter().enumerate() {
            let ends = s.ends(&s.pose);
            for (capsule, c) in arm.capsules.iter().enumerate() {
                let reach = s.radius + c.radius + NEAR;
                let far = reach + 0.5 * (s.length + (c.b - c.a).norm());
                let apart = nalgebra::center(&ends[0], &ends[1]) - nalgebra::center(&c.a, &c.b);
                if apart.norm_squared() > far * far {
                    continue;
                }
                let (point, axis_of_arm) = closest(&ends, &[c.a, c.b]);
                let between = point - axis_of_arm;
                let Some((normal, distance)) = Unit::try_new_and_get(between, 1e-9) else {
                    continue;
                };
                if distance > reach {
                    continue;
                }
                let was = s.last * s.pose.inverse() * point;
                let carried = point - arm.motion[c.link].inverse() * point;
                let hold = self
                    .holds
                    .iter()
                    .find(|h| (h.segment, h.capsule) == (segment, capsule));
                let stretch = self.physics.adhesion.map_or(0.0, |(stretch, dwell)| {
                    stretch * (1.0 - (-hold.map_or(0.0, |h| h.dwell) / dwell).exp())
                });
                contacts.push(Contact {
                    segment,
                    capsule,
                    point,
                    on_arm: axis_of_arm + normal.into_inner() * c.radius,
                    normal,
                    gap: distance - s.radius - c.radius,
                    slid: (point - was) - carried,
                    force: hold.map_or_else(Vector3::zeros, |h| h.force),
                    tension: stretch / (self.give(segment, &point, &normal) + SURFACE),
                });
            }
        }
        contacts
    }

    /// Finds the forces at which nothing overlaps, and nothing slides while within its friction cone.
    pub(crate) fn solve(&mut self, contacts: &mut [Contact]) {
        for c in contacts.iter() {
            self.push(c.segment, &c.point, &c.force);
        }
        let friction = self.physics.friction;
        for _ in 0..SWEEPS {
            for c in contacts.iter_mut() {
                let n = c.normal.into_inner();
                let pressure = c.force.dot(&n);
                let moved = self.moved(c.segment, &c.point);
                let give = self.give(c.segment, &c.point, &n) + SURFACE;
                let open = c.gap + moved.dot(&n) + SURFACE * pressure;
                let pressed = (pressure - open / give).max(-c.tension);
                self.push(c.segment, &c.point, &(n * (pressed - pressure)));

                let along = c.force - n * pressure;
                let slide = c.slid + self.moved(c.segment, &c.point);
                let slide = slide - n * slide.dot(&n);
                let mut held = along;
                if let Some((way, length)) = Unit::try_new_and_get(slide, 1e-12) {
                    let give = self.give(c.segment, &c.point, &way) + SURFACE;
                    held -= way.into_inner() * (length / give);
                }
                let most = friction * pressed.max(0.0);
                if held.norm() > most {
                    held *= most / held.norm();
                }
                self.push(c.segment, &c.point, &(held - along));
                c.force = n * pressed + held;
            }
        }
    }

    /// Keeps the state for the next step.
    pub(crate) fn remember(&mut self, contacts: &[Contact], dt: f64) {
        let before = std::mem::take(&mut self.holds);
        for c in contacts.iter().filter(|c| c.force != Vector3::zeros()) {
            let pressure = c.force.dot(&c.normal);
            if pressure < 0.0 && pressure <= -0.999 * c.tension {
                continue;
            }
            let key = (c.segment, c.capsule);
            let hold = before.iter().find(|h| (h.segment, h.capsule) == key);
            self.holds.push(Hold {
                segment: c.segment,
                capsule: c.capsule,
                force: c.force,
                dwell: hold.map_or(0.0, |h| h.dwell) + dt,
            });
        }
    }
}

/// The closest points of two line segments.
pub(crate) fn closest(p: &[Point3<f64>; 2], q: &[Point3<f64>; 2]) -> (Point3<f64>, Point3<f64>) {
    let (d, e, r) = (p[1] - p[0], q[1] - q[0], p[0] - q[0]);
    let (a, b, c) = (d.norm_squared(), d.dot(&e), e.norm_squared());
    let (f, g) = (d.dot(&r), e.dot(&r));
    let det = a * c - b * b;
    let s = if det > 1e-12 * a * c {
        ((b * g - c * f) / det).clamp(0.0, 1.0)
    } else {
        0.5
    };
    let t = ((b * s + g) / c).clamp(0.0, 1.0);
    let s = ((b * t - f) / a).clamp(0.0, 1.0);
    (p[0] + d * s, q[0] + e * t)
}
