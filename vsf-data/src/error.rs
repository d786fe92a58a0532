use crate::npy::NpyError;
use std::path::PathBuf;
use std::{fmt, io};
use thiserror::Error;

/// Error of a recording or a field on disk, or of data to be written.
///
/// Every message names the file. Rows count from 0, as in NumPy. Joints (columns of `angles`, `velocities` and `torques`)
/// count from 1, as robots number them.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DataError {
    /// A required file or folder does not exist.
    #[error("{}: no such {what}", path.display())]
    Missing {
        /// The path that was looked for.
        path: PathBuf,
        /// What it should have been, for example `file` or `data set folder`.
        what: &'static str,
    },
    /// The operating system refused to read or write.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// `read`, `write`, `create` or `list`.
        action: &'static str,
        /// The path.
        path: PathBuf,
        /// The reason, from the operating system.
        source: io::Error,
    },
    /// A `.npy` file, or one inside a `.npz` archive, cannot be read.
    #[error("{}: {source}", path.display())]
    Npy {
        /// The file; inside an archive `<archive>/<entry>`.
        path: PathBuf,
        /// What is wrong with the bytes.
        source: NpyError,
    },
    /// A `.npz` archive is not a readable zip file.
    #[error("{}: not a readable .npz (zip) archive: {problem}", path.display())]
    Npz {
        /// The archive, or `<archive>/<entry>`.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A PNG image is damaged, or not of the kind that the format requires.
    #[error("{}: {problem}", path.display())]
    Png {
        /// The image.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A PLY file is damaged or has no points.
    #[error("{}: {problem}", path.display())]
    Ply {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A PCD file is damaged or has no points.
    #[error("{}: {problem}", path.display())]
    Pcd {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// An MCAP file is damaged, lacks what was asked for, or cannot hold what is to be written.
    #[error("{}: {problem}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A message of an MCAP file that is no valid sample.
    #[error("{} {topic} message {message}: {problem}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Index of the message in its topic in this file, from 0.
        message: u64,
        /// What is wrong.
        problem: String,
    },
    /// A CSV file lacks what was asked for.
    #[error("{}: {problem}", path.display())]
    Csv {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A line of a CSV file that is no valid sample.
    #[error("{} line {line}: {problem}", path.display())]
    CsvLine {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// What is wrong.
        problem: String,
    },
    /// A cell of a CSV file that is not a valid number.
    #[error("{} line {line} column {column:?}: {problem}", path.display())]
    CsvCell {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Title of the column.
        column: String,
        /// What is wrong.
        problem: String,
    },
    /// Joint states that could be read with other arguments.
    #[error("{error}; {advice}")]
    Advised {
        /// The problem with the MCAP or CSV file.
        error: Box<DataError>,
        /// What may help.
        advice: Advice,
    },
    /// A file is not valid JSON.
    #[error("{} line {line} column {column}: invalid JSON: {problem}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What the parser found.
        problem: String,
    },
    /// A value in a JSON file has the wrong type, or a key occurs twice.
    #[error("{} line {line} column {column}: {problem}", path.display())]
    JsonType {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column, from 1, just after the value.
        column: usize,
        /// Found and expected type.
        problem: String,
    },
    /// A metadata value has the right type but no meaning.
    #[error("{}: {key}: {problem}", path.display())]
    Metadata {
        /// The metadata file, even if the value came from an override.
        path: PathBuf,
        /// The key of `dataset.json` or `camera.json`.
        key: &'static str,
        /// What is wrong, and what is allowed.
        problem: String,
    },
    /// Required metadata is neither in `dataset.json` nor given in another way.
    #[error("{}: {key} is required: {hint}", path.display())]
    MissingKey {
        /// The metadata file, or the sequence folder that needs it.
        path: PathBuf,
        /// The key of `dataset.json`.
        key: &'static str,
        /// How to provide it.
        hint: &'static str,
    },
    /// The robot is given as a path at which there is no file.
    #[error("robot {given:?}: no file {}", path.display())]
    RobotNotFound {
        /// The text in the metadata.
        given: String,
        /// The path that it resolves to.
        path: PathBuf,
    },
    /// An array has the wrong rank or width.
    #[error("{}: shape {got:?}, expected {expected}", path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// Its shape.
        got: Vec<usize>,
        /// The required shape, and the reason.
        expected: String,
    },
    /// Two arrays that belong together have different numbers of rows.
    #[error("{}: {got} rows, but {reference} has {expected}", path.display())]
    Rows {
        /// The file.
        path: PathBuf,
        /// Its rows.
        got: usize,
        /// The array it must match.
        reference: String,
        /// Rows of that array.
        expected: usize,
    },
    /// A number is NaN or infinite.
    #[error("{} row {row}{}{column}: {value}", path.display(), if column.is_empty() { "" } else { " " })]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Row, from 0.
        row: usize,
        /// Column: `joint 5` (from 1), `x`, or `column 2` (from 1); empty for a file with one column.
        column: String,
        /// The offending value.
        value: f64,
    },
    /// A coordinate of a point is beyond 1e6 m.
    #[error("{} row {row} {axis}: {value:e} m is beyond 1e6 m; check units", path.display())]
    FarPoint {
        /// The file.
        path: PathBuf,
        /// Row, from 0.
        row: usize,
        /// `x`, `y` or `z`.
        axis: &'static str,
        /// The coordinate (m).
        value: f64,
    },
    /// A time stamp is out of range.
    #[error("{} row {row}: time {value:e} s is beyond 1e12 s (30,000 years); stamps are seconds", path.display())]
    FarTime {
        /// The file.
        path: PathBuf,
        /// Row, from 0.
        row: usize,
        /// The offending value \[s\].
        value: f64,
    },
    /// Time stamps do not increase by at least half a nanosecond.
    #[error(
        "{} row {row}: time {value:?} s is not after {previous:?} s of the row before{}",
        path.display(),
        if value > previous { " by a nanosecond" } else { "" }
    )]
    TimeOrder {
        /// The file.
        path: PathBuf,
        /// Row, from 0.
        row: usize,
        /// Time of the row before \[s\].
        previous: f64,
        /// Time of this row \[s\].
        value: f64,
    },
    /// A standard deviation is negative.
    #[error("{} row {row}: standard deviation {value:?} is negative", path.display())]
    NegativeDeviation {
        /// The file.
        path: PathBuf,
        /// Row, from 0.
        row: usize,
        /// The offending value.
        value: f64,
    },
    /// An array has no rows or no columns.
    #[error("{}: {what} is empty", path.display())]
    Empty {
        /// The file or folder.
        path: PathBuf,
        /// What is empty.
        what: &'static str,
    },
    /// A folder holds no `seq_<ID>` folder.
    #[error("{}: no touch sequences (folders named seq_<ID>)", path.display())]
    NoSequences {
        /// The data set.
        path: PathBuf,
    },
    /// A name in the folder is not UTF-8, or an ID cannot be the name of a folder.
    #[error("{}: {id:?} cannot be a sequence ID: it must be UTF-8 without / and \\", path.display())]
    SequenceId {
        /// The data set.
        path: PathBuf,
        /// The ID, with replacement characters where it is not UTF-8.
        id: String,
    },
    /// A split lists no sequence.
    #[error("{}: splits: {split} is empty; leave the key out, or list sequence IDs", path.display())]
    EmptySplit {
        /// The metadata file.
        path: PathBuf,
        /// `train` or `test`.
        split: &'static str,
    },
    /// The metadata contain the ID of a sequence that does not exist.
    #[error("{}: {key} names sequence {id:?}, but there is no folder seq_{id}", path.display())]
    UnknownSequence {
        /// The metadata file.
        path: PathBuf,
        /// The key of `dataset.json`.
        key: &'static str,
        /// The ID.
        id: String,
    },
    /// A sequence occurs twice: in one split, in both, or in the list of sequences.
    #[error("{}: sequence {id:?} is listed twice in {place}", path.display())]
    DuplicateSequence {
        /// The metadata file.
        path: PathBuf,
        /// The ID.
        id: String,
        /// Where it occurs twice, for example `splits train and test`.
        place: &'static str,
    },
    /// Rows at which touches begin are out of range or do not increase.
    #[error("{}: touch_starts of sequence {id:?}: entry {index} is row {row}: {problem}", path.display())]
    TouchStarts {
        /// The metadata file.
        path: PathBuf,
        /// The sequence.
        id: String,
        /// Index in its list, from 0.
        index: usize,
        /// The row given there.
        row: usize,
        /// What is wrong.
        problem: String,
    },
    /// The tare samples, which are the contact-free start of a sequence, are all of it.
    #[error(
        "{}: tare_samples = {tare_samples}, but sequence {id:?} has {rows} samples; \
         there must be samples after those that tare",
        path.display()
    )]
    TareSamples {
        /// The metadata file.
        path: PathBuf,
        /// The sequence.
        id: String,
        /// Number of tare samples.
        tare_samples: usize,
        /// Number of samples in the sequence.
        rows: usize,
    },
    /// A data set has several stored fields.
    #[error("{} and {}: two stored fields in one data set; keep one", first.display(), second.display())]
    AmbiguousField {
        /// The first of them.
        first: PathBuf,
        /// Another one.
        second: PathBuf,
    },
    /// Something in the folder that would be mixed up with what is saved there.
    #[error("{}: is in the way: it would be mixed with what is written; remove it or write to another folder", path.display())]
    Leftover {
        /// The file or folder in the way.
        path: PathBuf,
    },
    /// A link in the place of a file that is to be written.
    #[error("{}: is a link, and what it leads to would be changed; remove it or write to another folder", path.display())]
    Link {
        /// The link.
        path: PathBuf,
    },
    /// A process was killed while it replaced a recording or field. Some files are old, others new.
    #[error("{}: writing to this folder was interrupted, and its files do not belong together; write it again or remove it", path.display())]
    Interrupted {
        /// The folder.
        path: PathBuf,
    },
    /// The stiffness of a field is not one number per point.
    #[error(
        "{}: K has shape {got:?} with axis_mode {axis_mode:?}; only isotropic fields (one stiffness per point, \
         shape [{points}]) are supported",
        path.display()
    )]
    AxisMode {
        /// The field.
        path: PathBuf,
        /// Shape of K.
        got: Vec<usize>,
        /// The mode in the file, or the one that the shape implies.
        axis_mode: String,
        /// Number of points.
        points: usize,
    },
    /// The features of a field are a pickled Python dictionary, which is never executed.
    #[error(
        "{}: `features` is a pickled Python object, which is not read because unpickling runs code. \
         In OpenVSF save the field to a folder (a path that ends in /), or convert once in Python: \
         z = np.load(f, allow_pickle=True); np.savez(g, points=z['points'], K=z['K'], \
         **{{k: v for k, v in z['features'].item().items() if k != 'K_std'}})",
        path.display()
    )]
    PickledFeatures {
        /// The archive.
        path: PathBuf,
    },
    /// A feature has a reserved name, or one that cannot be a file name.
    #[error("{}: {name:?} cannot be the name of a feature", path.display())]
    FeatureName {
        /// The field.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// Arguments of a function of this crate are invalid or do not fit each other.
    #[error("{what}: {problem}")]
    Argument {
        /// The argument.
        what: &'static str,
        /// What is wrong, and what is allowed.
        problem: String,
    },
}

