//! Samples of a stream that are kept, to be looked at in the end.

use crate::recording::untouched;
use vsf::core::{Belief, CoreError, UpdateReport};
use vsf::data::{Sequence, Table};
use vsf::pipeline::live::{Begins, Learner, Sample};
use vsf::pipeline::{Scene, motion_warnings, reading_warnings};

/// At most so many samples are kept, from all over the stream.
const MOST: usize = 20_000;

/// A learner whose samples are kept.
pub struct Kept<L> {
    learner: L,
    samples: Vec<(Begins, Sample)>,
    /// Every so many samples one is kept.
    every: usize,
    seen: usize,
    /// What has begun since the last one that was.
    begun: Begins,
}

impl<L> Kept<L> {
    pub fn new(learner: L) -> Self {
        Self {
            learner,
            samples: Vec::new(),
            every: 1,
            seen: 0,
            begun: Begins::Sequence,
        }
    }

    fn keep(&mut self, sample: &Sample, begins: Begins) {
        self.begun = of_both(self.begun, begins);
        if self.seen.is_multiple_of(self.every) {
            let begun = std::mem::replace(&mut self.begun, Begins::Nothing);
            self.samples.push((begun, sample.clone()));
        }
        self.seen += 1;
        if self.samples.len() == 2 * MOST {
            let pairs = self.samples.chunks_exact(2);
            // What begins between two samples begins with the next.
            let mut before = Begins::Nothing;
            let thinned = pairs.map(|pair| {
                let begun = of_both(before, pair[0].0);
                before = pair[1].0;
                (begun, pair[0].1.clone())
            });
            self.samples = thinned.collect();
            self.begun = of_both(before, self.begun);
            self.every *= 2;
        }
    }

    /// What looks wrong with them; with the readings only where these are `plain`, neither tared nor corrected.
    pub fn warnings(&self, scene: &Scene, plain: bool) -> anyhow::Result<Vec<String>> {
        let sequences = self.sequences()?;
        let all: Vec<&Sequence> = sequences.iter().collect();
        let mut found = motion_warnings(scene.robot(), &all);
        let scene = scene.clone().without_tare();
        let traces = scene.traces(&all, || {})?;
        let nothing = untouched(&scene, &traces);
        if plain && nothing.is_none() {
            found.extend(reading_warnings(&scene, &all, &traces));
        }
        let texts = found.iter().map(|w| format!("the stream: {w}"));
        let nothing = nothing.map(|e| format!("the stream: {e}"));
        Ok(texts.chain(nothing).collect())
    }

    fn sequences(&self) -> anyhow::Result<Vec<Sequence>> {
        let mut sequences = Vec::new();
        let parts = (self.samples).chunk_by(|_, (begun, _)| *begun != Begins::Sequence);
        for (number, part) in parts.enumerate() {
            let samples = || part.iter().map(|(_, sample)| sample);
            let joints = part[0].1.q.len();
            let angles = samples().flat_map(|s| s.q.iter().copied()).collect();
            let torques = samples().flat_map(|s| s.tau.iter().copied()).collect();
            let starts = part.iter().enumerate().skip(1);
            let starts = starts.filter(|(_, (begun, _))| *begun == Begins::Touch);
            sequences.push(Sequence {
                touch_starts: std::iter::once(0)
                    .chain(starts.map(|(row, _)| row))
                    .collect(),
                ..Sequence::new(
                    (number + 1).to_string(),
                    samples().map(|s| s.t).collect(),
                    Table::new(joints, angles)?,
                    Table::new(joints, torques)?,
                )
            });
        }
        Ok(sequences)
    }
}

/// What has begun where this and that has.
fn of_both(a: Begins, b: Begins) -> Begins {
    match (a, b) {
        (Begins::Sequence, _) | (_, Begins::Sequence) => Begins::Sequence,
        (Begins::Touch, _) | (_, Begins::Touch) => Begins::Touch,
        _ => Begins::Nothing,
    }
}

impl<L: Learner> Learner for Kept<L> {
    type Error = L::Error;

    fn joints(&self) -> usize {
        self.learner.joints()
    }

    fn tare(&mut self, sample: &Sample, begins: Begins, last: bool) -> Result<(), L::Error> {
        self.learner.tare(sample, begins, last)?;
        self.keep(sample, begins);
        Ok(())
    }

    fn learn(&mut self, sample: &Sample, begins: Begins) -> Result<Option<UpdateReport>, L::Error> {
        let report = self.learner.learn(sample, begins)?;
        self.keep(sample, begins);
        Ok(report)
    }

    fn touching(&self) -> &[u32] {
        self.learner.touching()
    }

    fn stiffness(&self, point: usize) -> [f64; 2] {
        self.learner.stiffness(point)
    }

    fn field(&self) -> Result<Belief<f64>, CoreError> {
        self.learner.field()
    }

    fn points(&self) -> usize {
        self.learner.points()
    }
}
