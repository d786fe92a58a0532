use super::{Begins, Learner, Numbered, Queue, Sample, WhenFull};
use crate::Estimate;
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};
use vsf_core::{CoreError, FilterHealth, median_of};

/// How a node handles imperfections of a stream.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Rate of the samples \[Hz\], used to count missing ones. Default: from the median of the last 101
    /// steps within a touch.
    pub rate_hz: Option<f64>,
    /// Summaries per second; default 10.
    pub publish_hz: f64,
    /// Longest gap between samples that is bridged \[s\]; default 0.1. At least 2.5 steps of the stream are
    /// bridged, and 10 s until its rate is known.
    ///
    /// After a longer gap in which a joint moved by more than 1e-3 rad or m, contacts are forgotten, since the
    /// path in between is unknown, and nothing is learned from a touch that has begun meanwhile.
    pub max_gap: f64,
    /// A sample at least this much older than the last one means that the clock was reset; a younger one is
    /// late \[s\]; default 1.
    pub restart: f64,
    /// Largest number of samples that wait; default 64.
    pub queue: usize,
    /// What happens to samples when the queue is full.
    pub when_full: WhenFull,
    /// For this time from the first sample on \[s\], more samples than `queue` may wait: those that came before
    /// the node began; default 2.
    pub patience: f64,
    /// Number of samples at the beginning of each sequence, in free air, whose mean reading counts as zero;
    /// default 0.
    pub tare: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rate_hz: None,
            publish_hz: 10.0,
            max_gap: 0.1,
            restart: 1.0,
            queue: 64,
            when_full: WhenFull::DropOldest,
            patience: 2.0,
            tare: 0,
        }
    }
}

/// Counts of what happened to the samples.
///
/// At the end `received = refused + dropped + repeated + late + stray + tared + skipped + used`. The first
/// three are counted by [`run`](super::run) alone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Lines received.
    pub received: u64,
    /// Lines that were not samples, or samples that the session refused.
    pub refused: u64,
    /// Samples dropped because the estimation was too slow.
    pub dropped: u64,
    /// Samples with the same time as the one before.
    pub repeated: u64,
    /// Samples older than the one before, or of an earlier sequence.
    pub late: u64,
    /// Samples whose time is far from those before, if the next samples did not confirm it; also the first
    /// of those that were confirmed.
    pub stray: u64,
    /// Samples used to tare the sensors, including those in vain: a sample in contact starts taring anew.
    pub tared: u64,
    /// Samples of touches whose beginning was not seen, from which nothing is learned.
    pub skipped: u64,
    /// Samples that entered the belief.
    pub used: u64,
    /// Samples missing between those of a touch that were used, including dropped ones.
    pub missing: u64,
    /// Gaps within a touch after which contacts were forgotten.
    pub gaps: u64,
    /// How often the clock went back within a sequence.
    pub restarts: u64,
}

/// Stiffness of the points touched so far \[N/m\].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Stiffness {
    /// Mean of the points.
    pub mean: f64,
    /// Mean of their standard deviations.
    pub sd: f64,
    /// Stiffness of the stiffest point.
    pub max: f64,
}

/// Summary of a node's belief and samples.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Summary {
    /// Time of the last sample \[s\].
    pub t: f64,
    /// Number of points touched now.
    pub contacts: usize,
    /// Number of points touched so far.
    pub touched: usize,
    /// Their stiffness.
    pub stiffness: Stiffness,
    /// Root mean square norm of the residuals before their update, since the last summary \[N m\]; `None`
    /// if nothing was learned since.
    pub residual: Option<f64>,
    /// Ratio of squared to expected innovations over all samples in contact since the start; see the guide
    /// on filter health.
    pub nis_ratio: Option<f64>,
    /// Longest step since the last summary \[ms\].
    pub slowest_ms: f64,
    /// Counts of what happened to the samples.
    #[serde(flatten)]
    pub counts: Counts,
}

