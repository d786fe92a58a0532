//! Kinematics and dynamics of random trees against independent arithmetic: products of matrices,
//! finite differences, Lagrange's equations.

use crate::common;

use common::{RandomRobot, apply, random_robot, rotation, rpy};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use vsf_robots::{RobotModel, jacobian};

const GRAVITY: Vector3<f64> = Vector3::new(1.3, -0.7, -9.81);

/// Potential energy of the links.
fn potential(robot: &RandomRobot, q: &[f64]) -> f64 {
    let poses = robot.poses(q);
    let energy = |(k, j): (usize, &common::RandomJoint)| {
        -j.mass * GRAVITY.dot(&apply(&poses[k + 1], &j.com).coords)
    };
    robot.joints.iter().enumerate().map(energy).sum()
}

/// Mass matrix as the sum of `Jv^T m Jv + Jw^T I Jw` over links, by differences of matrix products:
/// the velocity of a body is taken from its poses at `q + h e_j` and `q - h e_j`.
fn mass_by_differences(robot: &RandomRobot, q: &[f64]) -> DMatrix<f64> {
    let (d, h) = (q.len(), 1e-5);
    let here = robot.poses(q);
    let shifted = |j: usize, by: f64| {
        let mut q = q.to_vec();
        q[j] += by;
        robot.poses(&q)
    };
    let around: Vec<_> = (0..d).map(|j| (shifted(j, h), shifted(j, -h))).collect();
    let mut mass = DMatrix::zeros(d, d);
    for (k, body) in robot.joints.iter().enumerate() {
        let l = k + 1;
        let (mut linear, mut angular) = (DMatrix::zeros(3, d), DMatrix::zeros(3, d));
        for (j, (plus, minus)) in around.iter().enumerate() {
            let v = (apply(&plus[l], &body.com) - apply(&minus[l], &body.com)) / (2.0 * h);
            let R_dot = (rotation(&plus[l]) - rotation(&minus[l])) / (2.0 * h);
            let w = R_dot * rotation(&here[l]).transpose();
            linear.set_column(j, &v);
            angular.set_column(j, &Vector3::new(w[(2, 1)], w[(0, 2)], w[(1, 0)]));
        }
        let R = rotation(&here[l]) * rpy(&body.inertia_rpy);
        let inertia = R * Matrix3::from_diagonal(&body.moments.into()) * R.transpose();
        mass += linear.transpose() * &linear * body.mass;
        mass += angular.transpose() * inertia * &angular;
    }
    mass
}

fn mass_matrix(model: &RobotModel, q: &[f64]) -> DMatrix<f64> {
    let mut workspace = model.dynamics_workspace();
    let m = model.mass_matrix(q, &mut workspace).unwrap();
    DMatrix::from_row_slice(q.len(), q.len(), m)
}

