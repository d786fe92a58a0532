use crate::{listed, sequence};
use std::path::PathBuf;
use thiserror::Error;

/// Something in a recording that can be read but that a person should know.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DataWarning {
    /// `dataset.json` or `camera.json` has keys this version does not know. They are kept and
    /// written back, and have no effect.
    #[error("{}: unknown keys have no effect: {}", path.display(), keys.join(", "))]
    UnknownKeys {
        /// The file.
        path: PathBuf,
        /// The keys.
        keys: Vec<String>,
    },
    /// `dataset.json` tells of a clamped specimen, which also pulls. The keys are kept; no model in
    /// this workspace follows them.
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
    /// Arrays in the folders of sequences that the format does not know. They are not read.
    #[error(
        "{}: not read; the arrays of a sequence are {}{}", path.display(), sequence::ARRAYS.join(", "),
        more_of_kind(*others)
    )]
    OtherArrays {
        /// The first.
        path: PathBuf,
        /// Further ones.
        others: usize,
    },
    /// Rest points lie outside the box of the object (by more than a micrometer).
    #[error("{}: {count} of {total} points lie outside object_bbox", path.display())]
    PointsOutsideBox {
        /// The points.
        path: PathBuf,
        /// How many.
        count: usize,
        /// Out of how many.
        total: usize,
    },
    /// Points without coordinates, as pixels without a return are written. They are left out.
    #[error("{}: {count} of {total} points have no coordinates (NaN), left out", path.display())]
    WithoutReturn {
        /// The points.
        path: PathBuf,
        /// How many.
        count: usize,
        /// Out of how many.
        total: usize,
    },
    /// A PCD file that says where its sensor was. Points are taken as they are written, in the frame of the world.
    #[error(
        "{}: VIEWPOINT {} is not applied: if the points are in the frame of the sensor, bring them into that of the world first",
        path.display(), pose.map(|v| v.to_string()).join(" ")
    )]
    Viewpoint {
        /// The points.
        path: PathBuf,
        /// Place (m) and unit quaternion (w first).
        pose: [f64; 7],
    },
    /// Rest points in the place of others: springs there share what is one stiffness.
    #[error(
        "{}: {count} of {total} points repeat others, the first in row {row} that of row {of}; their stiffness is \
         shared out between them",
        path.display()
    )]
    RepeatedPoints {
        /// The points.
        path: PathBuf,
        /// How many repeat one before them.
        count: usize,
        /// Out of how many.
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
    /// Sequences whose torques are all zero: a sensor that was not recorded, or a planned motion.
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
    /// Test sequences with the very angles of train sequences, and other torques: no measured touch repeats another to
    /// the last digit, and one that is simulated again tests no place that was not touched.
    #[error(
        "{}: test sequence {first} has the very angles of train sequence {of}: errors on it are those of a touch that \
         was trained on{}",
        path.display(),
        more_of_kind(*others)
    )]
    RetracedSequences {
        /// The data set.
        path: PathBuf,
        /// ID of the first test sequence of that kind.
        first: String,
        /// ID of the train sequence with its angles.
        of: String,
        /// Further ones.
        others: usize,
    },
    /// Sequences with the angles and torques of others: they count twice, and where the other trains they test nothing.
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
        /// Further copies.
        others: usize,
    },
    /// Test sequences half of whose rows, or more, are those of a train sequence.
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
        /// Rows that both have.
        rows: usize,
        /// Further test sequences of that kind.
        others: usize,
    },
    /// Sequences with the torques of others to the last digit, and other angles: no sensor reads the same twice.
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
        /// ID of the sequence whose torques it has.
        of: String,
        /// Further ones.
        others: usize,
    },
    /// Time stamps that go on slower or faster than the metadata say, by more than a factor of 2; or of 1.2, where those of
    /// no sequence are any closer. The stamps count.
    #[error(
        "{}: rate_hz = {rate_hz:?}, but most samples of sequence {} are {step:.3e} s apart; the time stamps count{}",
        path.display(), listed(ids),
        if (0.1..10.0).contains(&(step * rate_hz)) { "" } else { ", which must be in seconds" }
    )]
    OtherRate {
        /// The metadata file.
        path: PathBuf,
        /// What it says (Hz).
        rate_hz: f64,
        /// Median time between samples (s), of the first of the sequences.
        step: f64,
        /// IDs of the sequences.
        ids: Vec<String>,
    },
    /// Sequences that were over before one began that is named before them. A session goes by names.
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
        /// ID of the sequence named before it.
        of: String,
        /// Further ones.
        others: usize,
    },
    /// Samples most of which are further apart than the pause that ends a sequence, as where times are not in seconds.
    #[error(
        "{}: the {count} samples fall into {sequences} sequences, at pauses of more than {gap:?} s: times must be in \
         seconds, and poses in which the robot only rests take a longer gap", path.display()
    )]
    SingleSamples {
        /// The file; the first one that is so.
        path: PathBuf,
        /// How many.
        count: usize,
        /// Of how many sequences.
        sequences: usize,
        /// The pause (s).
        gap: f64,
    },
    /// Text files whose last line has no end, as of writers that were interrupted.
    #[error(
        "{}: its last line has no end; if the file was cut off there, the last number is not all that was written{}",
        path.display(),
        more_of_kind(*others)
    )]
    NoLineEnd {
        /// The first.
        path: PathBuf,
        /// Further ones.
        others: usize,
    },
    /// Joint states without any of the robot's joints, as of a gripper on the same topic. They are
    /// left out.
    #[error("{} {topic}: {count} messages have none of the robot's joints, left out", path.display())]
    OtherJoints {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// How many.
        count: usize,
    },
    /// Contact-free samples at the start of the sequences that a file names say nothing about those
    /// split by a gap.
    #[error(
        "{}: tare_samples = {tare_samples} is of the sequences attached to the file, left out", path.display()
    )]
    TareSamplesLeftOut {
        /// The file.
        path: PathBuf,
        /// What it says.
        tare_samples: usize,
    },
    /// A field has `K_std` without the mark that says what it is. It is not used: OpenVSF
    /// writes the variance under this name.
    #[error("{}: K_std does not say whether it is a variance or a standard deviation; not used", path.display())]
    UnmarkedDeviation {
        /// The field.
        path: PathBuf,
    },
    /// Something in a field's folder or archive that is not an array of this format.
    #[error("{}: ignored, {why}", path.display())]
    Ignored {
        /// The file or entry.
        path: PathBuf,
        /// Why.
        why: &'static str,
    },
}

fn more_of_kind(others: usize) -> String {
    match others {
        0 => String::new(),
        n => format!("; {n} more of that kind"),
    }
}
