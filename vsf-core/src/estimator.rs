use crate::{Belief, CoreError, Observation, Scalar};
use dyn_clone::DynClone;
use std::f64::consts::TAU;

/// What one update did, for monitoring. All numbers are in units of the reading unless said.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UpdateReport {
    /// Touched points of the observation.
    pub contacts: usize,
    /// Degrees of freedom of `nis`: the channels of the reading.
    pub dof: usize,
    /// Normalized innovation squared, `r^T S^-1 r` with `S = W Sigma W^T + R`; its mean is `dof`
    /// for an exact filter whose prior and noise are right.
    pub nis: f64,
    /// Log-density of the reading under the belief before the update,
    /// `-(nis + log det S + dof log 2 pi) / 2`. Summed over a run it is the (prequential) marginal
    /// likelihood by which priors and noises are compared.
    pub log_likelihood: f64,
    /// Norm of the residual `tau - W mu` before the update.
    pub prefit: f64,
    /// Norm of the residual after the update and projection.
    pub postfit: f64,
    /// Points at which `K >= 0` acts: those whose mean the projection moved, by this reading or one that was replayed after it.
    /// Estimators that keep the mean without the constraint count those that are held at zero, and say of which points.
    pub projected: usize,
}

impl UpdateReport {
    /// What can be said before the belief is corrected, of `contacts` touched points, the residual `r = tau - W mu`,
    /// the residual `L^-1 r` whitened with `L L^T = S = W Sigma W^T + R`, and `log_det = log det S`. The other fields
    /// are 0.
    pub fn from_innovation(
        contacts: usize,
        residual: &[f64],
        whitened: &[f64],
        log_det: f64,
    ) -> Self {
        let dof = whitened.len();
        let nis: f64 = whitened.iter().map(|x| x * x).sum();
        Self {
            contacts,
            dof,
            nis,
            log_likelihood: -0.5 * (nis + log_det + dof as f64 * TAU.ln()),
            prefit: residual.iter().map(|r| r * r).sum::<f64>().sqrt(),
            ..Self::default()
        }
    }
}

/// A predicted reading with its uncertainty.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Prediction {
    /// Predicted reading, `d` values.
    pub mean: Vec<f64>,
    /// Its standard deviation per channel, noise included.
    pub sd: Vec<f64>,
}

impl Prediction {
    /// Checks that means and standard deviations are finite.
    ///
    /// # Errors
    /// [`CoreError::NotFinite`] names the channel.
    pub fn check_finite(&self) -> Result<(), CoreError> {
        CoreError::check_finite("predicted reading", &self.mean)?;
        CoreError::check_finite("predicted standard deviation", &self.sd)
    }
}

/// Learns the stiffness field from linear observations.
///
/// On an error the belief is unchanged. Estimators are [`Clone`]; `Box<dyn Estimator<Scalar = T>>` is an
/// estimator, and can be cloned, too.
pub trait Estimator: DynClone + Send + Sync {
    /// Number type of the belief.
    type Scalar: Scalar;

    /// The current belief: marginal mean and variance of every point.
    fn belief(&self) -> &Belief<Self::Scalar>;

    /// The whole field, as one keeps it at the end: the [`belief`](Self::belief) and, by estimators whose prior ties points
    /// together, what the touched points suggest of the others: their means, with the variances of the prior, which
    /// are upper bounds. By default the belief.
    ///
    /// # Errors
    /// Means beyond the range of numbers.
    fn field(&self) -> Result<Belief<Self::Scalar>, CoreError> {
        Ok(self.belief().clone())
    }

    /// Forgets everything and starts from `prior`.
    ///
    /// # Errors
    /// A prior that the estimator cannot take.
    fn reset(&mut self, prior: Belief<Self::Scalar>) -> Result<(), CoreError>;

