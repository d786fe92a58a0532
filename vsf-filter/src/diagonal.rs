use crate::replay::{ReplayVariance, Revisit};
use crate::{kernel, values};
use vsf_core::{
    Belief, CoreError, Estimator, Observation, Prediction, Scalar, SymmetricFactor, UpdateReport,
};

/// How [`DiagonalKalman`] takes in an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum DiagonalForm {
    /// Gain `v W^T S^-1` with `S = W v W^T + R`: the exact posterior mean of one observation.
    ///
    /// The variances lie between those of eq. 7 and the exact ones of one observation: with
    /// `h = w^T (R + c W v W^T)^-1 w`, `v' = v (1 - c v h) / (1 + (1 - c) v h)`, c = 0.05.
    ///
    /// With c = 0 (eq. 7), a point learns as if all others were known. Where many points are touched
    /// together, variances become far too small, and later readings count too little. With c = 1 (the exact
    /// variances), the filter lacks the correlations between points and so forgets what earlier readings
    /// said of them jointly. It then follows every reading, even those that contradict each other.
    #[default]
    Innovation,
    /// Variances by eq. 7, `1/v' = 1/v + w^T R^-1 w`, which then also enter the gain: a more cautious step
    /// (the form of OpenVSF).
    InnovationUpdated,
    /// Eq. 7 as printed, with gain `v' W^T R^-1`: every point is corrected by the whole residual.
    ///
    /// It diverges when an eigenvalue of `W v' W^T R^-1` exceeds 2. It is stable for the prior of the paper
    /// (sd 0.1 N/m, sigma_tau 1 N m), but not in general.
    Printed,
}

impl DiagonalForm {
    /// How much of the uncertainty of the other points counts when a point learns: c.
    fn others(self) -> f64 {
        match self {
            Self::Innovation => 0.05,
            Self::InnovationUpdated | Self::Printed => 0.0,
        }
    }
}

/// Projected diagonal Kalman filter: one independent Gaussian per point (eq. 6-7).
///
/// An update costs `O(d² n)` time for `n` touched points and `d` channels, whatever the size of the field.
/// It allocates only at its first use at a given size.
///
/// In `f32`, variances are accurate to a percent as long as one reading reduces the variance of a point to
/// no less than a millionth of its prior (`v w² / R` below 1e6). Use `f64` beyond that.
///
/// Points that were touched together are correlated afterward, but this filter does not represent
/// correlations. Use [`crate::MemoryReplay`] to compensate, as the paper does.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DiagonalKalman<T: Scalar> {
    belief: Belief<T>,
    form: DiagonalForm,
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::state::finite"))]
    whitened: Vec<f64>,
    #[cfg_attr(feature = "serde", serde(skip))]
    scratch: Correction<T>,
}

/// One correction and its buffers; means and variances are those of the touched points, in order.
#[derive(Debug, Clone, Default)]
pub(crate) struct Correction<T> {
    mean: Vec<T>,
    variance: Vec<T>,
    predicted: Vec<f64>,
    /// Innovation covariance, then the predicted reading.
    moments: Vec<f64>,
    residual: Vec<f64>,
    whitened: Vec<f64>,
    gain: Vec<f64>,
    blend: Vec<f64>,
    whitener: Vec<f64>,
    factor: SymmetricFactor,
    log_det: f64,
}

impl<T: Scalar> DiagonalKalman<T> {
    /// Creates a filter that starts from `prior`, in the default form.
    pub fn new(prior: Belief<T>) -> Self {
        Self::with_form(prior, DiagonalForm::default())
    }

    /// Creates a filter with the given form of the update.
    pub fn with_form(prior: Belief<T>, form: DiagonalForm) -> Self {
        Self {
            belief: prior,
            form,
            whitened: Vec::new(),
            scratch: Correction::default(),
        }
    }

    /// The form of the update.
    pub fn form(&self) -> DiagonalForm {
        self.form
    }
}

impl<T: Scalar> Correction<T> {
    /// The touched points of a field.
    pub(crate) fn gather(&mut self, obs: &Observation<T>, mean: &[T], variance: &[T]) {
        self.mean.resize(obs.len(), T::ZERO);
        self.variance.resize(obs.len(), T::ZERO);
        let to = [&mut self.mean[..], &mut self.variance];
        values::gather(obs.points(), [mean, variance], to);
    }

    /// The factor that [`Correction::innovate`] made.
    pub(crate) fn factor(&self) -> &SymmetricFactor {
        &self.factor
    }

    /// Predicts the reading and factors the innovation covariance `S = W diag(variance) W^T + R`.
    pub(crate) fn innovate(&mut self, obs: &Observation<T>) -> Result<(), CoreError> {
        let d = obs.dim();
        self.moments.resize((d + 1) * d, 0.0);
        kernel::moments(obs, &self.mean, &self.variance, &mut self.moments);
        let noise = obs.noise().covariance();
        let (covariance, predicted) = self.moments.split_at_mut(d * d);
        covariance.iter_mut().zip(noise).for_each(|(s, r)| *s += r);
        self.residual.clear();
        let pairs = obs.reading().iter().zip(&*predicted);
        self.residual.extend(pairs.map(|(t, p)| t.to_f64() - p));
        CoreError::check_finite("residual", &self.residual)?;
        let factored = self.factor.factor("innovation covariance", d, covariance);
        if !matches!(factored, Err(CoreError::NotPositiveDefinite { .. })) {
            return factored;
        }
        // Noise so small drowns in the rounding of sums in single precision.
        kernel::double_covariance(obs, &self.variance, covariance);
        covariance.iter_mut().zip(noise).for_each(|(s, r)| *s += r);
        self.factor.factor("innovation covariance", d, covariance)
    }

