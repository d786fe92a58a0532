//! Saving and restoring estimators, for the feature `serde`.
//!
//! An estimator saves all that its next update depends on, and no scratch, so that a restored one continues
//! bit for bit. To add one: derive `Serialize` and `Deserialize`, `#[serde(skip)]` the scratch, and make
//! sure that nothing is read that the constructor would refuse. Beliefs, noise and observations check
//! themselves. Fields that must be consistent with each other are read as a struct of parts and converted
//! by `TryFrom`, as in `robust/state.rs`. Then add the estimator to `tests/filter/state.rs`.

use rand_pcg::Pcg64Mcg;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use vsf_core::CoreError;

/// A whitened residual, of finite numbers.
pub(crate) fn finite<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
    let values = Vec::deserialize(from)?;
    CoreError::check_finite("whitened residual", &values).map_err(Error::custom)?;
    Ok(values)
}

/// The state of the generator, low half first: many formats have no 128-bit numbers.
pub(crate) fn save_rng<S: Serializer>(rng: &Pcg64Mcg, to: S) -> Result<S::Ok, S::Error> {
    [rng.state() as u64, (rng.state() >> 64) as u64].serialize(to)
}

/// What [`save_rng`] saved.
pub(crate) fn load_rng([low, high]: [u64; 2]) -> Result<Pcg64Mcg, CoreError> {
    if low % 2 == 0 {
        return Err(CoreError::other(
            "the state of a replay's random generator must be odd",
        ));
    }
    Ok(Pcg64Mcg::new(u128::from(high) << 64 | u128::from(low)))
}
