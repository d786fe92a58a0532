use crate::diagonal::postfit;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use vsf_core::{Belief, CoreError, Estimator, Observation, Prediction, Scalar, UpdateReport};

/// What happens to the variances when an observation is taken in again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ReplayVariance {
    /// They stay: an observation counts once, however often it is replayed. The default.
    #[default]
    Keep,
    /// They shrink every time (Alg. 1 as printed). The filter then believes to have seen
    /// `1 + T_replay` times the data and becomes overconfident.
    Shrink,
}

/// An estimator that can take in an observation again, the building block of [`MemoryReplay`].
pub trait Revisit: Estimator {
    /// One correction without projection. With [`ReplayVariance::Keep`] only the means move.
    ///
    /// # Errors
    /// As [`Estimator::update`]; the belief is then unchanged. `postfit` and `projected` of the
    /// report are not filled in.
    fn correct(
        &mut self,
        obs: &Observation<Self::Scalar>,
        variance: ReplayVariance,
    ) -> Result<UpdateReport, CoreError>;

    /// Sets negative means of the given points to zero (eq. 5, last line) and returns their
    /// number.
    fn project(&mut self, points: &[u32]) -> usize;

    /// Writes back the belief of a point, to undo corrections.
    fn restore(&mut self, point: u32, mean: Self::Scalar, variance: Self::Scalar);
}

/// Parameters of [`MemoryReplay`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReplayConfig {
    /// Past observations replayed after every update, T_replay; default 20 (paper).
    pub replays: usize,
    /// Variances under replay; default [`ReplayVariance::Keep`].
    pub variance: ReplayVariance,
    /// Seed of the draws, default 0. Same seed, same result, bit for bit.
    pub seed: u64,
    /// Upper bound of the memory held by past observations (bytes), default 256 MiB. When it is
    /// reached, new observations replace random old ones so that the buffer stays a uniform
    /// sample of the history (Vitter's algorithm R, doi 10.1145/3147.3165).
    pub byte_budget: usize,
    /// Whether a new touch sequence empties the buffer, default false. The paper empties it,
    /// which bounds memory; here the byte budget does, and earlier touches are not forgotten.
    pub clear_on_sequence: bool,
}

impl Default for ReplayConfig {
    fn default() -> Self {
        Self {
            replays: 20,
            variance: ReplayVariance::Keep,
            seed: 0,
            byte_budget: 256 << 20,
            clear_on_sequence: false,
        }
    }
}

/// Memory replay (Alg. 1): after each update, random past observations are taken in again.
///
/// Means are projected to `K >= 0` once at the end of an update. Observations without contacts
/// say nothing about the field and are not stored; during them the past is replayed all the same.
/// An update costs `1 + replays` corrections. Memory of past observations is reused, also across
/// sequences.
#[derive(Debug, Clone)]
pub struct MemoryReplay<E: Estimator> {
    inner: E,
    config: ReplayConfig,
    rng: Pcg64Mcg,
    buffer: Vec<Observation<E::Scalar>>,
    filled: usize,
    seen: u64,
    bytes: usize,
    /// Beliefs before the running update, in order of change.
    journal: Vec<(u32, E::Scalar, E::Scalar)>,
    whitened: Vec<f64>,
}

impl<E: Revisit> MemoryReplay<E> {
    /// Wraps an estimator.
    ///
    /// # Errors
    /// A byte budget of zero with replays wanted.
    pub fn new(inner: E, config: ReplayConfig) -> Result<Self, CoreError> {
        if config.replays > 0 && config.byte_budget == 0 {
            return Err(CoreError::Parameter {
                name: "replay byte budget",
                value: 0.0,
                range: "> 0 bytes, or set replays to 0",
            });
        }
        Ok(Self {
            inner,
            config,
            rng: Pcg64Mcg::seed_from_u64(config.seed),
            buffer: Vec::new(),
            filled: 0,
            seen: 0,
            bytes: 0,
            journal: Vec::new(),
            whitened: Vec::new(),
        })
    }

    /// The parameters.
    pub fn config(&self) -> &ReplayConfig {
        &self.config
    }

    /// The estimator inside.
    pub fn inner(&self) -> &E {
        &self.inner
    }

    /// Number of observations in the buffer.
    pub fn buffered(&self) -> usize {
        self.filled
    }

    /// Bytes held by the observations in the buffer, at most [`ReplayConfig::byte_budget`] (or
    /// one observation, if that alone is larger).
    pub fn buffered_bytes(&self) -> usize {
        self.bytes
    }

    /// Takes in `obs` and then the buffered observations `replays`, in this order: an update whose
    /// draws are given, to repeat a run from elsewhere. `obs` itself is the last of the buffer if
    /// it was stored.
    ///
    /// # Errors
    /// As [`Estimator::update`], or an index beyond the buffer.
    pub fn update_with(
        &mut self,
        obs: &Observation<E::Scalar>,
        replays: &[usize],
    ) -> Result<UpdateReport, CoreError> {
        self.run(obs, |_, k, _| replays.get(k).copied())
    }

