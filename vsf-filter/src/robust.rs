use crate::{ReplayVariance, Revisit};
use vsf_core::{
    Belief, CoreError, Estimator, Noise, Observation, Prediction, Scalar, SymmetricFactor,
    UpdateReport,
};

#[cfg(feature = "serde")]
mod state;

/// Weights stay above this, so that inflated noise stays finite.
const MIN_WEIGHT: f64 = 1e-30;

/// Loss that sets the weight of a reading by its residual `z = |r| / s`, in predicted standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum RobustLoss {
    /// `min(1, k / z)`: full weight up to `k`, a bounded influence beyond. At `k` = 1.345 it down-weights
    /// 18 % of good readings (those with `z > k`) and loses 5 % of efficiency.
    Huber {
        /// Threshold of full weight, > 0; default 1.345.
        k: f64,
    },
    /// `min(1, (nu + 1) / (nu + z²))`: the farther out a reading, the less its influence. For gross errors,
    /// and for a channel that is wrong all the time. It down-weights 32 % of good readings (those with
    /// `z > 1`), though only slightly.
    StudentT {
        /// Degrees of freedom, > 0; 4 is customary. The smaller, the heavier the tails.
        nu: f64,
    },
}

impl RobustLoss {
    /// Huber's loss with `k` = 1.345.
    pub const HUBER: Self = Self::Huber { k: 1.345 };
    /// Student's t with `nu` = 4.
    pub const STUDENT_T: Self = Self::StudentT { nu: 4.0 };

    /// Weight in (0, 1] of a residual of `z` predicted standard deviations.
    pub fn weight(&self, z: f64) -> f64 {
        let z = z.abs();
        let weight = match *self {
            Self::Huber { k } if z > k => k / z,
            Self::Huber { .. } => 1.0,
            Self::StudentT { nu } => (nu + 1.0) / (nu + z * z),
        };
        weight.clamp(MIN_WEIGHT, 1.0)
    }

    pub(crate) fn check(&self) -> Result<(), CoreError> {
        let (name, value) = match *self {
            Self::Huber { k } => ("Huber's k", k),
            Self::StudentT { nu } => ("degrees of freedom nu of Student's t", nu),
        };
        if value > 0.0 && value.is_finite() {
            Ok(())
        } else {
            Err(CoreError::Parameter {
                name,
                value,
                range: "> 0 and finite",
            })
        }
    }
}

impl Default for RobustLoss {
    fn default() -> Self {
        Self::HUBER
    }
}

