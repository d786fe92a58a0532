use crate::ContactConfig;
use crate::lanes::{Mask, Number, Triple};
use crate::slide::{DETACHED, STICKS, Slides, longest};
use crate::surface::{PROJECTION_STEPS, PROJECTION_TOLERANCE};
use pulp::Simd;

/// Tangential displacement that always sticks (m): rounding without friction.
const STICK_TOLERANCE: f64 = 1e-9;
/// A run of several slip steps is beyond a bend when the normal has turned by more than this (rad),
/// or the gap to the surface at its end is more than this share of its length.
const MAX_TURN: f64 = 0.15;
const MAX_GAP: f64 = 0.1;
/// Least share of the decrease of `|u|²` on a plane that a slip step must reach, to first order in its length.
const WEDGED: f64 = 0.05;

/// Evaluates the runs of one vector of lanes by the samples at their ends, and plans the next ones.
#[inline(always)]
pub(crate) fn advance<S: Simd>(simd: S, lanes: &mut Slides, config: &ContactConfig, v: usize) {
    let all = |value| Number::splat(simd, value);
    let (zero, one) = (all(0.0), all(1.0));
    let (step, longest) = (all(config.slip_step), all(longest(config)));
    let friction = all(config.friction);
    let rest = Triple::load(simd, &lanes.rest, v);
    let mut place = Triple::load(simd, &lanes.place, v);
    let mut normal = Triple::load(simd, &lanes.normal, v);
    let mut rate = Number::load(simd, &lanes.rate, v);
    let mut most = Number::load(simd, &lanes.most, v);
    let mut left = Number::load(simd, &lanes.left, v);
    let state = Number::load(simd, &lanes.state, v);
    let run = Run::load(simd, lanes, v);
    let mut pull = Pull::new(place, normal, rest, friction);

    // One correction of the end of the run, along the normal there.
    let there_normal = Triple::load(simd, &lanes.ends.normals, v);
    let gap = Number::load(simd, &lanes.ends.distances, v) - all(config.level());
    let there_place = Triple::load(simd, &lanes.ends.places, v) - there_normal * gap;
    let there = Pull::new(there_place, there_normal, rest, friction);

    let has_run = state.at_least(zero);
    let is_first = has_run & state.at_most(zero);
    let is_long = run.is_single & run.steps.above(one);
    let turn = there_normal - normal;
    let is_turned = turn.dot(turn).above(all(MAX_TURN * MAX_TURN));
    let most_gap = all(MAX_GAP) * run.way;
    let against = zero - run.direction.dot(there_normal);
    let is_wall = gap.below(zero - most_gap) & is_turned & against.above(zero);
    let is_bend = is_first & is_long & !is_wall & (is_turned | gap.abs().above(most_gap));
    let meets_wall = is_first & run.is_single & is_wall;
    let mut is_tried_again = is_bend;
    let mut crease = None;
    if meets_wall.any() {
        let free = run.way + gap / against;
        let has_room = meets_wall & free.at_least(step);
        most = has_room.pick((free / step).floor(), most);
        let (exists, slip) = pull.along_crease(normal, there_normal, friction);
        let takes_crease = meets_wall & !has_room & exists;
        rate = takes_crease.pick(one, rate);
        is_tried_again = is_tried_again | has_room | takes_crease;
        crease = Some((takes_crease, slip));
    }

    let is_close = gap.abs().at_most(all(PROJECTION_TOLERANCE));
    let is_last = state.at_least(all((PROJECTION_STEPS - 1) as f64));
    let is_corrected = is_close | is_last;
    let goes_on = has_run & !is_tried_again & !is_corrected;
    let is_ended = has_run & !is_tried_again & is_corrected;
    let plane = all(2.0 * WEDGED) * run.length * run.way;
    let is_wedged = is_ended & (pull.square - there.square).below(plane);
    let gives_up = is_wedged & run.steps.at_most(one);
    let decrease = pull.excess - there.excess;
    let is_past = is_ended & !is_wedged & is_long & there.excess.below(zero - step);
    let is_taken = is_ended & !is_wedged & !is_past;

    most = (is_bend | is_wedged).pick((run.steps * all(0.25)).floor(), most);
    if is_past.any() {
        // Back to the first step in the cone, by the secant.
        let secant = (pull.excess / decrease * run.steps).ceil();
        most = is_past.pick(secant.min(run.steps - one), most);
    }
    most = is_taken.pick((run.steps + run.steps).min(longest), most);
    let slope = (decrease / run.way).max(all(0.1)).min(all(2.0));
    rate = is_taken.pick(run.is_single.pick(slope, one), rate);
    left = is_taken.pick(left - run.steps.floor(), left);
    place = is_taken.pick3(there_place, place);
    normal = is_taken.pick3(there_normal, normal);
    pull = pull.replaced(is_taken, &there);

    let mut slips =
        pull.normal.at_least(zero) & pull.excess.above(zero) & left.above(zero) & !gives_up;
    let mut slip = pull.along_surface();
    let mut is_single = zero.at_most(one);
    if let Some((takes_crease, crease)) = crease {
        slip = slip.replaced(takes_crease, &crease);
        is_single = !takes_crease;
        slips = slips & slip.excess.above(zero);
    }
    let wanted = (slip.excess / (rate * step)).min(left).ceil();
    let steps = wanted.min(most).max(one);
    let next = Run {
        direction: slip.direction,
        length: slip.length,
        steps,
        way: (steps * step).min(slip.length),
        is_single,
    };
    let end = goes_on.pick3(there_place, place + next.direction * next.way);

    let adhesion = all(config.adhesion * config.adhesion);
    let holds = pull.normal.at_least(zero) | pull.square.at_most(adhesion);
    let done = holds.pick(all(STICKS), all(DETACHED));
    let state = goes_on.pick(state + one, slips.pick(zero, done));

    place.store(&mut lanes.place, v);
    normal.store(&mut lanes.normal, v);
    rate.store(&mut lanes.rate, v);
    most.store(&mut lanes.most, v);
    left.store(&mut lanes.left, v);
    state.store(&mut lanes.state, v);
    end.store(&mut lanes.ends.places, v);
    next.replaced(goes_on, &run).store(simd, lanes, v);
}

