//! Effects of the object: parameters from forces written in closed form, for points pressed by a
//! probe on a linear stage, where joint torques are forces.

use crate::common::{Begins, Row, close, effect, fit, motion, site};
use nalgebra::{Matrix3, Point3, Vector3};
use vsf_data::TorqueKind::External;
use vsf_gap::Site;
use vsf_robots::cartesian_stage;

/// Stiffness of every point (N/m).
const K: f64 = 200.0;
const RATE: f64 = 100.0;

fn stage(points: &[[f64; 3]]) -> Site {
    let points: Vec<Point3<f64>> = points.iter().map(|p| Point3::from(*p)).collect();
    site(cartesian_stage(0.004).unwrap(), &points, External)
}

/// One point at the origin, pressed down by `depth(t)`; it is touched while that is positive.
fn pressed(seconds: f64, depth: impl Fn(f64) -> f64) -> Vec<Row> {
    let mut rows = motion(seconds, RATE, |t| vec![0.0, 0.0, -depth(t)]);
    for row in &mut rows {
        let u = Vector3::new(0.0, 0.0, row.q[2]);
        if u.z < 0.0 {
            row.touched = vec![(0, u, -Vector3::z())];
        }
    }
    rows
}

/// The parameters of an effect that explain upward forces, against the truth.
fn recovers(name: &str, rows: &[Row], truth: &[f64], force: impl FnMut(&Row) -> f64) {
    let (site, effect) = (stage(&[[0.0; 3]]), effect(name));
    let force = rows.iter().map(force);
    let data: Vec<f64> = force.flat_map(|f| [0.0, 0.0, f]).collect();
    let found = fit(&site, effect.as_ref(), K, rows, &data);
    close(effect.as_ref(), &site, &found, truth, 2e-2);
}

fn depth(row: &Row) -> f64 {
    (-row.q[2]).max(0.0)
}

#[test]
fn a_damper_leads() {
    // At rest at first; the derivative over a sample is its mean, and the damper's spring lags it.
    let (eta, lag) = (0.08, 0.06);
    let rows = pressed(2.0, |t| {
        0.03 + 0.01 * (3.0 * t).sin() + 0.003 * (17.0 * t).sin()
    });
    let (mut last, mut rate) = (0.0, 0.0);
    recovers("viscoelastic", &rows, &[eta, lag], |r| {
        if r.dt > 0.0 {
            let share = 1.0 - (-r.dt / lag).exp();
            rate += share * ((depth(r) - last) / r.dt - rate);
        }
        last = depth(r);
        K * (depth(r) + eta * rate)
    });
}

#[test]
fn a_branch_relaxes() {
    // A ramp of 0.5 s, then hold: the closed form of the standard linear solid.
    let (v, ramp, g, tau) = (0.04, 0.5, 0.7, 0.8);
    let rows = pressed(4.0, |t| v * t.min(ramp));
    recovers("stress_relaxation", &rows, &[g, tau], |r| {
        let loaded = v * tau * (1.0 - (-r.clock.min(ramp) / tau).exp());
        let branch = loaded * (-(r.clock - ramp).max(0.0) / tau).exp();
        K * (depth(r) + g * branch)
    });
}

/// Pressed twice, the second time less deep, with a sequence that begins between.
fn pressed_twice() -> Vec<Row> {
    let mut rows = pressed(4.0, |t| {
        let (phase, most) = if t < 2.0 { (t, 0.03) } else { (t - 2.0, 0.025) };
        most * (1.0 - (phase - 1.0).abs()) - 1e-4
    });
    rows[200].begins = Some(Begins::Sequence);
    rows
}

#[test]
fn a_set_stays() {
    let (a, y) = (0.4, 0.012);
    let mut most = 0.0_f64;
    recovers("plastic_set", &pressed_twice(), &[a, y], |r| {
        most = most.max(depth(r));
        let set = a * (most - y).max(0.0);
        K * (depth(r) - set).max(0.0)
    });
}

#[test]
fn damage_stays() {
    let (d, y, s) = (0.5, 0.006, 0.012);
    let mut most = 0.0_f64;
    recovers("damage_softening", &pressed_twice(), &[d, y, s], |r| {
        most = most.max(depth(r));
        let lost = d * (1.0 - (-(most - y).max(0.0) / s).exp());
        K * (1.0 - lost) * depth(r)
    });
}

