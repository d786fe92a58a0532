use nalgebra::Point3;
use std::sync::Arc;
use vsf_core::{Belief, CoreError, RestPoints, Scalar};

#[cfg(feature = "serde")]
mod state;
#[cfg(feature = "serde")]
pub(crate) use state::PriorParts;

/// Gaussian prior of a whole field, `K_i = mean_i + level + smooth(p_i) + local_i`:
///
/// - `local_i`: independent for every point, with the variances of a [`Belief`];
/// - `level`: one number shared by all points (homogeneous plus heterogeneous: touching one point tells how
///   stiff the others are);
/// - `smooth`: a Matérn process in space, since neighboring points of real tissue are alike.
///
/// A [`Belief`] alone (uniform, per point, or an earlier field) is a prior too: `FieldPrior::from(belief)`.
///
/// The local part must not vanish. It keeps the covariance positive definite and allows for stiffness that
/// changes from point to point.
///
/// # Reference
/// C. E. Rasmussen, C. K. I. Williams, *Gaussian Processes for Machine Learning*, MIT Press 2006,
/// section 4.2.1 (Matérn) and 2.7 (a shared level as an explicit basis function).
///
/// ```
/// use vsf_core::{Belief, RestPoints, nalgebra::Point3};
/// use vsf_filter::{FieldPrior, Matern, Smoothness};
/// let rest = RestPoints::new(vec![Point3::origin(), Point3::new(0.02, 0.0, 0.0)])?;
/// let smooth = Matern { sd: 10.0, length: 0.02, smoothness: Smoothness::ThreeHalves };
/// let prior = FieldPrior::from(Belief::<f64>::uniform(2, 0.0, 1.0)?).with_smooth(smooth, &rest)?;
/// assert_eq!(prior.covariance(0, 0), 101.0);
/// assert!((prior.covariance(0, 1) - 48.3).abs() < 0.1);
/// # Ok::<(), vsf_core::CoreError>(())
/// ```
#[derive(Debug, Clone)]
pub struct FieldPrior {
    mean: Vec<f64>,
    local: Vec<f64>,
    level_variance: f64,
    smooth: Option<(Matern, Arc<[Point3<f64>]>)>,
}

/// A Matérn covariance function in space.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Matern {
    /// Standard deviation (N/m), > 0.
    pub sd: f64,
    /// Length scale: the distance over which stiffness stays alike (m), > 0.
    pub length: f64,
    /// How smooth the field is within that length scale.
    pub smoothness: Smoothness,
}

/// Smoothness `nu` of a Matérn process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Smoothness {
    /// `nu = 1/2`: continuous and rough, `exp(-r / l)`.
    Half,
    /// `nu = 3/2`: differentiable once, `(1 + s) exp(-s)` with `s = sqrt(3) r / l`. The default.
    #[default]
    ThreeHalves,
    /// `nu = 5/2`: differentiable twice, `(1 + s + s²/3) exp(-s)` with `s = sqrt(5) r / l`.
    FiveHalves,
}

impl Matern {
    fn check(&self) -> Result<(), CoreError> {
        for (name, value, range) in [
            ("smooth prior sd", self.sd, "> 0 N/m"),
            ("prior length", self.length, "> 0 m"),
        ] {
            if !(value > 0.0 && (value * value).is_normal()) {
                return Err(CoreError::Parameter { name, value, range });
            }
        }
        Ok(())
    }

    /// Covariance of two places that are `distance` (m) apart.
    pub fn covariance(&self, distance: f64) -> f64 {
        let nu2: f64 = match self.smoothness {
            Smoothness::Half => 1.0,
            Smoothness::ThreeHalves => 3.0,
            Smoothness::FiveHalves => 5.0,
        };
        let s = nu2.sqrt() * distance / self.length;
        let decay = (-s).exp();
        // Far apart the other factor is infinite.
        if decay == 0.0 {
            return 0.0;
        }
        let correlation = match self.smoothness {
            Smoothness::Half => decay,
            Smoothness::ThreeHalves => (1.0 + s) * decay,
            Smoothness::FiveHalves => (1.0 + s + s * s / 3.0) * decay,
        };
        self.sd * self.sd * correlation
    }
}

impl<T: Scalar> From<Belief<T>> for FieldPrior {
    fn from(belief: Belief<T>) -> Self {
        let widen = |x: &[T]| x.iter().map(|v| v.to_f64()).collect();
        Self {
            mean: widen(belief.mean()),
            local: widen(belief.variance()),
            level_variance: 0.0,
            smooth: None,
        }
    }
}

impl FieldPrior {
    /// Adds a level that all points share, of standard deviation `sd` (N/m, >= 0; 0 adds none).
    ///
    /// # Errors
    /// A standard deviation that is negative or not finite.
    pub fn with_level(mut self, sd: f64) -> Result<Self, CoreError> {
        if !(sd >= 0.0 && (sd * sd).is_finite()) {
            return Err(CoreError::Parameter {
                name: "level sd",
                value: sd,
                range: ">= 0 N/m",
            });
        }
        self.level_variance = sd * sd;
        Ok(self)
    }

    /// Adds a part that varies smoothly in space over the rest points.
    ///
    /// # Errors
    /// A parameter that is not positive and finite, or a number of points other than the field's.
    pub fn with_smooth(mut self, matern: Matern, rest: &RestPoints) -> Result<Self, CoreError> {
        matern.check()?;
        CoreError::check_len("rest points", rest.len(), self.len())?;
        self.smooth = Some((matern, rest.positions().into()));
        Ok(self)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.mean.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.mean.is_empty()
    }

    /// Whether points are independent, so that touching one says nothing about the others.
    pub fn is_independent(&self) -> bool {
        self.level_variance == 0.0 && self.smooth.is_none()
    }

    /// Variance of the level, when nothing else links the points.
    pub(crate) fn level_alone(&self) -> Option<f64> {
        (self.level_variance > 0.0 && self.smooth.is_none()).then_some(self.level_variance)
    }

    /// Adds a variance (N²/m²) to every point's own part.
    pub(crate) fn diffuse(&mut self, variance: f64) {
        self.local.iter_mut().for_each(|v| *v += variance);
    }

    /// Variance of the part of point `i` that it shares with no other (N²/m²).
    pub(crate) fn local_variance(&self, i: usize) -> f64 {
        self.local[i]
    }

    /// Variance of the shared level (N²/m²).
    pub(crate) fn level_variance(&self) -> f64 {
        self.level_variance
    }

    /// Whether covariances depend on where the points are.
    pub(crate) fn is_spatial(&self) -> bool {
        self.smooth.is_some()
    }

    /// Means of all points (N/m).
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Covariance of points `i` and `j` (N²/m²).
    ///
    /// # Panics
    /// If `i` or `j` is not below [`FieldPrior::len`].
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        let smooth = self.smooth.as_ref().map_or(0.0, |(matern, positions)| {
            matern.covariance((positions[i] - positions[j]).norm())
        });
        let local = if i == j { self.local[i] } else { 0.0 };
        self.level_variance + smooth + local
    }

    /// Marginal mean and total variance of every point.
    ///
    /// # Errors
    /// A variance that is not representable.
    pub fn marginals(&self) -> Result<Belief<f64>, CoreError> {
        let smooth = self.smooth.as_ref().map_or(0.0, |(m, _)| m.sd * m.sd);
        let shared = self.level_variance + smooth;
        let variance = self.local.iter().map(|v| v + shared);
        Belief::new(self.mean.clone(), variance.collect())
    }
}
