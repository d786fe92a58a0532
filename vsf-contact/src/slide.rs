use crate::lanes::{LANES, Mask, Number, Row, Triple, dispatch, vectors};
use crate::surface::{Anchor, PROJECTION_STEPS, PROJECTION_TOLERANCE, Surface};
use crate::{Batch, ContactConfig};
use nalgebra::{Point3, Vector3};
use pulp::{Simd, WithSimd};

/// Tangential displacement that always sticks (m): rounding without friction.
const STICK_TOLERANCE: f64 = 1e-9;
/// A run of several slip steps is beyond a bend when the normal has turned by more than this (rad),
/// or the gap to the surface at its end is more than this share of its length.
const MAX_TURN: f64 = 0.15;
const MAX_GAP: f64 = 0.1;
/// Least share of the decrease of `|u|²` on a plane that a slip step must reach.
const WEDGED: f64 = 0.05;

/// A point that is to slip: its place on the surface and where it would rest, in the link's frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slider {
    pub anchor: Anchor,
    pub rest_L: Point3<f64>,
}

impl Surface<'_> {
    /// Slips points until they stick, and gives back each of them, by the number it came with, with
    /// its new anchor and whether it stays in contact.
    ///
    /// Steps are taken in runs of at most a threshold's length, straight along the tangent and back
    /// to the surface. On a plane that is exactly what single steps do. A run that ends beyond a
    /// bend, shortens `u` too little or ends more than a slip step inside of the friction cone is
    /// tried again with fewer steps, at last with one. Where another surface is in the way the point
    /// slips along the crease between the two.
    ///
    /// Every point keeps a lane to itself until it is done. The next one then takes its place.
    pub fn slide(
        &self,
        mut next: impl FnMut() -> Option<(usize, Slider)>,
        mut done: impl FnMut(usize, Anchor, bool),
    ) {
        let mut lanes = Slides::new();
        loop {
            while lanes.len < LANES
                && let Some((number, slider)) = next()
            {
                lanes.push(number, &slider, self.config);
            }
            if lanes.len == 0 {
                return;
            }
            dispatch(Advance {
                lanes: &mut lanes,
                config: self.config,
            });
            lanes.retire(&mut done);
            lanes.ends.start(lanes.len);
            self.sdf.unite(&mut lanes.ends);
        }
    }
}

/// What a lane has to do next, by [`Slides::state`].
const FRESH: f64 = -1.0;
const DETACHED: f64 = -2.0;
const STICKS: f64 = -3.0;

/// Points that slip, one in each lane.
struct Slides {
    len: usize,
    numbers: [usize; LANES],
    rest: [Row; 3],
    place: [Row; 3],
    normal: [Row; 3],
    /// Decrease of the excess per way, 1 on a plane.
    rate: Row,
    /// Most steps of the next run, and of all that are left.
    most: Row,
    left: Row,
    /// The run that is tried: its direction, the part of `u` against that (m), its steps and
    /// length, and whether it is along one surface (1) or a crease (0).
    direction: [Row; 3],
    length: Row,
    steps: Row,
    way: Row,
    single: Row,
    /// Number of corrections at the end of the run, or one of the states above.
    state: Row,
    /// Where runs end, or the last correction led.
    ends: Batch,
}

impl Slides {
    fn new() -> Self {
        let row = [0.0; LANES];
        Self {
            len: 0,
            numbers: [0; LANES],
            rest: [row; 3],
            place: [row; 3],
            normal: [row; 3],
            rate: row,
            most: row,
            left: row,
            direction: [row; 3],
            length: row,
            steps: row,
            way: row,
            single: row,
            state: row,
            ends: Batch::new(),
        }
    }

    fn push(&mut self, number: usize, slider: &Slider, config: &ContactConfig) {
        let i = self.len;
        self.numbers[i] = number;
        let Anchor { place_L, normal_L } = slider.anchor;
        for a in 0..3 {
            self.rest[a][i] = slider.rest_L[a];
            self.place[a][i] = place_L[a];
            self.normal[a][i] = normal_L[a];
        }
        self.rate[i] = 1.0;
        self.most[i] = longest(config);
        self.left[i] = f64::from(config.max_slip_iterations);
        self.state[i] = FRESH;
        self.len += 1;
    }

