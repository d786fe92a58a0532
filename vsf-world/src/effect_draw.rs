//! Random draws of effects.

use crate::WorldError;
use crate::arm::{JOINTS, JointVector};
use crate::effect::Effect;
use rand::{Rng, RngExt};

impl Effect {
    /// Draws the effect `name` with a strength that suits torques of about 10 N m. `sequences` is the number of sequences
    /// of the session.
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
            "quantization" => Self::Quantization {
                step: even_joints(rng, 1.2, false),
            },
            "saturation" => Self::Saturation {
                keep: even_joints(rng, 1.0, false).map(|strength| {
                    if strength > 0.0 {
                        (-0.3 * strength).exp()
                    } else {
                        0.0
                    }
                }),
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
}

/// Draws a value for one joint or several, each with a random factor: of either sign if `signed`, otherwise positive.
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

/// Like [`joints`], without smaller values for the wrist.
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
