//! What an object of a world can do.

use crate::arm::{JOINTS, Touch, WorldCapsule};
use crate::effect::Effect;
use crate::material::Material;
use nalgebra::{Isometry3, Point3, Unit, Vector3};
use rand_pcg::Pcg64Mcg;

/// The arm as an object meets it, in the frame of the object.
pub(crate) struct Meeting<'a> {
    pub capsules: &'a [WorldCapsule],
    /// Motion of every link since the last step: new pose times inverse of the old.
    pub motion: &'a [Isometry3<f64>; JOINTS + 1],
    /// Time since the last step \[s\].
    pub dt: f64,
}

/// A place to push at.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Site {
    pub point: Point3<f64>,
    /// Into the object.
    pub inward: Unit<Vector3<f64>>,
    /// How far to push at first \[m\].
    pub depth: f64,
}

/// How surfaces meet and matter answers.
#[derive(Debug, Clone)]
pub(crate) struct Physics {
    pub material: Material,
    /// Friction coefficient.
    pub friction: f64,
    /// Displacement whose spring force the surfaces bear in tension \[m\], and the time \[s\] of
    /// contact until they do.
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

/// Something soft to touch. It lives in its own frame, which a session may move.
pub(crate) trait Object {
    /// Brings it back to its state before any touch, with this physics.
    fn reset(&mut self, physics: &Physics);

    /// Moves it one step on. Adds the forces on the arm to `touches`, in the object's frame.
    fn step(&mut self, arm: &Meeting<'_>, touches: &mut Vec<Touch>);

    /// Lets it come to rest without the arm for a time \[s\].
    fn recover(&mut self, seconds: f64);

    /// A place to push at, seen from the arm's base at `from`.
    fn site(&self, from: &Point3<f64>, rng: &mut Pcg64Mcg) -> Option<Site>;

    /// How many of its places at rest lie within a capsule.
    fn overlap(&self, capsule: &WorldCapsule) -> usize;

    /// True if a point of a regular grid stands for it: within it or not far outside.
    fn covers(&self, point: &Point3<f64>) -> bool;

    /// Smallest and largest corner.
    fn bounds(&self) -> [Point3<f64>; 2];

    /// Makes it `factor` times as stiff.
    fn scale_stiffness(&mut self, factor: f64);
}
