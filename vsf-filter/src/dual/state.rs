use super::{DualConfig, DualReplay, Pull, Scratch};
use crate::DiagonalKalman;
use crate::replay::check_sizes;
use crate::reservoir::Reservoir;
use crate::state::load_rng;
use serde::Deserialize;
use vsf_core::{CoreError, Estimator, Scalar};

/// What is saved of a [`DualReplay`].
#[derive(Deserialize)]
#[serde(
    rename = "DualReplay",
    bound(deserialize = "T: Scalar + Deserialize<'de>")
)]
pub(super) struct DualParts<T: Scalar> {
    filter: DiagonalKalman<T>,
    free: Vec<T>,
    prior: Vec<T>,
    config: DualConfig,
    rng: [u64; 2],
    buffer: Reservoir<T, Pull>,
}

impl<T: Scalar> TryFrom<DualParts<T>> for DualReplay<T> {
    type Error = CoreError;

    fn try_from(parts: DualParts<T>) -> Result<Self, CoreError> {
        let belief = parts.filter.belief();
        CoreError::check_len("free means", parts.free.len(), belief.len())?;
        CoreError::check_len("prior variances", parts.prior.len(), belief.len())?;
        let pairs = parts.free.iter().zip(belief.mean());
        if !pairs.fold(true, |ok, (free, mean)| {
            ok & free.is_finite() & (free.max(T::ZERO) == *mean)
        }) {
            return Err(CoreError::other(
                "the means of a dual replay are not its free means, cut off at zero",
            ));
        }
        let bad = |p: &&T| !(**p > T::ZERO && p.is_finite());
        if let Some(p) = parts.prior.iter().find(bad) {
            return Err(CoreError::Parameter {
                name: "prior variance of a dual replay",
                value: p.to_f64(),
                range: "> 0 N²/m² and finite",
            });
        }
        let budget = parts.config.byte_budget;
        parts.buffer.check(belief.len(), 0.0, budget)?;
        for (obs, pull) in parts.buffer.iter() {
            let d = obs.dim();
            CoreError::check_len("multipliers of an observation", pull.multipliers.len(), d)?;
            CoreError::check_finite("multipliers of an observation", &pull.multipliers)?;
            CoreError::check_len("factor of an observation", pull.factor.dim(), d)?;
        }
        check_sizes(parts.config.replays, budget)?;
        Ok(Self {
            filter: parts.filter,
            free: parts.free,
            prior: parts.prior,
            config: parts.config,
            rng: load_rng(parts.rng)?,
            buffer: parts.buffer,
            scratch: Scratch::default(),
        })
    }
}
