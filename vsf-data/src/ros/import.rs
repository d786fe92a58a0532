//! From joint states to a recording.

use super::joint_log::{JointLog, Sample, Source};
use super::messages::SECOND;
use super::{times_of, times_path};
use crate::csv_log::{Quantity, numbered};
use crate::dataset::{POINTS, Parts, check_robot};
use crate::listed;
use crate::{Advice, Clock, DataError, DataWarning, Dataset, Overrides, Sequence, Table};
use crate::{check, files, metadata};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Default of the longest pause within a sequence \[s\].
const GAP: f64 = 1.0;

/// A sample, and the place of each recording column in its arrays.
struct Row<'a> {
    sample: &'a Sample,
    columns: &'a [usize],
}

impl JointLog {
    /// The known metadata of the recording; those in `given` take precedence over those in the file.
    ///
    /// Files that [`McapExport`](crate::McapExport) did not write have none.
    ///
    /// # Errors
    /// Damaged metadata; a robot given as a URDF, which is not in the file, unless `given` sets the robot.
    pub fn metadata(&self, given: &Overrides) -> Result<Overrides, DataError> {
        Ok(self.all_metadata(given)?.0)
    }

    /// Makes a recording with the columns `joints`.
    ///
    /// Joints are given by their names in the files; for those of a robot, see [`names_of`](Self::names_of). The files may
    /// have them in another order, and other joints besides. Messages with none of these joints (for example of a gripper
    /// on the same topic) are left out, with a warning.
    ///
    /// A sequence ends where the next stamp is more than `gap` seconds away (default 1), and at the end of a CSV file. For
    /// a file that [`McapExport`](crate::McapExport) wrote, the sequences are those named in it, unless a `gap` is given;
    /// with a `gap`, what the file says about their splits, touches, tags and contact-free samples is also left out.
    ///
    /// Times count from the first sample of each sequence. Velocities are included for sequences that have them; a sample
    /// that has none, or NaN for every joint, counts as having no velocity. Points are those in the file, if it holds any.
    ///
    /// # Errors
    /// - [`DataError::MissingKey`] without a robot or a kind of torque, neither of which joint states contain, and for a
    ///   robot that is a URDF and not `given`.
    /// - [`DataError::Argument`] for joints that are empty or occur twice, and for a `gap` that leaves most samples alone.
    /// - [`DataError::Message`] for positions or efforts that are missing or not finite.
    /// - [`DataError::Message`] or [`DataError::Advised`] for stamps that do not increase, velocities of which some are
    ///   missing or not finite, joints that no message has, and sequences that were cut.
    /// - [`DataError::Csv`], [`DataError::CsvLine`] and [`DataError::CsvCell`] for the same in a CSV file, each of which
    ///   must have all joints.
    /// - Whatever [`Dataset::open`] would refuse.
    pub fn recording(
        &self,
        given: &Overrides,
        joints: &[String],
        gap: Option<f64>,
    ) -> Result<(Dataset, Vec<DataWarning>), DataError> {
        let path = &self.place();
        let (mut metadata, extra) = self.all_metadata(given)?;
        let mut left_out = None;
        if gap.is_some() {
            // What the file says of its sequences is not of these.
            metadata.splits = given.splits.clone();
            metadata.touch_starts = given.touch_starts.clone();
            metadata.sequence_tags = given.sequence_tags.clone();
            let known = std::mem::replace(&mut metadata.tare_samples, given.tare_samples);
            left_out = known.filter(|&k| k > 0 && given.tare_samples.is_none());
        }
        check_robot(path, &metadata)?;
        if metadata.torque_kind.is_none() {
            return Err(DataError::MissingKey {
                path: path.clone(),
                key: "torque_kind",
                hint: "joint states do not tell whether their efforts are `external` (of the \
                       environment on the robot, gravity removed) or `measured` (at the actuators)",
            });
        }
        if let Some(gap) = gap.filter(|gap| !(gap.is_finite() && *gap > 0.0)) {
            return Err(DataError::Argument {
                what: "gap",
                problem: format!("{gap:?} must be positive and finite"),
            });
        }
        let mut seen = BTreeSet::new();
        if let Some(joint) = (joints.iter()).find(|j| j.is_empty() || !seen.insert(*j)) {
            let problem = if joint.is_empty() {
                "a name is empty".to_owned()
            } else {
                format!("{joint:?} is there twice")
            };
            return Err(DataError::Argument {
                what: "joints",
                problem,
            });
        }
        check::check_metadata(path, &metadata)?;
        let columns = self.columns(joints)?;
        let rows = self.samples.iter().filter_map(|sample| {
            let columns = columns[sample.names].as_deref()?;
            Some(Row { sample, columns })
        });
        let rows: Vec<Row> = rows.collect();
        let named: Vec<_> = self.times().collect();
        let sequences = match gap {
            None if !named.is_empty() => self.named(&named, &rows)?,
            gap => self.split(gap.unwrap_or(GAP), &rows)?,
        };
        let files = self.files.len();
        let alone = sequences.iter().filter(|s| s.len() == 1).count();
        if let Some(gap) = gap.filter(|_| alone > files && 2 * alone > rows.len()) {
            let count = rows.len();
            return Err(DataError::Argument {
                what: "gap",
                problem: format!(
                    "{alone} of {count} samples are more than {gap:?} s from any other and would each be a sequence; give a gap \
                     longer than the time between samples"
                ),
            });
        }
        let single = if named.is_empty() {
            mostly_single(&sequences, &rows)
        } else {
            None
        };
        let attached = || {
            let (path, bytes) = self.part(POINTS)?;
            Some(files::parse_npy(&path, bytes).and_then(|array| files::points(&path, array)))
        };
        let rest_points = match &self.points {
            Some(points) => Some(points.clone()),
            None => attached().transpose()?,
        };
        let parts = Parts {
            sequences,
            rest_points,
            field: None,
            camera: None,
        };
        let (dataset, mut warnings) = Dataset::assemble(path, metadata, extra, parts)?;
        if let Some(tare_samples) = left_out {
            let path = path.clone();
            warnings.push(DataWarning::TareSamplesLeftOut { path, tare_samples });
        }
        if let Some((file, sequences, count)) = single {
            warnings.push(DataWarning::SingleSamples {
                path: self.files[file].clone(),
                count,
                sequences,
                gap: GAP,
            });
        }
        if let Some((&first, others)) = self.open_ended.split_first() {
            warnings.push(DataWarning::NoLineEnd {
                path: self.files[first].clone(),
                others: others.len(),
            });
        }
        let count = self.samples.len() - rows.len();
        if let Some(topic) = self.topic().filter(|_| count > 0) {
            let (path, topic) = (path.clone(), topic.to_owned());
            warnings.push(DataWarning::OtherJoints { path, topic, count });
        }
        Ok((dataset, warnings))
    }

