//! Forward kinematics, gravity torques and Jacobians of the Kinova Gen3 against numbers from other
//! software (tests/golden/README.md).

use nalgebra::{Isometry3, Point3, Vector3};
use ndarray::{Array1, Array2, Array3, Array4, Dimension, OwnedRepr};
use ndarray_npy::NpzReader;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use vsf_robots::{Meshes, RobotModel, UrdfOptions, jacobian, kinova_gen3};

fn read<D: Dimension>(file: &str, array: &str) -> ndarray::ArrayBase<OwnedRepr<f64>, D> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(file);
    NpzReader::new(File::open(path).unwrap())
        .unwrap()
        .by_name(array)
        .unwrap()
}

/// Largest difference between two poses, entry by entry of their 4x4 matrices.
fn difference(X: &Isometry3<f64>, golden: ndarray::ArrayView2<f64>) -> f64 {
    let X = X.to_homogeneous();
    let entries = golden.indexed_iter();
    entries.fold(0.0, |worst, ((i, j), g)| {
        f64::max(worst, (X[(i, j)] - g).abs())
    })
}

/// Klampt gives a link without inertia, the tool frame here, 0.1 g at its origin.
const KLAMPT_DEFAULT_MASS: f64 = 1e-4;

fn check_kinematics_and_gravity(robot: &RobotModel) -> (f64, f64) {
    let q: Array2<f64> = read("fk_gravity.npz", "q");
    let poses: Array4<f64> = read("fk_gravity.npz", "T_world_link");
    let torques: Array2<f64> = read("fk_gravity.npz", "gravity_torque");
    let g: Array1<f64> = read("fk_gravity.npz", "g_vec");
    let gravity = Vector3::new(g[0], g[1], g[2]);
    assert_eq!(gravity, Vector3::new(0.0, 0.0, -9.8));

    let (mut posture, mut workspace) = (robot.posture(), robot.dynamics_workspace());
    let (mut worst_pose, mut worst_torque) = (0.0, 0.0);
    for k in 0..q.nrows() {
        let q = q.row(k).to_vec();
        robot.update_posture(&q, &mut posture).unwrap();
        for (l, golden) in poses
            .index_axis(ndarray::Axis(0), k)
            .outer_iter()
            .enumerate()
        {
            // The golden links leave out `world`.
            let X = &posture.link_poses()[l + 1];
            worst_pose = f64::max(worst_pose, difference(X, golden));
        }
        let tau = robot.gravity_torques(&q, &gravity, &mut workspace).unwrap();
        let tool = robot.link_count() - 1;
        let p_W = Point3::from(posture.link_poses()[tool].translation.vector);
        let mut extra = [0.0; 7];
        posture.joint_torques(tool, &p_W, &(-gravity * KLAMPT_DEFAULT_MASS), &mut extra);
        for ((t, e), golden) in tau.iter().zip(extra).zip(torques.row(k)) {
            worst_torque = f64::max(worst_torque, (t + e - golden).abs());
        }
    }
    eprintln!(
        "{}: poses {worst_pose:.1e}, gravity {worst_torque:.1e}",
        robot.name()
    );
    (worst_pose, worst_torque)
}

fn check_jacobians(robot: &RobotModel) -> f64 {
    let q: Array2<f64> = read("jacobian.npz", "q");
    let p_world: Array2<f64> = read("jacobian.npz", "p_world");
    let p_local: Array2<f64> = read("jacobian.npz", "p_local");
    let golden: Array3<f64> = read("jacobian.npz", "J");
    let links = [
        "ForeArm_Link",
        "SphericalWrist1_Link",
        "SphericalWrist2_Link",
        "Bracelet_Link",
    ];
    let mut posture = robot.posture();
    let mut worst = 0.0;
    for k in 0..q.nrows() {
        let link = robot.link_index(links[(k / 3) % 4]).unwrap();
        robot
            .update_posture(&q.row(k).to_vec(), &mut posture)
            .unwrap();
        let point = |p: &Array2<f64>| Point3::new(p[(k, 0)], p[(k, 1)], p[(k, 2)]);
        let p_W = point(&p_world);
        assert!((posture.link_poses()[link] * point(&p_local) - p_W).norm() < 1e-12);
        let mut columns = [Vector3::zeros(); 7];
        jacobian(&posture, link, &p_W, &mut columns).unwrap();
        for ((j, i), &g) in golden.index_axis(ndarray::Axis(0), k).indexed_iter() {
            worst = f64::max(worst, (columns[j][i] - g).abs());
        }
    }
    eprintln!("{}: Jacobians {worst:.1e}", robot.name());
    worst
}

#[test]
fn the_built_in_robot_agrees() {
    let robot = kinova_gen3().unwrap();
    let (pose, torque) = check_kinematics_and_gravity(&robot);
    assert!(pose < 1e-9 && torque < 1e-9, "{pose:e} {torque:e}");
    let j = check_jacobians(&robot);
    assert!(j < 1e-12, "{j:e}");
}

#[test]
fn names_are_those_of_the_maker() {
    let robot = kinova_gen3().unwrap();
    let joints: Vec<_> = robot.joints().iter().map(|j| j.name().to_owned()).collect();
    assert_eq!(
        joints,
        (1..=7).map(|k| format!("Actuator{k}")).collect::<Vec<_>>()
    );
    assert_eq!(robot.link_index("Base_Link").unwrap(), 1);
    assert_eq!(robot.link_index("EndEffector_Link").unwrap(), 9);
    let bare: Vec<_> = robot.links_without_inertia().map(|l| l.name()).collect();
    assert_eq!(bare, ["EndEffector_Link"]);
    let shaped = |name| {
        let link = robot.link_index(name).unwrap();
        robot.colliders().iter().any(|c| c.link == link)
    };
    for link in &robot.links()[1..9] {
        assert!(shaped(link.name()), "{} has no shape", link.name());
    }
    assert!(!shaped("world") && !shaped("EndEffector_Link"));
}

#[test]
fn the_makers_urdf_and_meshes_agree() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data/kinova_gen3/kinova_gen3.urdf");
    if !path.exists() {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: the maker's URDF of the Gen3 is not on this machine"
        );
        return;
    }
    let robot = RobotModel::from_urdf_file(&path, &UrdfOptions::default()).unwrap();
    assert_eq!(robot.colliders().len(), 8);
    let (pose, torque) = check_kinematics_and_gravity(&robot);
    assert!(pose < 1e-9 && torque < 1e-9, "{pose:e} {torque:e}");
    assert!(check_jacobians(&robot) < 1e-12);

    let skip = UrdfOptions {
        meshes: Meshes::Skip,
        ..UrdfOptions::default()
    };
    let without = RobotModel::from_urdf_file(&path, &skip).unwrap();
    assert!(without.colliders().is_empty());
    let ours = kinova_gen3().unwrap();
    let limits = |r: &RobotModel| -> Vec<_> {
        r.joints()
            .iter()
            .map(|j| (j.name().to_owned(), j.kind(), *j.limits()))
            .collect()
    };
    assert_eq!(limits(&without), limits(&ours));
}
