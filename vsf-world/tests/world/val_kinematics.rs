//! Kinematics and weight against numbers from other software
//! (vsf-robots/tests/golden/README.md).

use nalgebra::{Isometry3, Vector3};
use ndarray::{Array2, Array4, ArrayBase, Dimension, OwnedRepr};
use ndarray_npy::NpzReader;
use std::fs::File;
use std::path::Path;
use vsf_world::{Arm, JOINTS, Touch};

fn read<D: Dimension>(array: &str) -> ArrayBase<OwnedRepr<f64>, D> {
    let golden = "../vsf-robots/tests/golden/fk_gravity.npz";
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(golden);
    NpzReader::new(File::open(path).unwrap())
        .unwrap()
        .by_name(array)
        .unwrap()
}

#[test]
fn val_poses_of_the_links() {
    let q: Array2<f64> = read("q");
    let poses: Array4<f64> = read("T_world_link");
    let mut arm = Arm::new(Isometry3::identity());
    let mut worst: f64 = 0.0;
    for (k, q) in q.outer_iter().enumerate() {
        arm.set(&std::array::from_fn(|j| q[j]));
        for (l, pose) in arm.poses().iter().enumerate() {
            let ours = pose.to_homogeneous();
            let entries =
                (0..16).map(|i| (ours[(i / 4, i % 4)] - poses[[k, l, i / 4, i % 4]]).abs());
            worst = entries.fold(worst, f64::max);
        }
    }
    assert!(worst < 1e-6, "{worst}");
}

#[test]
fn val_torques_of_a_force_are_the_slope_of_its_work() {
    const STEP: f64 = 1e-6;
    let q0: [f64; JOINTS] = [0.3, -0.7, 1.1, 1.9, -0.4, 0.8, 2.0];
    let force = Vector3::new(3.0, -5.0, 7.0);
    let mut arm = Arm::new(Isometry3::translation(0.0, 0.1, 0.0));
    arm.set(&q0);
    for link in 0..=JOINTS {
        arm.set(&q0);
        let point = arm.poses()[link] * nalgebra::Point3::new(0.02, -0.03, 0.05);
        let on_link = arm.poses()[link].inverse() * point;
        let tau = arm.joint_torques(&Touch { link, point, force });
        for (j, tau) in tau.iter().enumerate() {
            let mut work = |step: f64| {
                let mut q = q0;
                q[j] += step;
                arm.set(&q);
                force.dot(&(arm.poses()[link] * on_link).coords)
            };
            let slope = (work(STEP) - work(-STEP)) / (2.0 * STEP);
            assert!((tau - slope).abs() < 1e-7, "link {link} joint {}", j + 1);
        }
    }
}