    fn all_metadata(
        &self,
        given: &Overrides,
    ) -> Result<(Overrides, BTreeMap<String, String>), DataError> {
        let file = &self.files[0];
        let folder = file.parent().unwrap_or(Path::new(""));
        let (path, bytes) = self.part(metadata::FILE).unwrap_or((file.clone(), b"{}"));
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let parsed = metadata::parse(&path, bytes, folder, given);
        // A file of that name which happens to lie here may be of any robot.
        let is_urdf = match &parsed {
            Ok((metadata, _)) => metadata.robot.as_ref().is_some_and(|r| r.path.is_some()),
            Err(error) => matches!(error, DataError::RobotNotFound { .. }),
        };
        if is_urdf && given.robot.is_none() {
            return Err(DataError::MissingKey {
                path,
                key: "robot",
                hint: "it is a URDF, which is not in this file: give its path",
            });
        }
        let (mut metadata, extra) = parsed?;
        metadata.name.get_or_insert(stem.into_owned());
        Ok((metadata, extra))
    }

    /// A part of the recording, with its path for messages.
    fn part(&self, name: &str) -> Option<(PathBuf, &[u8])> {
        let (name, bytes) = self.parts.iter().find(|(part, _)| part == name)?;
        Some((self.files[0].join(name), bytes))
    }

