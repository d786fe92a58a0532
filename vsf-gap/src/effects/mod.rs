//! The catalogue: one file per effect.

mod adhesion;
mod anisotropy;
mod body;
mod contact_friction;
mod damage_softening;
mod encoder_offset;
mod geometry_padding;
mod gravity_tilt;
mod inertia_drag;
mod inertial_error;
mod joint;
mod joint_coulomb_friction;
mod joint_coupling;
mod joint_elasticity;
mod joint_load_friction;
mod joint_stribeck_friction;
mod joint_viscous_friction;
mod latency;
mod memory;
mod object_base_motion;
mod payload;
mod plastic_set;
mod registration_offset;
mod spatial_coupling;
mod strain_stiffening;
mod stress_relaxation;
mod torque_bias;
mod torque_drift;
mod torque_gain;
mod viscoelastic;

pub use adhesion::Adhesion;
pub use anisotropy::Anisotropy;
pub use contact_friction::ContactFriction;
pub use damage_softening::DamageSoftening;
pub use encoder_offset::EncoderOffset;
pub use geometry_padding::GeometryPadding;
pub use gravity_tilt::GravityTilt;
pub use inertia_drag::InertiaDrag;
pub use inertial_error::InertialError;
pub use joint_coulomb_friction::JointCoulombFriction;
pub use joint_coupling::JointCoupling;
pub use joint_elasticity::JointElasticity;
pub use joint_load_friction::JointLoadFriction;
pub use joint_stribeck_friction::JointStribeckFriction;
pub use joint_viscous_friction::JointViscousFriction;
pub use latency::Latency;
pub use object_base_motion::ObjectBaseMotion;
pub use payload::Payload;
pub use plastic_set::PlasticSet;
pub use registration_offset::RegistrationOffset;
pub use spatial_coupling::SpatialCoupling;
pub use strain_stiffening::StrainStiffening;
pub use stress_relaxation::StressRelaxation;
pub use torque_bias::TorqueBias;
pub use torque_drift::TorqueDrift;
pub use torque_gain::TorqueGain;
pub use viscoelastic::Viscoelastic;

use crate::GapError;
use crate::effect::Effect;
use std::sync::Arc;

/// All effects of the library, in catalogue order.
pub fn catalogue() -> Vec<Arc<dyn Effect>> {
    vec![
        Arc::new(TorqueBias),
        Arc::new(TorqueDrift),
        Arc::new(TorqueGain),
        Arc::new(JointCoulombFriction),
        Arc::new(JointViscousFriction),
        Arc::new(JointStribeckFriction),
        Arc::new(JointLoadFriction),
        Arc::new(Payload),
        Arc::new(GravityTilt),
        Arc::new(InertialError),
        Arc::new(JointCoupling),
        Arc::new(EncoderOffset),
        Arc::new(JointElasticity),
        Arc::new(Latency),
        Arc::new(RegistrationOffset),
        Arc::new(GeometryPadding),
        Arc::new(ContactFriction),
        Arc::new(Adhesion),
        Arc::new(ObjectBaseMotion),
        Arc::new(Viscoelastic),
        Arc::new(StressRelaxation),
        Arc::new(PlasticSet),
        Arc::new(DamageSoftening),
        Arc::new(StrainStiffening),
        Arc::new(SpatialCoupling),
        Arc::new(Anisotropy),
        Arc::new(InertiaDrag),
    ]
}

/// The effects of the catalogue with these names, in the given order.
///
/// # Errors
/// [`GapError::UnknownEffect`], which lists the known names.
pub fn named<S: AsRef<str>>(names: &[S]) -> Result<Vec<Arc<dyn Effect>>, GapError> {
    let all = catalogue();
    let find = |name: &S| {
        let name = name.as_ref();
        let found = all.iter().find(|e| e.name() == name).cloned();
        found.ok_or_else(|| {
            let known: Vec<&str> = all.iter().map(|e| e.name()).collect();
            GapError::UnknownEffect {
                name: name.to_owned(),
                known: known.join(", "),
            }
        })
    };
    names.iter().map(find).collect()
}
