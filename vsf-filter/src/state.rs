//! Saving and restoring estimators, for the feature `serde`.
//!
//! An estimator saves what its next update depends on and no scratch, so that a restored one goes
//! on bit for bit. How to add one: derive `Serialize` and `Deserialize`, `#[serde(skip)]` the
//! scratch, and make sure that nothing comes in which the constructor would refuse. Beliefs, noise
//! and observations check themselves; fields that must fit each other are read as a struct of parts
//! and put together by `TryFrom`, as in `robust/state.rs`. Then add it to `tests/state.rs`.

use serde::de::Error;
use serde::{Deserialize, Deserializer};
use vsf_core::CoreError;

/// A whitened residual, of finite numbers.
pub(crate) fn finite<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
    let values = Vec::deserialize(from)?;
    CoreError::check_finite("whitened residual", &values).map_err(Error::custom)?;
    Ok(values)
}