    /// IDs of the sequences named in the file, and their times.
    fn times(&self) -> impl Iterator<Item = (&str, &[u8])> {
        (self.parts.iter()).filter_map(|(name, bytes)| Some((times_of(name)?, &bytes[..])))
    }

    fn problem(&self, sample: &Sample, problem: String) -> DataError {
        let path = self.files[sample.file].clone();
        match &self.source {
            Source::Mcap { topic, .. } => DataError::Message {
                path,
                topic: topic.clone(),
                message: sample.place,
                problem,
            },
            Source::Csv(_) => DataError::CsvLine {
                path,
                line: sample.place,
                problem,
            },
        }
    }

    /// The error for a list of names that lacks the joints, with its first sample.
    fn problem_of_list(&self, sample: &Sample, problem: String) -> DataError {
        match &self.source {
            Source::Mcap { .. } => self.problem(sample, problem),
            Source::Csv(_) => {
                let path = self.files[sample.file].clone();
                DataError::Csv { path, problem }.advise(Advice::Names)
            }
        }
    }

    /// Checks that all files number their joints alike, if joints are numbered: as many, and from the same number on.
    fn check_numbers(&self, joints: &[String]) -> Result<(), DataError> {
        let is_own = |names: &Vec<String>| numbered(names, joints.len()).as_deref() == Some(joints);
        if self.topic().is_some() || !self.names.iter().any(is_own) {
            return Ok(());
        }
        match self.samples.iter().find(|s| !is_own(&self.names[s.names])) {
            None => Ok(()),
            Some(sample) => Err(DataError::Csv {
                path: self.files[sample.file].clone(),
                problem: format!(
                    "its joints are {}, and those of other files {}: joints are numbered in the order of the robot, all of them, in \
                     every file",
                    listed(&self.names[sample.names]),
                    listed(joints)
                ),
            }),
        }
    }

    /// For each list of names, the place of every joint; `None` for messages without any of the joints.
    fn columns(&self, joints: &[String]) -> Result<Vec<Option<Vec<usize>>>, DataError> {
        self.check_numbers(joints)?;
        let places = |(k, names): (usize, &Vec<String>)| {
            let (known, missing): (Vec<_>, Vec<_>) = joints.iter().partition(|j| names.contains(j));
            if known.is_empty() && self.topic().is_some() {
                return Ok(None);
            }
            let twice = (known.iter()).find(|j| names.iter().filter(|n| *n == **j).count() > 1);
            let problem = match twice {
                Some(joint) => format!("joint {joint:?} is named twice"),
                None if missing.is_empty() => {
                    let place = |j: &&String| names.iter().position(|n| n == *j);
                    return Ok(Some(known.iter().filter_map(place).collect()));
                }
                None => format!("no joint {}; there are {}", listed(&missing), listed(names)),
            };
            let of_list = self.samples.iter().find(|s| s.names == k);
            Err(of_list.map_or_else(
                || self.wrong(problem.clone()),
                |s| self.problem_of_list(s, problem.clone()),
            ))
        };
        let columns = self.names.iter().enumerate().map(places);
        let columns = columns.collect::<Result<Vec<_>, _>>()?;
        if columns.iter().all(Option::is_none) {
            let there: Vec<&String> = self.names.iter().flatten().collect();
            let error = self.wrong(format!(
                "no message on {} has the robot's joints {}; there are {}",
                self.topic().unwrap_or_default(),
                listed(joints),
                listed(&there)
            ));
            return Err(error.advise(Advice::Names));
        }
        Ok(columns)
    }

