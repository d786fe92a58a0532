//! The catalogue: one file per effect.

mod contact_friction;
mod encoder_offset;
mod geometry_padding;
mod joint;
mod joint_coulomb_friction;
mod joint_load_friction;
mod joint_stribeck_friction;
mod joint_viscous_friction;
mod latency;
mod registration_offset;
mod torque_bias;
mod torque_drift;
mod torque_gain;
mod viscoelastic;

pub use contact_friction::ContactFriction;
pub use encoder_offset::EncoderOffset;
pub use geometry_padding::GeometryPadding;
pub use joint_coulomb_friction::JointCoulombFriction;
pub use joint_load_friction::JointLoadFriction;
pub use joint_stribeck_friction::JointStribeckFriction;
pub use joint_viscous_friction::JointViscousFriction;
pub use latency::Latency;
pub use registration_offset::RegistrationOffset;
pub use torque_bias::TorqueBias;
pub use torque_drift::TorqueDrift;
pub use torque_gain::TorqueGain;
pub use viscoelastic::Viscoelastic;

use crate::effect::Effect;
use std::sync::Arc;

/// All effects of the library, in the order of the catalogue.
pub fn catalogue() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(TorqueBias),
        Arc::new(TorqueDrift),
        Arc::new(TorqueGain),
        Arc::new(JointCoulombFriction),
        Arc::new(JointViscousFriction),
        Arc::new(JointStribeckFriction),
        Arc::new(JointLoadFriction),
        Arc::new(EncoderOffset),
        Arc::new(Latency),
        Arc::new(RegistrationOffset),
        Arc::new(GeometryPadding),
        Arc::new(ContactFriction),
        Arc::new(Viscoelastic),
    ]
}
