use crate::{Belief, CoreError, Observation, Scalar};
use dyn_clone::DynClone;
use std::f64::consts::TAU;

/// Diagnostics of one update. [`prefit`](Self::prefit) and [`postfit`](Self::postfit) are in units of the reading.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UpdateReport {
    /// Number of touched points of the observation.
    pub contacts: usize,
    /// Degrees of freedom of `nis`: the channels of the reading.
    pub dof: usize,
    /// Normalized innovation squared, `r^T S^-1 r` with the residual `r = tau - W mu` before the update
    /// and `S = W Sigma W^T + R`. Its mean is `dof` for an exact filter whose prior and noise are right.
    pub nis: f64,
    /// Log-density of the reading under the belief before the update,
    /// `-(nis + log det S + dof log 2 pi) / 2`. Its sum over a run is the (prequential) log marginal
    /// likelihood, by which priors and noises can be compared.
    pub log_likelihood: f64,
    /// Norm of the residual `tau - W mu` before the update.
    pub prefit: f64,
    /// Norm of the residual after the update and projection.
    pub postfit: f64,
    /// Number of points at which the constraint `K >= 0` is active: those whose mean was moved by the projection,
    /// after this reading or one replayed after it. Estimators that also keep an unconstrained mean count the points
    /// held at zero instead; their documentation says among which points.
    pub projected: usize,
}

impl UpdateReport {
    /// The part of the report that is known before the belief is corrected; the other fields are 0.
    ///
    /// `contacts` is the number of touched points, `residual` is `r = tau - W mu`, `whitened` is `L^-1 r` with
    /// `L L^T = S = W Sigma W^T + R`, and `log_det` is `log det S`.
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
    /// Standard deviation of each channel, noise included.
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
/// On an error the belief is unchanged. Estimators are [`Clone`]. `Box<dyn Estimator<Scalar = T>>` is itself an
/// estimator and can be cloned.
pub trait Estimator: DynClone + Send + Sync {
    /// Number type of the belief.
    type Scalar: Scalar;

    /// The current belief: marginal mean and variance of every point.
    fn belief(&self) -> &Belief<Self::Scalar>;

    /// The whole field, as saved at the end of a run. By default the [`belief`](Self::belief).
    ///
    /// An estimator whose prior correlates points also infers the means of untouched points from the touched ones.
    /// The variances of these points remain those of the prior, which are upper bounds.
    ///
    /// # Errors
    /// A mean that overflows.
    fn field(&self) -> Result<Belief<Self::Scalar>, CoreError> {
        Ok(self.belief().clone())
    }

    /// Forgets everything and starts again from `prior`.
    ///
    /// # Errors
    /// A prior that the estimator does not accept.
    fn reset(&mut self, prior: Belief<Self::Scalar>) -> Result<(), CoreError>;

    /// Begins a new touch sequence. The default does nothing.
    ///
    /// The belief is kept. State that belongs to one sequence is dropped, such as a replay buffer
    /// that is configured so (section III-C).
    fn begin_sequence(&mut self) {}

    /// Updates the belief with one observation.
    ///
    /// # Errors
    /// An observation that does not fit the field, or a result that would not be finite.
    fn update(&mut self, obs: &Observation<Self::Scalar>) -> Result<UpdateReport, CoreError>;

    /// Lets every stiffness take an independent random step of this variance (N²/m², >= 0).
    ///
    /// This is the prediction step of a Kalman filter, for objects that stiffen, dry, heal or are
    /// cut. Means stay, variances grow by `variance`, and later readings therefore count for more
    /// than earlier ones. For a field that drifts at a rate `Q` (N²/m² per second), call this with
    /// `Q * dt` before each update. The default returns an error.
    ///
    /// Sums are rounded in [`Estimator::Scalar`]: in `f32`, steps below about 1e-7 of a variance
    /// vanish. Accumulate such steps and call this less often.
    ///
    /// # Errors
    /// [`CoreError::Unsupported`] when the estimator assumes a constant field; a variance that is
    /// negative or not finite; a sum that overflows. The belief is then unchanged.
    fn diffuse(&mut self, variance: Self::Scalar) -> Result<(), CoreError> {
        let _ = variance;
        Err(CoreError::Unsupported {
            what: "a field that changes with time (Estimator::diffuse)",
            by: std::any::type_name::<Self>(),
        })
    }

    /// The innovation of the last update, whitened with its predicted covariance.
    ///
    /// This is `L^-1 (tau - W mu)` with `L L^T = W Sigma W^T + R`, where `mu` and `Sigma` are those
    /// before the update. Its entries are independent standard normal numbers when prior and noise
    /// are right. Empty before the first update.
    fn whitened_residual(&self) -> &[f64];

    /// Predicts the reading of `obs`, whose own reading is ignored.
    ///
    /// The default uses the marginals of the belief. Estimators that keep correlations use those too.
    ///
    /// # Errors
    /// An observation that refers to points beyond the field, or a prediction that overflows.
    fn predict(
        &self,
        obs: &Observation<Self::Scalar>,
        out: &mut Prediction,
    ) -> Result<(), CoreError> {
        self.belief().predict(obs, |i| obs.noise().sd(i), out)
    }

    /// Memory (bytes) held for the replay of past observations, spare capacity included. 0 by default.
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