    /// The sequences named in the file, one after the other.
    fn named(&self, named: &[(&str, &[u8])], rows: &[Row]) -> Result<Vec<Sequence>, DataError> {
        let mut left = rows;
        let mut sequences = Vec::new();
        for (id, bytes) in named {
            let path = self.files[0].join(times_path(id));
            let time = files::vector(&path, files::parse_npy(&path, bytes)?)?;
            let Some((own, rest)) = left.split_at_checked(time.len()) else {
                return Err(self.other_count(rows.len()));
            };
            sequences.push(self.sequence(id, time, own)?);
            left = rest;
        }
        if left.is_empty() {
            Ok(sequences)
        } else {
            Err(self.other_count(rows.len()))
        }
    }

    fn other_count(&self, found: usize) -> DataError {
        let error = self.wrong(format!(
            "{} has {found} joint states, other than the sequences attached to the file say: it was cut",
            self.topic().unwrap_or_default()
        ));
        error.advise(Advice::Gap)
    }

    /// Sequences separated by pauses of more than `gap` seconds.
    fn split(&self, gap: f64, rows: &[Row]) -> Result<Vec<Sequence>, DataError> {
        let mut starts = vec![0];
        for (k, pair) in rows.windows(2).enumerate() {
            let [before, sample] = [0, 1].map(|i| pair[i].sample);
            if matches!(self.source, Source::Csv(_)) && before.file != sample.file {
                starts.push(k + 1);
                continue;
            }
            if sample.stamp <= before.stamp {
                return Err(self.disorder(before, sample));
            }
            if (sample.stamp as f64 - before.stamp as f64) > gap * SECOND as f64 {
                starts.push(k + 1);
            }
        }
        let ends = starts.iter().copied().skip(1).chain([rows.len()]);
        let digits = (starts.len() - 1).to_string().len().max(3);
        let sequence = |(k, (start, end)): (usize, (&usize, usize))| {
            let own = &rows[*start..end];
            let first = own.first().map_or(0, |row| row.sample.stamp);
            let time = own
                .iter()
                .map(|row| (row.sample.stamp - first) as f64 / SECOND as f64);
            self.sequence(&format!("{k:0digits$}"), time.collect(), own)
        };
        starts.iter().zip(ends).enumerate().map(sequence).collect()
    }

    /// The error for a sample that is not after the previous one.
    fn disorder(&self, before: &Sample, sample: &Sample) -> DataError {
        let [was, is] = [before, sample].map(|s| s.stamp as f64 / SECOND as f64);
        let clock = match &self.source {
            Source::Mcap { clock, .. } => clock,
            Source::Csv(_) => {
                let problem = format!("time {is} s is not after {was} s of the line before it");
                return self.problem(sample, problem);
            }
        };
        let stamp = match clock {
            Clock::Header => "stamp",
            Clock::Log => "time of logging",
        };
        let mut problem = format!(
            "{stamp} {is} s is not after {was} s of message {} before it, in {}",
            before.place,
            self.files[before.file].display()
        );
        if before.file != sample.file {
            problem += "; files are read in the order given and must follow one another in time";
            return self.problem(sample, problem);
        }
        let error = self.problem(sample, problem);
        match clock {
            Clock::Header => error.advise(Advice::LogTime),
            Clock::Log => error,
        }
    }