#[test]
fn springs_stiffen() {
    let rows = pressed(2.0, |t| 0.04 * (3.0 * t).sin());
    recovers("strain_stiffening", &rows, &[450.0, 2.0], |r| {
        let u = depth(r);
        K * (1.0 + 450.0 * u * u) * u
    });
    // Proportional to the displacement, the same at 3 cm.
    recovers("strain_stiffening", &rows, &[450.0, 1.0], |r| {
        let u = depth(r);
        K * (1.0 + 450.0 * 0.03 * u) * u
    });
}

#[test]
fn the_object_has_mass_and_drag() {
    // Two points, the second of which begins deeper.
    let (site, effect) = (
        stage(&[[0.0; 3], [0.0, 0.0, 0.004]]),
        effect("inertia_drag"),
    );
    let (m, c) = (0.2, 3.5);
    let mut rows = pressed(3.0, |t| 0.02 * (4.0 * t).sin() + 0.005 * (9.0 * t).sin());
    let mut data = Vec::new();
    for row in &mut rows {
        let depths = [depth(row), (0.004 - row.q[2]).max(0.0)];
        let pressed = |(i, u): (usize, f64)| {
            (u > 0.0).then(|| (i as u32, Vector3::new(0.0, 0.0, -u), -Vector3::z()))
        };
        row.touched = depths.into_iter().enumerate().filter_map(pressed).collect();
        let moved = (m * row.qdd[2] + c * row.qd[2]) * row.touched.len() as f64;
        data.extend([0.0, 0.0, K * (depths[0] + depths[1]) - moved]);
    }
    let found = fit(&site, effect.as_ref(), K, &rows, &data);
    close(effect.as_ref(), &site, &found, &[m, c], 2e-2);
}

#[test]
fn directions_differ() {
    let (site, effect) = (stage(&[[0.0; 3]]), effect("anisotropy"));
    let theta = [-0.3, -0.3, 0.2, 0.1, -0.1, 0.1];
    let [a_t, xx, yy, xy, xz, yz] = theta;
    let stiffness = Matrix3::new(1.0 + xx, xy, xz, xy, 1.0 + yy, yz, xz, yz, 1.0);
    let mut rows = motion(2.0, RATE, |_| vec![0.0; 3]);
    let mut data = Vec::new();
    for (k, row) in rows.iter_mut().enumerate() {
        let t = row.clock;
        let (x, y) = (0.7 + 0.3 * (3.0 * t).sin(), 0.6 + 0.3 * (5.0 * t).cos());
        let u = Vector3::new(x, y, -1.5) * 0.01;
        // A slanting surface, then a level one.
        let n = if k < 100 {
            Vector3::new(0.6, 0.0, -0.8)
        } else {
            -Vector3::z()
        };
        row.touched = vec![(0, u, n)];
        let tangential = u - n * n.dot(&u);
        let force = stiffness * u + tangential * a_t;
        // Friction holds no more, on this surface, than it has to hold without the effect.
        let (pressed, aside) = (n.dot(&force), force - n * n.dot(&force));
        let cone = tangential.norm() / n.dot(&u);
        assert!(cone > 0.15 && pressed > 0.0);
        let held = (cone * pressed / aside.norm()).min(1.0);
        data.extend((n * pressed + aside * held).iter().map(|f| -K * f));
    }
    let found = fit(&site, effect.as_ref(), K, &rows, &data);
    close(effect.as_ref(), &site, &found, &theta, 1e-3);
}

#[test]
fn neighbors_hold_each_other() {
    // A row of three points and one far away; the last of the row is never touched.
    let points = [
        [0.0; 3],
        [0.01, 0.0, 0.0],
        [0.02, 0.0, 0.0],
        [0.06, 0.0, 0.0],
    ];
    let (site, effect) = (stage(&points), effect("spatial_coupling"));
    let kappa = 30.0;
    let mut rows = motion(1.0, RATE, |_| vec![0.0; 3]);
    let mut data = Vec::new();
    for row in &mut rows {
        let [a, b, c] =
            [(2.0 * row.clock).sin(), (5.0 * row.clock).cos(), 0.7].map(|x| 0.01 * x - 0.02);
        let down = |u| Vector3::new(0.0, 0.0, u);
        let n = -Vector3::z();
        row.touched = vec![(0, down(a), n), (1, down(b), n), (3, down(c), n)];
        // Of the pairs, 0-1 cancels and 1-2 remains.
        data.extend([0.0, 0.0, -K * (a + b + c) - kappa * b]);
    }
    let found = fit(&site, effect.as_ref(), K, &rows, &data);
    close(effect.as_ref(), &site, &found, &[kappa], 1e-3);
}