    /// Takes out the lanes that are done; the last ones fill the gaps.
    fn retire(&mut self, mut done: impl FnMut(usize, Anchor, bool)) {
        let (mut ready, mut count) = ([0; LANES], 0);
        for i in 0..self.len {
            ready[count] = i;
            count += usize::from(self.state[i] < 0.0);
        }
        // From the back, so that the last lane is never one that is done.
        for &i in ready[..count].iter().rev() {
            let at = |rows: &[Row; 3]| Vector3::from_fn(|a, _| rows[a][i]);
            let anchor = Anchor {
                place_L: at(&self.place).into(),
                normal_L: at(&self.normal),
            };
            done(self.numbers[i], anchor, self.state[i] == STICKS);
            self.len -= 1;
            self.copy_lane(self.len, i);
        }
    }

    fn copy_lane(&mut self, from: usize, to: usize) {
        self.numbers[to] = self.numbers[from];
        let triples = [
            &mut self.rest,
            &mut self.place,
            &mut self.normal,
            &mut self.direction,
            &mut self.ends.places,
        ];
        for row in triples.into_iter().flatten() {
            row[to] = row[from];
        }
        for row in [
            &mut self.rate,
            &mut self.most,
            &mut self.left,
            &mut self.length,
            &mut self.steps,
            &mut self.way,
            &mut self.single,
            &mut self.state,
        ] {
            row[to] = row[from];
        }
    }
}

/// Most steps of a run.
fn longest(config: &ContactConfig) -> f64 {
    (config.threshold / config.slip_step).max(1.0)
}

/// Judges the runs by the samples at their ends and plans the next ones.
struct Advance<'a> {
    lanes: &'a mut Slides,
    config: &'a ContactConfig,
}

impl WithSimd for Advance<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for v in 0..vectors::<S>(self.lanes.len) {
            advance(simd, self.lanes, self.config, v);
        }
    }
}