/// Torques of Lagrange's equations: `M qdd + dM/dt qd - d(qd^T M qd / 2)/dq + dU/dq`, the
/// derivatives by central differences.
fn lagrange(robot: &RandomRobot, model: &RobotModel) -> DVector<f64> {
    let q = robot.state(0);
    let qd = DVector::from_vec(robot.state(1));
    let qdd = DVector::from_vec(robot.state(2));
    let h = 1e-5;
    let mut tau = mass_matrix(model, &q) * qdd;
    for j in 0..q.len() {
        let shifted = |by: f64| {
            let mut q = q.clone();
            q[j] += by;
            q
        };
        let (plus, minus) = (shifted(h), shifted(-h));
        let dM = (mass_matrix(model, &plus) - mass_matrix(model, &minus)) / (2.0 * h);
        tau += &dM * &qd * qd[j];
        tau[j] -= (qd.transpose() * &dM * &qd)[0] / 2.0;
        tau[j] += (potential(robot, &plus) - potential(robot, &minus)) / (2.0 * h);
    }
    tau
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn poses_are_products_of_transforms(robot in random_robot()) {
        let (model, q) = (robot.model(), robot.state(0));
        let mut posture = model.posture();
        model.update_posture(&q, &mut posture).unwrap();
        prop_assert_eq!(posture.q(), &q[..]);
        for (l, X) in robot.poses(&q).iter().enumerate() {
            let link = model.link_index(&format!("l{l}")).unwrap();
            let gap = posture.link_poses()[link].to_homogeneous() - X;
            prop_assert!(gap.amax() < 1e-13, "{gap}");
        }
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_the_position(robot in random_robot(), p in prop::array::uniform3(-1.0..1.0)) {
        let (model, q) = (robot.model(), robot.state(0));
        let mut posture = model.posture();
        model.update_posture(&q, &mut posture).unwrap();
        let here = robot.poses(&q);
        let mut columns = vec![Vector3::zeros(); q.len()];
        for (l, X_WL) in here.iter().enumerate() {
            let link = model.link_index(&format!("l{l}")).unwrap();
            let p_W = apply(X_WL, &p);
            jacobian(&posture, link, &p_W, &mut columns).unwrap();
            let moved = robot.moves_link(l);
            for j in 0..q.len() {
                let at = |by: f64| {
                    let mut q = q.clone();
                    q[j] += by;
                    apply(&robot.poses(&q)[l], &p)
                };
                let h = 1e-6;
                let difference = (at(h) - at(-h)) / (2.0 * h);
                prop_assert!((columns[j] - difference).norm() < 1e-8);
                if !moved[j] {
                    prop_assert_eq!(columns[j], Vector3::zeros());
                }
            }
        }
    }

    #[test]
    fn torques_of_a_force_are_the_transposed_jacobian(
        robot in random_robot(),
        p in prop::array::uniform3(-1.0..1.0),
        f in prop::array::uniform3(-10.0..10.0),
    ) {
        let (model, q) = (robot.model(), robot.state(0));
        let mut posture = model.posture();
        model.update_posture(&q, &mut posture).unwrap();
        let (p_W, f_W) = (Point3::from(p), Vector3::from(f));
        let (mut columns, mut tau) = (vec![Vector3::zeros(); q.len()], vec![7.0; q.len()]);
        for l in 0..model.link_count() {
            jacobian(&posture, l, &p_W, &mut columns).unwrap();
            posture.joint_torques(l, &p_W, &f_W, &mut tau);
            for (t, c) in tau.iter().zip(&columns) {
                prop_assert!((t - c.dot(&f_W)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn gravity_torques_are_the_gradient_of_the_potential(robot in random_robot()) {
        let (model, q) = (robot.model(), robot.state(0));
        let mut workspace = model.dynamics_workspace();
        let tau = model.gravity_torques(&q, &GRAVITY, &mut workspace).unwrap();
        let h = 1e-5;
        for j in 0..q.len() {
            let at = |by: f64| {
                let mut q = q.clone();
                q[j] += by;
                potential(&robot, &q)
            };
            let gradient = (at(h) - at(-h)) / (2.0 * h);
            prop_assert!((tau[j] - gradient).abs() < 1e-6, "{} {gradient}", tau[j]);
        }
    }

    #[test]
    fn the_mass_matrix_is_the_kinetic_energy(robot in random_robot()) {
        let (model, q) = (robot.model(), robot.state(0));
        let mass = mass_matrix(&model, &q);
        prop_assert_eq!(&mass, &mass.transpose());
        let gap = &mass - mass_by_differences(&robot, &q);
        prop_assert!(gap.is_empty() || gap.amax() < 1e-7, "{gap}");
    }

    #[test]
    fn inverse_dynamics_obey_lagrange(robot in random_robot()) {
        let model = robot.model();
        let expected = lagrange(&robot, &model);
        let mut workspace = model.dynamics_workspace();
        let (q, qd, qdd) = (robot.state(0), robot.state(1), robot.state(2));
        let tau = model.inverse_dynamics(&q, &qd, &qdd, &GRAVITY, &mut workspace).unwrap();
        for (t, e) in tau.iter().zip(&expected) {
            prop_assert!((t - e).abs() < 1e-6 * (1.0 + e.abs()), "{t} {e}");
        }
    }

    #[test]
    fn dynamics_do_not_care_where_the_base_is(
        robot in random_robot(),
        t in prop::array::uniform3(-5.0..5.0),
        r in prop::array::uniform3(-3.0..3.0),
    ) {
        let model = robot.model();
        let X_WB = Isometry3::from_parts(
            Vector3::from(t).into(),
            UnitQuaternion::from_euler_angles(r[0], r[1], r[2]),
        );
        let placed = model.clone().with_base_pose(X_WB).unwrap();
        let (q, qd, qdd) = (robot.state(0), robot.state(1), robot.state(2));
        let (mut w0, mut w1) = (model.dynamics_workspace(), placed.dynamics_workspace());
        let tau = model.inverse_dynamics(&q, &qd, &qdd, &GRAVITY, &mut w0).unwrap();
        let turned = placed
            .inverse_dynamics(&q, &qd, &qdd, &(X_WB.rotation * GRAVITY), &mut w1)
            .unwrap();
        for (a, b) in tau.iter().zip(turned) {
            prop_assert!((a - b).abs() < 1e-10 * (1.0 + a.abs()));
        }
        for (a, b) in w0.posture().link_poses().iter().zip(w1.posture().link_poses()) {
            prop_assert!(((X_WB * a).to_homogeneous() - b.to_homogeneous()).amax() < 1e-12);
        }
    }
}
