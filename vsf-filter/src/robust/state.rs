use super::{RobustLoss, RobustNoise};
use serde::Deserialize;
use vsf_core::{CoreError, Estimator};

/// No filter counts as far as that.
const MOST_READINGS: u64 = 1 << 50;

/// What is saved of a [`RobustNoise`].
#[derive(Deserialize)]
#[serde(rename = "RobustNoise")]
pub(super) struct RobustParts<E> {
    inner: E,
    loss: RobustLoss,
    weights: Vec<f64>,
    readings: u64,
    downweighted: u64,
}

impl<E: Estimator> TryFrom<RobustParts<E>> for RobustNoise<E> {
    type Error = CoreError;

    fn try_from(parts: RobustParts<E>) -> Result<Self, CoreError> {
        if let Some(&value) = parts.weights.iter().find(|&&w| !(w > 0.0 && w <= 1.0)) {
            return Err(CoreError::Parameter {
                name: "robust weight",
                value,
                range: "in (0, 1]",
            });
        }
        if parts.readings > MOST_READINGS {
            return Err(CoreError::Parameter {
                name: "readings",
                value: parts.readings as f64,
                range: "at most 2^50",
            });
        }
        if parts.downweighted > parts.readings {
            return Err(CoreError::Parameter {
                name: "down-weighted readings",
                value: parts.downweighted as f64,
                range: "at most all readings",
            });
        }
        Ok(Self {
            weights: parts.weights,
            readings: parts.readings,
            downweighted: parts.downweighted,
            ..Self::new(parts.inner, parts.loss)?
        })
    }
}