/// Wraps any estimator to make it robust against outliers in the readings, such as spikes or a stuck
/// sensor.
///
/// Before an update every channel is compared with its prediction. A residual of `z` predicted standard
/// deviations `s` gets a weight `omega` ([`RobustLoss`]). The noise of the channel is inflated until its
/// innovation variance is `s² / omega`: covariances `R_ij` become `R_ij / sqrt(omega_i omega_j)`, and the
/// diagonal gains another `(s_i² - R_ii) (1 / omega_i - 1)` for the uncertainty of the field. Without this
/// term, an outlier would pass unhindered wherever points are touched for the first time.
///
/// As a result, one channel alone shifts its prediction by at most `k` predicted standard deviations
/// (Huber). Readings of full weight reach the wrapped estimator unchanged.
///
/// # With memory replay
/// There are two ways to combine both:
/// - A [`MemoryReplay`](crate::MemoryReplay) around a `RobustNoise` (the better way): every replay weighs a
///   past observation anew, by all that is known by then (iteratively reweighted least squares).
/// - A `MemoryReplay` inside: it stores every observation with the noise assigned at its arrival.
///
/// Field errors in an example (`tests/filter/val_robust.rs`), with 5 % spikes of 60 deviations: 1.9 N/m
/// with replay alone, 0.16 N/m with either way, and 0.15 N/m without spikes. With six times less noise,
/// where first weights are often wrong: 0.31 N/m with replay alone, 0.03 N/m with replay around, 0.2 to 0.4
/// N/m with replay inside, and 0.03 N/m without spikes.
///
/// # Cost
/// One [`Estimator::predict`] and, when a weight is below 1, a copy of the observation: together about a
/// third of an update of [`DiagonalKalman`](crate::DiagonalKalman). Inside a memory replay every replay
/// pays this too. Nothing is allocated after warm-up.
///
/// # Limits
/// - Everything depends on the predicted deviations. If the prior or the noise is too narrow, good readings
///   look like outliers and learning slows down: watch [`RobustNoise::downweighted_share`]. An
///   overconfident filter has the same effect, such as [`DiagonalKalman`](crate::DiagonalKalman) without
///   replay where many points are touched at once. There this wrapper can lose more than it gains.
/// - Errors in most channels, or errors that have been the same since the first touch, are not seen as
///   outliers.
/// - With inflated noise, innovations are too small: the mean NIS of good readings is 0.82 of its dof for
///   [`RobustLoss::HUBER`] and 0.77 for [`RobustLoss::STUDENT_T`]. Log-likelihoods are not those of the
///   Gaussian model.
///
/// # Reference
/// P. J. Huber, *Robust Estimation of a Location Parameter*, 1964, doi 10.1214/aoms/1177703732.
/// K. L. Lange, R. J. A. Little, J. M. G. Taylor, *Robust Statistical Modeling Using the t
/// Distribution*, 1989, doi 10.1080/01621459.1989.10478852. In Kalman filters: C. J. Masreliez,
/// R. D. Martin, *Robust Bayesian Estimation for the Linear Model and Robustifying the Kalman
/// Filter*, 1977, doi 10.1109/TAC.1977.1101538 (weights by the innovation, as here); M. A. Gandhi,
/// L. Mili, *Robust Kalman Filter Based on a Generalized Maximum-Likelihood-Type Estimator*, 2010,
/// doi 10.1109/TSP.2009.2039731.
///
/// ```
/// use vsf_core::{Belief, Estimator, Noise, Observation};
/// use vsf_filter::{DiagonalKalman, RobustLoss, RobustNoise};
/// // A spring of 20 N/m pressed by 1 m; one of 30 readings is a spike.
/// let inner = DiagonalKalman::new(Belief::<f64>::uniform(1, 0.0, 50.0)?);
/// let mut filter = RobustNoise::new(inner, RobustLoss::STUDENT_T)?;
/// let mut obs = Observation::new(Noise::uniform(1, 0.5)?);
/// for t in 0..30 {
///     let force = if t == 20 { 500.0 } else { 20.0 };
///     obs.rebuild(1, &[0], &[force], |_, w| w[0] = 1.0)?;
///     filter.update(&obs)?;
/// }
/// assert!((filter.belief().mean()[0] - 20.0).abs() < 0.1);
/// assert_eq!(filter.downweighted_share(), Some(1.0 / 30.0));
/// # Ok::<(), vsf_core::CoreError>(())
/// ```
#[derive(Debug, Clone)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(
        try_from = "state::RobustParts<E>",
        bound(
            serialize = "E: serde::Serialize",
            deserialize = "E: serde::Deserialize<'de>"
        )
    )
)]
pub struct RobustNoise<E: Estimator> {
    inner: E,
    loss: RobustLoss,
    /// Of the last update.
    weights: Vec<f64>,
    /// Channel readings so far, and those of them with a weight below 1.
    readings: u64,
    downweighted: u64,
    #[cfg_attr(feature = "serde", serde(skip))]
    scratch: Scratch<E>,
}

#[derive(Debug, Clone)]
struct Scratch<E: Estimator> {
    prediction: Prediction,
    weights: Vec<f64>,
    covariance: Vec<f64>,
    noise: Noise,
    factor: SymmetricFactor,
    inflated: Observation<E::Scalar>,
}

impl<E: Estimator> Scratch<E> {
    fn new() -> Result<Self, CoreError> {
        let noise = Noise::uniform(0, 1.0)?;
        Ok(Self {
            prediction: Prediction::default(),
            weights: Vec::new(),
            covariance: Vec::new(),
            inflated: Observation::new(noise.clone()),
            noise,
            factor: SymmetricFactor::default(),
        })
    }

    /// Weights of the channels of `obs`.
    fn weigh(
        &mut self,
        inner: &E,
        loss: RobustLoss,
        obs: &Observation<E::Scalar>,
    ) -> Result<(), CoreError> {
        inner.predict(obs, &mut self.prediction)?;
        self.prediction.check_finite()?;
        let Prediction { mean, sd } = &self.prediction;
        self.weights.clear();
        let residuals = obs.reading().iter().zip(mean).zip(sd);
        self.weights
            .extend(residuals.map(|((t, m), s)| loss.weight((t.to_f64() - m) / s)));
        Ok(())
    }

