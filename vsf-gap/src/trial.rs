//! The trial on the sequences that no model was fitted to, which a named model has to pass.

use crate::closure::{Closure, Residuals, closure, noise_norm};
use crate::effect::Need;
use crate::evidence::{Factor, Spread};
use crate::fitted::Fitted;
use crate::judge::{Hypothesis, Judged, Nominal, OnTest, judge, opposes};
use crate::oscillation::oscillation;
use crate::predictive::TestDensity;
use crate::refine::Refined;
use crate::report::{MOSTLY, is_perfect};
use crate::verdict::VerdictKind;
use crate::{Acts, Campaign, ContactLog, GapError, Model, Motion};
use std::ops::Range;
use std::sync::Arc;
use vsf_core::median;
use vsf_data::{TorqueKind, tare};

/// Samples in a block of free motion.
const BLOCK: usize = 16;
/// Fewest blocks whose median can tell noise from more.
const FEWEST: usize = 8;
/// Residuals in free motion are noticed from this many times the noise of a sample on, and from this share of the readings'
/// RMS on. They remain if they are more than this share, half of the energy, of what the nominal model leaves.
const NOTICED: f64 = 0.5;
const LEAST: f64 = 0.01;
const REMAINS: f64 = 0.7;
/// Correlation of innovations between windows from which on something acts that the model does not have. For correct models
/// it was 0.27 at most. If nothing is touched, it does not count: then the form of friction is what is left.
const PERSISTENT: f64 = 0.35;
/// Share of what some effects leave that further ones have to explain if they gain little beside them.
const COMPLETE: f64 = 0.8;
/// The test sequences contradict the train sequences if they deviate by this many of the standard deviations that the
/// latter predict (root mean square). In recordings with nothing wrong it was 2.1 at most, in recordings with effects 2.4.
const SURPRISING: f64 = 4.0;
/// In free air, a model that was stopped at a bound has to leave less than this share of the error of sensors that read
/// zero. Further effects explain a little of anything.
const BARELY: f64 = 0.95;
/// Number of standard deviations by which the tare may be off.
const TARE: f64 = 3.0;

/// The sequences that check models, and the residuals of the nominal model on them.
pub(crate) struct Trial<'a> {
    whole: &'a Campaign,
    /// The campaign that models are fitted to.
    thinned: &'a Campaign,
    /// The test sequences; if there is only one sequence, that one.
    pub(crate) sequences: &'a [Motion],
    pub(crate) before: Residuals,
    /// Blocks of samples in which nothing is touched: index of the sequence, rows.
    free: Vec<(usize, Range<usize>)>,
    /// Log density of the test sequences under the nominal model, given the train sequences (nats).
    log_predictive: f64,
    /// Deviation of the nominal model there (standard deviations), if that is too large for what the train sequences show.
    pub(crate) surprise: Option<f64>,
    seed: u64,
}

/// Results of a model on these sequences.
pub(crate) struct Checked {
    /// Its field per rest point (N/m), fitted to the train sequences.
    pub(crate) field: Vec<f64>,
    pub(crate) residuals: Residuals,
    pub(crate) closure: Closure,
    /// Gain of the log density of the test sequences over the nominal model, given the train sequences, which leave the
    /// model's parameters uncertain (nats).
    pub(crate) foretold: f64,
    /// Persistence of the innovations on the train sequences ([`Fitted::persistence`](crate::fitted::Fitted)).
    pub(crate) persistence: f64,
    /// Correlation with spring torques of what the model leaves to the springs
    /// ([`Fitted::likeness`](crate::fitted::Fitted)).
    pub(crate) likeness: f64,
}

/// A model fitted to the train sequences, the factor of its covariance, its field per rest point (N/m), and its residuals
/// on the sequences that check models.
struct Predicted<'a> {
    fitted: Fitted<'a>,
    factor: Factor,
    field: Vec<f64>,
    residuals: Residuals,
}

/// A model that was up to be named.
pub(crate) struct Tried<'a> {
    pub(crate) effects: Vec<String>,
    pub(crate) refined: &'a Refined,
    pub(crate) checked: Checked,
}

/// Result of the trial.
pub(crate) struct Judgment<'a> {
    pub(crate) judged: Judged,
    /// The model that passed.
    pub(crate) named: Option<Tried<'a>>,
    /// Its mean error and that of the nominal model (N m or N), if it predicts worse. The errors are those of fields that
    /// the trial does not know.
    pub(crate) worse: Option<[f64; 2]>,
    /// The models that did not pass.
    pub(crate) refused: Vec<Tried<'a>>,
    /// Residuals in free motion (N m or N), if the named model, or the nominal one, leaves much there.
    pub(crate) left_free: Option<f64>,
    /// Persistence of the innovations of the named model, if it is too large for the model to be complete.
    pub(crate) persistence: Option<f64>,
}

