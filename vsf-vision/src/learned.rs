use crate::extrapolation::Known;
use crate::{
    Calibrated, Extrapolation, Features, GaussianProcess, GpConfig, KnnConfig, KnnRegressor,
    Predictions, Regressor, Ridge, Samples, Seen, VisionError,
};
use serde::{Deserialize, Serialize};
use vsf_core::{Belief, CoreError};

/// Choice of a regressor, with its parameters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum RegressorSpec {
    /// [`KnnRegressor`].
    Knn(KnnConfig),
    /// [`Ridge`].
    Ridge,
    /// [`GaussianProcess`].
    GaussianProcess(GpConfig),
}

impl Default for RegressorSpec {
    fn default() -> Self {
        Self::Knn(KnnConfig::default())
    }
}

impl RegressorSpec {
    /// Creates the regressor.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn build(&self) -> Result<Box<dyn Regressor>, VisionError> {
        Ok(match *self {
            Self::Knn(config) => Box::new(KnnRegressor::new(config)?),
            Self::Ridge => Box::new(Ridge::new()),
            Self::GaussianProcess(config) => Box::new(GaussianProcess::new(config)?),
        })
    }
}

/// A prior for new objects, learned from the fields of others. It predicts stiffness from features that
/// mean the same on every object, such as color, height, or depth behind the surface.
///
/// Variances are calibrated from object to object. To this end as many equal parts as there are objects, at
/// most 20, are held out in turn; the calibration is best when the objects are similar in size. Its JSON
/// holds samples and regressor. Reading it fits the regressor again, with the same predictions.
///
/// ```
/// use vsf_vision::{Features, LearnedPrior, RegressorSpec, Samples};
/// let bush = |shift: f64| {
///     let height: Vec<f64> = (0..20).map(|i| 0.02 * i as f64).collect();
///     let stiffness = height.iter().map(|h| 10.0 - 20.0 * h + shift).collect();
///     let features = Features::new(20).with_column("height", &height)?;
///     Samples::new(features, stiffness, vec![0.1; 20])
/// };
/// let prior = LearnedPrior::fit(RegressorSpec::Ridge, &[bush(0.0)?, bush(1.0)?])?;
/// let low = prior.predict(&Features::new(1).with_column("height", &[0.05])?)?;
/// assert!((low.mean[0] - 9.5).abs() < 0.5);
/// # Ok::<(), vsf_vision::VisionError>(())
/// ```
#[derive(Clone)]
pub struct LearnedPrior {
    saved: Saved,
    fitted: Calibrated<Box<dyn Regressor>>,
}

#[derive(Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    regressor: RegressorSpec,
    objects: usize,
    /// What they are called; none where nobody said.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    names: Vec<String>,
    features: Features,
    targets: Vec<f64>,
    variances: Vec<f64>,
}

/// Each is a fit, and a file says how many there are.
const MOST_FOLDS: usize = 20;

impl LearnedPrior {
    /// Learns from the samples of each object. With a single object, its quarters are held out in turn.
    ///
    /// Thin objects of very different size to similar numbers of samples, since equal parts are held out.
    ///
    /// # Errors
    /// No object, objects with different features, or what the regressor refuses.
    pub fn fit(regressor: RegressorSpec, objects: &[Samples]) -> Result<Self, VisionError> {
        let (first, others) = objects.split_first().ok_or(CoreError::TooFew {
            what: "objects",
            got: 0,
            least: 1,
        })?;
        let mut saved = Saved {
            regressor,
            objects: objects.len(),
            names: Vec::new(),
            features: first.features().clone(),
            targets: first.targets().to_vec(),
            variances: first.variances().to_vec(),
        };
        for object in others {
            saved.features.extend(object.features())?;
            saved.targets.extend(object.targets());
            saved.variances.extend(object.variances());
        }
        Self::of(saved)
    }

