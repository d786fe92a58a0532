//! Effects of sensors, gears and weights, applied to the torques of the touch.

use crate::arm::{Arm, JOINTS, JointVector, Mass, link_masses, weight_torques};
use crate::effect::Effect;
use crate::motion::{RATE_HZ, SESSION_STEP_S};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

/// Gravity \[m/s^2\].
pub(crate) const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// Rows of a sequence.
pub(crate) type Rows = Vec<JointVector>;

/// Central differences of rows \[1/s\].
pub(crate) fn rates(rows: &[JointVector], rate_hz: f64) -> Rows {
    let last = rows.len().saturating_sub(1);
    (0..rows.len())
        .map(|k| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(last));
            let span = (b - a).max(1) as f64 / rate_hz;
            std::array::from_fn(|j| (rows[b][j] - rows[a][j]) / span)
        })
        .collect()
}

/// The sensor torques from the touch torques `tau` of a session with joint angles `q`; one row per `stride` samples.
pub(crate) fn sense(
    effects: &[Effect],
    base: &Isometry3<f64>,
    q: &[Rows],
    tau: &[Rows],
    stride: usize,
) -> Vec<Rows> {
    let rate = RATE_HZ / stride as f64;
    let mut out = tau.to_vec();
    let qd: Vec<Rows> = q.iter().map(|rows| rates(rows, rate)).collect();
    // From the arm outward to the wire: weights, gears, sensors.
    let rank = |e: &Effect| match e {
        Effect::Payload { .. } | Effect::GravityTilt { .. } | Effect::InertialError { .. } => 0,
        Effect::CableTorque { .. } => 1,
        Effect::JointCoulombFriction { .. }
        | Effect::JointViscousFriction { .. }
        | Effect::JointStribeckFriction { .. }
        | Effect::JointLoadFriction { .. }
        | Effect::JointCoupling { .. } => 2,
        Effect::Latency { .. } => 3,
        _ => 4,
    };
    let mut order: Vec<&Effect> = effects.iter().filter(|e| e.is_of_the_sensor()).collect();
    order.sort_by_key(|e| rank(e));
    for effect in order {
        let session = Session {
            base,
            q,
            qd: &qd,
            rate,
        };
        session.apply(effect, &mut out);
    }
    out
}

struct Session<'a> {
    base: &'a Isometry3<f64>,
    q: &'a [Rows],
    qd: &'a [Rows],
    rate: f64,
}

impl Session<'_> {
    fn apply(&self, effect: &Effect, tau: &mut [Rows]) {
        match effect {
            Effect::Payload { mass, center } => {
                let hung = Mass {
                    link: JOINTS,
                    center: Point3::from(*center),
                    mass: *mass,
                };
                self.hang(&[hung], tau);
            }
            Effect::InertialError { mass, center } => {
                let hung: [Mass; JOINTS] = std::array::from_fn(|j| Mass {
                    link: j + 1,
                    center: Point3::from(*center) + link_masses()[j + 1].center.coords,
                    mass: mass[j],
                });
                self.hang(&hung, tau);
            }
            Effect::GravityTilt { heading, angle } => self.tilt(*heading, *angle, tau),
            Effect::Latency { delay_s, lag_s } => {
                for rows in tau {
                    delay(rows, *delay_s * self.rate);
                    lag(rows, *lag_s * self.rate);
                    lag(rows, *lag_s * self.rate);
                }
            }
            Effect::ThermalGain {
                loss,
                heating,
                cooling_s,
            } => {
                self.warm_up(loss, *heating, *cooling_s, tau);
            }
            Effect::Saturation { keep } => {
                for j in (0..JOINTS).filter(|&j| keep[j] > 0.0) {
                    let peak = tau
                        .iter()
                        .flatten()
                        .fold(0.0, |m: f64, t| m.max(t[j].abs()));
                    let limit = (peak * keep[j]).max(1e-9);
                    for t in tau.iter_mut().flatten() {
                        t[j] = t[j].clamp(-limit, limit);
                    }
                }
            }
            _ => self.each_sample(effect, tau),
        }
    }

    /// Applies effects that act on every joint of every sample independently.
    fn each_sample(&self, effect: &Effect, tau: &mut [Rows]) {
        for (s, rows) in tau.iter_mut().enumerate() {
            for (k, row) in rows.iter_mut().enumerate() {
                let (q, qd) = (&self.q[s][k], &self.qd[s][k]);
                let within = k as f64 / self.rate;
                let t = SESSION_STEP_S * s as f64 + within;
                for (j, tau) in row.iter_mut().enumerate() {
                    *tau += change(effect, j, q, qd, *tau, t);
                }
            }
        }
    }

    /// Adds weight and inertia of masses: `J^T m (g - a)`.
    fn hang(&self, masses: &[Mass], tau: &mut [Rows]) {
        let mut arm = Arm::new(*self.base);
        for (rows, q) in tau.iter_mut().zip(self.q) {
            let places: Vec<Vec<Vector3<f64>>> = (q.iter())
                .map(|q| {
                    arm.set(q);
                    let place = |m: &Mass| (arm.poses()[m.link] * m.center).coords;
                    masses.iter().map(place).collect()
                })
                .collect();
            for k in 0..rows.len() {
                let inner = k.clamp(1, rows.len().saturating_sub(2).max(1));
                arm.set(&q[k]);
                for (i, m) in masses.iter().enumerate() {
                    let bend = match places.get(inner + 1) {
                        Some(next) => next[i] - places[inner][i] * 2.0 + places[inner - 1][i],
                        None => Vector3::zeros(),
                    };
                    let touch = crate::Touch {
                        link: m.link,
                        point: places[k][i].into(),
                        force: (GRAVITY - bend * (self.rate * self.rate)) * m.mass,
                    };
                    add(&mut rows[k], &arm.joint_torques(&touch), 1.0);
                }
            }
        }
    }

    /// Adds the weight of the links under a turned gravity, minus their nominal weight.
    fn tilt(&self, heading: f64, angle: f64, tau: &mut [Rows]) {
        let axis = Vector3::new(heading.cos(), heading.sin(), 0.0);
        let change = UnitQuaternion::from_scaled_axis(axis * angle) * GRAVITY - GRAVITY;
        let mut arm = Arm::new(*self.base);
        let masses = link_masses();
        for (rows, q) in tau.iter_mut().zip(self.q) {
            for (row, q) in rows.iter_mut().zip(q) {
                add(row, &weight_torques(&mut arm, q, &masses, &change), 1.0);
            }
        }
    }

    fn warm_up(&self, loss: &JointVector, heating: f64, cooling_s: f64, tau: &mut [Rows]) {
        let mut heat: JointVector = [0.0; JOINTS];
        for rows in tau.iter_mut() {
            let working = rows.len() as f64 / self.rate;
            for row in rows.iter_mut() {
                for j in 0..JOINTS {
                    heat[j] += (heating * row[j].abs() - heat[j] / cooling_s) / self.rate;
                    row[j] *= 1.0 - 0.9 * (loss[j] * heat[j]).tanh();
                }
            }
            heat = heat.map(|h| h * (-(SESSION_STEP_S - working) / cooling_s).exp());
        }
    }
}

