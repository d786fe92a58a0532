//! Parameters shared by the commands: flags, over a configuration file, over a preset, over the
//! library's defaults.

use crate::exit::usage;
use anyhow::Context;
use clap::{Args, Command, ValueEnum};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Table;
use vsf::contact::{ContactConfig, GridOptions};
use vsf::core::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use vsf::data::{JointType, Overrides, RobotRef, Splits, TorqueKind};
use vsf::filter::{DiagonalForm, ReplayConfig, ReplayVariance};
use vsf::pipeline::{EstimatorSpec, Method, SceneOptions};

/// Where parameters come from besides the flags.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Sources of parameters")]
pub struct Sources {
    /// TOML file whose keys are the long flags of all commands' parameters, such as
    /// `threshold = 0.002`; unknown keys are refused. A flag goes before the file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// A named set of values below the configuration file
    #[arg(long)]
    preset: Option<Preset>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Preset {
    /// All values of the paper: prior N(0, 0.1²), noise sd 1, eq. 7 and Alg. 1 as printed (20
    /// replays, buffer emptied before each sequence, variances shrunk again by every replay),
    /// threshold 2 mm, friction 0.15, slip step 0.1 mm, points instead of cubes
    Paper,
}

impl Preset {
    fn table(self) -> Table {
        let Self::Paper = self;
        toml::toml! {
            estimator = "printed"
            replay = 20
            replay-variance = "shrink"
            clear-replay = true
            prior-sd = 0.1
            noise-sd = 1.0
            threshold = 0.002
            friction = 0.15
            slip-step = 0.0001
            subdivision = 1
        }
    }
}

/// The recording and the contact model.
#[derive(Debug, Clone, Default, Args, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
#[command(next_help_heading = "Recording (instead of dataset.json) and contact")]
pub struct SceneSettings {
    /// Built-in robot (kinova_gen3, cartesian_stage, planar_arm) or path of a URDF
    #[arg(long)]
    robot: Option<String>,
    /// Pose of the base in the world: x,y,z [m] and roll,pitch,yaw [rad]
    #[arg(
        long,
        value_delimiter = ',',
        allow_hyphen_values = true,
        allow_negative_numbers = true
    )]
    base_pose: Option<Vec<f64>>,
    /// What the torques mean: external, or measured (actuator side, with gravity)
    #[arg(long, value_parser = ["external", "measured"])]
    torque_kind: Option<String>,
    /// Sample rate of sequences without time.npy [Hz]
    #[arg(long, allow_negative_numbers = true)]
    rate_hz: Option<f64>,
    /// Gravity in the world frame, x,y,z [m/s^2]
    #[arg(
        long,
        value_delimiter = ',',
        allow_hyphen_values = true,
        allow_negative_numbers = true
    )]
    gravity: Option<Vec<f64>>,
    /// Contact-free samples at the start of each sequence, which tare the sensor
    #[arg(long)]
    tare_samples: Option<usize>,
    /// Joint names of the columns, in order
    #[arg(long, value_delimiter = ',')]
    joints: Option<Vec<String>>,
    /// Types of the columns: revolute or prismatic
    #[arg(long, value_delimiter = ',', value_parser = ["revolute", "prismatic"])]
    joint_types: Option<Vec<String>>,
    /// IDs of the train split; with --test or alone
    #[arg(long, value_delimiter = ',')]
    train: Option<Vec<String>>,
    /// IDs of the test split; with --train or alone
    #[arg(long, value_delimiter = ',')]
    test: Option<Vec<String>>,
    /// Folder of a package:// name in the URDF; may be repeated
    #[arg(long, value_name = "NAME=PATH")]
    package: Option<Vec<String>>,
    /// Links that may touch; all with collision shapes by default
    #[arg(long, value_delimiter = ',')]
    links: Option<Vec<String>>,
    /// Contact threshold delta [m], default 0.002
    #[arg(long, allow_negative_numbers = true)]
    threshold: Option<f64>,
    /// Friction coefficient nu_f, default 0.15
    #[arg(long, allow_negative_numbers = true)]
    friction: Option<f64>,
    /// Slip step lambda_s [m], default 0.0001
    #[arg(long, allow_negative_numbers = true)]
    slip_step: Option<f64>,
    /// Most slip steps of one point per sample, default 200
    #[arg(long)]
    max_slip_iterations: Option<u32>,
    /// Offset added to the robot's surface [m], default 0
    #[arg(long, allow_hyphen_values = true)]
    padding: Option<f64>,
    /// Sub-points per edge of the cube that a rest point stands for, 1 to 8, default 2; 1 moves
    /// the rest points alone, as the paper does, at an eighth of the cost
    #[arg(long)]
    subdivision: Option<usize>,
    /// Spacing of the distance grids of meshes [m]; chosen for an error of 0.5 mm by default
    #[arg(long, allow_negative_numbers = true)]
    grid_resolution: Option<f64>,
    /// Folder that keeps finished distance grids
    #[arg(long)]
    cache_dir: Option<PathBuf>,
}

