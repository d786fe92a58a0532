use super::{MemoryReplay, ReplayConfig, Revisit};
use crate::reservoir::Reservoir;
use crate::state::load_rng;
use serde::Deserialize;
use vsf_core::{CoreError, Estimator};

/// What is saved of a [`MemoryReplay`].
#[derive(Deserialize)]
#[serde(
    rename = "MemoryReplay",
    bound(deserialize = "E: Deserialize<'de>, E::Scalar: Deserialize<'de>")
)]
pub(super) struct ReplayParts<E: Estimator> {
    inner: E,
    config: ReplayConfig,
    rng: [u64; 2],
    buffer: Reservoir<E::Scalar>,
    diffused: f64,
    #[serde(deserialize_with = "crate::state::finite")]
    whitened: Vec<f64>,
}

impl<E: Revisit> TryFrom<ReplayParts<E>> for MemoryReplay<E> {
    type Error = CoreError;

    fn try_from(parts: ReplayParts<E>) -> Result<Self, CoreError> {
        if !(parts.diffused >= 0.0 && parts.diffused.is_finite()) {
            return Err(CoreError::Parameter {
                name: "total variance of the field's steps",
                value: parts.diffused,
                range: ">= 0 N²/m² and finite",
            });
        }
        let field_len = parts.inner.belief().len();
        parts
            .buffer
            .check(field_len, parts.diffused, parts.config.byte_budget)?;
        Ok(Self {
            rng: load_rng(parts.rng)?,
            buffer: parts.buffer,
            diffused: parts.diffused,
            whitened: parts.whitened,
            ..Self::new(parts.inner, parts.config)?
        })
    }
}