/// Blocks of consecutive samples of one touch, after the tare, in which the nominal model touches nothing.
fn free_blocks(sequences: &[Motion], logs: &[Arc<ContactLog>]) -> Vec<(usize, Range<usize>)> {
    let mut blocks = Vec::new();
    for (k, (motion, log)) in sequences.iter().zip(logs).enumerate() {
        for touch in &motion.touches {
            let begin = touch.start.max(motion.tare);
            let mut first = begin;
            for row in begin..touch.end {
                if !log.contacts[row].is_empty() {
                    first = row + 1;
                } else if row + 1 - first == BLOCK {
                    blocks.push((k, first..row + 1));
                    first = row + 1;
                }
            }
        }
    }
    blocks
}

/// Number of samples, at least 1.
fn samples(of: &[Motion]) -> f64 {
    of.iter().map(Motion::len).sum::<usize>().max(1) as f64
}

impl Tried<'_> {
    /// Mean error (N m or N).
    pub(crate) fn error(&self) -> f64 {
        self.checked.residuals.mean_error()
    }
}

impl<'a> Judgment<'a> {
    /// The named model, if it predicts no worse than the nominal one.
    pub(crate) fn corrected(&self) -> Option<&Tried<'a>> {
        self.named.as_ref().filter(|_| self.worse.is_none())
    }

    /// Whether it is still open what the field shows, if the named model has `closed` so much of the gap. It is not if the
    /// corrected model acts on sensors and joints only, if it explains most of the gap, or if the cause is unknown.
    pub(crate) fn leaves_field(&self, closed: f64) -> bool {
        let explains = |t: &Tried<'_>| closed >= MOSTLY || t.refined.model.acts() == Acts::Torques;
        let unknown = self.judged.verdict.kind == VerdictKind::Unknown || self.left_free.is_some();
        !unknown && !self.corrected().is_some_and(explains)
    }

    /// Whether a parameter of the corrected model was stopped at a bound of the plausible range. If anything `touches`,
    /// parameters of effects that follow contact do not count.
    pub(crate) fn is_stopped(&self, touches: bool) -> bool {
        let corrected = self.corrected();
        corrected.is_some_and(|t| t.refined.is_stopped(touches))
    }

    /// Whether the corrected model, with this `error`, predicts hardly better than sensors that read zero, with the error
    /// `of_silence`.
    pub(crate) fn is_silent(&self, error: f64, of_silence: f64, touches: bool) -> bool {
        let barely = if !touches && self.is_stopped(touches) {
            BARELY
        } else {
            1.0
        };
        self.corrected().is_some() && error >= barely * of_silence
    }

    /// Names of the named effects none of whose parameters the data determine.
    pub(crate) fn vague(&self) -> Vec<String> {
        let named = self.named.iter();
        let vague = named.flat_map(|t| t.refined.vague());
        vague.map(str::to_owned).collect()
    }

    /// Correlation with spring torques of what the named model leaves to the springs, if it is opposite to them.
    pub(crate) fn opposed(&self) -> Option<f64> {
        let likeness = self.named.as_ref()?.checked.likeness;
        opposes(likeness).then_some(likeness)
    }

    /// Names of the effects that did not pass.
    pub(crate) fn names_refused(&self) -> Vec<String> {
        let refused = self.refused.iter();
        refused.flat_map(|t| t.effects.clone()).collect()
    }

    /// Withdraws the named model, and with it what is known of its residuals.
    pub(crate) fn withdraw(&mut self) {
        self.named = None;
        self.persistence = None;
    }
}

impl<'a> Trial<'a> {
    /// Starts a trial with the nominal model, its field and its spread.
    ///
    /// # Errors
    /// Rows that contact cannot take; a covariance that is not positive definite.
    pub(crate) fn new(
        whole: &'a Campaign,
        thinned: &'a Campaign,
        fitted: &Fitted<'_>,
        field: &[f64],
        spread: &Spread,
        seed: u64,
    ) -> Result<Self, GapError> {
        let sequences = if whole.test.is_empty() {
            &whole.train[..]
        } else {
            &whole.test[..]
        };
        let all: Vec<&Motion> = sequences.iter().collect();
        let nominal = Model::default();
        let logs = whole.contact_logs(&nominal, &all)?;
        // Of an arm that touches nothing, motion is all that there is to explain.
        let free = match thinned.lacks(Need::Contact) {
            Some(_) => Vec::new(),
            None => free_blocks(sequences, &logs),
        };
        let density = TestDensity::new(thinned, fitted)?;
        let (log_predictive, surprise) = match &density {
            Some(density) => (density.log_density(spread)?, density.surprise(spread)?),
            None => (0.0, None),
        };
        Ok(Self {
            whole,
            thinned,
            sequences,
            before: whole.residuals_in(&nominal, field, &all, &all, &logs)?,
            free,
            log_predictive,
            surprise: surprise.filter(|s| *s > SURPRISING),
            seed,
        })
    }