    fn sequence(&self, id: &str, time: Vec<f64>, rows: &[Row]) -> Result<Sequence, DataError> {
        let width = rows.first().map_or(1, |row| row.columns.len());
        let needed = |quantity: Quantity, hint: &str| {
            let mut data = Vec::with_capacity(rows.len() * width);
            for row in rows {
                if row.sample.of(quantity).is_empty() {
                    let what = quantity.name();
                    return Err(self.problem(row.sample, format!("no {what}{hint}")));
                }
                self.append(&mut data, row, quantity)?;
            }
            Table::new(width, data)
        };
        let none = "; the driver does not report torques, or the topic is another one";
        let has_torque = |row: &Row| {
            let effort = |&k: &usize| row.sample.effort.get(k);
            row.columns.iter().filter_map(effort).any(|e| !e.is_nan())
        };
        Ok(Sequence {
            id: id.to_owned(),
            time,
            angles: needed(Quantity::Position, "")?,
            velocities: self.velocities(rows, width)?,
            torques: needed(Quantity::Effort, none).map_err(|error| {
                if rows.iter().any(has_torque) {
                    error
                } else {
                    error.advise(Advice::Planned)
                }
            })?,
            touch_starts: vec![0],
            tags: Vec::new(),
        })
    }

    /// Velocities, if the samples have them.
    fn velocities(&self, rows: &[Row], width: usize) -> Result<Option<Table>, DataError> {
        let has_any = |row: &&Row| {
            let velocity = &row.sample.velocity;
            !velocity.is_empty() && row.columns.iter().any(|&k| !velocity[k].is_nan())
        };
        let with = rows.iter().filter(has_any).count();
        if with == 0 {
            return Ok(None);
        }
        let mut data = Vec::with_capacity(rows.len() * width);
        for row in rows {
            if !has_any(&row) {
                let problem = "no velocity, which other samples of the sequence have";
                let error = self.problem(row.sample, problem.to_owned());
                return Err(error.advise(Advice::NoVelocities));
            }
            let added = self.append(&mut data, row, Quantity::Velocity);
            added.map_err(|error| error.advise(Advice::NoVelocities))?;
        }
        Table::new(width, data).map(Some)
    }

    /// Appends the columns of an array, which must be finite.
    fn append(&self, data: &mut Vec<f64>, row: &Row, quantity: Quantity) -> Result<(), DataError> {
        let array = row.sample.of(quantity);
        for &k in row.columns {
            if !array[k].is_finite() {
                return Err(self.not_finite(row.sample, k, quantity));
            }
            data.push(array[k]);
        }
        Ok(())
    }

    /// The error for column `k` of a sample, which is not finite.
    fn not_finite(&self, sample: &Sample, k: usize, quantity: Quantity) -> DataError {
        let value = sample.of(quantity)[k];
        let columns = match &self.source {
            Source::Mcap { .. } => {
                let (what, joint) = (quantity.name(), &self.names[sample.names][k]);
                return self.problem(sample, format!("{what} of joint {joint:?} is {value}"));
            }
            Source::Csv(columns) => &columns[sample.file],
        };
        let path = self.files[sample.file].clone();
        match columns.title_of(k, quantity) {
            Ok(column) => DataError::CsvCell {
                path,
                line: sample.place,
                column: column.to_owned(),
                problem: if value.is_nan() {
                    "empty or NaN; a sample has a number for every joint".to_owned()
                } else {
                    format!("{value} is not finite")
                },
            },
            Err(problem) => DataError::Csv { path, problem },
        }
    }
}

/// The first file whose sequences have fewer than two samples on average, with the numbers of its sequences and samples;
/// `sequences` are made of `rows`.
fn mostly_single(sequences: &[Sequence], rows: &[Row]) -> Option<(usize, usize, usize)> {
    let mut next = 0;
    let mut files: BTreeMap<usize, (usize, usize)> = BTreeMap::new();
    for sequence in sequences {
        let begin = next;
        next += sequence.len();
        for (k, row) in rows[begin..next].iter().enumerate() {
            let (pieces, samples) = files.entry(row.sample.file).or_default();
            *samples += 1;
            *pieces += usize::from(k == 0);
        }
    }
    let single =
        |(_, (pieces, samples)): &(usize, (usize, usize))| *pieces > 1 && *samples < 2 * pieces;
    let found = files.into_iter().find(single);
    found.map(|(file, (pieces, samples))| (file, pieces, samples))
}
