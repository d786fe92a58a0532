use super::{FieldPrior, Matern};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use vsf_core::{Belief, CoreError, RestPoints};

/// What is saved of a [`FieldPrior`].
#[derive(Serialize, Deserialize)]
#[serde(rename = "FieldPrior")]
pub(crate) struct PriorParts {
    mean: Vec<f64>,
    local: Vec<f64>,
    level_variance: f64,
    smooth: Option<(Matern, Vec<[f64; 3]>)>,
}

impl From<&FieldPrior> for PriorParts {
    fn from(prior: &FieldPrior) -> Self {
        let places = |at: &[Point3<f64>]| at.iter().map(|p| [p.x, p.y, p.z]).collect();
        Self {
            mean: prior.mean.clone(),
            local: prior.local.clone(),
            level_variance: prior.level_variance,
            smooth: prior.smooth.as_ref().map(|(m, at)| (*m, places(at))),
        }
    }
}

impl TryFrom<PriorParts> for FieldPrior {
    type Error = CoreError;

    fn try_from(parts: PriorParts) -> Result<Self, CoreError> {
        let mut prior = Self::from(Belief::new(parts.mean, parts.local)?);
        if !(parts.level_variance >= 0.0 && parts.level_variance.is_finite()) {
            return Err(CoreError::Parameter {
                name: "level variance",
                value: parts.level_variance,
                range: ">= 0 N²/m²",
            });
        }
        prior.level_variance = parts.level_variance;
        match parts.smooth {
            None => Ok(prior),
            Some((matern, at)) => {
                let at = at.into_iter().map(Point3::from).collect();
                prior.with_smooth(matern, &RestPoints::new(at)?)
            }
        }
    }
}