    /// How far a model with these residuals closes the gap of the nominal model.
    pub(crate) fn closure(&self, after: &Residuals) -> Closure {
        let noise = &self.whole.noise;
        closure(&self.before, after, noise, self.sequences, self.seed)
    }

    /// Checks a model with the field that the train sequences give it.
    ///
    /// # Errors
    /// Rows that contact cannot take; a covariance that is not positive definite.
    pub(crate) fn of(&self, refined: &Refined) -> Result<Checked, GapError> {
        let Predicted {
            fitted,
            factor,
            field,
            residuals,
        } = self.predicted(refined)?;
        let foretold = match TestDensity::new(self.thinned, &fitted)? {
            Some(density) => {
                let density = density.with_open(self.thinned, refined)?;
                density.log_density(&refined.spread)? - self.log_predictive
            }
            None => 0.0,
        };
        Ok(Checked {
            foretold,
            closure: self.closure(&residuals),
            persistence: fitted.persistence(&factor),
            likeness: fitted.likeness,
            field,
            residuals,
        })
    }

    /// The first part of the check. The log density of the test sequences takes longer.
    ///
    /// # Errors
    /// As [`Trial::of`].
    fn predicted(&self, refined: &Refined) -> Result<Predicted<'a>, GapError> {
        let thinned = self.thinned;
        let mut fitted = thinned.fitted(&refined.model, thinned.train.iter())?;
        let (field, factor) = thinned.field(&mut fitted, &refined.spread)?;
        let all: Vec<&Motion> = self.sequences.iter().collect();
        Ok(Predicted {
            residuals: self.whole.residuals(&refined.model, &field, &all)?,
            fitted,
            factor,
            field,
        })
    }

    /// Whether the further effects of `whole` explain nearly all that `part` leaves. Effects that only mend errors in the
    /// forms of others would not explain that much.
    ///
    /// # Errors
    /// As [`Trial::of`].
    pub(crate) fn completes(&self, part: &Refined, whole: &Refined) -> Result<bool, GapError> {
        let part = self.predicted(part)?.residuals;
        if is_perfect(part.mean_error(), noise_norm(&self.whole.noise)) {
            return Ok(false);
        }
        let whole = self.predicted(whole)?.residuals;
        let left = |of: &Residuals| 1.0 - self.closure(of).fraction;
        Ok(left(&whole) < (1.0 - COMPLETE) * left(&part))
    }

    /// Size (N m or N) of the residuals in free motion beyond noise: of those that persist, unless all is `perfect`, or of
    /// those that oscillate, which may have been taken for noise. 0 if there is little free motion.
    fn left_free(&self, residuals: &Residuals, perfect: bool) -> f64 {
        if self.free.len() < FEWEST {
            return 0.0;
        }
        let persists = if perfect {
            0.0
        } else {
            self.persists(residuals)
        };
        // Blocks of a touch that follow each other are one run.
        let begins = |sequence: usize, row: usize| {
            let touches = &self.sequences[sequence].touches;
            touches.iter().any(|touch| touch.start == row)
        };
        let mut runs: Vec<(usize, Range<usize>)> = Vec::new();
        for (sequence, rows) in &self.free {
            let follows = |(s, run): &&mut (usize, Range<usize>)| {
                s == sequence && run.end == rows.start && !begins(*sequence, rows.start)
            };
            match runs.last_mut().filter(follows) {
                Some((_, run)) => run.end = rows.end,
                None => runs.push((*sequence, rows.clone())),
            }
        }
        let runs: Vec<&[f64]> = runs.iter().map(|run| residuals.of(run)).collect();
        let noise: Vec<f64> = self.whole.noise.iter().map(|n| n.sd).collect();
        persists.max(oscillation(&runs, &noise))
    }

    /// Root of the median squared block mean, beyond noise. The median is robust to a few blocks that are not free because
    /// contact begins earlier than in the model.
    fn persists(&self, residuals: &Residuals) -> f64 {
        let d = residuals.joints;
        let square_of_mean = |block: &(usize, Range<usize>)| -> f64 {
            let rows = residuals.of(block);
            let mean = |j: usize| rows.iter().skip(j).step_by(d).sum::<f64>() / BLOCK as f64;
            (0..d).map(|j| mean(j).powi(2)).sum()
        };
        let square = median(self.free.iter().map(square_of_mean).collect()).unwrap_or(0.0);
        let of_means = |m: usize| -> f64 {
            let noise = self.whole.noise.iter().map(|n| n.of_means(m).sd);
            noise.map(|sd| sd * sd).sum()
        };
        let mut noise = of_means(BLOCK);
        // What the tare took for zero is off by its own noise, in all blocks alike.
        let tares = self.sequences.iter().map(|m| m.tare);
        if let Some(tare) = tares.filter(|t| *t > 0).min() {
            noise += TARE * TARE * of_means(tare);
        }
        (square - noise).max(0.0).sqrt()
    }

    /// Mean error (N m or N) of sensors that are assumed to read zero.
    ///
    /// # Errors
    /// None in practice: a tare is no longer than its sequence.
    pub(crate) fn of_silence(&self) -> Result<f64, GapError> {
        let of_motion = |m: &Motion| -> Result<Vec<f64>, GapError> {
            let mut rows = m.reading.data().to_vec();
            if self.whole.scene.torque_kind() == TorqueKind::Measured {
                // Actuators that read nothing would leave all of the arm's own torques to the environment.
                let load = match m.tare {
                    0 => m.load.clone(),
                    samples => tare(&m.load, samples)?,
                };
                rows.iter_mut().zip(load.data()).for_each(|(r, l)| *r -= l);
            }
            Ok(rows)
        };
        let silence = Residuals {
            joints: self.whole.site.joints(),
            rows: self
                .sequences
                .iter()
                .map(of_motion)
                .collect::<Result<_, _>>()?,
            predicted: Vec::new(),
        };
        Ok(silence.mean_error())
    }

    /// Size (N m or N) from which on residuals in free motion are noticed.
    fn noticed(&self) -> f64 {
        let readings = self.sequences.iter().flat_map(|m| m.reading.data());
        let rms = (readings.map(|v| v * v).sum::<f64>() / samples(self.sequences)).sqrt();
        (NOTICED * noise_norm(&self.whole.noise)).max(LEAST * rms)
    }

    /// Number of samples in windows of the test sequences, among the windows of all, divided by that of the train
    /// sequences. It scales a gain on the latter to one on the former.
    fn share(&self) -> f64 {
        let train: Vec<&Motion> = self.thinned.train.iter().collect();
        let session = self.thinned.session();
        let is_test = |k: usize| (self.thinned.test.iter()).any(|m| std::ptr::eq(m, session[k]));
        let tested = self.thinned.windows(&session).samples(is_test);
        tested as f64 / self.thinned.windows(&train).samples(|_| true).max(1) as f64
    }

    /// Judges the hypotheses. The best one is set aside, again and again, as long as it does not pass.
    ///
    /// # Errors
    /// As [`Trial::of`].
    pub(crate) fn judge<'h>(
        &self,
        mut hypotheses: Vec<Hypothesis<'h>>,
        nominal: &Nominal,
    ) -> Result<Judgment<'h>, GapError> {
        let share = self.share();
        let before = self.left_free(&self.before, nominal.perfect);
        let noticed = self.noticed();
        let much = |after: f64| (after > noticed && after > REMAINS * before).then_some(after);
        let mut refused = Vec::new();
        loop {
            let judged = judge(&hypotheses, nominal);
            let Some(i) = judged.named else {
                return Ok(Judgment {
                    judged,
                    named: None,
                    worse: None,
                    refused,
                    left_free: much(before),
                    persistence: None,
                });
            };
            let tried = Tried {
                effects: judged.verdict.effects.clone(),
                refined: hypotheses[i].refined,
                checked: self.of(hypotheses[i].refined)?,
            };
            let on_test = OnTest {
                closed: tried.checked.closure.fraction,
                foretold: tried.checked.foretold,
                worse: tried.error() > self.before.mean_error(),
                share,
            };
            if hypotheses[i].stands(&on_test) {
                return Ok(Judgment {
                    judged,
                    persistence: Some(tried.checked.persistence)
                        .filter(|p| *p > PERSISTENT)
                        .filter(|_| nominal.touches && !nominal.perfect),
                    // A model that predicts worse may leave more.
                    left_free: much(
                        self.left_free(&tried.checked.residuals, nominal.perfect)
                            .min(before),
                    ),
                    named: Some(tried),
                    worse: None,
                    refused,
                });
            }
            refused.push(tried);
            hypotheses.remove(i);
        }
    }
}