    /// New variances; the innovation covariance is at hand.
    fn shrink(&mut self, obs: &Observation<T>, form: DiagonalForm) -> Result<(), CoreError> {
        let (d, c) = (obs.dim(), form.others());
        let pairs = obs.noise().covariance().iter().zip(&self.moments);
        self.blend.clear();
        self.blend.extend(pairs.map(|(r, s)| (1.0 - c) * r + c * s));
        self.factor.factor("noise covariance", d, &self.blend)?;
        self.factor.inverse_lower(&mut self.whitener);
        kernel::shrink(obs, &self.whitener, c, &mut self.variance);
        if values::all_positive(&self.variance) {
            Ok(())
        } else {
            Err(CoreError::Overflow {
                what: "variance of a point",
            })
        }
    }

    /// New means and variances of the touched points, before projection, from the old ones.
    fn correct(
        &mut self,
        obs: &Observation<T>,
        form: DiagonalForm,
        mode: ReplayVariance,
    ) -> Result<(), CoreError> {
        self.innovate(obs)?;
        self.whitened.clone_from(&self.residual);
        self.factor.solve_lower(&mut self.whitened);
        self.log_det = self.factor.log_det();

        if form == DiagonalForm::Innovation {
            self.shift(obs);
        }
        if mode == ReplayVariance::Shrink {
            self.shrink(obs, form)?;
        }
        match form {
            DiagonalForm::Innovation => {}
            DiagonalForm::InnovationUpdated => {
                self.innovate(obs)?;
                self.shift(obs);
            }
            DiagonalForm::Printed => {
                self.factor
                    .factor("noise covariance", obs.dim(), obs.noise().covariance())?;
                self.shift(obs);
            }
        }
        if values::all_finite(&self.mean) {
            Ok(())
        } else {
            Err(CoreError::Overflow {
                what: "mean stiffness of a point",
            })
        }
    }

    /// Corrects the means by `v W^T A^-1 r` with the factored matrix `A`.
    fn shift(&mut self, obs: &Observation<T>) {
        self.gain.clone_from(&self.residual);
        self.factor.solve(&mut self.gain);
        kernel::shift(obs, &self.gain, &self.variance, &mut self.mean);
    }
}

impl<T: Scalar> Revisit for DiagonalKalman<T> {
    fn correct(
        &mut self,
        obs: &Observation<T>,
        mode: ReplayVariance,
    ) -> Result<UpdateReport, CoreError> {
        obs.check_fits(self.belief.len())?;
        let scratch = &mut self.scratch;
        scratch.gather(obs, self.belief.mean(), self.belief.variance());
        scratch.correct(obs, self.form, mode)?;

        let (mean, variance) = self.belief.parts_mut();
        values::scatter(obs.points(), &scratch.mean, mean);
        if mode == ReplayVariance::Shrink {
            values::scatter(obs.points(), &scratch.variance, variance);
        }
        std::mem::swap(&mut self.whitened, &mut scratch.whitened);
        Ok(UpdateReport::from_innovation(
            obs.len(),
            &scratch.residual,
            &self.whitened,
            scratch.log_det,
        ))
    }

    fn belief_mut(&mut self) -> &mut Belief<T> {
        &mut self.belief
    }
}

impl<T: Scalar> Estimator for DiagonalKalman<T> {
    type Scalar = T;

    fn belief(&self) -> &Belief<T> {
        &self.belief
    }

    fn reset(&mut self, prior: Belief<T>) -> Result<(), CoreError> {
        self.belief = prior;
        self.whitened.clear();
        Ok(())
    }

    fn update(&mut self, obs: &Observation<T>) -> Result<UpdateReport, CoreError> {
        let mut report = self.correct(obs, ReplayVariance::Shrink)?;
        report.projected = values::project_at(obs.points(), self.belief.parts_mut().0);
        let scratch = &mut self.scratch;
        report.postfit = postfit(
            obs,
            self.belief.mean(),
            &mut scratch.mean,
            &mut scratch.predicted,
        );
        Ok(report)
    }

    fn diffuse(&mut self, variance: T) -> Result<(), CoreError> {
        self.belief.diffuse(variance)
    }

    fn whitened_residual(&self) -> &[f64] {
        &self.whitened
    }

    fn predict(&self, obs: &Observation<T>, out: &mut Prediction) -> Result<(), CoreError> {
        obs.check_fits(self.belief.len())?;
        out.mean.resize(obs.dim(), 0.0);
        out.sd.resize(obs.dim(), 0.0);
        kernel::predict(obs, &self.belief, &mut out.mean, &mut out.sd);
        for (i, sd) in out.sd.iter_mut().enumerate() {
            *sd = (*sd + obs.noise().sd(i).powi(2)).sqrt();
        }
        out.check_finite()
    }
}

/// Norm of the residual of `obs` for a field of means. `touched` and `predicted` are scratch.
pub(crate) fn postfit<T: Scalar>(
    obs: &Observation<T>,
    mean: &[T],
    touched: &mut Vec<T>,
    predicted: &mut Vec<f64>,
) -> f64 {
    touched.resize(obs.len(), T::ZERO);
    values::gather(obs.points(), [mean], [touched]);
    predicted.resize(obs.dim(), 0.0);
    kernel::apply(obs, touched, predicted);
    let residuals = obs.reading().iter().zip(predicted.iter());
    residuals
        .map(|(t, p)| (t.to_f64() - p).powi(2))
        .sum::<f64>()
        .sqrt()
}
