//! What can be wrong with a recording, and how strongly.
//!
//! The forms are on purpose unlike those of textbooks: Coulomb friction differs between directions,
//! damage follows a Weibull curve, stress relaxes in three branches, clocks and axes wander. Whoever
//! diagnoses a recording has to do so by the physics, not by the formula.

use crate::WorldError;
use crate::arm::{JOINTS, JointVector};
use rand::{Rng, RngExt};
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

/// Names of effects outside that catalogue: the right answer to them is that none of it fits.
pub const UNKNOWN_EFFECTS: [&str; 8] = [
    "cable_torque",
    "backlash",
    "quantisation",
    "saturation",
    "offset_jump",
    "second_object",
    "periodic_disturbance",
    "thermal_gain",
];

/// An effect with its parameters. Names and parameters are what a label says; SI units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "name", content = "params", rename_all = "snake_case")]
#[allow(missing_docs)] // The parameters of a variant are described with it.
pub enum Effect {
    /// A constant torque per joint.
    TorqueBias { bias: JointVector },
    /// `amplitude (1 - exp(-t / tau_s))` of the session's time, and a slow wander of its own.
    TorqueDrift {
        amplitude: JointVector,
        tau_s: f64,
        wander: f64,
        phase: f64,
    },
    /// `tau (1 + gain)`, fading for torques far above `rolloff_nm`.
    TorqueGain { gain: JointVector, rolloff_nm: f64 },
    /// `-c` of the direction, over a smooth step of `width` \[rad/s\].
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
    /// A mass at `center` of the last link, with its weight and inertia.
    Payload { mass: f64, center: [f64; 3] },
    /// Gravity turned by `angle` about the horizontal direction `heading` \[rad\].
    GravityTilt { heading: f64, angle: f64 },
    /// Masses that the links 1 to 7 have more than they should, at `center` of the link.
    InertialError { mass: JointVector, center: [f64; 3] },
    /// Joint `to` feels `-viscous qd - coulomb sign(qd)` of joint `from`; joints from 1.
    JointCoupling {
        to: usize,
        from: usize,
        viscous: f64,
        coulomb: f64,
    },
    /// Recorded is `q + offset + eccentricity offset sin(q)`.
    EncoderOffset {
        offset: JointVector,
        eccentricity: f64,
    },
    /// Links turn by `tau / k / sqrt(1 + (tau / hardening_nm)^2)`, with `1 / k` as compliance.
    JointElasticity {
        compliance: JointVector,
        hardening_nm: f64,
    },
    /// The torques come `delay_s` late, through two equal lags.
    Latency { delay_s: f64, lag_s: f64 },
    /// The object stands elsewhere in every sequence, turned about the vertical.
    RegistrationOffset {
        per_sequence_m: Vec<[f64; 3]>,
        turn_rad: Vec<f64>,
    },
    /// Links 0 to 7 are thicker than the model says.
    GeometryPadding { padding_m: [f64; JOINTS + 1] },
    /// Friction of the surface, `log_ratio` away from what it should be: `mu exp(log_ratio)`.
    ContactFriction { log_ratio: f64 },
    /// Tension before the surfaces part, growing with the time of contact, uneven over places;
    /// as the displacement whose spring force it equals.
    Adhesion { stretch_m: f64, dwell_s: f64 },
    /// The object gives way as a whole: compliance along x, y, z, stiffer beyond `hardening_n`.
    ObjectBaseMotion {
        compliance: [f64; 3],
        hardening_n: f64,
    },
    /// Force `k eta v^power v0^(1 - power)` beside the elastic one, `v0` = 0.05 m/s.
    Viscoelastic { eta_s: f64, power: f64 },
    /// Three Maxwell branches with `g` times the stiffness.
    StressRelaxation { g: [f64; 3], tau_s: [f64; 3] },
    /// Rest places follow beyond a yield displacement, uneven over places.
    PlasticSet { yield_m: f64, hardening: f64 },
    /// Stiffness falls by `max (1 - exp(-((u_max - threshold) / scale)^1.6))`.
    DamageSoftening {
        threshold_m: f64,
        scale_m: f64,
        max: f64,
    },
    /// Force `k u (1 + gain (cosh(u / length) - 1))`.
    StrainStiffening { gain: f64, length_m: f64 },
    /// Springs between neighbours are `factor` times stiffer.
    SpatialCoupling { factor: f64 },
    /// Stiffer by `1 + alpha` along fibres whose direction winds with the place.
    Anisotropy {
        alpha: f64,
        heading: f64,
        winding: f64,
    },
    /// The object's matter, set in motion with a lag of 60 ms, has mass and drag: over the mean
    /// stiffness of its elements.
    InertiaDrag { mass_s2: f64, drag_s: f64 },

