use crate::PipelineError;
use std::collections::BTreeMap;
use std::path::PathBuf;
use vsf_data::{Dataset, JointType, RobotRef, listed};
use vsf_robots::{BUILTIN_NAMES, Joint, JointKind, RobotError, RobotModel, UrdfOptions, builtin};

/// Unit of a joint's readings: `N m`, or `N` for a sliding joint.
pub fn reading_unit(joint: &Joint) -> &'static str {
    match joint.kind() {
        JointKind::Prismatic => "N",
        JointKind::Revolute | JointKind::Continuous => "N m",
    }
}

/// Loads the robot of a recording, checks it against the recording's joints, and places it in the world.
/// `packages` are the folders for `package://` names in its URDF.
///
/// # Errors
/// An unknown or unreadable robot, or joints that contradict the recording.
pub fn robot_of(
    dataset: &Dataset,
    packages: &BTreeMap<String, PathBuf>,
) -> Result<RobotModel, PipelineError> {
    let robot = load_robot(&dataset.robot, dataset.joints.clone(), packages)?;
    placed(dataset, robot)
}

/// A robot as it stands in a recording, checked against the recording's joints.
///
/// # Errors
/// As [`check_joints`].
pub(crate) fn placed(dataset: &Dataset, robot: RobotModel) -> Result<RobotModel, PipelineError> {
    check_joints(dataset, &robot)?;
    Ok(robot.with_base_pose(dataset.base_pose)?)
}

/// Checks that a robot has the joints of a recording.
///
/// # Errors
/// Joints that contradict the recording.
pub(crate) fn check_joints(dataset: &Dataset, robot: &RobotModel) -> Result<(), PipelineError> {
    let names: Vec<&str> = robot.joints().iter().map(|j| j.name()).collect();
    if names.is_empty() {
        return Err(PipelineError::NoJoints {
            robot: robot.name().to_owned(),
        });
    }
    if dataset.width() != names.len() {
        return Err(PipelineError::JointCount {
            columns: dataset.width(),
            robot: robot.name().to_owned(),
            joints: names.len(),
            names: listed(&names),
        });
    }
    let mismatch = |key, column: usize, recorded: &str, robot: &str| PipelineError::JointMismatch {
        key,
        column: column + 1,
        recorded: recorded.to_owned(),
        robot: robot.to_owned(),
    };
    for (i, name) in dataset.joints.iter().flatten().enumerate() {
        if name != names[i] {
            return Err(mismatch(
                "joints",
                i,
                &format!("joint {name:?}"),
                &format!("{:?}", names[i]),
            ));
        }
    }
    for (i, kind) in dataset.joint_types.iter().flatten().enumerate() {
        let slides = robot.joints()[i].kind() == JointKind::Prismatic;
        match (kind, slides) {
            (JointType::Prismatic, false) => {
                return Err(mismatch("joint_types", i, "prismatic", "rotating"));
            }
            (JointType::Revolute, true) => {
                return Err(mismatch("joint_types", i, "revolute", "prismatic"));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Loads a robot by name or URDF, with its base at the origin.
///
/// `joint_order` names the joints of a URDF in order, by default that of the chain; those of built-in robots have theirs.
/// `packages` are the folders for `package://` names in the URDF.
///
/// # Errors
/// An unknown or unreadable robot.
pub fn load_robot(
    robot: &RobotRef,
    joint_order: Option<Vec<String>>,
    packages: &BTreeMap<String, PathBuf>,
) -> Result<RobotModel, PipelineError> {
    match &robot.path {
        Some(path) => {
            let options = UrdfOptions {
                packages: packages.clone(),
                joint_order,
                ..UrdfOptions::default()
            };
            RobotModel::from_urdf_file(path, &options).map_err(|e| match e {
                // These name the file.
                RobotError::Read { .. } | RobotError::Urdf { .. } => e.into(),
                source => PipelineError::RobotFile {
                    path: path.clone(),
                    source,
                },
            })
        }
        None => builtin(&robot.given)
            .transpose()?
            .ok_or_else(|| PipelineError::UnknownRobot {
                name: robot.given.clone(),
                known: BUILTIN_NAMES.join(", "),
            }),
    }
}
