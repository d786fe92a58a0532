use super::container::{Output, wrong};
use super::messages::{
    JOINT_STATE, LAST, POINT_CLOUD, SECOND, TRANSFORMS, joint_state, point_cloud, transform,
};
use super::{RECORDED, times_path};
use crate::colormap::Scale;
use crate::dataset::POINTS;
use crate::{DataError, Dataset, Sequence, StiffnessField, Table};
use crate::{files, metadata, npy, write_file};
use std::path::Path;

/// Stamp of the first message: 0 means "not set" to ROS.
const START: i64 = SECOND;

/// Pause from the end of a sequence to the start of the next one: longer than the gap at which an import splits, in case
/// the file loses its attachments.
const PAUSE: i64 = 2 * SECOND;

/// The frame of positions: the world frame of the recording.
const FRAME: &str = "world";

/// Predicted readings of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct EffortPrediction {
    /// The predicted torques \[N m\] (prismatic: forces \[N\]), `T` x `d`, for comparison with those of the recording.
    pub mean: Table,
    /// Their standard deviations, `T` x `d`, if the predictor gives them.
    pub sd: Option<Table>,
}

/// Writes an MCAP file of ROS 2 messages (CDR): a recording, what a field predicts for it, and the field.
///
/// Foxglove Studio, PlotJuggler and `ros2 bag play` (for rviz) read it as it is.
///
/// | topic | type | what |
/// | --- | --- | --- |
/// | `/joint_states` | `sensor_msgs/msg/JointState` | angles \[rad\], velocities if recorded, and as effort the torques of the recording \[N m\] (prismatic: m, N) |
/// | `/tf` | `tf2_msgs/msg/TFMessage` | with every joint state the pose of the [base](Self::base) in the frame `world` |
/// | `/predicted/joint_states` | the same | as effort the predicted torques; nothing else |
/// | `/predicted/joint_states_sd` | the same | as effort their standard deviations; nothing else |
/// | `/stiffness_field` | `sensor_msgs/msg/PointCloud2` | the same cloud at the start of every sequence: `x y z` \[m\] in the frame `world`, `stiffness` and, if known, `sd` [N/m], `rgb`; `float32` |
///
/// One clock runs over all sequences. It starts at 1 s, and each sequence begins 2 s after the end of the previous one.
/// Stamps are whole nanoseconds.
///
/// So that [`JointLog`](crate::JointLog) can read the recording back without loss, the file also holds, as attachments,
/// `dataset.json`, `points.npy` and `seq_<ID>/time.npy` of the recording. Of a robot given as a URDF, it has only the
/// file's name. Camera and stored field of the recording are not included.
///
/// ```
/// # use vsf_data::{McapExport, StiffnessField};
/// # use nalgebra::Point3;
/// # let field = StiffnessField { points: vec![Point3::origin()], stiffness: vec![9.0],
/// #     ..StiffnessField::default() };
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("field.mcap");
/// let export = McapExport { field: Some(&field), ..McapExport::default() };
/// export.save(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct McapExport<'a> {
    /// The recording.
    pub recording: Option<&'a Dataset>,
    /// Names of the recording's joints, one per column.
    pub joints: &'a [String],
    /// Name of the robot's root link. With it and the robot's URDF, viewers show the arm at the cloud. `None` leaves its
    /// pose out.
    pub base: Option<&'a str>,
    /// Predictions for the sequences, one each in their order, or none at all.
    pub predictions: &'a [EffortPrediction],
    /// The field.
    pub field: Option<&'a StiffnessField>,
    /// Color the field by its standard deviation in place of its stiffness.
    pub deviation: bool,
    /// Stiffness, or deviation, of the brightest color [N/m], positive; the default is the largest one.
    pub full_scale: Option<f64>,
}