    /// Torque of a cable or of cogging: `amplitude sin(periods q + phase)`.
    CableTorque {
        amplitude: JointVector,
        periods: f64,
        phase: f64,
    },
    /// The link lags within a play of the gear, on the side of the load.
    Backlash { play: JointVector },
    /// Torques come in steps.
    Quantisation { step: JointVector },
    /// Torques stop growing at a share of what the joint feels at most.
    Saturation { keep: JointVector },
    /// Offsets jump once, at a time of the session.
    OffsetJump { jump: JointVector, at_s: f64 },
    /// A soft ball in the way of link `link` at its posture of deepest touch.
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
    /// Sensitivity falls while a joint works and recovers while it rests: `tau (1 - 0.9 tanh(loss
    /// heat))`.
    ThermalGain {
        loss: JointVector,
        heating: f64,
        cooling_s: f64,
    },
}

/// One joint or several, each with a factor of either sign or of one.
fn joints(rng: &mut impl Rng, mean: f64, signed: bool) -> JointVector {
    // Wrist joints bear less.
    const SHARE: JointVector = [1.0, 1.0, 0.8, 0.8, 0.45, 0.4, 0.15];
    let mut chosen = [false; JOINTS];
    match rng.random_range(0..4) {
        0 => chosen[rng.random_range(0..4)] = true,
        1 => chosen = [true; JOINTS],
        _ => {
            chosen[rng.random_range(0..4)] = true;
            for c in &mut chosen {
                *c |= rng.random::<f64>() < 0.35;
            }
        }
    }
    std::array::from_fn(|j| {
        let size = mean * SHARE[j] * rng.random_range(0.6..1.4);
        let sign = if signed && rng.random::<bool>() {
            -1.0
        } else {
            1.0
        };
        if chosen[j] { sign * size } else { 0.0 }
    })
}

/// As [`joints`], without the smaller wrist.
fn even_joints(rng: &mut impl Rng, mean: f64, signed: bool) -> JointVector {
    let v = joints(rng, mean, signed);
    v.map(|x| {
        if x == 0.0 {
            0.0
        } else {
            x.signum() * mean * rng.random_range(0.7..1.3)
        }
    })
}

fn sign(rng: &mut impl Rng) -> f64 {
    if rng.random::<bool>() { 1.0 } else { -1.0 }
}

/// A vector of length 0.6 to 1.
fn direction(rng: &mut impl Rng) -> [f64; 3] {
    let v = place(rng, 1.0);
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-6);
    let wanted = rng.random_range(0.6..1.0);
    v.map(|x| x * wanted / length)
}

fn place(rng: &mut impl Rng, range: f64) -> [f64; 3] {
    std::array::from_fn(|_| rng.random_range(-range..range))
}

