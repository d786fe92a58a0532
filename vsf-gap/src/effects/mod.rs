//! The catalogue: one file per effect.

mod encoder_offset;
mod torque_bias;
mod viscoelastic;

pub use encoder_offset::EncoderOffset;
pub use torque_bias::TorqueBias;
pub use viscoelastic::Viscoelastic;

use crate::effect::Effect;
use std::sync::Arc;

/// All effects of the library, in the order of the catalogue.
pub fn catalogue() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(TorqueBias),
        Arc::new(EncoderOffset),
        Arc::new(Viscoelastic),
    ]
}
