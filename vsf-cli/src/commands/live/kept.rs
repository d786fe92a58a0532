//! Samples of a stream that are kept, to be looked at in the end.

use crate::corrected::CorrectedModel;
use vsf::core::{Belief, CoreError, UpdateReport, median};
use vsf::data::{Dataset, Sequence, Splits, Table, TorqueKind};
use vsf::pipeline::live::{Begins, Learner, Sample};
use vsf::pipeline::{Scene, motion_warnings, reading_warnings};

/// A stretch has so many samples at least, and ends where nothing is touched, but for one of so many.
const LEAST: usize = 1_000;
const MOST: usize = 2_500;
/// Between so many stretches and twice as many are kept of a long stream, from all over it.
const STRETCHES: usize = 16;

/// A learner whose samples are kept, in stretches that begin and end in free air.
pub struct Kept<L> {
    learner: L,
    kept: Vec<Stretch>,
    now: Stretch,
    /// Every so many stretches one is kept, of so many that there were.
    every: usize,
    seen: usize,
    /// Whether the arm is in a touch that has been cut off.
    cut: bool,
    /// Whether all samples have been kept since the last stretch ended.
    goes_on: bool,
}

/// Samples, and what is taken as zero of their loads (N m or N).
#[derive(Default)]
struct Stretch {
    samples: Vec<(Begins, Sample)>,
    zero: Vec<f64>,
    /// Its place among all that there were, and whether it goes on from the one before.
    place: usize,
    follows: bool,
}

impl<L: Learner> Kept<L> {
    pub fn new(learner: L) -> Self {
        Self {
            learner,
            kept: Vec::new(),
            now: Stretch::default(),
            every: 1,
            seen: 0,
            cut: false,
            goes_on: false,
        }
    }

    fn keep(&mut self, sample: &Sample, begins: Begins) {
        let is_free = self.learner.touching().is_empty();
        self.cut &= !is_free;
        if begins == Begins::Sequence {
            self.end();
        }
        if self.cut {
            self.goes_on = false;
            return;
        }
        if self.now.samples.is_empty() {
            self.now.place = self.seen;
            self.now.follows = self.goes_on && begins != Begins::Sequence;
            self.goes_on = true;
        }
        self.now.zero.clear();
        self.now.zero.extend_from_slice(self.learner.zero());
        self.now.samples.push((begins, sample.clone()));
        let kept = self.now.samples.len();
        if kept >= MOST || is_free && kept >= LEAST {
            self.cut = !is_free;
            self.end();
        }
    }

    /// A stretch ends.
    fn end(&mut self) {
        let stretch = std::mem::take(&mut self.now);
        if stretch.samples.is_empty() {
            return;
        }
        if self.seen.is_multiple_of(self.every) {
            self.kept.push(stretch);
        }
        self.seen += 1;
        if self.kept.len() == 2 * STRETCHES {
            let mut odd = true;
            self.kept.retain(|_| {
                odd = !odd;
                !odd
            });
            self.every *= 2;
        }
    }

    /// Those that are kept, in their order.
    fn stretches(&self) -> impl Iterator<Item = &Stretch> {
        self.kept.iter().chain([&self.now])
    }

    /// Time from one sample to the next within a touch (s), in the median.
    pub fn step(&self) -> Option<f64> {
        let pairs = self.stretches().flat_map(|s| s.samples.windows(2));
        let steps = pairs.filter_map(|pair| {
            let [(_, before), (begins, sample)] = pair else {
                return None;
            };
            (*begins == Begins::Nothing).then_some(sample.t - before.t)
        });
        median(steps.collect())
    }

    /// What looks wrong with them, where the scene and, if there is one, a corrected model hold.
    pub fn warnings(
        &self,
        dataset: &Dataset,
        scene: &Scene,
        model: Option<&CorrectedModel>,
    ) -> anyhow::Result<Vec<String>> {
        let stretches: Vec<&Stretch> = self.stretches().collect();
        let mut sequences: Vec<Sequence> = Vec::new();
        let goes_on =
            |a: &&Stretch, b: &&Stretch| b.follows && b.place == a.place + 1 && a.zero == b.zero;
        for stretches in stretches.chunk_by(goes_on) {
            if let Some(mut sequence) = sequence(stretches, scene.torque_kind())? {
                while sequences.iter().any(|s| s.id == sequence.id) {
                    sequence.id += " again";
                }
                sequences.push(sequence);
            }
        }
        let all: Vec<&Sequence> = sequences.iter().collect();
        let mut found = motion_warnings(scene.robot(), &all);
        let scene = scene.clone().without_tare();
        let traces = match model {
            None => scene.traces(&all, || {})?,
            Some(model) => {
                let stream = Dataset {
                    sequences: sequences.clone(),
                    splits: Splits::default(),
                    ..dataset.clone()
                };
                model.traces(&stream, &scene, &all)?
            }
        };
        found.extend(reading_warnings(&scene, &all, &traces));
        let texts = found.iter().map(|w| format!("the stream: {w}"));
        let mut torques = all.iter().flat_map(|s| s.torques.data());
        let is_dead = !all.is_empty() && torques.all(|tau| *tau == 0.0);
        let dead = is_dead
            .then(|| "the stream: all torques are zero, as if nothing was measured".to_owned());
        Ok(texts.chain(dead).collect())
    }
}

/// Stretches one after the other, tared, as a sequence that is named by its time; touches of a single sample, which say nothing of
/// motion, are left out.
fn sequence(stretches: &[&Stretch], kind: TorqueKind) -> anyhow::Result<Option<Sequence>> {
    let all: Vec<&(Begins, Sample)> = stretches.iter().flat_map(|s| &s.samples).collect();
    let touches = all.chunk_by(|_, (begins, _)| *begins == Begins::Nothing);
    let (mut samples, mut starts) = (Vec::new(), Vec::new());
    for touch in touches.filter(|touch| touch.len() > 1) {
        starts.push(samples.len());
        samples.extend(touch.iter().map(|(_, sample)| sample));
    }
    let Some(first) = samples.first() else {
        return Ok(None);
    };
    let joints = first.q.len();
    let table = |of: &dyn Fn(&Sample) -> Option<&Vec<f64>>| -> anyhow::Result<Option<Table>> {
        let rows: Option<Vec<&Vec<f64>>> = samples.iter().map(|s| of(s)).collect();
        let data = rows.map(|rows| rows.into_iter().flatten().copied().collect());
        Ok(data.map(|data| Table::new(joints, data)).transpose()?)
    };
    let tables = (table(&|s| Some(&s.q))?, table(&|s| Some(&s.tau))?);
    let (Some(angles), Some(mut torques)) = tables else {
        return Ok(None);
    };
    // They have the same.
    let zeros = stretches[0].zero.iter().cycle();
    let pairs = torques.data_mut().iter_mut().zip(zeros);
    pairs.for_each(|(tau, zero)| match kind {
        TorqueKind::External => *tau -= zero,
        // The load is what the arm needs less these.
        TorqueKind::Measured => *tau += zero,
    });
    let time = samples.iter().map(|s| s.t).collect();
    Ok(Some(Sequence {
        touch_starts: starts,
        velocities: table(&|s| s.qd.as_ref())?,
        ..Sequence::new(format!("from {} s", first.t), time, angles, torques)
    }))
}

impl<L: Learner> Learner for Kept<L> {
    type Error = L::Error;

    fn joints(&self) -> usize {
        self.learner.joints()
    }

    fn zero(&self) -> &[f64] {
        self.learner.zero()
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