/// Learns from a stream, however late, broken or repeated its samples are.
#[derive(Debug)]
pub struct Node<L> {
    learner: L,
    options: Options,
    /// Time of the last sample that was taken, its touch and sequence.
    last: Option<f64>,
    touch: u64,
    sequence: u64,
    q: Vec<f64>,
    /// Earliest time of the samples that were late since, and the last one that was stray.
    earliest: f64,
    stray: Option<f64>,
    /// Tare samples of the sequence so far.
    tared: u64,
    steps: Steps,
    health: FilterHealth,
    due: Option<f64>,
    is_due: bool,
    touched: Vec<bool>,
    since: Since,
    pub(super) counts: Counts,
}

/// Until the rate is known, only longer gaps than this (s) are any.
const SLOWEST: f64 = 10.0;
/// Where no joint has moved by more than this (rad or m), nothing was missed.
const MOST_MOVED: f64 = 1e-3;

/// Where a sample belongs.
struct Placed {
    begins: Begins,
    /// Whether the clock went back.
    restarted: bool,
    /// Whether samples are missing in a touch.
    gap: bool,
    /// Time since the sample before it in the touch (s).
    step: Option<f64>,
}

/// The last steps from sample to sample within a touch (s).
#[derive(Debug, Default)]
struct Steps {
    last: VecDeque<f64>,
    since: usize,
    /// The median, where there are enough.
    usual: Option<f64>,
    scratch: Vec<f64>,
}

impl Steps {
    const MOST: usize = 101;
    const LEAST: usize = 5;
    /// The median is found anew after so many.
    const OFTEN: usize = 16;

    fn add(&mut self, step: f64) {
        if self.last.len() == Self::MOST {
            self.last.pop_front();
        }
        self.last.push_back(step);
        self.since += 1;
        let is_new = self.last.len() <= Self::OFTEN || self.since >= Self::OFTEN;
        if self.last.len() >= Self::LEAST && is_new {
            self.since = 0;
            self.scratch.clear();
            self.scratch.extend(&self.last);
            self.usual = median_of(&mut self.scratch);
        }
    }
}

/// What was seen since the last summary.
#[derive(Debug, Default)]
struct Since {
    steps: u32,
    squares: f64,
    slowest: f64,
}

impl<L: Learner> Node<L> {
    /// Creates a node before its first sample. `touched` flags the points that the learner knows from
    /// before; empty means none.
    ///
    /// # Errors
    /// A number of `touched` flags other than the learner's number of points, rates, a gap or a restart
    /// that are not positive, or a patience that is negative or of more than a day.
    pub fn new(learner: L, mut touched: Vec<bool>, options: Options) -> Result<Self, CoreError> {
        if touched.is_empty() {
            touched.resize(learner.points(), false);
        }
        CoreError::check_len("touched points", touched.len(), learner.points())?;
        let Options {
            rate_hz,
            publish_hz,
            max_gap,
            restart,
            patience,
            ..
        } = options;
        let rates = [
            ("rate", rate_hz.unwrap_or(1.0)),
            ("rate of summaries", publish_hz),
        ];
        for (name, value) in rates {
            if !(value > 0.0 && value.is_finite()) {
                return Err(parameter(name, value, "> 0 Hz"));
            }
        }
        for (name, value) in [("longest gap", max_gap), ("restart", restart)] {
            if value.is_nan() || value <= 0.0 {
                return Err(parameter(name, value, "> 0 s"));
            }
        }
        if !(0.0..=86_400.0).contains(&patience) {
            return Err(parameter("patience", patience, "0 to 86400 s"));
        }
        Ok(Self {
            touched,
            last: None,
            touch: 0,
            sequence: 0,
            q: Vec::new(),
            earliest: f64::INFINITY,
            stray: None,
            tared: 0,
            steps: Steps::default(),
            health: FilterHealth::default(),
            due: None,
            is_due: false,
            since: Since::default(),
            counts: Counts::default(),
            learner,
            options,
        })
    }

    /// Returns the node with statistics that continue earlier ones, such as those before a restart.
    #[must_use]
    pub fn with_health(self, health: FilterHealth) -> Self {
        Self { health, ..self }
    }