    /// A new touch sequence begins. The belief is kept; what is bound to the sequence (a
    /// replay buffer that is told so, section III-C) is dropped. Nothing by default.
    fn begin_sequence(&mut self) {}

    /// Takes in one observation.
    ///
    /// # Errors
    /// An observation that does not fit the field, or a result that would not be finite.
    fn update(&mut self, obs: &Observation<Self::Scalar>) -> Result<UpdateReport, CoreError>;

    /// Time passes: every stiffness takes an independent random step of this variance (at least 0
    /// N²/m²). Means stay and variances grow by it, so that later readings count for more than
    /// earlier ones: the prediction step of a Kalman filter, for objects that stiffen, dry, heal or
    /// are cut. For a field that drifts at a rate `Q` (N²/m² per second), call it with `Q * dt`
    /// before each update. By default refused.
    ///
    /// Sums are rounded in [`Estimator::Scalar`]: in `f32`, steps below about 1e-7 of a variance
    /// vanish. Collect them and call this less often.
    ///
    /// # Errors
    /// [`CoreError::Unsupported`] when the estimator takes the field to be constant; a variance that
    /// is negative or not finite; a sum beyond the range of numbers. The belief is then unchanged.
    fn diffuse(&mut self, variance: Self::Scalar) -> Result<(), CoreError> {
        let _ = variance;
        Err(CoreError::Unsupported {
            what: "a field that changes with time (Estimator::diffuse)",
            by: std::any::type_name::<Self>(),
        })
    }

    /// The residual of the last update before it was taken in, whitened with its predicted
    /// covariance: `L^-1 (tau - W mu)` with `L L^T = W Sigma W^T + R`. Independent standard normal
    /// numbers when prior and noise are right. Empty before the first update.
    fn whitened_residual(&self) -> &[f64];

    /// Predicts the reading of `obs` (its own reading is not looked at). By default from the
    /// marginals; estimators with correlations use them.
    ///
    /// # Errors
    /// An observation that reaches beyond the field, or a prediction beyond the range of numbers.
    fn predict(
        &self,
        obs: &Observation<Self::Scalar>,
        out: &mut Prediction,
    ) -> Result<(), CoreError> {
        self.belief().predict(obs, |i| obs.noise().sd(i), out)
    }

    /// Bytes that it holds for past observations, to replay them; by default none. Memory that waits for reuse counts.
    fn buffered_bytes(&self) -> usize {
        0
    }
}

dyn_clone::clone_trait_object!(<T: Scalar> Estimator<Scalar = T>);

impl<T: Scalar> std::fmt::Debug for dyn Estimator<Scalar = T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Estimator")
            .field("scalar", &T::NAME)
            .field("points", &self.belief().len())
            .finish_non_exhaustive()
    }
}

impl<E: Estimator + ?Sized> Estimator for Box<E>
where
    Self: Clone,
{
    type Scalar = E::Scalar;
    fn belief(&self) -> &Belief<E::Scalar> {
        (**self).belief()
    }
    fn field(&self) -> Result<Belief<E::Scalar>, CoreError> {
        (**self).field()
    }
    fn reset(&mut self, prior: Belief<E::Scalar>) -> Result<(), CoreError> {
        (**self).reset(prior)
    }
    fn begin_sequence(&mut self) {
        (**self).begin_sequence();
    }
    fn update(&mut self, obs: &Observation<E::Scalar>) -> Result<UpdateReport, CoreError> {
        (**self).update(obs)
    }
    fn diffuse(&mut self, variance: E::Scalar) -> Result<(), CoreError> {
        (**self).diffuse(variance)
    }
    fn whitened_residual(&self) -> &[f64] {
        (**self).whitened_residual()
    }
    fn predict(&self, obs: &Observation<E::Scalar>, out: &mut Prediction) -> Result<(), CoreError> {
        (**self).predict(obs, out)
    }
    fn buffered_bytes(&self) -> usize {
        (**self).buffered_bytes()
    }
}
