//! Any text as a URDF, then kinematics and dynamics of the robot that it gives.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::core::nalgebra::Vector3;
use vsf::robots::{RobotModel, UrdfOptions};
use vsf_fuzz::scratch;

fuzz_target!(|text: &str| {
    let Ok(robot) = RobotModel::from_urdf_str(text, scratch(), &UrdfOptions::default()) else {
        return;
    };
    let q = vec![0.1; robot.joint_count()];
    let mut posture = robot.posture();
    let _ = robot.update_posture(&q, &mut posture);
    let mut workspace = robot.dynamics_workspace();
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let _ = robot.inverse_dynamics(&q, &q, &q, &gravity, &mut workspace);
});
