//! Parameters shared by the commands, as flags over the library's defaults.

use crate::exit::usage;
use crate::range::{
    deviation, finite, length, not_negative, offset, positive, replays, share, spacing,
};
use clap::builder::RangedU64ValueParser;
use clap::{Args, ValueEnum};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vsf::contact::{ContactConfig, GridOptions};
use vsf::core::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use vsf::data::{ContactParameters, JointType, Overrides, RobotRef, Splits, TorqueKind};
use vsf::filter::{DiagonalForm, DualConfig, Projection, ReplayConfig, ReplayVariance, RobustLoss};
use vsf::pipeline::{EstimatorSpec, FilterSpec, HyperMethod, PriorShape, SceneOptions, VisionSpec};
use vsf::vision::{GpConfig, KnnConfig, LearnedPrior, RegressorSpec};

/// The recording.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Recording (instead of dataset.json)")]
pub struct MetadataSettings {
    /// Built-in robot (kinova_gen3, cartesian_stage, planar_arm) or path of a URDF
    #[arg(long)]
    robot: Option<String>,
    /// Pose of the base in the world: x,y,z [m] and roll,pitch,yaw [rad]
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_parser = finite)]
    base_pose: Option<Vec<f64>>,
    /// What the torques mean: external, or measured (actuator side, with gravity)
    #[arg(long, value_parser = ["external", "measured"])]
    torque_kind: Option<String>,
    /// Sample rate of sequences without time.npy [Hz]
    #[arg(long, value_parser = positive)]
    rate_hz: Option<f64>,
    /// Gravity in the world frame, x,y,z [m/s^2]
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_parser = finite)]
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
    /// IDs of the train split; without --test nothing tests
    #[arg(long, value_delimiter = ',')]
    train: Option<Vec<String>>,
    /// IDs of the test split; without --train nothing trains
    #[arg(long, value_delimiter = ',')]
    test: Option<Vec<String>>,
    /// Folder of a package:// name in the URDF; may be repeated
    #[arg(long, value_name = "NAME=PATH", value_parser = package)]
    package: Option<Vec<(String, PathBuf)>>,
}

/// The recording and the contact model. Each part is a group of its own: clap leaves the group of a
/// struct empty that has parts.
#[derive(Debug, Clone, Default, Args)]
pub struct SceneSettings {
    #[command(flatten)]
    pub metadata: MetadataSettings,
    #[command(flatten)]
    contact: ContactSettings,
}

/// The contact model.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Contact (a field that predicts brings its own)")]
pub struct ContactSettings {
    /// Links that may touch; all with collision shapes by default
    #[arg(long, value_delimiter = ',')]
    links: Option<Vec<String>>,
    /// Contact threshold delta [m]: points are touched from so far before the surface on; default 0.8
    /// of the points' spacing where fields are learned or looked at, 0.002 in diagnoses; fields, corrected models and simulated recordings bring theirs
    #[arg(long, value_parser = length)]
    threshold: Option<f64>,
    /// Friction coefficient nu_f, default 0.15
    #[arg(long, value_parser = not_negative)]
    friction: Option<f64>,
    /// Slip step lambda_s [m], default 0.0001. A finer one takes more steps for the same slip: see
    /// --max-slip-iterations
    #[arg(long, value_parser = length)]
    slip_step: Option<f64>,
    /// Most slip steps of one point per sample; by default as many as make 2 cm, 200 of 0.0001
    #[arg(long)]
    max_slip_iterations: Option<u32>,
    /// Offset added to the robot's surface [m], default 0
    #[arg(long, value_parser = offset)]
    padding: Option<f64>,
    /// Sub-points per edge of the cube that a rest point stands for, 1 to 8, default 2; 1 moves
    /// the rest points alone, as the paper does, at an eighth of the cost
    #[arg(long, value_parser = RangedU64ValueParser::<usize>::new().range(1..=8))]
    subdivision: Option<usize>,
    /// Spacing of the distance grids of meshes [m], 1e-6 to 1; chosen for an error of 0.5 mm by default
    #[arg(long, value_parser = spacing)]
    grid_resolution: Option<f64>,
    /// Folder that keeps finished distance grids
    #[arg(long)]
    cache_dir: Option<PathBuf>,
}

