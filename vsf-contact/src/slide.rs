use crate::lanes::{LANES, Row, dispatch, vectors};
use crate::slip::advance;
use crate::surface::{Anchor, Surface};
use crate::{Batch, ContactConfig};
use nalgebra::{Point3, Vector3};
use pulp::{Simd, WithSimd};

/// A point that may slip: its place on the surface and its rest position, in the link's frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slider {
    pub anchor: Anchor,
    pub rest_L: Point3<f64>,
}

impl Surface<'_> {
    /// Slips points until they stick. `next` supplies the points with their numbers. `done` gets each
    /// number back with the new anchor and whether the point stays in contact.
    ///
    /// Steps are taken in runs of at most the threshold's length: straight along the tangent, then back
    /// to the surface. On a plane this equals single steps exactly. A run that ends beyond a bend,
    /// shortens `u` too little or ends more than a slip step inside of the friction cone is retried
    /// with fewer steps, in the end with one. Where another surface is in the way, the point slips along
    /// the crease between the two.
    ///
    /// Every point occupies a lane until it is done. The next point then takes over that lane.
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

/// States of a lane without a run, see [`Slides::state`].
pub(crate) const FRESH: f64 = -1.0;
pub(crate) const DETACHED: f64 = -2.0;
pub(crate) const STICKS: f64 = -3.0;

/// Points that slip, one in each lane.
pub(crate) struct Slides {
    len: usize,
    numbers: [usize; LANES],
    pub rest: [Row; 3],
    pub place: [Row; 3],
    pub normal: [Row; 3],
    /// Decrease of the excess per way, 1 on a plane.
    pub rate: Row,
    /// Most steps of the next run, and of all that are left.
    pub most: Row,
    pub left: Row,
    /// The run being tried: `direction`, the component of `u` against it (`length`, m), number of `steps`,
    /// distance covered (`way`, m), and whether it follows one surface (`single` 1) or a crease (0).
    pub direction: [Row; 3],
    pub length: Row,
    pub steps: Row,
    pub way: Row,
    pub single: Row,
    /// Number of corrections at the end of the run, or one of the states above.
    pub state: Row,
    /// Where runs end, or the last correction led.
    pub ends: Batch,
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

/// Most steps of a run, not always whole.
pub(crate) fn longest(config: &ContactConfig) -> f64 {
    (config.threshold / config.slip_step).max(1.0)
}

/// Advances every lane according to the samples at the ends of the runs.
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
