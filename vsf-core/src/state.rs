//! Deserialization under the feature `serde`. Values go through the constructors, so that their
//! checks apply. Each `*Parts` type has the fields of its target type, in the same order.

use crate::{Belief, CoreError, FilterHealth, Noise, Observation, Scalar, SymmetricFactor};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(rename = "Belief")]
pub(crate) struct BeliefParts<T> {
    mean: Vec<T>,
    variance: Vec<T>,
}

impl<T: Scalar> TryFrom<BeliefParts<T>> for Belief<T> {
    type Error = CoreError;

    fn try_from(parts: BeliefParts<T>) -> Result<Self, CoreError> {
        Self::new(parts.mean, parts.variance)
    }
}

#[derive(Deserialize)]
#[serde(rename = "Noise")]
pub(crate) struct NoiseParts {
    dim: usize,
    covariance: Vec<f64>,
}

impl TryFrom<NoiseParts> for Noise {
    type Error = CoreError;

    fn try_from(parts: NoiseParts) -> Result<Self, CoreError> {
        Self::full(parts.dim, parts.covariance)
    }
}

#[derive(Deserialize)]
#[serde(rename = "FilterHealth")]
pub(crate) struct HealthParts {
    updates: usize,
    dof: usize,
    nis: f64,
}

impl TryFrom<HealthParts> for FilterHealth {
    type Error = CoreError;

    fn try_from(parts: HealthParts) -> Result<Self, CoreError> {
        Self::from_sums(parts.updates, parts.dof, parts.nis)
    }
}

#[derive(Deserialize)]
#[serde(rename = "SymmetricFactor")]
pub(crate) struct FactorParts {
    dim: usize,
    lower: Vec<f64>,
}

impl TryFrom<FactorParts> for SymmetricFactor {
    type Error = CoreError;

    fn try_from(parts: FactorParts) -> Result<Self, CoreError> {
        Self::from_lower(parts.dim, parts.lower)
    }
}

#[derive(Deserialize)]
#[serde(rename = "Observation")]
pub(crate) struct ObservationParts<T> {
    points: Vec<u32>,
    rows: Vec<T>,
    reading: Vec<T>,
    noise: Noise,
}

impl<T: Scalar> TryFrom<ObservationParts<T>> for Observation<T> {
    type Error = CoreError;

    fn try_from(parts: ObservationParts<T>) -> Result<Self, CoreError> {
        let ObservationParts {
            points,
            rows,
            reading,
            noise,
        } = parts;
        let (n, d) = (points.len(), noise.dim());
        CoreError::check_len("observation matrix", rows.len(), n.saturating_mul(d))?;
        let reading: Vec<f64> = reading.iter().map(|r| r.to_f64()).collect();
        // Whether the points fit a field is checked where the observation meets one.
        let field_len = points.last().map_or(0, |&p| p as usize + 1);
        let mut obs = Self::new(noise);
        obs.rebuild_rows(field_len, &points, &reading, |w| w.copy_from_slice(&rows))?;
        Ok(obs)
    }
}
