//! Effects of sensors, joints and the arm's own weight: parameters from readings written in closed
//! form, for an arm of two links in a vertical plane, angles from the horizontal.

use crate::common::{Begins, GRAVITY, Row, close, effect, fit, motion, predict, site};
use nalgebra::{Point3, Rotation3, Vector3};
use std::f64::consts::PI;
use vsf_data::TorqueKind::{self, External, Measured};
use vsf_gap::Site;
use vsf_robots::planar_arm;

const LENGTH: f64 = 0.4;
const RADIUS: f64 = 0.03;

fn arm(kind: TorqueKind) -> Site {
    let robot = planar_arm(2, LENGTH, RADIUS).unwrap();
    site(robot, &[Point3::new(0.5, 0.0, 0.2)], kind)
}

fn waving() -> Vec<Row> {
    motion(10.0, 20.0, |t| {
        vec![
            0.4 + 0.5 * (1.1 * t).sin() + 0.1 * (3.7 * t).sin(),
            -0.7 + 0.6 * (1.9 * t).cos() + 0.2 * (0.4 * t).sin(),
        ]
    })
}

/// The parameters of an effect that explain `reading`, against the truth.
fn recovers(
    name: &str,
    site: &Site,
    rows: &[Row],
    truth: &[f64],
    reading: impl Fn(&Row) -> [f64; 2],
) {
    let effect = effect(name);
    let data: Vec<f64> = rows.iter().flat_map(reading).collect();
    let found = fit(site, effect.as_ref(), 0.0, rows, &data);
    close(effect.as_ref(), site, &found, truth, 1e-2);
}

#[test]
fn a_bias_is_constant() {
    let (site, rows) = (arm(External), waving());
    recovers("torque_bias", &site, &rows, &[0.7, -1.2], |_| [0.7, -1.2]);
}

/// The same motion, in two sequences: the second begins after 12 s.
fn waving_twice() -> Vec<Row> {
    let mut rows = waving();
    for row in rows.iter_mut().filter(|r| r.clock >= SECOND) {
        row.clock += BREAK;
    }
    let first = rows.iter().position(|r| r.clock >= SECOND).unwrap();
    rows[first].begins = Some(Begins::Sequence);
    rows
}

/// When the second sequence begins (s), before the break and after it.
const SECOND: f64 = 6.0;
const BREAK: f64 = 6.0;

/// What has grown by then of rates of 1 that fade over 5 s, since the session and since the sequence began.
fn grown(clock: f64) -> [f64; 2] {
    let began = if clock < SECOND { 0.0 } else { SECOND + BREAK };
    [clock, clock - began].map(|t| 5.0 * (1.0 - (-t / 5.0).exp()))
}

#[test]
fn a_drift_follows_the_clock() {
    let (site, rows) = (arm(External), waving_twice());
    let truth = [0.12, -0.08, 0.0, 0.0, 5.0];
    recovers("torque_drift", &site, &rows, &truth, |r| {
        let [session, _] = grown(r.clock);
        [0.12 * session, -0.08 * session]
    });
}

#[test]
fn a_drift_begins_anew_where_zero_is_set_before_each_sequence() {
    let (site, rows) = (arm(External), waving_twice());
    let truth = [0.0, 0.0, 0.2, -0.3, 5.0];
    recovers("torque_drift", &site, &rows, &truth, |r| {
        let [_, sequence] = grown(r.clock);
        [0.2 * sequence, -0.3 * sequence]
    });
}

/// What an actuator reads too much, the object seems to push too little.
#[test]
fn errors_of_actuator_readings_have_the_sign_of_the_sensor() {
    let (site, rows) = (arm(Measured), waving_twice());
    recovers("torque_bias", &site, &rows, &[0.7, -1.2], |_| [-0.7, 1.2]);
    let truth = [0.12, -0.08, 0.2, -0.3, 5.0];
    recovers("torque_drift", &site, &rows, &truth, |r| {
        let [session, sequence] = grown(r.clock);
        [
            -0.12 * session - 0.2 * sequence,
            0.08 * session + 0.3 * sequence,
        ]
    });
}