/// The estimator, prior and noise.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Estimator")]
pub struct EstimatorSettings {
    /// Which estimator, default batch
    #[arg(long)]
    estimator: Option<EstimatorKind>,
    /// What an exact filter does with means below zero: takes the optimum within K >= 0
    /// (constrained, default of `exact`), shows them as zero (output-only, default of
    /// `information`) or also goes on from zero (fed-back, eq. 5)
    #[arg(long)]
    projection: Option<ProjectionKind>,
    /// How outliers among the readings count, such as spikes or a sensor that sticks: in full (none, default), with a
    /// bounded pull (huber), or the less the farther out (student-t); not with `batch`
    #[arg(long)]
    robust: Option<RobustKind>,
    /// Past observations replayed after every update, default 20; 0 with `diagonal`
    #[arg(long, value_parser = replays)]
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
    /// Prior standard deviation of every point's own stiffness [N/m]; chosen from the sequences by
    /// default. Given alone, the noise keeps its chosen ratio to it
    #[arg(long, value_parser = deviation)]
    pub prior_sd: Option<f64>,
    /// Standard deviation of the readings [N m or N], model error included: one for all channels or
    /// one each; chosen from the sequences by default
    #[arg(long, value_delimiter = ',', value_parser = deviation)]
    pub noise_sd: Option<Vec<f64>>,
    /// Standard deviation of the smooth part of the prior, per that of a point's own part, 0 for independent
    /// points; by default 0.25 or 0, whichever suits better (with more than 1500 touched points 0.25)
    #[arg(long, value_parser = share)]
    smooth_share: Option<f64>,
    /// Length over which the smooth part of the prior stays alike [m], default 0.04
    #[arg(long, value_parser = positive)]
    smooth_length: Option<f64>,
    /// Standard deviation of a level that all points share, per that of a point's own part, default 0
    #[arg(long, value_parser = share)]
    level_share: Option<f64>,
    /// How prior and noise are chosen where they are not given, default held-out
    #[arg(long)]
    hyper: Option<HyperKind>,
    /// What the recording's camera/ says about points, touched or not, as the mean of the prior;
    /// how much of it is chosen on held-out sequences: none (default, touches alone), level (one
    /// stiffness, fading behind the seen surface), knn, ridge or gp (regression of the touched points
    /// on colour and position), or a FILE that `vsf learn` wrote
    #[arg(long, value_name = "METHOD|FILE", value_parser = vision)]
    vision: Option<Vision>,
}

/// A method by name, or what other objects teach.
#[derive(Debug, Clone)]
enum Vision {
    Kind(VisionKind),
    Learned(PathBuf),
}

