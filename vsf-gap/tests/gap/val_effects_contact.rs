//! Effects on where and how the robot touches: parameters from forces written in closed form, for a
//! plate that presses one point.

use crate::common::campaign::{RATE, Rows, free_arm, plate, torques};
use crate::common::{close, effect, fit_with};
use vsf_gap::{Campaign, Model};

const K: f64 = 300.0;
/// Distance at which contact begins (m).
const DELTA: f64 = 2e-3;

/// Height of the plate (m).
fn height(t: f64) -> f64 {
    5e-3 + 0.01 * (4.0 * t).cos() - 3e-3 * t
}

/// Two sequences with the plate at `height`, read as `force(t, height, sequence)`.
fn pressing(force: impl Fn(f64, f64, usize) -> f64) -> (Campaign, Vec<f64>) {
    let row = |k: usize, s: usize| {
        let t = k as f64 / RATE;
        let z = height(t);
        (vec![0.0, 0.0, z], vec![0.0, 0.0, force(t, z, s)])
    };
    let sequence = |s: usize| (0..250).map(|k| row(k, s)).collect::<Rows>();
    let rows = [sequence(0), sequence(1)];
    let data = rows.iter().flatten().flat_map(|row| row.1.clone());
    (plate(&[[0.0; 3]], &rows), data.collect())
}

fn recovered(name: &str, campaign: &Campaign, data: &[f64]) -> Vec<f64> {
    let effect = effect(name);
    let model = |theta: &[f64]| torques(campaign, &Model::of(&effect, theta), K);
    fit_with(campaign.site(), effect.as_ref(), data, model)
}

fn recovers(name: &str, truth: &[f64], tolerance: f64, force: impl Fn(f64, f64, usize) -> f64) {
    let (campaign, data) = pressing(force);
    let found = recovered(name, &campaign, &data);
    close(
        effect(name).as_ref(),
        campaign.site(),
        &found,
        truth,
        tolerance,
    );
}

/// Force of the point on a plate at height `z`.
fn spring(z: f64) -> f64 {
    K * (DELTA - z).max(0.0)
}

#[test]
fn adhesion_pulls_as_contact_is_lost() {
    let reach = 4.3e-3;
    // Touched since the plate came down to the point, until it has pulled it too far.
    let sticks = |t: f64| {
        let samples = 0..=(t * RATE).round() as usize;
        samples.fold(false, |touched, k| {
            let up = height(k as f64 / RATE) - DELTA;
            up < 0.0 || touched && up <= reach
        })
    };
    let (campaign, data) = pressing(|t, z, _| if sticks(t) { K * (DELTA - z) } else { 0.0 });
    let effect = effect("adhesion");
    let error = |reach: f64| {
        let model = torques(&campaign, &Model::of(&effect, &[reach]), K);
        let apart = model.iter().zip(&data).map(|(m, d)| (m - d).abs());
        apart.fold(0.0, f64::max)
    };
    // A point lets go between two samples: the reach is known to that step, here below 0.4 mm.
    assert!(error(reach) < 1e-9);
    for other in [0.0, reach - 5e-4, reach + 5e-4] {
        assert!(error(other) > 0.5, "{other}");
    }
}

#[test]
fn thick_links_touch_early() {
    recovers("geometry_padding", &[1.7e-3], 1e-3, |_, z, _| {
        spring(z - 1.7e-3)
    });
    recovers("geometry_padding", &[-1.2e-3], 1e-3, |_, z, _| {
        spring(z + 1.2e-3)
    });
}

#[test]
fn an_encoder_that_is_off_shifts_the_link() {
    // Sideways nothing shows.
    let truth = [f64::NAN, f64::NAN, -2e-3];
    recovers("encoder_offset", &truth, 1e-3, |_, z, _| spring(z - 2e-3));
}

#[test]
fn an_object_that_is_higher_is_touched_early() {
    let (campaign, data) = pressing(|_, z, s| spring(z - [1e-3, 3e-3][s]));
    let found = recovered("registration_offset", &campaign, &data);
    // One offset in common and one of each sequence: their sums count. Sideways nothing shows.
    let [common, first, second] = [found[2], found[5], found[8]];
    assert!((common + first - 1e-3).abs() < 1e-6, "{found:?}");
    assert!((common + second - 3e-3).abs() < 1e-6, "{found:?}");
}

