//! Masses that move with the links against the inverse dynamics of robots that have them.

use crate::common;

use common::{Row, effect, motion, predict, site};
use nalgebra::Vector3;
use vsf_data::TorqueKind::{External, Measured};
use vsf_gap::Site;
use vsf_robots::{RobotModel, UrdfOptions};

/// An arm in space with a mass in the middle of each link, and 2 kg more on one link.
fn arm(extra: Option<(usize, [f64; 3])>) -> RobotModel {
    let mut urdf = String::from("<robot name='arm'><link name='l0'/>");
    let joints = [
        ("0 0 0.3", "0.2 0.1 0", "0.1 0 1", "continuous"),
        ("0.1 0 0.2", "1.2 0 0.3", "0 1 0.3", "continuous"),
        ("0 0.1 0.3", "0 -0.5 0.1", "1 0.2 0", "prismatic"),
        ("0.2 0 0.1", "0.3 0.3 0", "0.5 1 0", "continuous"),
    ];
    for (k, (xyz, rpy, axis, kind)) in joints.into_iter().enumerate() {
        let (mass, [x, y, z]) = match extra {
            Some((link, at)) if link == k => (2.0, at),
            _ => (1e-9, [0.0; 3]),
        };
        let (child, limit) = (
            k + 1,
            "<limit lower='-9' upper='9' effort='1' velocity='1'/>",
        );
        urdf += &format!(
            "<joint name='j{child}' type='{kind}'><origin xyz='{xyz}' rpy='{rpy}'/>
            <axis xyz='{axis}'/><parent link='l{k}'/><child link='l{child}'/>{limit}</joint>
            <link name='l{child}'><inertial><origin xyz='{x} {y} {z}'/><mass value='{mass}'/>
            <inertia ixx='0.1' iyy='0.1' izz='0.1' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        );
    }
    urdf += "</robot>";
    RobotModel::from_urdf_str(&urdf, "", &UrdfOptions::default()).unwrap()
}

fn moving() -> Vec<Row> {
    motion(2.0, 10.0, |t| {
        let wave =
            |k: usize| (0.3 + 0.4 * k as f64) * ((1.0 + 0.3 * k as f64) * t + k as f64).sin();
        (0..4).map(wave).collect()
    })
}

/// Inverse dynamics of all rows.
fn dynamics(robot: &RobotModel, rows: &[Row]) -> Vec<f64> {
    let g = Vector3::new(0.0, 0.0, -common::GRAVITY);
    let mut workspace = robot.dynamics_workspace();
    let mut torques = |r: &Row| {
        let tau = robot.inverse_dynamics(&r.q, &r.qd, &r.qdd, &g, &mut workspace);
        tau.unwrap().to_vec()
    };
    rows.iter().flat_map(&mut torques).collect()
}

fn agree(site: &Site, name: &str, theta: &[f64], rows: &[Row], actuators: &[f64]) {
    let found = predict(site, effect(name).as_ref(), theta, 0.0, rows);
    for (f, a) in found.iter().zip(actuators) {
        // What the actuators give is missing from the reading.
        assert!(
            (f + a).abs() < 1e-6 * (1.0 + a.abs()),
            "{name}: {f} and {a}"
        );
    }
}

#[test]
fn masses_and_moments_are_those_of_inverse_dynamics() {
    let rows = moving();
    let light = dynamics(&arm(None), &rows);
    let site = site(arm(None), &[], Measured);
    for link in 0..4 {
        // A mass at the origin of the link.
        let heavy = dynamics(&arm(Some((link, [0.0; 3]))), &rows);
        let more: Vec<f64> = heavy.iter().zip(&light).map(|(h, l)| h - l).collect();
        let mut theta = vec![0.0; 20];
        theta[4 * link] = 2.0;
        agree(&site, "inertial_error", &theta, &rows, &more);
        if link == 3 {
            agree(&site, "payload", &theta[12..16], &rows, &more);
        }
        // A mass at c less one at -c: first moments alone.
        let c = [0.1, -0.07, 0.2];
        let there = dynamics(&arm(Some((link, c))), &rows);
        let opposite = dynamics(&arm(Some((link, c.map(|x| -x)))), &rows);
        let more: Vec<f64> = there.iter().zip(&opposite).map(|(h, l)| h - l).collect();
        let mut theta = vec![0.0; 20];
        for k in 0..3 {
            theta[4 * link + 1 + k] = 2.0 * 2.0 * c[k];
        }
        agree(&site, "inertial_error", &theta, &rows, &more);
        if link == 3 {
            agree(&site, "payload", &theta[12..16], &rows, &more);
        }
    }
}

/// What is left in readings that were freed of a wrong weight is the weight alone, however fast the arm moves.
#[test]
fn masses_weigh_on_external_readings() {
    let rows = moving();
    let resting: Vec<Row> = (rows.iter().cloned())
        .map(|row| Row {
            qd: vec![0.0; 4],
            qdd: vec![0.0; 4],
            ..row
        })
        .collect();
    let light = dynamics(&arm(None), &resting);
    let site = site(arm(None), &[], External);
    for link in 0..4 {
        let heavy = dynamics(&arm(Some((link, [0.0; 3]))), &resting);
        let more: Vec<f64> = heavy.iter().zip(&light).map(|(h, l)| h - l).collect();
        let mut theta = vec![0.0; 16];
        theta[4 * link] = 2.0;
        agree(&site, "inertial_error", &theta, &rows, &more);
    }
}

#[test]
fn rotors_resist_the_acceleration_of_their_joint() {
    let rows = moving();
    let site = site(arm(None), &[], Measured);
    let rotors = [0.3, 0.2, 1.5, 0.1];
    let mut theta = vec![0.0; 20];
    theta[16..].copy_from_slice(&rotors);
    let of_row = |r: &Row| (0..4).map(|j| rotors[j] * r.qdd[j]).collect::<Vec<_>>();
    let more: Vec<f64> = rows.iter().flat_map(of_row).collect();
    agree(&site, "inertial_error", &theta, &rows, &more);
}