/// Several slip steps at once.
struct Run<S: Simd> {
    direction: Triple<S>,
    /// Part of `u` against that direction (m).
    length: Number<S>,
    steps: Number<S>,
    way: Number<S>,
    /// Along one surface, not a crease.
    is_single: Mask<S>,
}

impl<S: Simd> Run<S> {
    #[inline(always)]
    fn load(simd: S, lanes: &Slides, v: usize) -> Self {
        Self {
            direction: Triple::load(simd, &lanes.direction, v),
            length: Number::load(simd, &lanes.length, v),
            steps: Number::load(simd, &lanes.steps, v),
            way: Number::load(simd, &lanes.way, v),
            is_single: Number::load(simd, &lanes.single, v).above(Number::splat(simd, 0.0)),
        }
    }

    #[inline(always)]
    fn store(&self, simd: S, lanes: &mut Slides, v: usize) {
        let single = (self.is_single).pick(Number::splat(simd, 1.0), Number::splat(simd, 0.0));
        self.direction.store(&mut lanes.direction, v);
        self.length.store(&mut lanes.length, v);
        self.steps.store(&mut lanes.steps, v);
        self.way.store(&mut lanes.way, v);
        single.store(&mut lanes.single, v);
    }

    #[inline(always)]
    fn replaced(&self, mask: Mask<S>, by: &Self) -> Self {
        Self {
            direction: mask.pick3(by.direction, self.direction),
            length: mask.pick(by.length, self.length),
            steps: mask.pick(by.steps, self.steps),
            way: mask.pick(by.way, self.way),
            is_single: mask & by.is_single | !mask & self.is_single,
        }
    }
}

/// The displacement `u` of a point, in parts.
#[derive(Clone, Copy)]
struct Pull<S: Simd> {
    square: Number<S>,
    normal: Number<S>,
    tangent: Triple<S>,
    length: Number<S>,
    /// By how much the tangential part exceeds the friction cone (m).
    excess: Number<S>,
}

/// Where a point slips to.
struct Slip<S: Simd> {
    direction: Triple<S>,
    /// Part of `u` against that direction (m), and by how much friction does not hold it.
    length: Number<S>,
    excess: Number<S>,
}

impl<S: Simd> Slip<S> {
    #[inline(always)]
    fn replaced(&self, mask: Mask<S>, by: &Self) -> Self {
        Self {
            direction: mask.pick3(by.direction, self.direction),
            length: mask.pick(by.length, self.length),
            excess: mask.pick(by.excess, self.excess),
        }
    }
}

impl<S: Simd> Pull<S> {
    #[inline(always)]
    fn new(place: Triple<S>, n: Triple<S>, rest: Triple<S>, friction: Number<S>) -> Self {
        let u = place - rest;
        let normal = u.dot(n);
        let tangent = u - n * normal;
        let length = tangent.norm();
        Self {
            square: u.dot(u),
            normal,
            tangent,
            length,
            excess: length - friction * normal - normal.all(STICK_TOLERANCE),
        }
    }

    #[inline(always)]
    fn replaced(&self, mask: Mask<S>, by: &Self) -> Self {
        Self {
            square: mask.pick(by.square, self.square),
            normal: mask.pick(by.normal, self.normal),
            tangent: mask.pick3(by.tangent, self.tangent),
            length: mask.pick(by.length, self.length),
            excess: mask.pick(by.excess, self.excess),
        }
    }

    #[inline(always)]
    fn along_surface(&self) -> Slip<S> {
        Slip {
            direction: self.tangent * (self.length.all(-1.0) / self.length),
            length: self.length,
            excess: self.excess,
        }
    }

    /// Slip of a point between two surfaces, which bear `u` in proportion to its parts along their
    /// normals, each with its own friction; and whether both of them bear.
    #[inline(always)]
    fn along_crease(
        &self,
        one: Triple<S>,
        other: Triple<S>,
        friction: Number<S>,
    ) -> (Mask<S>, Slip<S>) {
        let all = |value| friction.all(value);
        let u = one * self.normal + self.tangent;
        let cosine = one.dot(other);
        let (p, q) = (u.dot(one), u.dot(other));
        let scale = all(1.0) / (all(1.0) - cosine * cosine);
        let a = (p - cosine * q) * scale;
        let b = (q - cosine * p) * scale;
        let along = u - one * a - other * b;
        let length = along.norm();
        let slip = Slip {
            direction: along * (all(-1.0) / length.max(all(STICK_TOLERANCE))),
            length,
            excess: length - friction * (a + b) - all(STICK_TOLERANCE),
        };
        (a.above(all(0.0)) & b.above(all(0.0)), slip)
    }
}
