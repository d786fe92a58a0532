//! Interface of the objects of a world.

use crate::arm::{JOINTS, Touch, WorldCapsule};
use crate::effect::Effect;
use crate::material::Material;
use nalgebra::{Isometry3, Point3, Unit, Vector3};
use rand_pcg::Pcg64Mcg;

/// The arm as seen by an object, in the frame of the object.
pub(crate) struct Meeting<'a> {
    pub capsules: &'a [WorldCapsule],
    /// Motion of every link since the last step: new pose times the inverse of the old one.
    pub motion: &'a [Isometry3<f64>; JOINTS + 1],
    /// Time since the last step \[s\].
    pub dt: f64,
}

/// A place to push at.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Site {
    pub point: Point3<f64>,
    /// Direction into the object.
    pub inward: Unit<Vector3<f64>>,
    /// Depth of the first push \[m\].
    pub depth: f64,
}

/// Parameters of surfaces and material.
#[derive(Debug, Clone)]
pub(crate) struct Physics {
    pub material: Material,
    /// Friction coefficient.
    pub friction: f64,
    /// Displacement whose spring force the surfaces bear in tension \[m\], and the contact time until they do \[s\].
    pub adhesion: Option<(f64, f64)>,
    /// Factor on the springs between neighbors.
    pub coupling: f64,
}

impl Physics {
    pub fn new(friction: f64, effects: &[Effect]) -> Self {
        let mut physics = Self {
            material: Material::new(effects),
            friction,
            adhesion: None,
            coupling: 1.0,
        };
        for effect in effects {
            match *effect {
                Effect::ContactFriction { log_ratio } => physics.friction *= log_ratio.exp(),
                Effect::Adhesion { stretch_m, dwell_s } => {
                    physics.adhesion = Some((stretch_m, dwell_s));
                }
                Effect::SpatialCoupling { factor } => physics.coupling = factor,
                _ => {}
            }
        }
        physics
    }
}

/// A soft object to touch. It lives in its own frame, which a session may move.
pub(crate) trait Object {
    /// Restores the state before any touch, with this physics.
    fn reset(&mut self, physics: &Physics);

    /// Advances by one step. Adds the forces on the arm to `touches`, in the object's frame.
    fn step(&mut self, arm: &Meeting<'_>, touches: &mut Vec<Touch>);

    /// Lets the object recover for a time without the arm \[s\].
    fn recover(&mut self, seconds: f64);

    /// A place to push at, seen from the arm's base at `from`.
    fn site(&self, from: &Point3<f64>, rng: &mut Pcg64Mcg) -> Option<Site>;

    /// Number of its places at rest within a capsule.
    fn overlap(&self, capsule: &WorldCapsule) -> usize;

    /// True if a point of a regular grid represents the object: within it or not far outside.
    fn covers(&self, point: &Point3<f64>) -> bool;

    /// Smallest and largest corner of the bounding box.
    fn bounds(&self) -> [Point3<f64>; 2];

    /// Multiplies the stiffness by `factor`.
    fn scale_stiffness(&mut self, factor: f64);
}
