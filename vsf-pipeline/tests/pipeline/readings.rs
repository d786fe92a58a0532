//! Readings at the actuators of an arm whose motion is known.

use nalgebra::{Point3, Vector3};
use std::borrow::Cow;
use std::f64::consts::{PI, TAU};
use vsf_data::{Dataset, RobotRef, Sequence, Table, TorqueKind};
use vsf_pipeline::{
    Scene, SceneOptions, derivatives_of, external_torques, motion_warnings, rigid_body_torques,
    unwound,
};
use vsf_robots::{RobotModel, kinova_gen3, planar_arm};

/// What the joints feel besides.
const TOUCH: [f64; 3] = [0.4, -0.3, 0.2];

fn planar() -> RobotModel {
    planar_arm(3, 0.3, 0.03).unwrap()
}

/// Two seconds of a swing at `rate` samples a second; angles as an encoder of 1e-5 rad gives them.
fn swing(rate: f64) -> Sequence {
    let robot = planar();
    let mut workspace = robot.dynamics_workspace();
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let (mut angles, mut torques) = (Vec::new(), Vec::new());
    let time: Vec<f64> = (0..(2.0 * rate) as usize)
        .map(|k| k as f64 / rate)
        .collect();
    for t in &time {
        // Half a turn to and fro, once a second.
        let pace = TAU;
        let (sin, cos) = (pace * t).sin_cos();
        let q = [0.8 * sin, 0.5 * cos, -0.3 * sin];
        let qd = [0.8 * pace * cos, -0.5 * pace * sin, -0.3 * pace * cos];
        let qdd = q.map(|q| -pace * pace * q);
        let rigid = robot
            .inverse_dynamics(&q, &qd, &qdd, &gravity, &mut workspace)
            .unwrap();
        angles.extend(q.map(|q| (q * 1e5).round() / 1e5));
        torques.extend(rigid.iter().zip(TOUCH).map(|(r, touch)| r - touch));
    }
    let table = |data: Vec<f64>| Table::new(3, data).unwrap();
    Sequence::new("0", time, table(angles), table(torques))
}

fn scene(sequence: &Sequence) -> Scene {
    let robot = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
    let dataset = Dataset {
        torque_kind: TorqueKind::Measured,
        rest_points: Some(vec![Point3::new(9.0, 0.0, 0.0)]),
        ..Dataset::new(robot, vec![sequence.clone()])
    };
    Scene::open(&dataset, &SceneOptions::default()).unwrap()
}

/// Poses in which the arm rests, each a touch of its own.
#[test]
fn poses_are_held_by_gravity() {
    let swing = swing(5.0);
    let mut poses = Sequence {
        touch_starts: (0..swing.len()).collect(),
        ..swing
    };
    let scene = scene(&poses);
    let error = external_torques(&scene, &poses).unwrap_err().to_string();
    assert!(
        error.contains("sequence 0") && error.contains("velocities.npy"),
        "{error}"
    );
    let still = vec![0.0; poses.angles.data().len()];
    poses.velocities = Some(Table::new(3, still).unwrap());
    let external = external_torques(&scene, &poses).unwrap();
    let mut workspace = scene.robot().dynamics_workspace();
    for row in 0..poses.len() {
        let q = &poses.angles[row];
        let hold = (scene.robot())
            .gravity_torques(q, &scene.gravity(), &mut workspace)
            .unwrap();
        for j in 0..3 {
            assert_eq!(external[row][j], hold[j] - poses.torques[row][j]);
        }
    }
}

/// Windows are as long as samples are dense, however long the arm rests between touches.
#[test]
fn pauses_do_not_change_the_motion() {
    let steady = swing(1000.0);
    let half = steady.len() / 2;
    let late = |(k, t): (usize, &f64)| if k < half { *t } else { t + 60.0 };
    let paused = Sequence {
        time: steady.time.iter().enumerate().map(late).collect(),
        touch_starts: vec![0, half],
        ..steady.clone()
    };
    let parted = Sequence {
        touch_starts: vec![0, half],
        ..steady
    };
    let [a, b] = [&paused, &parted].map(|s| derivatives_of(&planar(), s).unwrap());
    for (a, b) in a.accelerations.data().iter().zip(b.accelerations.data()) {
        assert!((a - b).abs() < 1e-6 * (1.0 + b.abs()), "{a} {b}");
    }
    let short = derivatives_of(&planar(), &swing(10.0)).unwrap();
    assert!(
        rigid_body_torques(scene(&parted).robot(), &Vector3::zeros(), &parted, &short).is_err()
    );
}