/// The estimator, prior and noise.
#[derive(Debug, Clone, Default, Args, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
#[command(next_help_heading = "Estimator")]
pub struct EstimatorSettings {
    /// Which estimator, default replay
    #[arg(long)]
    estimator: Option<EstimatorKind>,
    /// Past observations replayed after every update, default 20; 0 with `diagonal`
    #[arg(long)]
    replay: Option<usize>,
    /// Whether a replay leaves the variances (keep, default) or shrinks them again (shrink)
    #[arg(long, value_parser = ["keep", "shrink"])]
    replay_variance: Option<String>,
    /// Whether each sequence starts with an empty replay buffer, default false
    #[arg(long, num_args = 0..=1, default_missing_value = "true")]
    clear_replay: Option<bool>,
    /// Seed of the replay draws, default 0
    #[arg(long)]
    seed: Option<u64>,
    /// Prior standard deviation of the stiffness [N/m]; chosen from the sequences by default
    #[arg(long, allow_negative_numbers = true)]
    pub prior_sd: Option<f64>,
    /// Standard deviation of every reading [N m or N], model error included; chosen from the
    /// sequences by default
    #[arg(long, allow_negative_numbers = true)]
    pub noise_sd: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum EstimatorKind {
    /// Diagonal Kalman filter with memory replay (Alg. 1)
    Replay,
    /// Diagonal Kalman filter alone
    Diagonal,
    /// Eq. 7 as printed, with memory replay; may diverge beyond the paper's prior
    Printed,
    /// Gain from the variances after the update, with memory replay
    Updated,
    /// The constrained optimum over all samples at once, offline
    Batch,
}

/// A group of parameters that a command takes.
pub trait Group: Args + Serialize + DeserializeOwned {
    /// The values in force: these flags, over the file, over the preset.
    fn resolve(&self, sources: &Sources) -> anyhow::Result<Self> {
        let mut table = sources.preset.map(Preset::table).unwrap_or_default();
        if let Some(path) = &sources.config {
            table.extend(read(path)?);
        }
        table.extend(Table::try_from(self).context("flags")?);
        Self::deserialize(table).context("parameters")
    }
}

impl Group for SceneSettings {}
impl Group for EstimatorSettings {}

/// A configuration file, with all keys and values checked.
fn read(path: &Path) -> anyhow::Result<Table> {
    let place = || format!("cannot read {}", path.display());
    let text = std::fs::read_to_string(path).with_context(place)?;
    let wrong = |e: toml::de::Error| {
        let line = e
            .span()
            .map_or(0, |s| text[..s.start].lines().count().max(1));
        let at = if line > 0 {
            format!(" line {line}")
        } else {
            String::new()
        };
        usage(format!("{}{at}: {}", path.display(), e.message()))
    };
    let table: Table = toml::from_str(&text).map_err(wrong)?;
    let known = EstimatorSettings::augment_args(SceneSettings::augment_args(Command::new("")));
    let known: Vec<&str> = known.get_arguments().filter_map(|a| a.get_long()).collect();
    if let Some(key) = table.keys().find(|k| !known.contains(&k.as_str())) {
        let place = path.display();
        let known = known.join(", ");
        return Err(usage(format!(
            "{place}: unknown key {key:?}; the keys are {known}"
        )));
    }
    toml::from_str::<SceneSettings>(&text).map_err(wrong)?;
    toml::from_str::<EstimatorSettings>(&text).map_err(wrong)?;
    Ok(table)
}

fn numbers<const N: usize>(name: &str, given: &[f64]) -> anyhow::Result<[f64; N]> {
    let count = given.len();
    <[f64; N]>::try_from(given)
        .map_err(|_| usage(format!("--{name} takes {N} numbers, {count} given")))
}

impl SceneSettings {
    /// What goes before `dataset.json`.
    pub fn overrides(&self) -> anyhow::Result<Overrides> {
        let robot = self.robot.as_deref();
        let splits = (self.train.is_some() || self.test.is_some()).then(|| Splits {
            train: self.train.clone().unwrap_or_default(),
            test: self.test.clone().unwrap_or_default(),
        });
        let kind = |t: &String| match t == "prismatic" {
            true => JointType::Prismatic,
            false => JointType::Revolute,
        };
        Ok(Overrides {
            robot: robot
                .map(|r| RobotRef::resolve(r, Path::new(".")))
                .transpose()?,
            torque_kind: match self.torque_kind.as_deref() {
                Some("external") => Some(TorqueKind::External),
                Some("measured") => Some(TorqueKind::Measured),
                Some(other) => {
                    return Err(usage(format!(
                        "torque-kind {other:?}: external or measured"
                    )));
                }
                None => None,
            },
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
            joint_types: match &self.joint_types {
                Some(types) if types.iter().any(|t| t != "prismatic" && t != "revolute") => {
                    return Err(usage("joint-types: revolute or prismatic"));
                }
                types => types.as_ref().map(|t| t.iter().map(kind).collect()),
            },
            ..Overrides::default()
        })
    }

