//! Every URDF of the reference data reads, and its kinematics and dynamics are consistent.

use nalgebra::Vector3;
use std::io::Write;
use std::path::{Path, PathBuf};
use vsf_core::Shape;
use vsf_robots::{RobotModel, UrdfOptions, cartesian_stage, kinova_gen3};

fn urdfs(dir: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            urdfs(&path, found);
        } else if path.extension().is_some_and(|e| e == "urdf") {
            found.push(path);
        }
    }
}

/// The folder of the reference data, where there is one.
fn data() -> Option<PathBuf> {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    if !dir.exists() {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: the reference data are not on this machine"
        );
        return None;
    }
    Some(dir)
}

#[test]
fn all_of_them_read() {
    let Some(dir) = data() else { return };
    let mut found = Vec::new();
    urdfs(&dir, &mut found);
    assert!(found.len() > 20);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    for path in found {
        let robot = RobotModel::from_urdf_file(&path, &UrdfOptions::default())
            .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let q: Vec<f64> = (0..robot.joint_count())
            .map(|j| 0.3 + 0.1 * j as f64)
            .collect();
        let mut workspace = robot.dynamics_workspace();
        robot.gravity_torques(&q, &gravity, &mut workspace).unwrap();
        let mass = robot.mass_matrix(&q, &mut workspace).unwrap();
        let d = q.len();
        vsf_core::SymmetricFactor::default()
            .factor("mass matrix", d, mass)
            .unwrap();
    }
}

#[test]
fn capsules_of_the_plant_robot_are_recognized() {
    let Some(dir) = data() else { return };
    let path = dir.join("plants/orange_tree_full_overlap/robot.urdf");
    let robot = RobotModel::from_urdf_file(path, &UrdfOptions::default()).unwrap();
    assert_eq!(robot.colliders().len(), 23);
    assert!(
        robot
            .colliders()
            .iter()
            .all(|c| matches!(c.shape, Shape::Capsule { .. }))
    );
    let ours = kinova_gen3().unwrap();
    let names = |r: &RobotModel| {
        r.links()
            .iter()
            .map(|l| l.name().to_owned())
            .collect::<Vec<_>>()
    };
    assert_eq!(names(&robot), names(&ours));
}

#[test]
fn the_built_in_stage_is_the_stage_of_the_data() {
    let Some(dir) = data() else { return };
    let path = dir.join("real/palpation_whole_region/robot.urdf");
    let robot = RobotModel::from_urdf_file(path, &UrdfOptions::default()).unwrap();
    let ours = cartesian_stage(0.004).unwrap();
    assert_eq!(robot.links(), ours.links());
    assert_eq!(robot.joints(), ours.joints());
    assert_eq!(robot.colliders(), ours.colliders());
}
