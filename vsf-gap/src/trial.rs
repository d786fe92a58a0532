//! The trial on the sequences that no model was fitted to: what is named has to stand it.

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

/// Samples of a block of free motion.
const BLOCK: usize = 16;
/// Fewest blocks whose median tells noise from more.
const FEWEST: usize = 8;
/// What is left in free motion is noticed from so many times the noise of a sample on, and from this share of
/// the readings' RMS on; it remains if it is more than this share, half of the energy, of what the nominal
/// model leaves.
const NOTICED: f64 = 0.5;
const LEAST: f64 = 0.01;
const REMAINS: f64 = 0.7;
/// Correlation of innovations from window to window from which on something acts that the model does not have:
/// of models that were right it was 0.27 at most. Unless nothing is touched: then the form of friction is what is left.
const PERSISTENT: f64 = 0.35;
/// The share of what some effects leave that further ones have to take where they gain little beside them.
const COMPLETE: f64 = 0.8;
/// Test sequences that are off by so many of the standard deviations that the train sequences lead to expect (root mean
/// square) contradict these: of recordings that nothing was wrong with it was 2.1 at most, of such with effects 2.4.
const SURPRISING: f64 = 4.0;
/// In free air a model that was stopped at a bound has to leave less than this share of what sensors that read nothing
/// would: further effects take a little of anything.
const BARELY: f64 = 0.95;
/// By so many standard deviations the tare may be off.
const TARE: f64 = 3.0;

/// The sequences that check models, and what the nominal one leaves there.
pub(crate) struct Trial<'a> {
    whole: &'a Campaign,
    /// What models are fitted to.
    thinned: &'a Campaign,
    /// The test sequences; of a single sequence, that one.
    pub(crate) sequences: &'a [Motion],
    pub(crate) before: Residuals,
    /// Blocks of samples in which nothing is touched: index of the sequence, rows.
    free: Vec<(usize, Range<usize>)>,
    /// How likely the nominal model makes the test sequences, given the train sequences (nats).
    log_predictive: f64,
    /// How far off it is there (standard deviations), if that is too far for what the train sequences show.
    pub(crate) surprise: Option<f64>,
    seed: u64,
}

/// A model on these sequences.
pub(crate) struct Checked {
    /// Its field per rest point (N/m), fitted to the train sequences.
    pub(crate) field: Vec<f64>,
    pub(crate) residuals: Residuals,
    pub(crate) closure: Closure,
    /// How much likelier it makes the test sequences than the nominal model does, given the train sequences, its parameters
    /// being as uncertain as these leave them (nats).
    pub(crate) foretold: f64,
    /// How far innovations on the train sequences persist ([`Fitted::persistence`](crate::fitted::Fitted)).
    pub(crate) persistence: f64,
    /// How much like springs what the model leaves to them is ([`Fitted::likeness`](crate::fitted::Fitted)).
    pub(crate) likeness: f64,
}

/// A model as fitted to the train sequences, the factor of its covariance, its field per rest point (N/m), and what it leaves on
/// the sequences that check models.
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

/// What the trial leaves.
pub(crate) struct Judgment<'a> {
    pub(crate) judged: Judged,
    /// The model that stood it.
    pub(crate) named: Option<Tried<'a>>,
    /// Its mean error and that of the nominal model (N m or N), where it predicts worse: by fields that the trial does not
    /// know.
    pub(crate) worse: Option<[f64; 2]>,
    /// Those that did not stand it.
    pub(crate) refused: Vec<Tried<'a>>,
    /// What is left in free motion (N m or N), where the named model, or the nominal one, leaves much.
    pub(crate) left_free: Option<f64>,
    /// How far the innovations of the named model persist, where they persist too far for it to be all.
    pub(crate) persistence: Option<f64>,
}

/// Samples in a row of one touch, after the tare, in which the nominal model touches nothing.
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