#[test]
fn friction_follows_the_velocity() {
    let (site, rows) = (arm(External), waving());
    let dry = |c: f64, v: f64, eps: f64| -c * (v / eps).tanh();
    recovers(
        "joint_coulomb_friction",
        &site,
        &rows,
        &[0.6, 0.3, 0.0, 0.0, 0.02],
        |r| [dry(0.6, r.qd[0], 0.02), dry(0.3, r.qd[1], 0.02)],
    );
    // 0.75 N m forward and 0.45 N m backward, 0.24 and 0.36 N m.
    let truth = [0.6, 0.3, 0.25, -0.2, 0.02];
    recovers("joint_coulomb_friction", &site, &rows, &truth, |r| {
        let way = |forward: f64, backward: f64, v: f64| {
            if v > 0.0 {
                dry(forward, v, 0.02)
            } else {
                dry(backward, v, 0.02)
            }
        };
        [way(0.75, 0.45, r.qd[0]), way(0.24, 0.36, r.qd[1])]
    });
    recovers("joint_viscous_friction", &site, &rows, &[4.0, 1.5], |r| {
        [-4.0 * r.qd[0], -1.5 * r.qd[1]]
    });
    let truth = [0.4, 0.2, 0.9, 0.5, 0.12, 0.03];
    recovers("joint_stribeck_friction", &site, &rows, &truth, |r| {
        let slow = |v: f64| (-(v / 0.12) * (v / 0.12)).exp();
        let [v, w] = [r.qd[0], r.qd[1]];
        [
            dry(0.4 + 0.9 * slow(v), v, 0.03),
            dry(0.2 + 0.5 * slow(w), w, 0.03),
        ]
    });
    // Joint 1 driven by joint 2, joint 2 by joint 1.
    let truth = [0.3, 2.0, 0.05, -0.2, 1.0, -0.1, 0.02];
    recovers("joint_coupling", &site, &rows, &truth, |r| {
        [
            dry(0.3, r.qd[1], 0.02) - 2.0 * r.qd[1] - 0.05 * r.qdd[1],
            dry(-0.2, r.qd[0], 0.02) - r.qd[0] + 0.1 * r.qdd[0],
        ]
    });
}

/// Weight of a point of mass `m` at `(x, z)` from the elbow, in the frame of the second link.
fn weight(q: &[f64], m: f64, [x, z]: [f64; 2]) -> [f64; 2] {
    let a = q[0] + q[1];
    // How fast the point rises with the elbow, and with the shoulder.
    let elbow = x * a.cos() - z * a.sin();
    let shoulder = LENGTH * q[0].cos() + elbow;
    [-m * GRAVITY * shoulder, -m * GRAVITY * elbow]
}

#[test]
fn a_payload_hangs_from_the_last_link() {
    let (site, rows) = (arm(External), waving());
    let (m, [x, z]) = (0.8, [0.35, -0.05]);
    // Sideways, the arm does not feel it.
    let truth = [m, m * x, f64::NAN, m * z];
    recovers("payload", &site, &rows, &truth, |r| weight(&r.q, m, [x, z]));
}

#[test]
fn a_payload_resists_acceleration() {
    let (site, rows) = (arm(Measured), waving());
    let truth = [0.8, 0.0, f64::NAN, 0.0];
    recovers("payload", &site, &rows, &truth, |r| {
        // At the elbow: a pendulum of the first joint.
        let inertia = -0.8 * LENGTH * LENGTH * r.qdd[0];
        [weight(&r.q, 0.8, [0.0, 0.0])[0] + inertia, 0.0]
    });
}