    fn run(
        &mut self,
        obs: &Observation<E::Scalar>,
        draw: impl FnMut(&mut Pcg64Mcg, usize, usize) -> Option<usize>,
    ) -> Result<UpdateReport, CoreError> {
        self.journal.clear();
        remember(self.inner.belief(), obs, &mut self.journal)?;
        let mut report = self.inner.correct(obs, ReplayVariance::Shrink)?;
        self.whitened.clear();
        self.whitened
            .extend_from_slice(self.inner.whitened_residual());
        let slot = self.store(obs);
        if let Err(error) = self.replay(draw) {
            for &(point, mean, variance) in self.journal.iter().rev() {
                self.inner.restore(point, mean, variance);
            }
            if let Some(slot) = slot {
                self.forget(slot);
            }
            return Err(error);
        }
        for &(point, ..) in &self.journal {
            report.projected += self.inner.project(&[point]);
        }
        report.postfit = postfit(self.inner.belief().mean(), obs);
        Ok(report)
    }

    fn replay(
        &mut self,
        mut draw: impl FnMut(&mut Pcg64Mcg, usize, usize) -> Option<usize>,
    ) -> Result<(), CoreError> {
        let past = &self.buffer[..self.filled];
        for k in 0.. {
            let Some(j) = (!past.is_empty())
                .then(|| draw(&mut self.rng, k, past.len()))
                .flatten()
            else {
                break;
            };
            let obs = past.get(j).ok_or(CoreError::OutOfRange {
                what: "replayed observation",
                index: j,
                len: past.len(),
            })?;
            remember(self.inner.belief(), obs, &mut self.journal)?;
            self.inner.correct(obs, self.config.variance)?;
        }
        Ok(())
    }

    /// Puts an observation into the buffer; `None` when the reservoir leaves it out.
    fn store(&mut self, obs: &Observation<E::Scalar>) -> Option<usize> {
        if obs.is_empty() || self.config.replays == 0 {
            return None;
        }
        self.seen += 1;
        let size = obs.bytes();
        if self.filled == 0 || self.bytes + size <= self.config.byte_budget {
            if self.filled == self.buffer.len() {
                self.buffer.push(obs.clone());
            } else {
                self.buffer[self.filled].clone_from(obs);
            }
            self.filled += 1;
            self.bytes += size;
            return Some(self.filled - 1);
        }
        let j = self.rng.random_range(0..self.seen) as usize;
        if j >= self.filled {
            return None;
        }
        self.bytes = self.bytes - self.buffer[j].bytes() + size;
        self.buffer[j].clone_from(obs);
        while self.bytes > self.config.byte_budget && self.filled > 1 {
            let victim = if self.filled - 1 == j {
                self.filled - 2
            } else {
                self.filled - 1
            };
            self.forget(victim);
            if victim < j {
                return Some(j - 1);
            }
        }
        Some(j)
    }

    fn forget(&mut self, slot: usize) {
        self.bytes -= self.buffer[slot].bytes();
        self.filled -= 1;
        self.buffer.swap(slot, self.filled);
    }
}

/// Notes the beliefs that a correction by `obs` will change.
fn remember<T: Scalar>(
    belief: &Belief<T>,
    obs: &Observation<T>,
    journal: &mut Vec<(u32, T, T)>,
) -> Result<(), CoreError> {
    obs.check_fits(belief.len())?;
    let (mean, variance) = (belief.mean(), belief.variance());
    journal.extend(
        obs.points()
            .iter()
            .map(|&p| (p, mean[p as usize], variance[p as usize])),
    );
    Ok(())
}

impl<E: Revisit> Estimator for MemoryReplay<E> {
    type Scalar = E::Scalar;

    fn belief(&self) -> &Belief<E::Scalar> {
        self.inner.belief()
    }

    fn reset(&mut self, prior: Belief<E::Scalar>) -> Result<(), CoreError> {
        self.inner.reset(prior)?;
        self.rng = Pcg64Mcg::seed_from_u64(self.config.seed);
        (self.filled, self.seen, self.bytes) = (0, 0, 0);
        self.whitened.clear();
        Ok(())
    }

    fn begin_sequence(&mut self) {
        self.inner.begin_sequence();
        if self.config.clear_on_sequence {
            (self.filled, self.seen, self.bytes) = (0, 0, 0);
        }
    }

    fn update(&mut self, obs: &Observation<E::Scalar>) -> Result<UpdateReport, CoreError> {
        let replays = self.config.replays;
        self.run(obs, |rng, k, len| {
            (k < replays).then(|| rng.random_range(0..len))
        })
    }

    fn whitened_residual(&self) -> &[f64] {
        &self.whitened
    }

    fn predict(&self, obs: &Observation<E::Scalar>, out: &mut Prediction) -> Result<(), CoreError> {
        self.inner.predict(obs, out)
    }
}