    /// `obs` with its noise inflated by the weights.
    fn inflate<'a>(
        &'a mut self,
        obs: &'a Observation<E::Scalar>,
    ) -> Result<&'a Observation<E::Scalar>, CoreError> {
        if self.weights.iter().all(|&w| w == 1.0) {
            return Ok(obs);
        }
        let (d, r) = (obs.dim(), obs.noise().covariance());
        self.covariance.resize(d * d, 0.0);
        for i in 0..d {
            let w = self.weights[i];
            for j in 0..i {
                let scaled = r[i * d + j] / (w * self.weights[j]).sqrt();
                self.covariance[i * d + j] = scaled;
                self.covariance[j * d + i] = scaled;
            }
            let own = r[i * d + i];
            let field = (self.prediction.sd[i].powi(2) - own).max(0.0);
            self.covariance[i * d + i] = own / w + field * (1.0 / w - 1.0);
        }
        self.noise.set_full(d, &self.covariance, &mut self.factor)?;
        self.inflated.clone_from(obs);
        self.inflated.set_noise(&self.noise)?;
        Ok(&self.inflated)
    }
}

impl<E: Estimator> RobustNoise<E> {
    /// Wraps an estimator.
    ///
    /// # Errors
    /// A parameter of the loss that is not positive and finite.
    pub fn new(inner: E, loss: RobustLoss) -> Result<Self, CoreError> {
        loss.check()?;
        Ok(Self {
            inner,
            loss,
            weights: Vec::new(),
            readings: 0,
            downweighted: 0,
            scratch: Scratch::new()?,
        })
    }

    /// The loss.
    pub fn loss(&self) -> RobustLoss {
        self.loss
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

    /// Weight in (0, 1] of every channel in the last update; empty before the first one. If the weight of a
    /// joint stays small, its sensor does not fit the field.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Share of all channel readings since the last reset whose weight was below 1; `None` before the first
    /// update.
    ///
    /// [`RobustLoss`] gives the share to expect of good readings. Replays that keep the variances are not
    /// counted. A reading is counted even if its update then failed in a replay.
    pub fn downweighted_share(&self) -> Option<f64> {
        (self.readings > 0).then(|| self.downweighted as f64 / self.readings as f64)
    }

    /// Has the estimator inside take in `obs` with inflated noise. Weights are noted for a `fresh`
    /// reading: one that is replayed was fitted before, and shows smaller residuals.
    fn robustly(
        &mut self,
        obs: &Observation<E::Scalar>,
        fresh: bool,
        take_in: impl FnOnce(&mut E, &Observation<E::Scalar>) -> Result<UpdateReport, CoreError>,
    ) -> Result<UpdateReport, CoreError> {
        self.scratch.weigh(&self.inner, self.loss, obs)?;
        let inflated = self.scratch.inflate(obs)?;
        let report = take_in(&mut self.inner, inflated)?;
        if fresh {
            std::mem::swap(&mut self.weights, &mut self.scratch.weights);
            self.readings += self.weights.len() as u64;
            self.downweighted += self.weights.iter().filter(|&&w| w < 1.0).count() as u64;
        }
        Ok(report)
    }
}

impl<E: Estimator + Clone> Estimator for RobustNoise<E> {
    type Scalar = E::Scalar;

    fn belief(&self) -> &Belief<E::Scalar> {
        self.inner.belief()
    }

    fn field(&self) -> Result<Belief<E::Scalar>, CoreError> {
        self.inner.field()
    }

    fn reset(&mut self, prior: Belief<E::Scalar>) -> Result<(), CoreError> {
        self.inner.reset(prior)?;
        self.weights.clear();
        (self.readings, self.downweighted) = (0, 0);
        Ok(())
    }

    fn begin_sequence(&mut self) {
        self.inner.begin_sequence();
    }

    fn update(&mut self, obs: &Observation<E::Scalar>) -> Result<UpdateReport, CoreError> {
        self.robustly(obs, true, |inner, obs| inner.update(obs))
    }

    fn diffuse(&mut self, variance: E::Scalar) -> Result<(), CoreError> {
        self.inner.diffuse(variance)
    }

    fn buffered_bytes(&self) -> usize {
        self.inner.buffered_bytes()
    }

    fn whitened_residual(&self) -> &[f64] {
        self.inner.whitened_residual()
    }

    fn predict(&self, obs: &Observation<E::Scalar>, out: &mut Prediction) -> Result<(), CoreError> {
        self.inner.predict(obs, out)
    }
}

impl<E: Revisit + Clone> Revisit for RobustNoise<E> {
    fn correct(
        &mut self,
        obs: &Observation<E::Scalar>,
        variance: ReplayVariance,
    ) -> Result<UpdateReport, CoreError> {
        let fresh = variance == ReplayVariance::Shrink;
        self.robustly(obs, fresh, |inner, obs| inner.correct(obs, variance))
    }

    fn belief_mut(&mut self) -> &mut Belief<E::Scalar> {
        self.inner.belief_mut()
    }
}
