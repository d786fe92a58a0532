//! What can be wrong with a recording.
//!
//! The forms deliberately differ from those of textbooks: Coulomb friction differs between directions, damage follows a
//! Weibull curve, stress relaxes in three branches, clocks and axes wander. A diagnosis has to recognize the physics, not
//! the formula.

use crate::arm::{JOINTS, JointVector};
use serde::{Deserialize, Serialize};

/// Names of the effects that a catalogue of causes knows.
pub const EFFECTS: [&str; 27] = [
    "torque_bias",
    "torque_drift",
    "torque_gain",
    "joint_coulomb_friction",
    "joint_viscous_friction",
    "joint_stribeck_friction",
    "joint_load_friction",
    "payload",
    "gravity_tilt",
    "inertial_error",
    "joint_coupling",
    "encoder_offset",
    "joint_elasticity",
    "latency",
    "registration_offset",
    "geometry_padding",
    "contact_friction",
    "adhesion",
    "object_base_motion",
    "viscoelastic",
    "stress_relaxation",
    "plastic_set",
    "damage_softening",
    "strain_stiffening",
    "spatial_coupling",
    "anisotropy",
    "inertia_drag",
];

/// Names of effects outside that catalogue. The right answer to them is that no effect of the catalogue fits.
pub const UNKNOWN_EFFECTS: [&str; 8] = [
    "cable_torque",
    "backlash",
    "quantization",
    "saturation",
    "offset_jump",
    "second_object",
    "periodic_disturbance",
    "thermal_gain",
];

/// An effect with its parameters, in SI units. Labels contain names and parameters as they are here.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "name", content = "params", rename_all = "snake_case")]
#[allow(missing_docs)] // The parameters of a variant are described with it.
pub enum Effect {
    /// A constant torque per joint.
    TorqueBias { bias: JointVector },
    /// `amplitude (1 - exp(-t / tau_s))` of the session's time, plus a slow wander.
    TorqueDrift {
        amplitude: JointVector,
        tau_s: f64,
        wander: f64,
        phase: f64,
    },
    /// `tau (1 + gain)`; the gain fades for torques far above `rolloff_nm`.
    TorqueGain { gain: JointVector, rolloff_nm: f64 },
    /// Friction `-c`, with a `c` for each direction, over a smooth step of `width` \[rad/s\].
    JointCoulombFriction {
        c_plus: JointVector,
        c_minus: JointVector,
        width: f64,
    },
    /// `-d |qd|^power sign(qd)`.
    JointViscousFriction { d: JointVector, power: f64 },
    /// `-c (share + (1 - share) / (1 + (qd / v_s)^2)) sign(qd)`.
    JointStribeckFriction {
        c: JointVector,
        share: f64,
        v_s: f64,
        width: f64,
    },
    /// `-m |tau|^power sign(qd)`.
    JointLoadFriction {
        m: JointVector,
        power: f64,
        width: f64,
    },
    /// A mass at `center` in the frame of the last link, with its weight and inertia.
    Payload { mass: f64, center: [f64; 3] },
    /// Gravity turned by `angle` about the horizontal direction `heading` \[rad\].
    GravityTilt { heading: f64, angle: f64 },
    /// Additional masses of the links 1 to 7, at `center` in the frame of each link.
    InertialError { mass: JointVector, center: [f64; 3] },
    /// Joint `to` is subject to `-viscous qd - coulomb sign(viscous qd)`, with the velocity `qd` of joint `from`; joints
    /// count from 1.
    JointCoupling {
        to: usize,
        from: usize,
        viscous: f64,
        coulomb: f64,
    },
    /// The recorded angle is `q + offset + eccentricity offset sin(q)`.
    EncoderOffset {
        offset: JointVector,
        eccentricity: f64,
    },
    /// Links turn by `tau / k / sqrt(1 + (tau / hardening_nm)^2)`, with compliance `1 / k`.
    JointElasticity {
        compliance: JointVector,
        hardening_nm: f64,
    },
    /// The torques come `delay_s` late, and pass through two equal lags.
    Latency { delay_s: f64, lag_s: f64 },
    /// The object stands elsewhere in every sequence, and is turned about the vertical.
    RegistrationOffset {
        per_sequence_m: Vec<[f64; 3]>,
        turn_rad: Vec<f64>,
    },
    /// Links 0 to 7 are thicker than in the model.
    GeometryPadding { padding_m: [f64; JOINTS + 1] },
    /// Surface friction with a log ratio to the nominal one: `mu exp(log_ratio)`.
    ContactFriction { log_ratio: f64 },
    /// Tension before the surfaces part, given as the displacement whose spring force it equals. It grows with the time of
    /// contact, and varies between places.
    Adhesion { stretch_m: f64, dwell_s: f64 },
    /// The object gives way as a whole: compliance along x, y, z, stiffer beyond `hardening_n`.
    ObjectBaseMotion {
        compliance: [f64; 3],
        hardening_n: f64,
    },
    /// Force `k eta v^power v0^(1 - power)` in addition to the elastic one, `v0` = 0.05 m/s.
    Viscoelastic { eta_s: f64, power: f64 },
    /// Three Maxwell branches with `g` times the stiffness.
    StressRelaxation { g: [f64; 3], tau_s: [f64; 3] },
    /// Rest positions shift beyond a yield displacement, which varies between places.
    PlasticSet { yield_m: f64, hardening: f64 },
    /// Stiffness falls by `max (1 - exp(-((u_max - threshold) / scale)^1.6))`.
    DamageSoftening {
        threshold_m: f64,
        scale_m: f64,
        max: f64,
    },
    /// Force `k u (1 + gain (cosh(u / length) - 1))`.
    StrainStiffening { gain: f64, length_m: f64 },
    /// Springs between neighbors are `factor` times stiffer.
    SpatialCoupling { factor: f64 },
    /// Stiffer by `1 + alpha` along fibers, whose direction varies with the place.
    Anisotropy {
        alpha: f64,
        heading: f64,
        winding: f64,
    },
    /// Mass and drag of the object's material, which follows the surface with a lag of 60 ms; relative to the mean
    /// stiffness of its elements.
    InertiaDrag { mass_s2: f64, drag_s: f64 },