    /// How the scene is put together.
    pub fn options(&self) -> anyhow::Result<SceneOptions> {
        let defaults = ContactConfig::default();
        let mut packages = BTreeMap::new();
        for pair in self.package.iter().flatten() {
            let (name, path) = pair
                .split_once('=')
                .ok_or_else(|| usage(format!("--package {pair:?}: expected NAME=PATH")))?;
            packages.insert(name.to_owned(), PathBuf::from(path));
        }
        Ok(SceneOptions {
            contact: ContactConfig {
                threshold: self.threshold.unwrap_or(defaults.threshold),
                friction: self.friction.unwrap_or(defaults.friction),
                slip_step: self.slip_step.unwrap_or(defaults.slip_step),
                max_slip_iterations: self
                    .max_slip_iterations
                    .unwrap_or(defaults.max_slip_iterations),
                padding: self.padding.unwrap_or(defaults.padding),
                ..defaults
            },
            grid: GridOptions {
                resolution: self.grid_resolution,
                cache_dir: self.cache_dir.clone(),
                ..GridOptions::default()
            },
            links: self.links.clone(),
            packages,
            subdivision: self
                .subdivision
                .unwrap_or(SceneOptions::default().subdivision),
        })
    }
}

fn pose([x, y, z, roll, pitch, yaw]: [f64; 6]) -> anyhow::Result<Isometry3<f64>> {
    if ![x, y, z, roll, pitch, yaw].iter().all(|v| v.is_finite()) {
        return Err(usage("--base-pose: every number must be finite"));
    }
    let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
}

impl EstimatorSettings {
    /// The estimator.
    pub fn spec(&self) -> anyhow::Result<EstimatorSpec> {
        for (flag, value) in [("prior-sd", self.prior_sd), ("noise-sd", self.noise_sd)] {
            if let Some(sd) = value
                && !(1e-100..=1e100).contains(&sd)
            {
                return Err(usage(format!(
                    "--{flag} = {sd} must be positive and at most 1e100"
                )));
            }
        }
        let kind = self.estimator.unwrap_or(EstimatorKind::Replay);
        let alone = matches!(kind, EstimatorKind::Diagonal | EstimatorKind::Batch);
        if alone && self.replay.is_some_and(|r| r > 0) {
            let name = self.name();
            return Err(usage(format!(
                "the estimator `{name}` has no replay; choose `replay`",
            )));
        }
        let defaults = ReplayConfig::default();
        Ok(EstimatorSpec {
            method: match kind {
                EstimatorKind::Batch => Method::Batch,
                _ => Method::Online,
            },
            form: match kind {
                EstimatorKind::Replay | EstimatorKind::Diagonal | EstimatorKind::Batch => {
                    DiagonalForm::Innovation
                }
                EstimatorKind::Printed => DiagonalForm::Printed,
                EstimatorKind::Updated => DiagonalForm::InnovationUpdated,
            },
            replay: ReplayConfig {
                replays: if alone {
                    0
                } else {
                    self.replay.unwrap_or(defaults.replays)
                },
                variance: match self.replay_variance.as_deref() {
                    Some("shrink") => ReplayVariance::Shrink,
                    Some("keep") | None => ReplayVariance::Keep,
                    Some(other) => {
                        return Err(usage(format!("replay-variance {other:?}: keep or shrink")));
                    }
                },
                seed: self.seed.unwrap_or(defaults.seed),
                clear_on_sequence: self.clear_replay.unwrap_or(defaults.clear_on_sequence),
                ..defaults
            },
        })
    }

    /// Name of the estimator, for reports.
    pub fn name(&self) -> String {
        let kind = self.estimator.unwrap_or(EstimatorKind::Replay);
        kind.to_possible_value()
            .map_or_else(String::new, |v| v.get_name().to_owned())
    }
}