#[inline(always)]
fn advance<S: Simd>(simd: S, lanes: &mut Slides, config: &ContactConfig, v: usize) {
    let all = |value| Number::splat(simd, value);
    let (zero, one) = (all(0.0), all(1.0));
    let (step, longest) = (all(config.slip_step), all(longest(config)));
    let friction = all(config.friction);
    let rest = Triple::load(simd, &lanes.rest, v);
    let place = Triple::load(simd, &lanes.place, v);
    let normal = Triple::load(simd, &lanes.normal, v);
    let mut rate = Number::load(simd, &lanes.rate, v);
    let mut most = Number::load(simd, &lanes.most, v);
    let left = Number::load(simd, &lanes.left, v);
    let direction = Triple::load(simd, &lanes.direction, v);
    let length = Number::load(simd, &lanes.length, v);
    let steps = Number::load(simd, &lanes.steps, v);
    let way = Number::load(simd, &lanes.way, v);
    let is_single = Number::load(simd, &lanes.single, v).above(zero);
    let state = Number::load(simd, &lanes.state, v);
    let pull = Pull::new(place, normal, rest, friction);

    // One correction of the end of the run, along the normal there.
    let there_normal = Triple::load(simd, &lanes.ends.normals, v);
    let gap = Number::load(simd, &lanes.ends.distances, v) - all(config.level());
    let there_place = Triple::load(simd, &lanes.ends.places, v) - there_normal * gap;
    let there = Pull::new(there_place, there_normal, rest, friction);

    let is_run = state.at_least(zero);
    let is_first = is_run & state.at_most(zero);
    let is_long = is_single & steps.above(one);
    let turn = there_normal - normal;
    let is_turned = turn.dot(turn).above(all(MAX_TURN * MAX_TURN));
    let most_gap = all(MAX_GAP) * way;
    let against = zero - direction.dot(there_normal);
    let is_wall = gap.below(zero - most_gap) & is_turned & against.above(zero);
    let is_bend = is_first & is_long & !is_wall & (is_turned | gap.abs().above(most_gap));
    let meets_wall = is_first & is_single & is_wall;
    let mut is_blocked = is_bend;
    let mut crease = None;
    if meets_wall.any() {
        let free = way + gap / against;
        let has_room = meets_wall & free.at_least(step);
        most = has_room.pick((free / step).floor(), most);
        let (exists, slip) = pull.along_crease(normal, there_normal, friction);
        let takes_crease = meets_wall & !has_room & exists;
        rate = takes_crease.pick(one, rate);
        is_blocked = is_blocked | has_room | takes_crease;
        crease = Some((takes_crease, slip));
    }

    let is_open = is_run & !is_blocked;
    let is_close = gap.abs().at_most(all(PROJECTION_TOLERANCE));
    let is_last = state.at_least(all((PROJECTION_STEPS - 1) as f64));
    let goes_on = is_open & !is_close & !is_last;
    let is_ended = is_open & !goes_on;
    let plane = all(2.0 * WEDGED) * length * way;
    let is_wedged = is_ended & (pull.square - there.square).below(plane);
    let gives_up = is_wedged & steps.at_most(one);
    let decrease = pull.excess - there.excess;
    let is_past = is_ended & !is_wedged & is_long & there.excess.below(zero - step);
    let is_taken = is_ended & !is_wedged & !is_past;

    most = (is_bend | is_wedged).pick((steps * all(0.25)).floor(), most);
    if is_past.any() {
        // Back to the first step in the cone, by the secant.
        let secant = (pull.excess / decrease * steps).ceil();
        most = is_past.pick(secant.min(steps - one), most);
    }
    most = is_taken.pick((steps + steps).min(longest), most);
    let slope = (decrease / way).max(all(0.1)).min(all(2.0));
    rate = is_taken.pick(is_single.pick(slope, one), rate);
    let left = is_taken.pick(left - steps.floor(), left);
    let place = is_taken.pick3(there_place, place);
    let normal = is_taken.pick3(there_normal, normal);
    let pull = pull.replaced(is_taken, &there);

    let mut slips =
        pull.normal.at_least(zero) & pull.excess.above(zero) & left.above(zero) & !gives_up;
    let mut slip = pull.along_surface();
    let mut single = one;
    if let Some((takes_crease, crease)) = crease {
        slip = slip.replaced(takes_crease, &crease);
        single = takes_crease.pick(zero, one);
        slips = slips & slip.excess.above(zero);
    }
    let wanted = (slip.excess / (rate * step)).min(left).ceil();
    let next_steps = wanted.min(most).max(one);
    let next_way = (next_steps * step).min(slip.length);
    let next_end = place + slip.direction * next_way;

    let adhesion = all(config.adhesion * config.adhesion);
    let holds = pull.normal.at_least(zero) | pull.square.at_most(adhesion);
    let done = holds.pick(all(STICKS), all(DETACHED));
    let state = goes_on.pick(state + one, slips.pick(zero, done));

    rate.store(&mut lanes.rate, v);
    most.store(&mut lanes.most, v);
    left.store(&mut lanes.left, v);
    place.store(&mut lanes.place, v);
    normal.store(&mut lanes.normal, v);
    state.store(&mut lanes.state, v);
    let kept = |old, new| goes_on.pick(old, new);
    kept(length, slip.length).store(&mut lanes.length, v);
    kept(steps, next_steps).store(&mut lanes.steps, v);
    kept(way, next_way).store(&mut lanes.way, v);
    kept(is_single.pick(one, zero), single).store(&mut lanes.single, v);
    let direction = goes_on.pick3(direction, slip.direction);
    direction.store(&mut lanes.direction, v);
    let end = goes_on.pick3(there_place, next_end);
    end.store(&mut lanes.ends.places, v);
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
