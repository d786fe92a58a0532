use super::{MemoryReplay, ReplayConfig, Revisit};
use crate::reservoir::Reservoir;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize, Serializer};
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

/// The state of the generator, low half first: many formats have no 128-bit numbers.
pub(super) fn save_rng<S: Serializer>(rng: &Pcg64Mcg, to: S) -> Result<S::Ok, S::Error> {
    [rng.state() as u64, (rng.state() >> 64) as u64].serialize(to)
}

impl<E: Revisit> TryFrom<ReplayParts<E>> for MemoryReplay<E> {
    type Error = CoreError;

    fn try_from(parts: ReplayParts<E>) -> Result<Self, CoreError> {
        let [low, high] = parts.rng;
        if low % 2 == 0 {
            return Err(CoreError::Other(
                "the state of a replay's random generator must be odd".into(),
            ));
        }
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
            rng: Pcg64Mcg::new(u128::from(high) << 64 | u128::from(low)),
            buffer: parts.buffer,
            diffused: parts.diffused,
            whitened: parts.whitened,
            ..Self::new(parts.inner, parts.config)?
        })
    }
}
