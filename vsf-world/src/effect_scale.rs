//! Scaling of effects.

use crate::effect::Effect;

impl Effect {
    /// The same effect, `s` times as strong, `s > 0`.
    #[must_use]
    pub fn scaled(&self, s: f64) -> Self {
        let mut e = self.clone();
        let each = |v: &mut [f64]| v.iter_mut().for_each(|x| *x *= s);
        match &mut e {
            Self::TorqueBias { bias: v }
            | Self::TorqueGain { gain: v, .. }
            | Self::JointViscousFriction { d: v, .. }
            | Self::JointStribeckFriction { c: v, .. }
            | Self::JointLoadFriction { m: v, .. }
            | Self::InertialError { mass: v, .. }
            | Self::EncoderOffset { offset: v, .. }
            | Self::JointElasticity { compliance: v, .. }
            | Self::CableTorque { amplitude: v, .. }
            | Self::Backlash { play: v }
            | Self::Quantization { step: v }
            | Self::OffsetJump { jump: v, .. }
            | Self::PeriodicDisturbance { amplitude: v, .. }
            | Self::ThermalGain { loss: v, .. }
            | Self::TorqueDrift { amplitude: v, .. } => each(v),
            Self::JointCoulombFriction {
                c_plus, c_minus, ..
            } => {
                each(c_plus);
                each(c_minus);
            }
            Self::GeometryPadding { padding_m } => each(padding_m),
            Self::ObjectBaseMotion { compliance, .. } => each(compliance),
            Self::StressRelaxation { g, .. } => each(g),
            Self::RegistrationOffset {
                per_sequence_m,
                turn_rad,
            } => {
                per_sequence_m.iter_mut().for_each(|v| each(v));
                each(turn_rad);
            }
            Self::Latency { delay_s, lag_s } => {
                *delay_s *= s;
                *lag_s *= s;
            }
            Self::InertiaDrag { mass_s2, drag_s } => {
                *mass_s2 *= s;
                *drag_s *= s;
            }
            Self::JointCoupling {
                viscous, coulomb, ..
            } => {
                *viscous *= s;
                *coulomb *= s;
            }
            Self::Payload { mass: x, .. }
            | Self::GravityTilt { angle: x, .. }
            | Self::ContactFriction { log_ratio: x }
            | Self::Adhesion { stretch_m: x, .. }
            | Self::Viscoelastic { eta_s: x, .. }
            | Self::StrainStiffening { gain: x, .. }
            | Self::Anisotropy { alpha: x, .. }
            | Self::SecondObject { stiffness: x, .. } => *x *= s,
            // Nearer to what they cannot exceed.
            Self::DamageSoftening { max: x, .. } => *x = 1.0 - (1.0 - *x).powf(s),
            Self::PlasticSet { yield_m: x, .. } => *x /= s,
            Self::Saturation { keep } => {
                keep.iter_mut()
                    .filter(|k| **k > 0.0)
                    .for_each(|k| *k = k.powf(s));
            }
            Self::SpatialCoupling { factor } => *factor = 1.0 + (*factor - 1.0) * s,
        }
        e
    }

    /// Largest strength that is still plausible.
    pub(crate) fn strongest(&self) -> f64 {
        match self {
            Self::RegistrationOffset { .. } => 2.0,
            Self::EncoderOffset { .. } => 2.5,
            Self::GeometryPadding { .. } | Self::ContactFriction { .. } => 3.0,
            Self::Latency { .. } | Self::ObjectBaseMotion { .. } | Self::PlasticSet { .. } => 3.0,
            Self::JointElasticity { .. } | Self::Backlash { .. } => 3.0,
            Self::TorqueGain { .. } | Self::JointLoadFriction { .. } | Self::Adhesion { .. } => 3.0,
            Self::Saturation { .. } => 6.0,
            _ => 8.0,
        }
    }
}
