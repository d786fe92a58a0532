use crate::aging::Aging;
use crate::diagonal::postfit;
use crate::reservoir::Reservoir;
use crate::values;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use vsf_core::{Belief, CoreError, Estimator, Observation, Prediction, Scalar, UpdateReport};

#[cfg(feature = "serde")]
mod state;

/// What happens to the variances when a past observation is replayed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ReplayVariance {
    /// Replays leave them alone (default): an observation shrinks the variances once, however often the
    /// means are fitted to it.
    ///
    /// The filter stays somewhat overconfident, as the diagonal filter is by itself, because it ignores
    /// correlations. On well-specified data the normalized innovation squared (NIS) is 1.45 times its dof
    /// with 20 replays and 2.3 times without (`tests/filter/replay.rs`).
    #[default]
    Keep,
    /// Replays shrink them every time (Alg. 1 as printed). The filter acts as if it had seen `1 + T_replay`
    /// times the data and becomes overconfident.
    Shrink,
}

/// An estimator that can take in an observation again: the building block of [`MemoryReplay`].
///
/// Its belief must be its whole state: marginals without correlations, so that writing back earlier
/// marginals undoes a correction. `Box<dyn Revisit<Scalar = T>>` implements the trait too, for a choice at
/// run time.
pub trait Revisit: Estimator {
    /// Makes one correction without projection. With [`ReplayVariance::Keep`] only the means change. Points
    /// that `obs` does not touch stay as they are.
    ///
    /// # Errors
    /// As [`Estimator::update`]; the belief is then unchanged.
    ///
    /// `postfit` and `projected` of the report are not filled in.
    fn correct(
        &mut self,
        obs: &Observation<Self::Scalar>,
        variance: ReplayVariance,
    ) -> Result<UpdateReport, CoreError>;

    /// Mutable access to the belief, to project it or to undo corrections.
    fn belief_mut(&mut self) -> &mut Belief<Self::Scalar>;
}

dyn_clone::clone_trait_object!(<T: Scalar> Revisit<Scalar = T>);

impl<T: Scalar> std::fmt::Debug for dyn Revisit<Scalar = T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Revisit")
            .field("scalar", &T::NAME)
            .field("points", &self.belief().len())
            .finish_non_exhaustive()
    }
}

impl<E: Revisit + ?Sized> Revisit for Box<E>
where
    Self: Clone,
{
    fn correct(
        &mut self,
        obs: &Observation<E::Scalar>,
        variance: ReplayVariance,
    ) -> Result<UpdateReport, CoreError> {
        (**self).correct(obs, variance)
    }

    fn belief_mut(&mut self) -> &mut Belief<E::Scalar> {
        (**self).belief_mut()
    }
}

/// More replays than any control loop has time for.
const MOST_REPLAYS: usize = 1_000_000;

/// Parameters of [`MemoryReplay`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ReplayConfig {
    /// Number of past observations replayed after every update (T_replay), up to a million; default 20
    /// (paper).
    pub replays: usize,
    /// Variances under replay; default [`ReplayVariance::Keep`].
    pub variance: ReplayVariance,
    /// Seed of the random draws, default 0. The same seed gives the same result, bit for bit.
    pub seed: u64,
    /// Upper bound on the memory held by past observations (bytes), default 256 MiB.
    ///
    /// When it is reached, new observations replace random old ones, so that the buffer stays a uniform
    /// sample of the history. One observation is always kept, however large. Memory is reused and never
    /// shrinks: a place in the buffer counts with the size of the largest observation that it
    /// has held. An update
    /// allocates while the buffer fills, and later where an observation is larger than all that were in its
    /// place.
    pub byte_budget: usize,
    /// Whether a new touch sequence empties the buffer, default false.
    ///
    /// The paper empties it, which bounds memory. Here the byte budget bounds it, so earlier touches need
    /// not be forgotten.
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