#[test]
fn a_tilt_turns_the_weight_of_all_links() {
    let (tilt, rows) = (0.11, waving());
    let R = Rotation3::from_axis_angle(&Vector3::y_axis(), tilt);
    let g = Vector3::new(0.0, 0.0, -GRAVITY);
    let change = R.transpose() * g - g;
    let mass = 1000.0 * PI * RADIUS * RADIUS * LENGTH;
    // Weight of the links in a gravity (x, z): mass times gravity times what a center moves by.
    let weight = |q: &[f64]| {
        let (a, b) = (q[0], q[0] + q[1]);
        let along = |angle: f64, l: f64| (-l * angle.sin()) * change.x + l * angle.cos() * change.z;
        let elbow = along(b, 0.5 * LENGTH);
        let shoulder = along(a, 0.5 * LENGTH) + along(a, LENGTH) + elbow;
        [mass * shoulder, mass * elbow]
    };
    let truth = [f64::NAN, tilt];
    for kind in [External, Measured] {
        recovers("gravity_tilt", &arm(kind), &rows, &truth, |r| weight(&r.q));
    }
}

#[test]
fn a_gain_and_load_friction_scale_the_torque() {
    let up = Vector3::z();
    let mut rows = waving();
    // A point pressed by a changing amount.
    for row in &mut rows {
        let u = Vector3::new(0.0, 0.0, -0.01 * (1.0 + (0.9 * row.clock).sin()));
        row.touched = vec![(0, u, -up)];
        row.force = -300.0 * u;
    }
    let external = arm(External);
    let nominal = predict(
        &external,
        effect("torque_bias").as_ref(),
        &[0.0, 0.0],
        300.0,
        &rows,
    );
    for (row, tau) in rows.iter_mut().zip(nominal.chunks_exact(2)) {
        (row.reading, row.load) = (tau.to_vec(), tau.to_vec());
    }
    let gain = effect("torque_gain");
    let data: Vec<f64> = nominal
        .chunks_exact(2)
        .flat_map(|t| [1.3 * t[0], 0.8 * t[1]])
        .collect();
    let found = fit(&external, gain.as_ref(), 300.0, &rows, &data);
    close(gain.as_ref(), &external, &found, &[0.3, -0.2], 1e-3);

    let friction = effect("joint_load_friction");
    let mut data = Vec::new();
    for (row, t) in rows.iter().zip(nominal.chunks_exact(2)) {
        for (j, m) in [0.5, 0.2].into_iter().enumerate() {
            data.push(t[j] - m * t[j].abs() * (row.qd[j] / 0.02).tanh());
        }
    }
    let found = fit(&external, friction.as_ref(), 300.0, &rows, &data);
    // The sign of a torque of less than 0.1 N m is not sharp.
    close(friction.as_ref(), &external, &found, &[0.5, 0.2, 0.02], 0.2);

    // Readings of actuators: the load is the arm's own, whatever it touches.
    let measured = arm(Measured);
    for row in &mut rows {
        row.load = vec![3.0 * row.q[0].cos(), -2.0 * row.q[1].cos()];
    }
    let mut data = Vec::new();
    let mut gained = Vec::new();
    for (row, t) in rows.iter().zip(nominal.chunks_exact(2)) {
        for (j, m) in [0.5, 0.2].into_iter().enumerate() {
            let load = row.load[j];
            data.push(t[j] - m * load.abs() * (row.qd[j] / 0.02).tanh());
            // Rigid-body torque less (1 + g) times what the actuator has: load less contact.
            gained.push(load - (1.0 + m) * (load - t[j]));
        }
    }
    let found = fit(&measured, friction.as_ref(), 300.0, &rows, &data);
    close(
        friction.as_ref(),
        &measured,
        &found,
        &[0.5, 0.2, 0.02],
        1e-2,
    );
    let found = fit(&measured, gain.as_ref(), 300.0, &rows, &gained);
    close(gain.as_ref(), &measured, &found, &[0.5, 0.2], 1e-3);
}