    /// Creates a new queue for its samples, for one [`run`](super::run).
    pub fn new_queue(&self) -> Arc<Queue<Numbered>> {
        let patience = Duration::from_secs_f64(self.options.patience);
        let queue = Queue::new(self.options.queue, self.options.when_full);
        Arc::new(queue.with_patience(patience))
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The learner.
    pub fn learner(&self) -> &L {
        &self.learner
    }

    /// The learner, to change what it knows of the world.
    pub fn learner_mut(&mut self) -> &mut L {
        &mut self.learner
    }

    /// Returns the learner.
    pub fn into_learner(self) -> L {
        self.learner
    }

    /// Innovation statistics of the updates in contact.
    pub fn health(&self) -> &FilterHealth {
        &self.health
    }

    /// The present estimate of the field.
    ///
    /// # Errors
    /// As [`Learner::field`].
    pub fn estimate(&self) -> Result<Estimate, CoreError> {
        Ok(Estimate {
            belief: self.learner.field()?,
            touched: self.touched.clone(),
            health: self.health,
        })
    }

    /// Which points were touched so far.
    pub fn touched(&self) -> &[bool] {
        &self.touched
    }

    /// Counts of what happened to the samples so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Takes in a sample. A late, repeated or stray sample is only counted.
    ///
    /// # Errors
    /// A sample that is not finite or that the [`Learner`] refuses; the belief is unchanged.
    pub fn take(&mut self, sample: &Sample) -> Result<(), L::Error> {
        CoreError::check_finite("time", &[sample.t])?;
        let usual = (self.options.rate_hz.map(f64::recip)).or(self.steps.usual);
        let Some(placed) = self.place(sample, usual) else {
            return Ok(());
        };
        let Placed {
            begins,
            restarted,
            gap,
            step,
        } = placed;
        let period = 1.0 / self.options.publish_hz;
        if begins == Begins::Sequence {
            // By another clock it is due as soon.
            let left = self.due.zip(self.last).map(|(due, last)| due - last);
            self.due = left.map(|left| sample.t + left.clamp(0.0, period));
        }
        let tared = match begins {
            Begins::Sequence => 0,
            _ => self.tared,
        };
        if tared < self.options.tare {
            let last = tared + 1 == self.options.tare;
            // Where it is refused, taring begins anew.
            self.tared = 0;
            self.learner.tare(sample, begins, last)?;
            self.tared = tared + 1;
            self.counts.tared += 1;
            self.counts.restarts += u64::from(restarted);
            self.went_to(sample);
            return Ok(());
        }
        let start = Instant::now();
        let report = self.learner.learn(sample, begins)?;
        let touching = self.learner.touching();
        let len = self.touched.len();
        if let Some(&point) = touching.iter().find(|p| **p as usize >= len) {
            let (what, index) = ("touched point of the learner", point as usize);
            return Err(CoreError::OutOfRange { what, index, len }.into());
        }
        let took = 1e3 * start.elapsed().as_secs_f64();
        if let Some(step) = step {
            if self.options.rate_hz.is_none() {
                self.steps.add(step);
            }
            let between = usual.map_or(0.0, |usual| (step / usual).round() - 1.0);
            self.counts.missing = self.counts.missing.saturating_add(between.max(0.0) as u64);
        }
        self.counts.gaps += u64::from(gap);
        self.counts.restarts += u64::from(restarted);
        self.tared = tared;
        self.went_to(sample);
        self.since.slowest = self.since.slowest.max(took);
        match report {
            None => self.counts.skipped += 1,
            Some(report) => {
                self.counts.used += 1;
                self.since.steps += 1;
                self.since.squares += report.prefit * report.prefit;
                let touching = self.learner.touching();
                if !touching.is_empty() {
                    self.health.record(&report);
                }
                touching
                    .iter()
                    .for_each(|p| self.touched[*p as usize] = true);
            }
        }
        let due = self.due.unwrap_or(sample.t + period);
        // The sample next to the time that is due, not the one after it.
        self.is_due = sample.t + 0.5 * usual.unwrap_or(0.0) >= due;
        self.due = Some(if !self.is_due {
            due
        } else if due + period > sample.t {
            due + period
        } else {
            sample.t + period
        });
        Ok(())
    }

    /// Where a sample belongs, by its numbers and time, with the `usual` time between samples (s); `None` where it is not to be
    /// taken, which is counted.
    fn place(&mut self, sample: &Sample, usual: Option<f64>) -> Option<Placed> {
        let new = |begins| Placed {
            begins,
            restarted: false,
            gap: false,
            step: None,
        };
        let Some(last) = self.last else {
            return Some(new(Begins::Touch));
        };
        // Sequences do not come back.
        if sample.sequence < self.sequence {
            self.counts.late += 1;
            return None;
        }
        if sample.sequence > self.sequence {
            return Some(new(Begins::Sequence));
        }
        let Options {
            max_gap, restart, ..
        } = self.options;
        let step = sample.t - last;
        if step == 0.0 {
            self.counts.repeated += 1;
            return None;
        }
        if step < 0.0 && step > -restart {
            self.counts.late += 1;
            self.earliest = self.earliest.min(sample.t);
            return None;
        }
        let begins = sample.touch != self.touch;
        let longest = match usual {
            Some(usual) => max_gap.max(2.5 * usual),
            None => max_gap.max(SLOWEST),
        };
        if step < 0.0 || !begins && step > longest {
            // A single stamp that fits no other is not believed.
            let follows = |stray: f64| sample.t > stray && sample.t - stray <= longest;
            if !self.stray.is_some_and(follows) {
                self.stray = Some(sample.t);
                self.counts.stray += 1;
                return None;
            }
        }
        if step < 0.0 {
            return Some(Placed {
                restarted: true,
                ..new(Begins::Sequence)
            });
        }
        // Of a clock that was set back, samples are late until it has caught up: the way there was not seen.
        let unseen = step.max(last - self.earliest) > longest;
        let mut pairs = self.q.iter().zip(&sample.q);
        let rests = pairs.all(|(a, b)| (a - b).abs() <= MOST_MOVED);
        let gap = !begins && unseen && !rests;
        Some(Placed {
            gap,
            step: (!begins).then_some(step),
            ..new(if gap || begins {
                Begins::Touch
            } else {
                Begins::Nothing
            })
        })
    }

    fn went_to(&mut self, sample: &Sample) {
        self.last = Some(sample.t);
        self.q.clone_from(&sample.q);
        self.stray = None;
        self.earliest = f64::INFINITY;
        self.touch = sample.touch;
        self.sequence = sample.sequence;
    }

    /// Whether it is time for a summary.
    pub fn is_due(&self) -> bool {
        self.is_due
    }

    /// Returns a summary of the present state, and starts the next period.
    pub fn summary(&mut self) -> Summary {
        self.is_due = false;
        let since = std::mem::take(&mut self.since);
        let mut stiffness = Stiffness::default();
        let mut touched = 0;
        for (i, _) in self.touched.iter().enumerate().filter(|(_, t)| **t) {
            let [k, variance] = self.learner.stiffness(i);
            stiffness.mean += k;
            stiffness.sd += variance.sqrt();
            stiffness.max = stiffness.max.max(k);
            touched += 1;
        }
        stiffness.mean /= f64::max(1.0, touched as f64);
        stiffness.sd /= f64::max(1.0, touched as f64);
        Summary {
            t: self.last.unwrap_or(0.0),
            contacts: self.learner.touching().len(),
            touched,
            stiffness,
            residual: (since.steps > 0).then(|| (since.squares / f64::from(since.steps)).sqrt()),
            nis_ratio: self.health.nis_ratio(),
            slowest_ms: (1e3 * since.slowest).round() / 1e3,
            counts: self.counts,
        }
    }
}

fn parameter(name: &'static str, value: f64, range: &'static str) -> CoreError {
    CoreError::Parameter { name, value, range }
}