impl Effect {
    /// Draws the effect `name` at a strength that is about right for 10 N m; `sequences` is the
    /// number of sequences of the session.
    ///
    /// # Errors
    /// [`WorldError::UnknownEffect`].
    pub fn draw(name: &str, rng: &mut impl Rng, sequences: usize) -> Result<Self, WorldError> {
        let tau = std::f64::consts::TAU;
        Ok(match name {
            "torque_bias" => Self::TorqueBias {
                bias: joints(rng, 0.6, true),
            },
            "torque_drift" => Self::TorqueDrift {
                amplitude: joints(rng, 0.9, true),
                tau_s: rng.random_range(40.0..120.0),
                wander: rng.random_range(0.05..0.15),
                phase: rng.random_range(0.0..tau),
            },
            "torque_gain" => Self::TorqueGain {
                gain: {
                    let s = sign(rng);
                    even_joints(rng, 0.3, false).map(|g| s * g)
                },
                rolloff_nm: rng.random_range(20.0..30.0),
            },
            "joint_coulomb_friction" => {
                let c_plus = joints(rng, 0.6, false);
                Self::JointCoulombFriction {
                    c_minus: c_plus.map(|c| c * rng.random_range(0.6..1.5)),
                    c_plus,
                    width: rng.random_range(0.006..0.015),
                }
            }
            "joint_viscous_friction" => Self::JointViscousFriction {
                d: joints(rng, 4.0, false),
                power: rng.random_range(0.85..1.15),
            },
            "joint_stribeck_friction" => Self::JointStribeckFriction {
                c: joints(rng, 1.0, false),
                share: rng.random_range(0.15..0.35),
                v_s: rng.random_range(0.02..0.05),
                width: rng.random_range(0.003..0.006),
            },
            "joint_load_friction" => Self::JointLoadFriction {
                m: even_joints(rng, 0.4, false),
                power: rng.random_range(0.8..1.1),
                width: rng.random_range(0.006..0.012),
            },
            "payload" => Self::Payload {
                mass: 0.1,
                center: place(rng, 0.09),
            },
            "gravity_tilt" => Self::GravityTilt {
                heading: rng.random_range(0.0..tau),
                angle: 0.05 * sign(rng),
            },
            "inertial_error" => {
                let mut mass = [0.0; JOINTS];
                mass[rng.random_range(2..6)] = 0.15 * sign(rng);
                let second = rng.random_range(2..7);
                mass[second] += 0.08 * sign(rng);
                Self::InertialError {
                    mass,
                    center: place(rng, 0.08),
                }
            }
            "joint_coupling" => {
                let to = rng.random_range(1..5);
                let from = (to + rng.random_range(1..4)) % 6 + 1;
                let from = if from == to { from + 1 } else { from };
                Self::JointCoupling {
                    to,
                    from,
                    viscous: 3.0 * sign(rng),
                    coulomb: rng.random_range(0.0..0.25),
                }
            }
            "encoder_offset" => Self::EncoderOffset {
                offset: {
                    let v = even_joints(rng, 0.02, true);
                    // A common turn of the base alone would be a place of the object.
                    if v[1..].iter().all(|x| *x == 0.0) {
                        [0.0, 0.02, 0.0, -0.02, 0.0, 0.0, 0.0]
                    } else {
                        v
                    }
                },
                eccentricity: rng.random_range(0.1..0.25),
            },
            "joint_elasticity" => Self::JointElasticity {
                compliance: even_joints(rng, 1.5e-3, false),
                hardening_nm: rng.random_range(15.0..25.0),
            },
            "latency" => Self::Latency {
                delay_s: rng.random_range(0.05..0.08),
                lag_s: rng.random_range(0.015..0.03),
            },
            "registration_offset" => Self::RegistrationOffset {
                per_sequence_m: (0..sequences)
                    .map(|s| {
                        if s == 0 {
                            [0.0; 3]
                        } else {
                            direction(rng).map(|x| 0.008 * x)
                        }
                    })
                    .collect(),
                turn_rad: (0..sequences)
                    .map(|s| {
                        if s == 0 {
                            0.0
                        } else {
                            rng.random_range(-0.02..0.02)
                        }
                    })
                    .collect(),
            },
            "geometry_padding" => {
                let side = sign(rng);
                Self::GeometryPadding {
                    padding_m: std::array::from_fn(|_| side * rng.random_range(0.0025..0.004)),
                }
            }
            "contact_friction" => Self::ContactFriction {
                log_ratio: 0.5 * sign(rng),
            },
            "adhesion" => Self::Adhesion {
                stretch_m: 0.01,
                dwell_s: rng.random_range(0.1..0.4),
            },
            "object_base_motion" => Self::ObjectBaseMotion {
                compliance: std::array::from_fn(|_| rng.random_range(3e-4..7e-4)),
                hardening_n: rng.random_range(40.0..80.0),
            },
            "viscoelastic" => Self::Viscoelastic {
                eta_s: 0.1,
                power: rng.random_range(0.75..1.0),
            },
            "stress_relaxation" => {
                let g: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.1..0.3));
                Self::StressRelaxation {
                    g,
                    tau_s: [0.15, 0.8, 4.0].map(|t| t * rng.random_range(0.7..1.4)),
                }
            }
            "plastic_set" => Self::PlasticSet {
                yield_m: 0.02,
                hardening: rng.random_range(0.2..0.5),
            },
            "damage_softening" => Self::DamageSoftening {
                threshold_m: rng.random_range(0.003..0.008),
                scale_m: rng.random_range(0.012..0.022),
                max: 0.4,
            },
            "strain_stiffening" => Self::StrainStiffening {
                gain: 0.6,
                length_m: rng.random_range(0.015..0.022),
            },
            "spatial_coupling" => Self::SpatialCoupling { factor: 4.0 },
            "anisotropy" => Self::Anisotropy {
                alpha: 1.0,
                heading: rng.random_range(0.0..tau),
                winding: rng.random_range(-4.0..4.0),
            },
            "inertia_drag" => Self::InertiaDrag {
                mass_s2: rng.random_range(0.01..0.02),
                drag_s: rng.random_range(0.04..0.08),
            },
            "cable_torque" => Self::CableTorque {
                amplitude: joints(rng, 0.8, true),
                periods: rng.random_range(5.0..14.0),
                phase: rng.random_range(0.0..tau),
            },
            "backlash" => Self::Backlash {
                play: even_joints(rng, 0.01, false),
            },
            "quantisation" => Self::Quantisation {
                step: even_joints(rng, 1.2, false),
            },
            "saturation" => Self::Saturation {
                keep: even_joints(rng, 1.0, false),
            },
            "offset_jump" => Self::OffsetJump {
                jump: joints(rng, 0.9, true),
                at_s: 20.0 * rng.random_range(1..sequences.max(2)) as f64
                    + rng.random_range(1.5..6.0),
            },
            "second_object" => Self::SecondObject {
                link: rng.random_range(4..6),
                stiffness: 150.0,
                reach_m: rng.random_range(0.02..0.04),
                bearing: rng.random_range(0.0..tau),
            },
            "periodic_disturbance" => Self::PeriodicDisturbance {
                amplitude: joints(rng, 0.8, true),
                frequency_hz: rng.random_range(0.7..6.0),
                phase: rng.random_range(0.0..tau),
            },
            "thermal_gain" => Self::ThermalGain {
                loss: even_joints(rng, 2.0, false),
                heating: rng.random_range(0.01..0.03),
                cooling_s: rng.random_range(30.0..60.0),
            },
            _ => {
                return Err(WorldError::UnknownEffect {
                    name: name.to_owned(),
                });
            }
        })
    }

    /// The same effect `s` times as strong, `s > 0`.
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
            | Self::Quantisation { step: v }
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
                    .for_each(|k| *k = (-0.3 * s * *k).exp());
            }
            Self::SpatialCoupling { factor } => *factor = 1.0 + (*factor - 1.0) * s,
        }
        e
    }

    /// Largest strength that is still believable.
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
            Self::Quantisation { .. } => "quantisation",
            Self::Saturation { .. } => "saturation",
            Self::OffsetJump { .. } => "offset_jump",
            Self::SecondObject { .. } => "second_object",
            Self::PeriodicDisturbance { .. } => "periodic_disturbance",
            Self::ThermalGain { .. } => "thermal_gain",
        }
    }

    /// Joints that carry the effect themselves, counted from 1; `None` if it is no matter of joints.
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
            | Self::Quantisation { step: v }
            | Self::Saturation { keep: v }
            | Self::OffsetJump { jump: v, .. }
            | Self::PeriodicDisturbance { amplitude: v, .. }
            | Self::ThermalGain { loss: v, .. } => of(v),
            Self::JointCoupling { to, .. } => vec![*to],
            _ => return None,
        })
    }

    /// True if the effect changes what is recorded as angles and leaves the torques alone.
    pub fn is_what_if(&self) -> bool {
        matches!(self, Self::EncoderOffset { .. })
    }

    /// True if the torques that the object causes stay as they are: the effect is one of the
    /// sensors or of the arm's weight, and is computed after the touch.
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