impl McapExport<'_> {
    /// Writes the file, completely or not at all.
    ///
    /// # Errors
    /// - A recording or field that its own `save` would refuse.
    /// - [`DataError::Argument`] for joints or predictions that do not fit the recording, for a full scale that is not
    ///   positive and finite, and for the deviation of a field without one.
    /// - [`DataError::Mcap`] for more than 68 years or 4 GiB of points.
    /// - [`DataError::Io`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), DataError> {
        let path = path.as_ref();
        let mut out = Output::new(path)?;
        if let Some(recording) = self.recording {
            recording.check_in(path)?;
            self.check_rows(recording)?;
            for (name, bytes) in parts(path, recording)? {
                out.attach(name, START, bytes)?;
            }
        }
        if let Some(field) = self.field {
            field.check(path)?;
        }
        let clouds = match self.field {
            Some(_) => Some(out.topic("/stiffness_field", &POINT_CLOUD)?),
            None => None,
        };
        // A viewer that listens late, as rviz does to `ros2 bag play`, has the next one.
        let cloud = |out: &mut Output, number, stamp| match (self.field, clouds) {
            (Some(field), Some(topic)) => {
                out.message(topic, number, stamp, &self.cloud(path, stamp, field)?)
            }
            _ => Ok(()),
        };
        match self.recording {
            Some(recording) => {
                let stamps = stamps(&recording.sequences)
                    .ok_or_else(|| wrong(path, "the recording is longer than 68 years"))?;
                self.joint_states(&mut out, recording, &stamps, cloud)?;
            }
            None => cloud(&mut out, 0, START)?,
        }
        write_file(path, &out.finish()?)
    }

    /// The message of a field.
    fn cloud(&self, path: &Path, stamp: i64, field: &StiffnessField) -> Result<Vec<u8>, DataError> {
        let values = match (self.deviation, &field.sd) {
            (false, _) => &field.stiffness,
            (true, Some(sd)) => sd,
            (true, None) => {
                return Err(DataError::Argument {
                    what: "deviation",
                    problem: "the field has no standard deviation (K_std)".to_owned(),
                });
            }
        };
        let scale = Scale::new(values, self.full_scale)?;
        let sd = field.sd.as_deref().unwrap_or_default();
        for (i, p) in field.points.iter().enumerate() {
            let arrays = [
                (crate::field::POINTS, p.coords.as_slice()),
                (crate::field::STIFFNESS, &field.stiffness[i..=i]),
            ];
            let deviation = sd
                .get(i)
                .map(|sd| (crate::field::SD, std::slice::from_ref(sd)));
            for (array, row) in arrays.into_iter().chain(deviation) {
                if let Some(large) = row.iter().find(|v| !(**v as f32).is_finite()) {
                    let problem = format!(
                        "row {i} of {array} of the field holds {large:e}: too large for float32"
                    );
                    return Err(wrong(path, problem));
                }
            }
        }
        let cloud = point_cloud(stamp, FRAME, field, values, scale);
        cloud.ok_or_else(|| wrong(path, "too many points for one message"))
    }

    /// Writes the joint states, measured and predicted, of all samples at their stamps, and the `cloud` for an index and a
    /// stamp at the start of each sequence.
    fn joint_states(
        &self,
        out: &mut Output,
        recording: &Dataset,
        stamps: &[i64],
        cloud: impl Fn(&mut Output, u32, i64) -> Result<(), DataError>,
    ) -> Result<(), DataError> {
        let joints = out.topic(RECORDED, &JOINT_STATE)?;
        let mut topic_of = |name, is_told: bool| -> Result<_, DataError> {
            is_told.then(|| out.topic(name, &JOINT_STATE)).transpose()
        };
        let predictions = self.predictions;
        let mean = topic_of("/predicted/joint_states", !predictions.is_empty())?;
        let has_sd = predictions.iter().any(|p| p.sd.is_some());
        let sd = topic_of("/predicted/joint_states_sd", has_sd)?;
        let poses = (self.base)
            .map(|base| Ok((base, out.topic("/tf", &TRANSFORMS)?)))
            .transpose()?;
        let state = |stamp, position: &[f64], velocity: &[f64], effort: &[f64]| {
            joint_state(stamp, self.joints, position, velocity, effort)
        };
        let rows = |(i, s): (usize, &'_ Sequence)| (0..s.len()).map(move |row| (i, row));
        let rows = recording.sequences.iter().enumerate().flat_map(rows);
        for ((number, (i, row)), &stamp) in (0..).zip(rows).zip(stamps) {
            if row == 0 {
                cloud(out, i as u32, stamp)?;
            }
            let s = &recording.sequences[i];
            let velocity = s.velocities.as_ref().map_or(&[][..], |v| &v[row]);
            let measured = state(stamp, &s.angles[row], velocity, &s.torques[row]);
            out.message(joints, number, stamp, &measured)?;
            if let Some((base, topic)) = poses {
                let pose = transform(stamp, FRAME, base, &recording.base_pose);
                out.message(topic, number, stamp, &pose)?;
            }
            let of = predictions.get(i);
            let tables = [
                (mean, of.map(|p| &p.mean)),
                (sd, of.and_then(|p| p.sd.as_ref())),
            ];
            for (topic, table) in tables {
                if let (Some(topic), Some(table)) = (topic, table) {
                    let effort = state(stamp, &[], &[], &table[row]);
                    out.message(topic, number, stamp, &effort)?;
                }
            }
        }
        Ok(())
    }

    fn check_rows(&self, recording: &Dataset) -> Result<(), DataError> {
        let (names, width) = (self.joints.len(), recording.width());
        if names != width {
            return Err(DataError::Argument {
                what: "joints",
                problem: format!("{names} names of {width} joints"),
            });
        }
        let sizes = |table: &Table| (table.rows(), table.cols());
        let expected = recording.sequences.iter().map(|s| sizes(&s.angles));
        let fits = |p: &EffortPrediction, expected: (usize, usize)| {
            sizes(&p.mean) == expected && p.sd.as_ref().is_none_or(|sd| sizes(sd) == expected)
        };
        let fit = self.predictions.len() == recording.sequences.len()
            && self
                .predictions
                .iter()
                .zip(expected)
                .all(|(p, e)| fits(p, e));
        if self.predictions.is_empty() || fit {
            Ok(())
        } else {
            Err(DataError::Argument {
                what: "predictions",
                problem: "not those of the recording's sequences".to_owned(),
            })
        }
    }
}