    /// Torque of a cable or of cogging: `amplitude sin(periods q + phase)`.
    CableTorque {
        amplitude: JointVector,
        periods: f64,
        phase: f64,
    },
    /// The link lags by the backlash of the gear, on the side of the load.
    Backlash { play: JointVector },
    /// Torques are quantized in steps.
    Quantization { step: JointVector },
    /// Torques saturate at a share of the largest torque of the joint.
    Saturation { keep: JointVector },
    /// The torque offsets jump once, at a time of the session.
    OffsetJump { jump: JointVector, at_s: f64 },
    /// A soft ball in the way of link `link`, at its posture of deepest touch.
    SecondObject {
        link: usize,
        stiffness: f64,
        reach_m: f64,
        bearing: f64,
    },
    /// A torque of fixed frequency.
    PeriodicDisturbance {
        amplitude: JointVector,
        frequency_hz: f64,
        phase: f64,
    },
    /// Sensitivity falls while a joint is loaded and recovers while it rests: `tau (1 - 0.9 tanh(loss heat))`.
    ThermalGain {
        loss: JointVector,
        heating: f64,
        cooling_s: f64,
    },
}

impl Effect {
    /// The name, as in [`EFFECTS`] or [`UNKNOWN_EFFECTS`].
    pub fn name(&self) -> &'static str {
        match self {
            Self::TorqueBias { .. } => "torque_bias",
            Self::TorqueDrift { .. } => "torque_drift",
            Self::TorqueGain { .. } => "torque_gain",
            Self::JointCoulombFriction { .. } => "joint_coulomb_friction",
            Self::JointViscousFriction { .. } => "joint_viscous_friction",
            Self::JointStribeckFriction { .. } => "joint_stribeck_friction",
            Self::JointLoadFriction { .. } => "joint_load_friction",
            Self::Payload { .. } => "payload",
            Self::GravityTilt { .. } => "gravity_tilt",
            Self::InertialError { .. } => "inertial_error",
            Self::JointCoupling { .. } => "joint_coupling",
            Self::EncoderOffset { .. } => "encoder_offset",
            Self::JointElasticity { .. } => "joint_elasticity",
            Self::Latency { .. } => "latency",
            Self::RegistrationOffset { .. } => "registration_offset",
            Self::GeometryPadding { .. } => "geometry_padding",
            Self::ContactFriction { .. } => "contact_friction",
            Self::Adhesion { .. } => "adhesion",
            Self::ObjectBaseMotion { .. } => "object_base_motion",
            Self::Viscoelastic { .. } => "viscoelastic",
            Self::StressRelaxation { .. } => "stress_relaxation",
            Self::PlasticSet { .. } => "plastic_set",
            Self::DamageSoftening { .. } => "damage_softening",
            Self::StrainStiffening { .. } => "strain_stiffening",
            Self::SpatialCoupling { .. } => "spatial_coupling",
            Self::Anisotropy { .. } => "anisotropy",
            Self::InertiaDrag { .. } => "inertia_drag",
            Self::CableTorque { .. } => "cable_torque",
            Self::Backlash { .. } => "backlash",
            Self::Quantization { .. } => "quantization",
            Self::Saturation { .. } => "saturation",
            Self::OffsetJump { .. } => "offset_jump",
            Self::SecondObject { .. } => "second_object",
            Self::PeriodicDisturbance { .. } => "periodic_disturbance",
            Self::ThermalGain { .. } => "thermal_gain",
        }
    }

    /// Joints that have the effect, counted from 1; `None` if the effect does not act on joints.
    pub fn joints(&self) -> Option<Vec<usize>> {
        let of = |v: &JointVector| (1..=JOINTS).filter(|j| v[j - 1] != 0.0).collect();
        Some(match self {
            Self::TorqueBias { bias: v }
            | Self::TorqueDrift { amplitude: v, .. }
            | Self::TorqueGain { gain: v, .. }
            | Self::JointCoulombFriction { c_plus: v, .. }
            | Self::JointViscousFriction { d: v, .. }
            | Self::JointStribeckFriction { c: v, .. }
            | Self::JointLoadFriction { m: v, .. }
            | Self::EncoderOffset { offset: v, .. }
            | Self::JointElasticity { compliance: v, .. }
            | Self::CableTorque { amplitude: v, .. }
            | Self::Backlash { play: v }
            | Self::Quantization { step: v }
            | Self::Saturation { keep: v }
            | Self::OffsetJump { jump: v, .. }
            | Self::PeriodicDisturbance { amplitude: v, .. }
            | Self::ThermalGain { loss: v, .. } => of(v),
            Self::JointCoupling { to, .. } => vec![*to],
            _ => return None,
        })
    }

    /// True if the effect changes the recorded angles and leaves the torques unchanged.
    pub fn is_what_if(&self) -> bool {
        matches!(self, Self::EncoderOffset { .. })
    }

    /// True if the effect leaves the contact torques unchanged: it is one of the sensors or of the arm's weight, and is
    /// computed after the touch.
    pub(crate) fn is_of_the_sensor(&self) -> bool {
        !matches!(
            self,
            Self::EncoderOffset { .. }
                | Self::JointElasticity { .. }
                | Self::RegistrationOffset { .. }
                | Self::GeometryPadding { .. }
                | Self::ContactFriction { .. }
                | Self::Adhesion { .. }
                | Self::ObjectBaseMotion { .. }
                | Self::Viscoelastic { .. }
                | Self::StressRelaxation { .. }
                | Self::PlasticSet { .. }
                | Self::DamageSoftening { .. }
                | Self::StrainStiffening { .. }
                | Self::SpatialCoupling { .. }
                | Self::Anisotropy { .. }
                | Self::InertiaDrag { .. }
                | Self::Backlash { .. }
                | Self::SecondObject { .. }
        )
    }
}