#[test]
fn late_readings_are_those_of_earlier_postures() {
    recovers("latency", &[0.137], 1e-2, |t, _, _| {
        spring(height((t - 0.137).max(0.0)))
    });
}

#[test]
fn gears_and_bases_that_give_way_are_springs_in_series() {
    let c = 4e-4;
    let in_series = |_: f64, z: f64, _: usize| spring(z) / (1.0 + c * K);
    recovers(
        "joint_elasticity",
        &[f64::NAN, f64::NAN, c],
        1e-2,
        in_series,
    );
    // The force is that of the sample before and is taken 3 % too small.
    recovers(
        "object_base_motion",
        &[f64::NAN, f64::NAN, c],
        0.15,
        in_series,
    );
}

#[test]
fn friction_lets_the_point_slip() {
    let mu = 0.4;
    // Down by 1 cm, then to the side and back.
    let side = |t: f64| {
        if t < 1.0 {
            0.0
        } else {
            6e-3 * (2.0 * (t - 1.0)).sin()
        }
    };
    let depth = |t: f64| 0.01 * t.min(1.0);
    let mut u = 0.0_f64;
    let mut last = 0.0;
    let rows: Rows = (0..400)
        .map(|k| {
            let t = k as f64 / RATE;
            // Carried along, and slipping at the edge of the cone.
            u = (u + side(t) - last).clamp(-mu * depth(t), mu * depth(t));
            last = side(t);
            let q = vec![side(t), 0.0, DELTA - depth(t)];
            (q, vec![-K * u, 0.0, K * depth(t)])
        })
        .collect();
    let data: Vec<f64> = rows.iter().flat_map(|row| row.1.clone()).collect();
    let campaign = plate(&[[0.0; 3]], &[rows]);
    let effect = effect("contact_friction");
    // Slip goes in steps of 0.1 mm, so that the misfit is not smooth.
    let misfit = |d_mu: f64| {
        let found = torques(&campaign, &Model::of(&effect, &[d_mu]), K);
        found
            .iter()
            .zip(&data)
            .map(|(f, d)| (f - d).powi(2))
            .sum::<f64>()
    };
    let tried = (-7..=40).map(|k| 0.02 * k as f64);
    let best = tried.min_by(|a, b| misfit(*a).total_cmp(&misfit(*b)));
    assert!((best.unwrap() - (mu - 0.15)).abs() < 0.02, "{best:?}");
}

#[test]
fn actuators_carry_the_weight_of_where_the_links_are() {
    let motion = |k: usize| {
        let t = k as f64 / RATE;
        vec![
            0.3 + 0.5 * (2.0 * t).sin(),
            -0.4 + 0.3 * (3.0 * t).cos(),
            0.8 * t,
        ]
    };
    let offset = [0.05, -0.03, 0.02];
    let rows: Rows = (0..200).map(|k| (motion(k), vec![0.0; 3])).collect();
    let still = free_arm(std::slice::from_ref(&rows));
    // Readings of actuators that hold the links at the true angles.
    let mut workspace = still.site().robot.dynamics_workspace();
    let recorded = &still.train()[0];
    let read = |k: usize| {
        let q: Vec<f64> = motion(k).iter().zip(offset).map(|(q, o)| q + o).collect();
        let (qd, qdd, g) = (&recorded.qd[k], &recorded.qdd[k], &still.site().gravity);
        let tau = still
            .site()
            .robot
            .inverse_dynamics(&q, qd, qdd, g, &mut workspace);
        (motion(k), tau.unwrap().to_vec())
    };
    let campaign = free_arm(&[(0..200).map(read).collect()]);
    let data = campaign.train()[0].reading.data();
    let found = recovered("encoder_offset", &campaign, data);
    let effect = effect("encoder_offset");
    close(effect.as_ref(), campaign.site(), &found, &offset, 1e-3);
}