/// Stamps of receiving: ten at a time, a microsecond apart.
#[test]
fn bursts_do_not_change_the_motion() {
    let steady = swing(1000.0);
    let at = |k: usize| 0.01 * (k / 10) as f64 + 1e-6 * (k % 10) as f64;
    let bursts = Sequence {
        time: (0..steady.len()).map(at).collect(),
        velocities: steady.velocities.clone(),
        ..steady.clone()
    };
    let [a, b] = [&bursts, &steady].map(|s| derivatives_of(&planar(), s).unwrap());
    let largest = |d: &[f64]| d.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let [a, b] = [a, b].map(|d| largest(d.velocities.data()));
    assert!((a / b - 1.0).abs() < 0.2, "{a} for {b} rad/s");
}

/// Neither weight nor inertia is left, at any sample rate.
#[test]
fn what_the_arm_needs_to_move_is_taken_off() {
    for rate in [100.0, 1000.0] {
        let sequence = swing(rate);
        let scene = scene(&sequence);
        let external = external_torques(&scene, &sequence).unwrap();
        let mut workspace = scene.robot().dynamics_workspace();
        let (mut left, mut inertia) = (0.0_f64, 0.0_f64);
        // A derivative at the ends is extrapolated.
        for row in sequence.len() / 20..sequence.len() * 19 / 20 {
            let q = &sequence.angles[row];
            let hold = (scene.robot())
                .gravity_torques(q, &scene.gravity(), &mut workspace)
                .unwrap();
            for j in 0..3 {
                let reading = sequence.torques[row][j] + TOUCH[j];
                inertia = inertia.max((reading - hold[j]).abs());
                left = left.max((external[row][j] - TOUCH[j]).abs());
            }
        }
        assert!(left < 0.02 * inertia, "{left} of {inertia} at {rate} Hz");
    }
}

/// The first joint of a Gen3 turns on and on, and its encoder begins anew at half a turn.
#[test]
fn a_continuous_joint_turns_on_where_its_encoder_begins_anew() {
    let robot = kinova_gen3().unwrap();
    let (rate, pace) = (100.0, 1.3);
    let time: Vec<f64> = (0..800).map(|k| f64::from(k) / rate).collect();
    let posture = |turn: f64| [turn, 0.5, turn - 3.0, -1.2, 0.3, 0.8, -0.2];
    let recorded = |at: fn(f64) -> f64| {
        let angles = time.iter().flat_map(|t| posture(at(pace * t))).collect();
        let torques = vec![0.0; 7 * time.len()];
        let table = |data: Vec<f64>| Table::new(7, data).unwrap();
        Sequence::new("0", time.clone(), table(angles), table(torques))
    };
    let on = recorded(|turn| turn);
    let anew = recorded(|turn| (turn + PI).rem_euclid(TAU) - PI);
    assert!(matches!(unwound(&robot, &on), Cow::Borrowed(_)));
    let unwound = unwound(&robot, &anew);
    for (a, b) in unwound.angles.data().iter().zip(on.angles.data()) {
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }
    let [a, b] = [&anew, &on].map(|s| derivatives_of(&robot, s).unwrap());
    for (row, (a, b)) in a.velocities.iter().zip(b.velocities.iter()).enumerate() {
        assert!((a[0] - pace).abs() < 1e-9, "row {row}: {a:?} {b:?}");
    }
    assert_eq!(motion_warnings(&robot, &[&anew]), []);
    // Recorded velocities are found to fit.
    let told = Sequence {
        velocities: Some(b.velocities),
        ..anew
    };
    assert_eq!(motion_warnings(&robot, &[&told]), []);
}