    fn of(saved: Saved) -> Result<Self, VisionError> {
        let folds = if saved.objects < 2 {
            4
        } else {
            saved.objects.min(MOST_FOLDS)
        };
        let mut fitted = Calibrated::new(saved.regressor.build()?, folds)?;
        let (targets, variances) = (saved.targets.clone(), saved.variances.clone());
        fitted.fit(&Samples::new(saved.features.clone(), targets, variances)?)?;
        Ok(Self { saved, fitted })
    }

    /// Samples of one object for [`fit`](Self::fit): the touched points of its field, described by their
    /// [`appearance`](Seen::appearance).
    ///
    /// `prior_variance` (N²/m²) is the variance of a point before it was touched, all parts of the prior
    /// together. The targets are the stiffness of the material, `k_i` in `K_i = o_i k_i` with the
    /// [occupancy](Seen::occupancy) `o_i`.
    ///
    /// # Errors
    /// Lengths that differ, a variance that is not positive, or fewer than 2 touched points in sight or
    /// behind what is in sight.
    pub fn samples(
        seen: &Seen,
        field: &Belief<f64>,
        touched: &[bool],
        prior_variance: f64,
    ) -> Result<Samples, VisionError> {
        let fade = Extrapolation::FADE;
        let known = Known::new(seen, field, touched, prior_variance, fade)?;
        known.samples(&known.points, seen.appearance(&known.points)?)
    }

    /// Predicts the stiffness `K_i` (N/m, >= 0) of the points of another object from its view. It is 0
    /// where there is nothing and outside the picture.
    ///
    /// # Errors
    /// A prior that was learned from features other than those of [`samples`](Self::samples).
    pub fn stiffness(&self, seen: &Seen) -> Result<Vec<f64>, VisionError> {
        let occupancy = seen.occupancy(Extrapolation::FADE)?;
        let of: Vec<usize> = (0..seen.len()).filter(|&i| occupancy[i] > 0.0).collect();
        let found = self.predict(&seen.appearance(&of)?)?;
        let mut stiffness = vec![0.0; seen.len()];
        for (i, k) in of.into_iter().zip(found.mean) {
            stiffness[i] = occupancy[i] * k.max(0.0);
        }
        Ok(stiffness)
    }

    /// Says what the objects are called, so that it can be told where it is applied to one of them.
    #[must_use]
    pub fn with_names(mut self, names: Vec<String>) -> Self {
        self.saved.names = names;
        self
    }

    /// What the objects that it learned from are called, as [`with_names`](Self::with_names) said.
    pub fn names(&self) -> &[String] {
        &self.saved.names
    }

    /// Number of objects that it was learned from, and number of their points.
    pub fn learned_from(&self) -> (usize, usize) {
        (self.saved.objects, self.saved.targets.len())
    }

    /// Predicts mean and variance of the stiffness of points of another object. Clamp means at 0 before you
    /// use them in a [`vsf_core::Belief`].
    ///
    /// # Errors
    /// Features other than those it was learned from.
    pub fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        self.fitted.predict(features)
    }

    /// Samples and regressor as JSON, for [`from_json`](Self::from_json).
    pub fn to_json(&self) -> String {
        // Texts and finite numbers alone: nothing that JSON cannot hold.
        serde_json::to_string(&self.saved).unwrap_or_default()
    }

    /// Reads what [`to_json`](Self::to_json) has written, and fits it again.
    ///
    /// # Errors
    /// [`VisionError::Json`], or numbers that are invalid.
    pub fn from_json(text: &str) -> Result<Self, VisionError> {
        let saved = serde_json::from_str(text).map_err(|error| VisionError::Json {
            problem: error.to_string(),
        })?;
        Self::of(saved)
    }
}

/// Equal when they learned from the same.
impl PartialEq for LearnedPrior {
    fn eq(&self, other: &Self) -> bool {
        self.saved == other.saved
    }
}

impl std::fmt::Debug for LearnedPrior {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LearnedPrior")
            .field("regressor", &self.saved.regressor)
            .field("objects", &self.saved.objects)
            .field("samples", &self.saved.targets.len())
            .finish_non_exhaustive()
    }
}
