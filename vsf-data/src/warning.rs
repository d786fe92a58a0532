use crate::{listed, sequence};
use std::path::PathBuf;
use thiserror::Error;

/// Something in a recording that does not prevent reading it, but that one should know about.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DataWarning {
    /// `dataset.json` or `camera.json` has keys that this version does not know. They have no effect, but are kept and
    /// written back.
    #[error("{}: unknown keys have no effect: {}", path.display(), keys.join(", "))]
    UnknownKeys {
        /// The file.
        path: PathBuf,
        /// The keys.
        keys: Vec<String>,
    },
    /// `dataset.json` describes a clamped specimen, which also pulls. The keys are kept, but no model in this workspace
    /// uses them.
    #[error(
        "{}: a clamped specimen is taken as one that is pushed; these keys have no effect: {}",
        path.display(), keys.join(", ")
    )]
    ClampedSpecimen {
        /// The file.
        path: PathBuf,
        /// The keys, `attachment` or `gauge_length`.
        keys: Vec<&'static str>,
    },
    /// The folders of sequences have arrays that the format does not know. They are not read.
    #[error(
        "{}: not read; the arrays of a sequence are {}{}", path.display(), sequence::ARRAYS.join(", "),
        more_of_kind(*others)
    )]
    OtherArrays {
        /// The first of them.
        path: PathBuf,
        /// Number of further ones.
        others: usize,
    },
    /// Rest points lie outside the object's bounding box, by more than a micrometer.
    #[error("{}: {count} of {total} points lie outside object_bbox", path.display())]
    PointsOutsideBox {
        /// The file of the points.
        path: PathBuf,
        /// Number of such points.
        count: usize,
        /// Number of all points.
        total: usize,
    },
    /// Points have no coordinates, as written for pixels without a return. They are left out.
    #[error("{}: {count} of {total} points have no coordinates (NaN), left out", path.display())]
    WithoutReturn {
        /// The file of the points.
        path: PathBuf,
        /// Number of such points.
        count: usize,
        /// Number of all points.
        total: usize,
    },
    /// A PCD file states the pose of its sensor. It is not applied: points are taken as they are, in the world frame.
    #[error(
        "{}: VIEWPOINT {} is not applied: if the points are in the frame of the sensor, bring them into that of the world first",
        path.display(), pose.map(|v| v.to_string()).join(" ")
    )]
    Viewpoint {
        /// The points.
        path: PathBuf,
        /// Position (m) and unit quaternion (w first).
        pose: [f64; 7],
    },
    /// Rest points repeat others. The springs of such points share what is a single stiffness.
    #[error(
        "{}: {count} of {total} points repeat others, the first in row {row} that of row {of}; their stiffness is \
         shared out between them",
        path.display()
    )]
    RepeatedPoints {
        /// The file of the points.
        path: PathBuf,
        /// Number of points that repeat an earlier one.
        count: usize,
        /// Number of all points.
        total: usize,
        /// Row of the first of them, from 0.
        row: usize,
        /// The row that it repeats.
        of: usize,
    },
    /// Sequences that neither split lists: neither training nor test uses them.
    #[error("{}: in neither split, used only where they are named: {}", path.display(), listed(ids))]
    UnassignedSequences {
        /// The data set.
        path: PathBuf,
        /// Their IDs.
        ids: Vec<String>,
    },
    /// All torques of some sequences are zero: a sensor that was not recorded, or a planned motion.
    #[error(
        "{}: torques are all zero, as if nothing was measured, in sequence {}; right for motions that are planned and not made",
        path.display(),
        listed(ids)
    )]
    ZeroTorques {
        /// The data set.
        path: PathBuf,
        /// Their IDs.
        ids: Vec<String>,
    },
    /// Test sequences have exactly the angles of train sequences, but other torques. No measured touch repeats another to
    /// the last digit, and one that is simulated again tests no new place.
    #[error(
        "{}: test sequence {first} has the very angles of train sequence {of}: errors on it are those of a touch that \
         was trained on{}",
        path.display(),
        more_of_kind(*others)
    )]
    RetracedSequences {
        /// The data set.
        path: PathBuf,
        /// ID of the first such test sequence.
        first: String,
        /// ID of the train sequence with the same angles.
        of: String,
        /// Number of further ones.
        others: usize,
    },
    /// Sequences are copies of others, angles and torques alike. They count twice, and test nothing if the other is a train
    /// sequence.
    #[error(
        "{}: sequence {first} is a copy of {of}, angles and torques alike: it counts twice, and errors on the one are not \
         those of touches unseen if the other trains{}",
        path.display(),
        match others { 0 => String::new(), n => format!("; there are {n} more copies") }
    )]
    CopiedSequences {
        /// The data set.
        path: PathBuf,
        /// ID of the first copy.
        first: String,
        /// ID of the sequence that it is a copy of.
        of: String,
        /// Number of further copies.
        others: usize,
    },
    /// At least half of the rows of a test sequence are rows of a train sequence.
    #[error(
        "{}: {rows} rows of the test sequence {first} are rows of the train sequence {of}, angles and torques alike, as if the one \
         were cut out of the other: errors there are those of a fit{}",
        path.display(),
        match others { 0 => String::new(), n => format!("; so it is in {n} more") }
    )]
    OverlappingSequences {
        /// The data set.
        path: PathBuf,
        /// ID of the first such test sequence.
        first: String,
        /// ID of the train sequence.
        of: String,
        /// Number of common rows.
        rows: usize,
        /// Number of further test sequences of that kind.
        others: usize,
    },
    /// Sequences have exactly the torques of others, but other angles. No sensor reads the same twice.
    #[error(
        "{}: sequence {first} has the very torques of {of}, with other angles: one of the two has the other's file{}",
        path.display(),
        more_of_kind(*others)
    )]
    CopiedTorques {
        /// The data set.
        path: PathBuf,
        /// ID of the first of them.
        first: String,
        /// ID of the sequence with the same torques.
        of: String,
        /// Number of further ones.
        others: usize,
    },
    /// Time stamps disagree with the sample rate in the metadata, by more than a factor of 2, or of 1.2 if no sequence is
    /// any closer. The time stamps are used.
    #[error(
        "{}: rate_hz = {rate_hz:?}, but most samples of sequence {} are {step:.3e} s apart; the time stamps count{}",
        path.display(), listed(ids),
        if (0.1..10.0).contains(&(step * rate_hz)) { "" } else { ", which must be in seconds" }
    )]
    OtherRate {
        /// The metadata file.
        path: PathBuf,
        /// The rate in the metadata (Hz).
        rate_hz: f64,
        /// Median time between samples (s) of the first of the sequences.
        step: f64,
        /// IDs of the sequences.
        ids: Vec<String>,
    },
    /// Sequences were over before a sequence began whose name comes earlier. Sessions are ordered by name.
    #[error(
        "{}: sequence {first} was over before {of} began, but is taken to follow it: sessions go by the order of names, and \
         what drifts, wears or softens comes out wrong; name sequences in the order of recording{}",
        path.display(),
        more_of_kind(*others)
    )]
    EarlierSequences {
        /// The data set.
        path: PathBuf,
        /// ID of the first of them.
        first: String,
        /// ID of the sequence with the earlier name.
        of: String,
        /// Number of further ones.
        others: usize,
    },
    /// Most samples are further apart than the pause that ends a sequence, as if times were not in seconds.
    #[error(
        "{}: the {count} samples fall into {sequences} sequences, at pauses of more than {gap:?} s: times must be in \
         seconds, and poses in which the robot only rests take a longer gap", path.display()
    )]
    SingleSamples {
        /// The first such file.
        path: PathBuf,
        /// Number of samples.
        count: usize,
        /// Number of sequences.
        sequences: usize,
        /// The pause (s).
        gap: f64,
    },
    /// The last line of text files is not terminated, as if the writer was interrupted.
    #[error(
        "{}: its last line has no end; if the file was cut off there, the last number is not all that was written{}",
        path.display(),
        more_of_kind(*others)
    )]
    NoLineEnd {
        /// The first of them.
        path: PathBuf,
        /// Number of further ones.
        others: usize,
    },
    /// Joint states have none of the robot's joints, for example those of a gripper on the same topic. They are left out.
    #[error("{} {topic}: {count} messages have none of the robot's joints, left out", path.display())]
    OtherJoints {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Number of such joint states.
        count: usize,
    },
    /// The number of contact-free samples in the file is not used: it applies to the sequences named there, not to those
    /// split by a gap.
    #[error(
        "{}: tare_samples = {tare_samples} is of the sequences attached to the file, left out", path.display()
    )]
    TareSamplesLeftOut {
        /// The file.
        path: PathBuf,
        /// The number in the file.
        tare_samples: usize,
    },
    /// A field has `K_std` without the mark that says what it is. It is not used, since OpenVSF writes the variance under
    /// this name.
    #[error("{}: K_std does not say whether it is a variance or a standard deviation; not used", path.display())]
    UnmarkedDeviation {
        /// The field.
        path: PathBuf,
    },
    /// A folder or archive of a field has something that is not an array of this format.
    #[error("{}: ignored, {why}", path.display())]
    Ignored {
        /// The file or entry.
        path: PathBuf,
        /// The reason.
        why: &'static str,
    },
}

fn more_of_kind(others: usize) -> String {
    match others {
        0 => String::new(),
        n => format!("; {n} more of that kind"),
    }
}