/// The parts of a recording that the messages do not hold.
fn parts(path: &Path, recording: &Dataset) -> Result<Vec<(String, Vec<u8>)>, DataError> {
    let robot = match &recording.robot.path {
        // Where the file lies on this machine says nothing on another one; that it is one is told by
        // the slash.
        Some(urdf) => {
            let name = urdf.file_name().unwrap_or_default();
            format!("./{}", name.to_string_lossy())
        }
        None => recording.robot.given.clone(),
    };
    let json = metadata::encode(path, recording.metadata(), &recording.extra, &robot)?;
    let mut parts = vec![(metadata::FILE.to_owned(), json)];
    if let Some(points) = &recording.rest_points {
        let bytes = npy::encode(&[points.len(), 3], &files::coordinates(points));
        parts.push((POINTS.to_owned(), bytes));
    }
    for sequence in &recording.sequences {
        let bytes = npy::encode(&[sequence.len()], &sequence.time);
        parts.push((times_path(&sequence.id), bytes));
    }
    Ok(parts)
}

/// Stamps \[ns\] of all samples on one clock; `None` beyond the end of the clock.
fn stamps(sequences: &[Sequence]) -> Option<Vec<i64>> {
    let mut stamps = Vec::new();
    let mut start = START;
    for sequence in sequences {
        for time in &sequence.time {
            let after = ((time - sequence.time[0]) * SECOND as f64).round();
            // Beyond 2^63 the cast saturates.
            let stamp = start.checked_add(after as i64).filter(|s| *s <= LAST)?;
            stamps.push(stamp);
        }
        start = stamps.last().map_or(START, |last| last + PAUSE);
    }
    Some(stamps)
}