/// Checks the number of replays and the memory for past observations.
pub(crate) fn check_sizes(replays: usize, byte_budget: usize) -> Result<(), CoreError> {
    if replays > MOST_REPLAYS {
        return Err(CoreError::TooMany {
            what: "replays",
            got: replays,
            max: MOST_REPLAYS,
        });
    }
    if replays > 0 && byte_budget == 0 {
        return Err(CoreError::Parameter {
            name: "replay byte budget",
            value: 0.0,
            range: "> 0 bytes, or set replays to 0",
        });
    }
    Ok(())
}

/// Memory replay (Alg. 1): after each update, random past observations are taken in again.
///
/// An update costs `1 + replays` corrections. Means are projected to `K >= 0` once at the end of an update.
/// (Alg. 1 can also be read as projecting after every replay, as eq. 7 does.) Observations without contacts
/// say nothing about the field and are not stored, but past ones are replayed then as well. The memory of
/// past observations is reused, also across sequences.
///
/// Every replay fits a reading once more, so in the end the means follow the readings, whatever the prior
/// says. [`crate::DualReplay`] counts each reading once.
///
/// When an update fails, the belief is as before, bit for bit, and the observation is not in the buffer.
/// Observations that were removed to make room for it stay removed, and the random draws continue from
/// where they were.
///
/// # A field that changes
/// A past reading describes an earlier state of a field that changes ([`Estimator::diffuse`]). When it is
/// replayed after steps of total variance `Q`, its noise is `R + Q W W^T`, which is right if nothing else
/// is known of the present field. Many old readings share the same steps, however, and together would hold
/// the field back. Therefore an observation leaves the buffer once `Q W W^T` exceeds three times the noise
/// of a channel. The noise is updated when an observation is drawn, so that `diffuse` stays O(N).
#[derive(Debug, Clone)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(
        try_from = "state::ReplayParts<E>",
        bound(
            serialize = "E: serde::Serialize, E::Scalar: serde::Serialize",
            deserialize = "E: Revisit + serde::Deserialize<'de>, E::Scalar: serde::Deserialize<'de>"
        )
    )
)]
pub struct MemoryReplay<E: Estimator> {
    inner: E,
    config: ReplayConfig,
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::state::save_rng"))]
    rng: Pcg64Mcg,
    buffer: Reservoir<E::Scalar>,
    /// Total variance of the field's random steps since the last reset (N²/m²).
    diffused: f64,
    whitened: Vec<f64>,
    #[cfg_attr(feature = "serde", serde(skip))]
    aging: Aging<E::Scalar>,
    /// Drawn in the running update, but no longer worth a replay.
    #[cfg_attr(feature = "serde", serde(skip))]
    faded: Vec<usize>,
    #[cfg_attr(feature = "serde", serde(skip))]
    undo: Undo<E::Scalar>,
    #[cfg_attr(feature = "serde", serde(skip))]
    touched: Vec<E::Scalar>,
    #[cfg_attr(feature = "serde", serde(skip))]
    predicted: Vec<f64>,
}

/// What the running update changed: beliefs of the touched points before each correction, one
/// correction after the other.
#[derive(Debug, Clone, Default)]
struct Undo<T> {
    /// The observation itself, then replays by their index in the buffer.
    replays: Vec<usize>,
    mean: Stack<T>,
    /// Only of corrections that change variances.
    variance: Stack<T>,
}

/// Values of points, the last ones noted on top. It never shrinks, so that no memory is cleared
/// again.
#[derive(Debug, Clone, Default)]
struct Stack<T> {
    values: Vec<T>,
    len: usize,
}

impl<E: Revisit> MemoryReplay<E> {
    /// Wraps an estimator.
    ///
    /// # Errors
    /// A byte budget of zero although replays are requested, or more than a million replays.
    pub fn new(inner: E, config: ReplayConfig) -> Result<Self, CoreError> {
        check_sizes(config.replays, config.byte_budget)?;
        Ok(Self {
            inner,
            config,
            rng: Pcg64Mcg::seed_from_u64(config.seed),
            buffer: Reservoir::new(),
            diffused: 0.0,
            aging: Aging::new()?,
            faded: Vec::new(),
            undo: Undo::default(),
            whitened: Vec::new(),
            touched: Vec::new(),
            predicted: Vec::new(),
        })
    }

    /// The parameters.
    pub fn config(&self) -> &ReplayConfig {
        &self.config
    }

