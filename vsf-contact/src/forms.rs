//! Signed distances in closed form, for many points at once, each shape in its own frame.

use crate::lanes::{Number, Triple};
use nalgebra::{Vector2, Vector3};
use pulp::Simd;

/// Lengths below this have no direction \[m\]; their squares would lose digits.
const TINY: f64 = 1e-100;

pub(crate) trait Form {
    /// Distances, and outward unit normals for when they are wanted.
    fn sample<S: Simd>(&self, p: Triple<S>) -> (Number<S>, impl FnOnce() -> Triple<S>);
}

/// Balls along z from `bottom` over `length`; the cone between has slope (`sine`, `cosine`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SweptBall {
    pub bottom: f64,
    pub length: f64,
    pub radius_bottom: f64,
    pub radius_top: f64,
    pub sine: f64,
    pub cosine: f64,
}

/// A core cylinder, grown by `rounding`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RoundedCylinder {
    pub core: Vector2<f64>,
    pub rounding: f64,
}

/// A core box, grown by `rounding`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RoundedBox {
    pub core: Vector3<f64>,
    pub rounding: f64,
}

impl Form for SweptBall {
    #[inline(always)]
    fn sample<S: Simd>(&self, p: Triple<S>) -> (Number<S>, impl FnOnce() -> Triple<S>) {
        let all = move |value| p.x.all(value);
        let (sine, cosine) = (all(self.sine), all(self.cosine));
        let radial = (p.x * p.x + p.y * p.y).sqrt();
        let z = p.z - all(self.bottom);
        // Position along the cone's side, which ends at cosine * length.
        let along = cosine * z - sine * radial;
        // The centers of both ends belong to the side, whose normal is right there.
        let below = along.below(all(0.0));
        let on_side = !below & along.at_most(all(self.cosine * self.length));
        let from_side = cosine * radial + sine * z - all(self.radius_bottom);
        let end = Triple {
            z: z - below.pick(all(0.0), all(self.length)),
            ..p
        };
        let apart = end.norm();
        let from_end = apart - below.pick(all(self.radius_bottom), all(self.radius_top));
        let normal = move || {
            let away = Away::new(p, radial);
            let side = away.side();
            let slope = Triple {
                x: cosine * side.x,
                y: cosine * side.y,
                z: sine,
            };
            let is_apart = apart.above(all(TINY));
            let round = is_apart.pick3(end * (all(1.0) / apart), side);
            on_side.pick3(slope, round)
        };
        (on_side.pick(from_side, from_end), normal)
    }
}

impl Form for RoundedCylinder {
    #[inline(always)]
    fn sample<S: Simd>(&self, p: Triple<S>) -> (Number<S>, impl FnOnce() -> Triple<S>) {
        let all = move |value| p.x.all(value);
        let (zero, one) = (all(0.0), all(1.0));
        let radial = (p.x * p.x + p.y * p.y).sqrt();
        let x = radial - all(self.core.x);
        let y = p.z.abs() - all(self.core.y);
        let (out_x, out_y) = (x.max(zero), y.max(zero));
        let out = (out_x * out_x + out_y * out_y).sqrt();
        let (is_outside, is_side) = (out.above(all(TINY)), x.at_least(y));
        let distance = is_outside.pick(out, is_side.pick(x, y)) - all(self.rounding);
        let normal = move || {
            let n_x = is_outside.pick(out_x, is_side.pick(one, zero));
            let n_y = is_outside.pick(out_y, is_side.pick(zero, one));
            let away = Away::new(p, radial);
            // One division makes unit vectors of both `n` and `away`.
            let scale = one / (is_outside.pick(out, one) * away.length);
            Triple {
                x: n_x * away.x * scale,
                y: n_x * away.y * scale,
                z: n_y * away.length * scale * p.z.sign(),
            }
        };
        (distance, normal)
    }
}

impl Form for RoundedBox {
    #[inline(always)]
    fn sample<S: Simd>(&self, p: Triple<S>) -> (Number<S>, impl FnOnce() -> Triple<S>) {
        let all = move |value| p.x.all(value);
        let (zero, one) = (all(0.0), all(1.0));
        let q = Triple {
            x: p.x.abs() - all(self.core.x),
            y: p.y.abs() - all(self.core.y),
            z: p.z.abs() - all(self.core.z),
        };
        let outward = q.map(|x| x.max(zero));
        let out = outward.norm();
        let is_outside = out.above(all(TINY));
        // Of the nearest face, the first of several.
        let is_x = q.x.at_least(q.y) & q.x.at_least(q.z);
        let is_y = !is_x & q.y.at_least(q.z);
        let depth = is_x.pick(q.x, is_y.pick(q.y, q.z));
        let normal = move || {
            let face = Triple {
                x: is_x.pick(one, zero),
                y: is_y.pick(one, zero),
                z: (is_x | is_y).pick(zero, one),
            };
            let n = is_outside.pick3(outward * (one / out), face);
            n.zip(p, |n, x| n * x.sign())
        };
        (is_outside.pick(out, depth) - all(self.rounding), normal)
    }
}

/// The way from the z axis to a point, +x for points on the axis.
struct Away<S: Simd> {
    x: Number<S>,
    y: Number<S>,
    length: Number<S>,
}

impl<S: Simd> Away<S> {
    #[inline(always)]
    fn new(p: Triple<S>, radial: Number<S>) -> Self {
        let (zero, one) = (radial.all(0.0), radial.all(1.0));
        let is_off = radial.above(radial.all(TINY));
        Self {
            x: is_off.pick(p.x, one),
            y: is_off.pick(p.y, zero),
            length: is_off.pick(radial, one),
        }
    }

    #[inline(always)]
    fn side(&self) -> Triple<S> {
        let scale = self.length.all(1.0) / self.length;
        Triple {
            x: self.x * scale,
            y: self.y * scale,
            z: scale.all(0.0),
        }
    }
}
