//! Built-in toy robots against formulas on paper.

use nalgebra::{Point3, Vector3};
use std::f64::consts::PI;
use vsf_core::Shape;
use vsf_robots::{BUILTIN_NAMES, builtin, cartesian_stage, planar_arm};

const G: f64 = 9.81;

#[test]
fn one_link_is_a_physical_pendulum() {
    let (length, radius) = (0.4, 0.02);
    let arm = planar_arm(1, length, radius).unwrap();
    let mut workspace = arm.dynamics_workspace();
    let mass = 1000.0 * PI * radius * radius * length;
    let q = 0.6f64;
    let gravity = Vector3::new(0.0, 0.0, -G);
    let tau = arm.gravity_torques(&[q], &gravity, &mut workspace).unwrap()[0];
    assert!((tau - mass * G * length / 2.0 * q.cos()).abs() < 1e-14);
    let inertia =
        mass * (3.0 * radius * radius + length * length) / 12.0 + mass * (length / 2.0).powi(2);
    let m = arm.mass_matrix(&[q], &mut workspace).unwrap()[0];
    assert!((m - inertia).abs() < 1e-16);
    assert_eq!(
        arm.links_without_inertia()
            .map(|l| l.name())
            .collect::<Vec<_>>(),
        ["tip"]
    );
}

/// Double pendulum with angles from the horizontal: the Coriolis torques are
/// `-m2 l1 c2 sin(q2) (2 qd1 qd2 + qd2^2)` and `m2 l1 c2 sin(q2) qd1^2`.
#[test]
fn two_links_have_the_textbook_coriolis_torques() {
    let (l, r) = (0.5, 0.03);
    let arm = planar_arm(2, l, r).unwrap();
    let mass = arm.links()[2].mass();
    let (q, qd) = ([0.4, -0.9f64], [1.5, -2.0]);
    let mut workspace = arm.dynamics_workspace();
    let tau = arm
        .inverse_dynamics(&q, &qd, &[0.0; 2], &Vector3::zeros(), &mut workspace)
        .unwrap();
    let b = mass * l * (l / 2.0) * q[1].sin();
    assert!((tau[0] + b * (2.0 * qd[0] * qd[1] + qd[1] * qd[1])).abs() < 1e-14);
    assert!((tau[1] - b * qd[0] * qd[0]).abs() < 1e-14);
}

#[test]
fn the_arm_stays_in_its_plane_and_reaches_its_length() {
    let arm = planar_arm(3, 0.3, 0.03).unwrap();
    let mut posture = arm.posture();
    arm.update_posture(&[0.3, 0.5, -1.1], &mut posture).unwrap();
    let tip = posture.link_poses()[arm.link_index("tip").unwrap()]
        .translation
        .vector;
    let angles = [0.3f64, 0.8, -0.3];
    let x: f64 = angles.iter().map(|a| 0.3 * a.cos()).sum();
    let z: f64 = angles.iter().map(|a| 0.3 * a.sin()).sum();
    assert!((tip - Vector3::new(x, 0.0, z)).norm() < 1e-15);
    // Capsules reach from joint to joint.
    for (k, c) in arm.colliders().iter().enumerate() {
        let Shape::Capsule { half_length, .. } = c.shape else {
            panic!()
        };
        let start = c.X_LS * Point3::new(0.0, 0.0, -half_length);
        let end = c.X_LS * Point3::new(0.0, 0.0, half_length);
        assert!(start.coords.norm() < 1e-15 && (end.x - 0.3).abs() < 1e-15);
        assert_eq!(arm.links()[c.link].name(), format!("link_{}", k + 1));
    }
}

#[test]
fn the_stage_puts_the_lowest_point_of_its_tip_at_the_joint_position() {
    let stage = cartesian_stage(0.01).unwrap();
    let mut posture = stage.posture();
    stage
        .update_posture(&[0.1, -0.2, 0.3], &mut posture)
        .unwrap();
    let [tip] = stage.colliders() else { panic!() };
    let center = posture.link_poses()[tip.link] * tip.X_LS;
    let lowest = center.translation.vector - Vector3::new(0.0, 0.0, 0.01);
    assert!((lowest - Vector3::new(0.1, -0.2, 0.3)).norm() < 1e-16);
    let mut workspace = stage.dynamics_workspace();
    let gravity = Vector3::new(0.0, 0.0, -G);
    let tau = stage
        .gravity_torques(&[0.0; 3], &gravity, &mut workspace)
        .unwrap();
    assert_eq!(tau, [0.0, 0.0, 0.1 * G]);
    let m = stage.mass_matrix(&[0.0; 3], &mut workspace).unwrap();
    for (value, expected) in m.iter().zip([0.3, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.1]) {
        assert!((value - expected).abs() < 1e-16);
    }
}

#[test]
fn built_in_robots_are_found_by_name() {
    for name in BUILTIN_NAMES {
        assert_eq!(builtin(name).unwrap().unwrap().name(), name);
    }
    assert!(builtin("robot.urdf").is_none());
}

#[test]
fn bad_sizes_are_refused() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
        if bad != 1e300 {
            assert!(cartesian_stage(bad).is_err(), "{bad}");
        }
        assert!(planar_arm(2, bad, 0.1).is_err() || bad == 1e300, "{bad}");
        assert!(planar_arm(2, 0.1, bad).is_err(), "{bad}");
    }
    for links in [0, 999, usize::MAX] {
        assert!(planar_arm(links, 0.1, 0.1).is_err());
    }
}