    /// The wrapped estimator.
    pub fn inner(&self) -> &E {
        &self.inner
    }

    /// The wrapped estimator, to reconfigure it between updates.
    pub fn inner_mut(&mut self) -> &mut E {
        &mut self.inner
    }

    /// Returns the wrapped estimator.
    pub fn into_inner(self) -> E {
        self.inner
    }

    /// Number of observations in the buffer.
    pub fn buffered(&self) -> usize {
        self.buffer.len()
    }

    /// Takes in `obs`, then the buffered observations with the indices `replays`, in this order.
    ///
    /// This is an update with given instead of random draws, such as to reproduce another run. If `obs` was
    /// stored, it is the last one in the buffer.
    ///
    /// # Errors
    /// As [`Estimator::update`], or an index beyond the buffer.
    pub fn update_with(
        &mut self,
        obs: &Observation<E::Scalar>,
        replays: &[usize],
    ) -> Result<UpdateReport, CoreError> {
        // An observation that random keys leave out is found where it is replayed.
        let len = self.buffer.len() + usize::from(self.may_store(obs));
        if let Some(&index) = replays.iter().find(|index| **index >= len) {
            return Err(CoreError::OutOfRange {
                what: "replayed observation",
                index,
                len,
            });
        }
        self.run(obs, |_, k, _| replays.get(k).copied())
    }

    /// Whether an observation is one to be replayed.
    fn may_store(&self, obs: &Observation<E::Scalar>) -> bool {
        !obs.is_empty() && self.config.replays > 0
    }

    fn run(
        &mut self,
        obs: &Observation<E::Scalar>,
        draw: impl FnMut(&mut Pcg64Mcg, usize, usize) -> Option<usize>,
    ) -> Result<UpdateReport, CoreError> {
        obs.check_fits(self.inner.belief().len())?;
        self.undo.clear();
        self.faded.clear();
        self.undo
            .note(self.inner.belief(), obs, ReplayVariance::Shrink);
        let mut report = self.inner.correct(obs, ReplayVariance::Shrink)?;
        self.predicted.clear();
        self.predicted
            .extend_from_slice(self.inner.whitened_residual());
        let stored = self.may_store(obs)
            && self.buffer.push(
                obs,
                &(),
                self.diffused,
                self.config.byte_budget,
                &mut self.rng,
            );
        if let Err(error) = self.replay(draw) {
            self.roll_back(obs);
            if stored {
                self.buffer.pop();
            }
            return Err(error);
        }
        std::mem::swap(&mut self.whitened, &mut self.predicted);
        report.projected = self.project(obs);
        report.postfit = postfit(
            obs,
            self.inner.belief().mean(),
            &mut self.touched,
            &mut self.predicted,
        );
        self.drop_faded();
        Ok(report)
    }

    /// Takes observations that have faded out of the buffer, the last first: those that move up
    /// into their places stay.
    fn drop_faded(&mut self) {
        self.faded.sort_unstable_by(|a, b| b.cmp(a));
        self.faded.dedup();
        for &j in &self.faded {
            self.buffer.remove(j);
        }
    }

    fn replay(
        &mut self,
        mut draw: impl FnMut(&mut Pcg64Mcg, usize, usize) -> Option<usize>,
    ) -> Result<(), CoreError> {
        let len = self.buffer.len();
        for k in 0.. {
            let Some(j) = (len > 0).then(|| draw(&mut self.rng, k, len)).flatten() else {
                break;
            };
            if !self.buffer.age(j, self.diffused, &mut self.aging) {
                self.faded.push(j);
                continue;
            }
            let past = self.buffer.get(j).ok_or(CoreError::OutOfRange {
                what: "replayed observation",
                index: j,
                len,
            })?;
            let mode = self.config.variance;
            self.undo.note(self.inner.belief(), past, mode);
            self.undo.replays.push(j);
            self.inner.correct(past, mode)?;
        }
        Ok(())
    }