/// Number of samples, 1 at least.
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

    /// Whether what the field shows is left to explain, if the named model has `closed` so much of the gap: sensors and
    /// joints have no part in it, a model that explains most of the gap leaves none, and what is unknown is so.
    pub(crate) fn leaves_field(&self, closed: f64) -> bool {
        let explains = |t: &Tried<'_>| closed >= MOSTLY || t.refined.model.acts() == Acts::Torques;
        let unknown = self.judged.verdict.kind == VerdictKind::Unknown || self.left_free.is_some();
        !unknown && !self.corrected().is_some_and(explains)
    }

    /// Whether a parameter of the corrected model stopped at a bound of what is plausible; where it `touches`, of an effect
    /// that does not follow contact.
    pub(crate) fn is_stopped(&self, touches: bool) -> bool {
        let corrected = self.corrected();
        corrected.is_some_and(|t| t.refined.is_stopped(touches))
    }

    /// Whether the corrected model, with this `error`, hardly predicts better than sensors that read nothing, with theirs.
    pub(crate) fn is_silent(&self, error: f64, of_silence: f64, touches: bool) -> bool {
        let barely = if !touches && self.is_stopped(touches) {
            BARELY
        } else {
            1.0
        };
        self.corrected().is_some() && error >= barely * of_silence
    }

    /// Names of the named effects of none of whose parameters the data say anything.
    pub(crate) fn vague(&self) -> Vec<String> {
        let named = self.named.iter();
        let vague = named.flat_map(|t| t.refined.vague());
        vague.map(str::to_owned).collect()
    }

    /// How much like springs what the named model leaves to them is, where it is opposite to them.
    pub(crate) fn opposed(&self) -> Option<f64> {
        let likeness = self.named.as_ref()?.checked.likeness;
        opposes(likeness).then_some(likeness)
    }

    /// The effects that did not stand it.
    pub(crate) fn names_refused(&self) -> Vec<String> {
        let refused = self.refused.iter();
        refused.flat_map(|t| t.effects.clone()).collect()
    }

    /// Names no model, and so knows nothing of what it leaves.
    pub(crate) fn withdraw(&mut self) {
        self.named = None;
        self.persistence = None;
    }
}

impl<'a> Trial<'a> {
    /// With the nominal model, its field and its spread.
    ///
    /// # Errors
    /// Rows that contact cannot take, a covariance that is not positive definite.
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

    /// How far residuals close the gap of the nominal model.
    pub(crate) fn closure(&self, after: &Residuals) -> Closure {
        let noise = &self.whole.noise;
        closure(&self.before, after, noise, self.sequences, self.seed)
    }

    /// A model, with the field that the train sequences give it.
    ///
    /// # Errors
    /// Rows that contact cannot take, a covariance that is not positive definite.
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

    /// The same, before it is judged: how likely the test sequences are takes longer.
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

    /// Whether further effects take nearly all that a part of the model leaves: what is wrong with the forms of the
    /// first is nothing that others would mend so well.
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

    /// Size (N m or N) of what is left of residuals in free motion beyond noise: of what persists, unless all is `perfect`,
    /// or of what oscillates, which may have been taken for noise. 0 where there is little free motion.
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

    /// The root of the median square of the means of blocks, beyond noise: a few are not free where contact begins earlier
    /// than the model has it.
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

    /// The mean error (N m or N) of sensors that are taken to read nothing.
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

    /// From which size on (N m or N) what is left in free motion is much.
    fn noticed(&self) -> f64 {
        let readings = self.sequences.iter().flat_map(|m| m.reading.data());
        let rms = (readings.map(|v| v * v).sum::<f64>() / samples(self.sequences)).sqrt();
        (NOTICED * noise_norm(&self.whole.noise)).max(LEAST * rms)
    }

    /// Samples in windows of these sequences, among those of all, over those in windows of the train sequences: what the
    /// former may tell of what the latter do.
    fn share(&self) -> f64 {
        let train: Vec<&Motion> = self.thinned.train.iter().collect();
        let session = self.thinned.session();
        let is_test = |k: usize| (self.thinned.test.iter()).any(|m| std::ptr::eq(m, session[k]));
        let tested = self.thinned.windows(&session).samples(is_test);
        tested as f64 / self.thinned.windows(&train).samples(|_| true).max(1) as f64
    }

    /// Judges the hypotheses, and leaves aside the best one as long as it does not stand.
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
