use crate::exit::usage;
use crate::range::{finite, positive, whole};
use clap::{Args, ValueEnum};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use vsf::core::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use vsf::data::{JointType, Overrides, RobotRef, Splits, TorqueKind};

/// The recording.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Recording (overrides dataset.json)")]
pub struct MetadataSettings {
    /// Built-in robot (kinova_gen3, cartesian_stage, planar_arm) or path of a URDF
    #[arg(long)]
    robot: Option<String>,
    /// Pose of the robot's base in the world frame: x,y,z [m] and roll,pitch,yaw [rad]
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_parser = finite)]
    base_pose: Option<Vec<f64>>,
    /// Kind of the torques: external (of the environment on the robot) or measured (at the actuators, gravity
    /// included)
    #[arg(long)]
    torque_kind: Option<TorqueName>,
    /// Sample rate of sequences without time.npy [Hz]
    #[arg(long, value_parser = positive)]
    rate_hz: Option<f64>,
    /// Gravity in the world frame: x,y,z [m/s^2]
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_parser = finite)]
    gravity: Option<Vec<f64>>,
    /// Number of contact-free samples at the start of each sequence, used to tare the sensor
    #[arg(long, value_parser = whole(0..=usize::MAX))]
    tare_samples: Option<usize>,
    /// Joint names of the columns, in order
    #[arg(long, value_delimiter = ',')]
    joints: Option<Vec<String>>,
    /// Joint types of the columns: revolute or prismatic
    #[arg(long, value_delimiter = ',')]
    joint_types: Option<Vec<JointName>>,
    /// IDs of the train sequences; without --test, the test split is empty
    #[arg(long, value_delimiter = ',')]
    train: Option<Vec<String>>,
    /// IDs of the test sequences; without --train, the train split is empty
    #[arg(long, value_delimiter = ',')]
    test: Option<Vec<String>>,
    /// Folder of a package:// name in the URDF; may be repeated
    #[arg(long, value_name = "NAME=PATH", value_parser = package)]
    package: Option<Vec<(String, PathBuf)>>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum TorqueName {
    External,
    Measured,
}

impl From<TorqueName> for TorqueKind {
    fn from(name: TorqueName) -> Self {
        match name {
            TorqueName::External => Self::External,
            TorqueName::Measured => Self::Measured,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum JointName {
    Revolute,
    Prismatic,
}

impl From<JointName> for JointType {
    fn from(name: JointName) -> Self {
        match name {
            JointName::Revolute => Self::Revolute,
            JointName::Prismatic => Self::Prismatic,
        }
    }
}

impl MetadataSettings {
    /// What goes before `dataset.json`.
    pub fn overrides(&self) -> anyhow::Result<Overrides> {
        let robot = self.robot.as_deref();
        let splits = (self.train.is_some() || self.test.is_some()).then(|| Splits {
            train: self.train.clone().unwrap_or_default(),
            test: self.test.clone().unwrap_or_default(),
        });
        Ok(Overrides {
            robot: robot
                .map(|r| RobotRef::resolve(r, Path::new(".")))
                .transpose()?,
            torque_kind: self.torque_kind.map(TorqueKind::from),
            rate_hz: self.rate_hz,
            gravity: match &self.gravity {
                Some(g) => Some(Vector3::from(numbers::<3>("gravity", g)?)),
                None => None,
            },
            base_pose: match &self.base_pose {
                Some(p) => Some(pose(numbers::<6>("base-pose", p)?)?),
                None => None,
            },
            tare_samples: self.tare_samples,
            splits,
            joints: self.joints.clone(),
            joint_types: (self.joint_types.as_ref())
                .map(|types| types.iter().map(|&t| t.into()).collect()),
            ..Overrides::default()
        })
    }

    /// The flag that set a key of `dataset.json`, if one did.
    pub fn flag(&self, key: &str) -> Option<&'static str> {
        let (is_set, flag) = match key {
            "joints" => (self.joints.is_some(), "--joints"),
            "joint_types" if self.joint_types.is_some() => (true, "--joint-types"),
            // Types of the file do not fit joints of the flag.
            "joint_types" => (self.joints.is_some(), "--joints"),
            "rate_hz" => (self.rate_hz.is_some(), "--rate-hz"),
            "base_pose" => (self.base_pose.is_some(), "--base-pose"),
            "gravity" => (self.gravity.is_some(), "--gravity"),
            "tare_samples" => (self.tare_samples.is_some(), "--tare-samples"),
            "splits" => (
                self.train.is_some() || self.test.is_some(),
                "--train, --test",
            ),
            _ => (false, ""),
        };
        is_set.then_some(flag)
    }

    /// Folders of `package://` names.
    pub fn packages(&self) -> BTreeMap<String, PathBuf> {
        self.package.iter().flatten().cloned().collect()
    }
}

fn package(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, path)) if !name.is_empty() && !path.is_empty() => {
            Ok((name.to_owned(), PathBuf::from(path)))
        }
        _ => Err("must be NAME=PATH".to_owned()),
    }
}

fn numbers<const N: usize>(name: &str, given: &[f64]) -> anyhow::Result<[f64; N]> {
    let count = given.len();
    <[f64; N]>::try_from(given)
        .map_err(|_| usage(format!("--{name} takes {N} numbers, {count} given")))
}

/// More than a turn is no radian.
fn pose([x, y, z, roll, pitch, yaw]: [f64; 6]) -> anyhow::Result<Isometry3<f64>> {
    if let Some(angle) = [roll, pitch, yaw].into_iter().find(|a| a.abs() > TAU) {
        return Err(usage(format!(
            "--base-pose: an angle of {angle:?} rad is more than a turn; is it in degrees?"
        )));
    }
    let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
}