    /// The belief as it was before the running update.
    fn roll_back(&mut self, obs: &Observation<E::Scalar>) {
        let (mean, variance) = self.inner.belief_mut().parts_mut();
        let Undo {
            replays,
            mean: means,
            variance: variances,
        } = &mut self.undo;
        let past = replays.iter().rev().filter_map(|&j| self.buffer.get(j));
        let last = (obs, ReplayVariance::Shrink);
        for (obs, mode) in past.map(|o| (o, self.config.variance)).chain([last]) {
            means.pop(obs.points(), mean);
            if mode == ReplayVariance::Shrink {
                variances.pop(obs.points(), variance);
            }
        }
    }

    /// Projects all points that the running update touched.
    fn project(&mut self, obs: &Observation<E::Scalar>) -> usize {
        let mean = self.inner.belief_mut().parts_mut().0;
        // Untouched means are not negative. One pass over all is quicker than many short ones.
        if self.undo.mean.len > mean.len() / 4 {
            return values::project(mean);
        }
        let past = self.undo.replays.iter().filter_map(|&j| self.buffer.get(j));
        past.chain([obs])
            .map(|obs| values::project_at(obs.points(), mean))
            .sum()
    }
}

impl<T: Scalar> Undo<T> {
    fn clear(&mut self) {
        self.replays.clear();
        self.mean.len = 0;
        self.variance.len = 0;
    }

    /// Notes what a correction by `obs` will change.
    fn note(&mut self, belief: &Belief<T>, obs: &Observation<T>, mode: ReplayVariance) {
        self.mean.push(obs.points(), belief.mean());
        if mode == ReplayVariance::Shrink {
            self.variance.push(obs.points(), belief.variance());
        }
    }
}

impl<T: Scalar> Stack<T> {
    /// Notes the values at `points`.
    fn push(&mut self, points: &[u32], from: &[T]) {
        let start = self.len;
        self.len += points.len();
        if self.len > self.values.len() {
            self.values.resize(self.len, T::ZERO);
        }
        values::gather(points, [from], [&mut self.values[start..self.len]]);
    }

    /// Moves the values that were noted last back to their points.
    fn pop(&mut self, points: &[u32], to: &mut [T]) {
        let start = self.len - points.len();
        values::scatter(points, &self.values[start..self.len], to);
        self.len = start;
    }
}

impl<E: Revisit + Clone> Estimator for MemoryReplay<E> {
    type Scalar = E::Scalar;

    fn belief(&self) -> &Belief<E::Scalar> {
        self.inner.belief()
    }

    fn field(&self) -> Result<Belief<E::Scalar>, CoreError> {
        self.inner.field()
    }

    fn reset(&mut self, prior: Belief<E::Scalar>) -> Result<(), CoreError> {
        self.inner.reset(prior)?;
        self.rng = Pcg64Mcg::seed_from_u64(self.config.seed);
        // A fresh one: memory that waits for reuse counts, and others would have to leave sooner than at first.
        self.buffer = Reservoir::new();
        self.diffused = 0.0;
        self.whitened.clear();
        Ok(())
    }

    fn begin_sequence(&mut self) {
        self.inner.begin_sequence();
        if self.config.clear_on_sequence {
            self.buffer.clear();
        }
    }

    fn update(&mut self, obs: &Observation<E::Scalar>) -> Result<UpdateReport, CoreError> {
        let replays = self.config.replays;
        self.run(obs, |rng, k, len| {
            (k < replays).then(|| rng.random_range(0..len))
        })
    }

    fn diffuse(&mut self, variance: E::Scalar) -> Result<(), CoreError> {
        let diffused = self.diffused + variance.to_f64();
        if diffused == f64::INFINITY {
            return Err(CoreError::Overflow {
                what: "total variance of the field's steps",
            });
        }
        self.inner.diffuse(variance)?;
        self.diffused = diffused;
        Ok(())
    }

    /// At most [`ReplayConfig::byte_budget`], or one observation, if that alone is larger.
    fn buffered_bytes(&self) -> usize {
        self.buffer.bytes()
    }

    fn whitened_residual(&self) -> &[f64] {
        &self.whitened
    }

    fn predict(&self, obs: &Observation<E::Scalar>, out: &mut Prediction) -> Result<(), CoreError> {
        self.inner.predict(obs, out)
    }
}