/// What may help against [`DataError::Advised`]: an argument or method of [`JointLog`](crate::JointLog).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Advice {
    /// The `topic` of [`JointLog::open`](crate::JointLog::open).
    Topic,
    /// The `joints` of [`JointLog::recording`](crate::JointLog::recording).
    Names,
    /// The `gap` of [`JointLog::recording`](crate::JointLog::recording).
    Gap,
    /// [`Clock::Log`](crate::Clock::Log).
    LogTime,
    /// [`JointLog::without_velocities`](crate::JointLog::without_velocities).
    NoVelocities,
    /// [`JointLog::planned`](crate::JointLog::planned).
    Planned,
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Topic => "give the topic of one",
            Self::Names => "should these be the same, give their names in the files",
            Self::Gap => "give a gap to split it by its stamps",
            Self::LogTime => "where stamps are of no use, take the times of logging",
            Self::NoVelocities => "the velocities may be left out",
            Self::Planned => "a motion that is planned and not made may go without torques",
        })
    }
}

impl DataError {
    /// Adds advice to the error.
    pub(crate) fn advise(self, advice: Advice) -> Self {
        let error = Box::new(self);
        Self::Advised { error, advice }
    }

    /// Turns an error of the operating system into [`DataError::Missing`] or [`DataError::Io`].
    pub(crate) fn io(action: &'static str, path: impl Into<PathBuf>, source: io::Error) -> Self {
        let path = path.into();
        if action == "read" && source.kind() == io::ErrorKind::NotFound {
            return Self::Missing { path, what: "file" };
        }
        Self::Io {
            action,
            path,
            source,
        }
    }
}