fn vision(text: &str) -> Result<Vision, String> {
    match VisionKind::from_str(text, false) {
        Ok(kind) => Ok(Vision::Kind(kind)),
        Err(_) if Path::new(text).is_file() => Ok(Vision::Learned(text.into())),
        Err(_) => Err("no such file; methods are none, level, knn, ridge, gp".to_owned()),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum HyperKind {
    /// By the prediction of touches that are held out
    HeldOut,
    /// By the marginal likelihood of the readings, as if their errors were independent
    Likelihood,
}

/// How untouched points are guessed by what the camera sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum VisionKind {
    /// The prior has mean zero
    None,
    /// One stiffness, fading behind the seen surface
    Level,
    /// Regression on the 200 nearest touched points in colour and position
    Knn,
    /// Linear regression on colour and position
    Ridge,
    /// Gaussian process over colour and position
    Gp,
}

impl VisionKind {
    /// The method, if any.
    pub fn spec(self) -> Option<VisionSpec> {
        let regression = match self {
            Self::None => return None,
            Self::Level => return Some(VisionSpec::Level),
            Self::Knn => RegressorSpec::Knn(KnnConfig::default()),
            Self::Ridge => RegressorSpec::Ridge,
            Self::Gp => RegressorSpec::GaussianProcess(GpConfig::default()),
        };
        Some(VisionSpec::Regression(regression))
    }

    /// Name, for reports.
    pub fn name(self) -> String {
        name_of(&self)
    }
}

/// The name of a value on the command line.
pub fn name_of(value: &impl ValueEnum) -> String {
    let value = value.to_possible_value();
    value.map_or_else(String::new, |v| v.get_name().to_owned())
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum EstimatorKind {
    /// The constrained optimum over all samples at once, offline
    Batch,
    /// The exact posterior, sample by sample
    Exact,
    /// The same from the precision matrix (eq. 5), slow
    Information,
    /// Replays that come down to the constrained optimum of independent points, for 1 kHz loops
    Dual,
    /// Diagonal Kalman filter with memory replay (Alg. 1), as in the paper
    Replay,
    /// Diagonal Kalman filter alone
    Diagonal,
    /// Eq. 7 as printed, with memory replay; may diverge beyond the paper's prior
    Printed,
    /// Gain from the variances after the update, with memory replay
    Updated,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum RobustKind {
    None,
    Huber,
    StudentT,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ProjectionKind {
    Constrained,
    OutputOnly,
    FedBack,
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

impl MetadataSettings {
    /// What goes before `dataset.json`.
    pub fn overrides(&self) -> anyhow::Result<Overrides> {
        let robot = self.robot.as_deref();
        let splits = (self.train.is_some() || self.test.is_some()).then(|| Splits {
            train: self.train.clone().unwrap_or_default(),
            test: self.test.clone().unwrap_or_default(),
        });
        let torque_kind = |kind: &str| match kind == "measured" {
            true => TorqueKind::Measured,
            false => TorqueKind::External,
        };
        let joint_type = |kind: &String| match kind == "prismatic" {
            true => JointType::Prismatic,
            false => JointType::Revolute,
        };
        Ok(Overrides {
            robot: robot
                .map(|r| RobotRef::resolve(r, Path::new(".")))
                .transpose()?,
            torque_kind: self.torque_kind.as_deref().map(torque_kind),
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
                .map(|types| types.iter().map(joint_type).collect()),
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

impl SceneSettings {
    /// With a contact threshold (m), if one is given, and defaults for the rest.
    pub fn with_threshold(threshold: Option<f64>) -> Self {
        Self {
            contact: ContactSettings {
                threshold,
                ..ContactSettings::default()
            },
            ..Self::default()
        }
    }

    /// Whether the links that may touch are given.
    pub fn has_links(&self) -> bool {
        self.contact.links.is_some()
    }

    /// Refuses a link that is named twice, which no field could remember.
    pub fn check_links(&self) -> anyhow::Result<()> {
        let links = self.contact.links.as_deref().unwrap_or_default();
        let twice = |(k, link): &(usize, &String)| links[..*k].contains(link);
        match links.iter().enumerate().find(twice) {
            Some((_, link)) => Err(usage(format!("--links names {link:?} twice"))),
            None => Ok(()),
        }
    }

    /// Whether the contact threshold is given.
    pub fn has_threshold(&self) -> bool {
        self.contact.threshold.is_some()
    }

    /// How the scene is put together: the flags, over the contact that a field or a model remembers, over the defaults.
    pub fn options(&self, remembered: Option<&ContactParameters>) -> SceneOptions {
        let given = &self.contact;
        let below = SceneOptions::default();
        let below = match remembered {
            Some(contact) => below.with_contact_of(contact),
            None => below,
        };
        let defaults = match given.slip_step {
            Some(step) => below.contact.with_slip_step(step),
            None => below.contact,
        };
        SceneOptions {
            contact: ContactConfig {
                threshold: given.threshold.unwrap_or(defaults.threshold),
                friction: given.friction.unwrap_or(defaults.friction),
                max_slip_iterations: given
                    .max_slip_iterations
                    .unwrap_or(defaults.max_slip_iterations),
                padding: given.padding.unwrap_or(defaults.padding),
                ..defaults
            },
            grid: GridOptions {
                resolution: given.grid_resolution,
                cache_dir: given.cache_dir.clone(),
                ..GridOptions::default()
            },
            links: given.links.clone().or(below.links),
            packages: self.metadata.packages(),
            subdivision: given.subdivision.unwrap_or(below.subdivision),
        }
    }
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

impl EstimatorSettings {
    /// The estimator.
    pub fn spec(&self) -> anyhow::Result<EstimatorSpec> {
        use EstimatorKind::{Batch, Diagonal, Dual, Exact, Information, Printed, Replay, Updated};
        let kind = self.kind();
        let replays = self.replay.is_some_and(|r| r > 0);
        if replays && !matches!(kind, Dual | Replay | Printed | Updated) {
            return Err(self.without("--replay", "replay", "dual"));
        }
        let replays_variance = matches!(kind, Replay | Printed | Updated);
        if !replays_variance && self.replay_variance.is_some() {
            return Err(self.without("--replay-variance", "replay of variances", "replay"));
        }
        if !replays_variance && self.clear_replay.is_some() {
            let what = "buffer that a sequence empties";
            return Err(self.without("--clear-replay", what, "replay"));
        }
        if !matches!(kind, Exact | Information) && self.projection.is_some() {
            return Err(self.without("--projection", "projection", "exact"));
        }
        let projection = match self.projection {
            Some(ProjectionKind::Constrained) if kind == Information => {
                return Err(self.without("--projection", "constrained projection", "exact"));
            }
            None if kind == Information => Projection::OutputOnly,
            None | Some(ProjectionKind::Constrained) => Projection::Constrained,
            Some(ProjectionKind::OutputOnly) => Projection::OutputOnly,
            Some(ProjectionKind::FedBack) => Projection::FedBack,
        };
        let form = match kind {
            Printed => DiagonalForm::Printed,
            Updated => DiagonalForm::InnovationUpdated,
            _ => DiagonalForm::Innovation,
        };
        let robust = match self.robust {
            None | Some(RobustKind::None) => None,
            Some(_) if kind == Batch => {
                return Err(self.without("--robust", "robust noise", "exact"));
            }
            Some(RobustKind::Huber) => Some(RobustLoss::HUBER),
            Some(RobustKind::StudentT) => Some(RobustLoss::STUDENT_T),
        };
        let filter = match kind {
            Batch => return Ok(EstimatorSpec::Batch),
            Exact => FilterSpec::Exact(projection),
            Information => FilterSpec::Information(projection),
            Dual => FilterSpec::Dual(self.dual_config()),
            Replay | Diagonal | Printed | Updated => FilterSpec::Replay {
                form,
                config: self.replay_config(kind == Diagonal),
            },
        };
        Ok(EstimatorSpec::Online { filter, robust })
    }

    fn without(&self, flag: &str, feature: &str, other: &str) -> anyhow::Error {
        let name = self.name();
        usage(format!(
            "{flag}: the estimator `{name}` has no {feature}; choose `{other}`"
        ))
    }

    fn dual_config(&self) -> DualConfig {
        let defaults = DualConfig::default();
        DualConfig {
            replays: self.replay.unwrap_or(defaults.replays),
            seed: self.seed.unwrap_or(defaults.seed),
            ..defaults
        }
    }

    fn replay_config(&self, none: bool) -> ReplayConfig {
        let defaults = ReplayConfig::default();
        ReplayConfig {
            replays: if none {
                0
            } else {
                self.replay.unwrap_or(defaults.replays)
            },
            variance: match self.replay_variance.as_deref() {
                Some("shrink") => ReplayVariance::Shrink,
                _ => ReplayVariance::Keep,
            },
            seed: self.seed.unwrap_or(defaults.seed),
            clear_on_sequence: self.clear_replay.unwrap_or(defaults.clear_on_sequence),
            ..defaults
        }
    }

    /// The smooth part of the prior.
    pub fn shape(&self) -> PriorShape {
        let defaults = PriorShape::default();
        PriorShape {
            smooth_share: self.smooth_share.unwrap_or(defaults.smooth_share),
            length: self.smooth_length.unwrap_or(defaults.length),
            level_share: self.level_share.unwrap_or(defaults.level_share),
        }
    }

    /// Those to choose from: without the smooth part too, unless its share is given.
    pub fn shapes(&self) -> Vec<PriorShape> {
        match self.smooth_share {
            Some(_) => vec![self.shape()],
            None => self.shape().or_independent(),
        }
    }

    /// How prior and noise are chosen, and its name for reports.
    pub fn method(&self) -> (HyperMethod, &'static str) {
        match self.hyper {
            None | Some(HyperKind::HeldOut) => (HyperMethod::HeldOut, "held-out"),
            Some(HyperKind::Likelihood) => (HyperMethod::Likelihood, "likelihood"),
        }
    }

    /// How untouched points are guessed by what the camera sees, if they are.
    pub fn vision(&self) -> anyhow::Result<Option<VisionSpec>> {
        match &self.vision {
            None => Ok(None),
            Some(Vision::Kind(kind)) => Ok(kind.spec()),
            Some(Vision::Learned(path)) => {
                let learned = LearnedPrior::open(path)?;
                Ok(Some(VisionSpec::Learned(Arc::new(learned))))
            }
        }
    }

    /// The file that says how untouched points are guessed.
    pub fn vision_file(&self) -> Option<&Path> {
        match &self.vision {
            Some(Vision::Learned(path)) => Some(path),
            _ => None,
        }
    }

    /// Name of what guesses untouched points, for reports.
    pub fn vision_name(&self) -> String {
        match &self.vision {
            None => VisionKind::None.name(),
            Some(Vision::Kind(kind)) => kind.name(),
            Some(Vision::Learned(path)) => path.to_string_lossy().into_owned(),
        }
    }

    /// Name of how outliers count, for reports.
    pub fn robust_name(&self) -> String {
        name_of(&self.robust.unwrap_or(RobustKind::None))
    }

    fn kind(&self) -> EstimatorKind {
        self.estimator.unwrap_or(EstimatorKind::Batch)
    }

    /// Name of the estimator, for reports.
    pub fn name(&self) -> String {
        name_of(&self.kind())
    }
}
