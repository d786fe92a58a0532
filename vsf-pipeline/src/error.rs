use crate::Approach;
use std::path::PathBuf;
use thiserror::Error;
use vsf_contact::ContactError;
use vsf_core::CoreError;
use vsf_data::DataError;
use vsf_robots::RobotError;
use vsf_vision::VisionError;

/// What can go wrong between a recording and its evaluation.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The recording or field cannot be read.
    #[error(transparent)]
    Data(#[from] DataError),
    /// The robot cannot be used.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The robot of a URDF file cannot be used.
    #[error("{}: {source}", path.display())]
    RobotFile {
        /// The URDF.
        path: PathBuf,
        /// What is wrong with it.
        source: RobotError,
    },
    /// The robot's shapes cannot be used.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// A collision shape of a link cannot be used.
    #[error("robot {robot:?}, {shape} of link {link:?}: {source}")]
    LinkShape {
        /// Name of the robot.
        robot: String,
        /// The link.
        link: String,
        /// `a collision shape`, or the mesh with its file.
        shape: String,
        /// What is wrong with it.
        source: ContactError,
    },
    /// Numbers that are invalid.
    #[error(transparent)]
    Core(#[from] CoreError),
    /// The view of a camera cannot be used or does not show what was touched, or a regressor cannot learn
    /// from its samples.
    #[error(transparent)]
    Vision(#[from] VisionError),
    /// A stored field holds numbers that no estimate can have.
    #[error("{name} {problem}")]
    Stored {
        /// The array or feature.
        name: &'static str,
        /// What is wrong with it.
        problem: String,
    },
    /// There is no view of the object.
    #[error("the recording has no camera/ (color.png, depth.png, camera.json) to see points with")]
    NoCamera,
    /// An error in one row of a sequence.
    #[error("sequence {id} row {row}: {source}")]
    Sequence {
        /// The sequence.
        id: String,
        /// The row, from 0.
        row: usize,
        /// What is wrong there.
        source: CoreError,
    },
    /// A recording was combined with the scene of another one.
    #[error(
        "{what} of the recording is another than that of the scene: make the scene of this recording (`Scene::open`, \
         `Scene::with_robot`, `Scene::in_air`)"
    )]
    OtherScene {
        /// The key of `dataset.json` that differs.
        what: &'static str,
    },
    /// Traces in several contact models that do not have the same samples.
    #[error(
        "sequence {id}: its samples in contact model {index} (from 0) are not those in the first: compare traces of the same \
         touches, times and readings"
    )]
    OtherSamples {
        /// The sequence.
        id: String,
        /// The contact model, from 0.
        index: usize,
    },
    /// Touches of a trace that do not cover it in order, without gaps, from its first sample to its last.
    #[error(
        "sequence {id}: touch {index} is samples {start} to {end} (exclusive) of {rows}; touches follow each other from the \
         first sample to the last"
    )]
    Touches {
        /// The sequence.
        id: String,
        /// The touch, from 0.
        index: usize,
        /// Its first sample.
        start: usize,
        /// One past its last sample.
        end: usize,
        /// Number of samples of the trace.
        rows: usize,
    },
    /// The velocities and accelerations of the arm cannot be determined.
    #[error(
        "sequence {id}: velocities and accelerations cannot be estimated ({source}); record velocities \
         (velocities.npy), zeros for poses in which the arm rests"
    )]
    Motion {
        /// The sequence.
        id: String,
        /// What is wrong.
        source: DataError,
    },
    /// A reading beyond any sensor, whose square might overflow.
    #[error(
        "sequence {id} row {row} joint {joint}: a torque of {value:?} {unit}; at most {most:e} is \
         taken, check the file and its units"
    )]
    Torque {
        /// The sequence.
        id: String,
        /// The row, from 0.
        row: usize,
        /// The joint, from 1.
        joint: usize,
        /// Its value.
        value: f64,
        /// `N m`, or `N` for a sliding joint.
        unit: &'static str,
        /// Largest magnitude that is accepted.
        most: f64,
    },
    /// A position or velocity beyond any robot, whose square might overflow.
    #[error(
        "sequence {id} row {row} joint {joint}: {what} of {value:?} {unit}; at most {most:e} is taken, check the file and \
         its units"
    )]
    State {
        /// The sequence.
        id: String,
        /// The row, from 0.
        row: usize,
        /// The joint, from 1.
        joint: usize,
        /// Whether it is a position or a velocity.
        what: &'static str,
        /// Its value.
        value: f64,
        /// `rad` or `m`; for velocities per second.
        unit: &'static str,
        /// Largest magnitude that is accepted.
        most: f64,
    },
    /// There is no estimator with this name.
    #[error("unknown estimator {name:?}: there are {known}")]
    UnknownEstimator {
        /// The name.
        name: String,
        /// The known names.
        known: String,
    },
    /// A robot name that is neither built in nor a file.
    #[error("unknown robot {name:?}: built in are {known}; a URDF is given by its path")]
    UnknownRobot {
        /// The name.
        name: String,
        /// The built-in names.
        known: String,
    },
    /// A robot without movable joints.
    #[error("robot {robot:?} has no moving joints: all of its joints are fixed, or it has none")]
    NoJoints {
        /// Name of the robot.
        robot: String,
    },
    /// The recording has a number of joints other than that of the robot.
    #[error(
        "the recording has {columns} joint columns, robot {robot:?} has {joints} joints ({names}); \
         check `robot` and `joints`"
    )]
    JointCount {
        /// Number of columns of angles and torques.
        columns: usize,
        /// Name of the robot.
        robot: String,
        /// Number of joints of the robot.
        joints: usize,
        /// Their names.
        names: String,
    },
    /// `joints` or `joint_types` of the recording contradict the robot.
    #[error(
        "column {column} of the recording is {recorded} by {key}, the robot's joint there is {robot}; bring the columns \
         into the robot's order, or mend {key}"
    )]
    JointMismatch {
        /// The key of the recording, `joints` or `joint_types`.
        key: &'static str,
        /// Column, from 1.
        column: usize,
        /// What the recording says.
        recorded: String,
        /// What the robot says.
        robot: String,
    },
    /// There are no rest points to estimate stiffness at.
    #[error(
        "the recording has no rest points (points.npy); give some (`vsf points` makes them of a view in camera/), or a field \
         with points: a recording without points is free motion and has no stiffness to estimate"
    )]
    NoPoints,
    /// The robot has no collision shapes, or none on the chosen links.
    #[error("no link of robot {robot:?} can touch anything: {reason}")]
    NoShapes {
        /// Name of the robot.
        robot: String,
        /// Why.
        reason: String,
    },
    /// The number of points of the field is not that of the recording.
    #[error("the field has {field} points, the recording {recording}; they must be the same")]
    FieldSize {
        /// Number of points of the field.
        field: usize,
        /// Number of rest points of the recording.
        recording: usize,
    },
    /// There is no sequence to work on.
    #[error("no {what} sequence: {hint}")]
    NoSequences {
        /// `train`, `test` or the like.
        what: &'static str,
        /// What to do.
        hint: &'static str,
    },
    /// The robot never touched the points.
    #[error(
        "the robot touches none of the {points} rest points in the {what} sequences{}; check \
         base_pose, units and the robot",
        nearest.as_ref().map_or_else(String::new, |nearest| format!(": {nearest}"))
    )]
    NoContact {
        /// `train` or the like.
        what: &'static str,
        /// Number of rest points.
        points: usize,
        /// Where it comes nearest, if that was looked at.
        nearest: Option<Approach>,
    },
    /// The robot touched points, but no contact causes a torque at any joint.
    #[error(
        "the robot touches {touched} of the rest points in the {what} sequences, but springs there give no torque \
         at any joint: they push along the joints' axes or through them; check base_pose and the joints, or \
         touch elsewhere"
    )]
    NoTorque {
        /// `train` or the like.
        what: &'static str,
        /// Number of touched points.
        touched: usize,
    },
}