/// The torque that the effect adds at joint `j` at the session's time `t`.
fn change(effect: &Effect, j: usize, q: &JointVector, qd: &JointVector, tau: f64, t: f64) -> f64 {
    let direction = |v: f64, width: f64| v / (v * v + width * width).sqrt();
    match effect {
        Effect::TorqueBias { bias } => bias[j],
        Effect::TorqueDrift {
            amplitude,
            tau_s,
            wander,
            phase,
        } => {
            let slow = (0.11 * t + phase + j as f64).sin() * (0.043 * t + 2.0 * phase).cos();
            amplitude[j] * (1.0 - (-t / tau_s).exp() + wander * slow)
        }
        Effect::TorqueGain { gain, rolloff_nm } => {
            gain[j] * tau / (1.0 + (tau / rolloff_nm).powi(2)).sqrt()
        }
        Effect::JointCoulombFriction {
            c_plus,
            c_minus,
            width,
        } => {
            let c = if qd[j] > 0.0 { c_plus[j] } else { c_minus[j] };
            -c * direction(qd[j], *width)
        }
        Effect::JointViscousFriction { d, power } => {
            -d[j] * qd[j].abs().powf(*power) * qd[j].signum()
        }
        Effect::JointStribeckFriction {
            c,
            share,
            v_s,
            width,
        } => {
            let bump = (1.0 - share) / (1.0 + (qd[j] / v_s).powi(2));
            -c[j] * (share + bump) * direction(qd[j], *width)
        }
        Effect::JointLoadFriction { m, power, width } => {
            -m[j] * tau.abs().powf(*power) * direction(qd[j], *width)
        }
        Effect::JointCoupling {
            to,
            from,
            viscous,
            coulomb,
        } if to - 1 == j => {
            let v = qd[from - 1];
            -viscous * v - viscous.signum() * coulomb * direction(v, 0.01)
        }
        Effect::CableTorque {
            amplitude,
            periods,
            phase,
        } => amplitude[j] * (periods * q[j] + phase + j as f64).sin(),
        Effect::Quantization { step } if step[j] > 0.0 => (tau / step[j]).round() * step[j] - tau,
        Effect::OffsetJump { jump, at_s } if t >= *at_s => jump[j],
        Effect::PeriodicDisturbance {
            amplitude,
            frequency_hz,
            phase,
        } => amplitude[j] * (std::f64::consts::TAU * frequency_hz * t + phase).sin(),
        _ => 0.0,
    }
}

/// `a += s b`.
pub(crate) fn add(a: &mut JointVector, b: &JointVector, s: f64) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += s * b;
    }
}

/// Delays rows by a number of rows, with interpolation.
fn delay(rows: &mut Rows, by: f64) {
    let at = |k: usize| {
        let x = (k as f64 - by).max(0.0);
        let (i, t) = (x.floor() as usize, x.fract());
        let next = &rows[(i + 1).min(rows.len() - 1)];
        std::array::from_fn(|j| rows[i][j] * (1.0 - t) + next[j] * t)
    };
    *rows = (0..rows.len()).map(at).collect();
}

/// First-order lag of `by` rows.
fn lag(rows: &mut Rows, by: f64) {
    let keep = if by > 0.0 { (-1.0 / by).exp() } else { 0.0 };
    for k in 1..rows.len() {
        let last = rows[k - 1];
        for (x, last) in rows[k].iter_mut().zip(last) {
            *x += (last - *x) * keep;
        }
    }
}
