//! Checks of what the format promises about a data set, on reading and on writing.

use crate::dataset::{CAMERA, FIELD, POINTS, sequence_ids_or_none, stored_field};
use crate::{Attachment, DataError, DataWarning, Dataset, Overrides, Sequence, Splits, Table};
use crate::{files, metadata, pose};
use nalgebra::Point3;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// How far outside `object_bbox` a point may lie without a warning \[m\]: rounding to f32.
const BOX_SLACK: f64 = 1e-6;
/// Sample rates of joint states that are accepted (Hz), for which time stamps are finite numbers.
const RATES: RangeInclusive<f64> = 1e-6..=1e9;
/// Values of the step between samples times the stated rate that agree with that rate: the first range if some sequence
/// lies within the second one, otherwise the second.
const SAME_RATE: RangeInclusive<f64> = 0.5..=2.0;
const ANY_OF_RATE: RangeInclusive<f64> = 1.0 / 1.2..=1.2;
/// Largest gravity that is accepted (m/s²).
const MOST_GRAVITY: f64 = 100.0;

impl Dataset {
    /// Checks everything that the format promises, as [`open`](Self::open) does: every sequence ([`Sequence::check`]), IDs
    /// and splits, metadata, points, field and camera.
    ///
    /// # Errors
    /// The first problem. It names the file that [`save`](Self::save) would write, in the folder `.`.
    ///
    /// ```
    /// # use vsf_data::{Dataset, RobotRef, Sequence, Table};
    /// # let table = Table::new(1, vec![0.0])?;
    /// # let touch = Sequence::new("a", vec![0.0], table.clone(), table);
    /// # let robot = RobotRef::resolve("planar_arm", ".".as_ref())?;
    /// let mut recording = Dataset::new(robot, vec![touch]);
    /// recording.check()?;
    /// recording.splits.test.push("b".to_owned());
    /// let error = recording.check().unwrap_err();
    /// assert!(error.to_string().contains(r#"splits names sequence "b""#));
    /// # Ok::<(), vsf_data::DataError>(())
    /// ```
    pub fn check(&self) -> Result<(), DataError> {
        self.check_in(Path::new("."))
    }

    /// [`check`](Self::check), with files named below `dir`.
    pub(crate) fn check_in(&self, dir: &Path) -> Result<(), DataError> {
        let path = dir.join(metadata::FILE);
        check_metadata(dir, &self.metadata())?;
        if self.sequences.is_empty() {
            return Err(DataError::NoSequences {
                path: dir.to_owned(),
            });
        }
        let mut ids = BTreeSet::new();
        for sequence in &self.sequences {
            sequence.check_in(dir)?;
            if !ids.insert(&sequence.id) {
                return Err(duplicate(path, &sequence.id, "sequences"));
            }
            if self.tare_samples >= sequence.len() {
                return Err(DataError::TareSamples {
                    path,
                    id: sequence.id.clone(),
                    tare_samples: self.tare_samples,
                    rows: sequence.len(),
                });
            }
            self.check_width(dir, sequence)?;
        }
        self.check_splits(path)?;
        if let Some(points) = &self.rest_points {
            files::check_points(&dir.join(POINTS), points)?;
        }
        if let Some(field) = &self.field {
            field.check(&dir.join(FIELD))?;
        }
        if let Some(camera) = &self.camera {
            camera.check(&dir.join(CAMERA))?;
        }
        Ok(())
    }

    fn check_width(&self, dir: &Path, sequence: &Sequence) -> Result<(), DataError> {
        let (width, path) = (self.width(), sequence.folder(dir).join("angles.npy"));
        if sequence.width() != width {
            return Err(DataError::Shape {
                path,
                got: vec![sequence.len(), sequence.width()],
                expected: format!("{width} columns, as the first sequence"),
            });
        }
        let joints = self.joints.as_ref().map(Vec::len);
        let types = self.joint_types.as_ref().map(Vec::len);
        let listed = [("joints", joints), ("joint_types", types)];
        match listed
            .into_iter()
            .find(|(_, n)| n.is_some_and(|n| n != width))
        {
            Some((key, n)) => Err(DataError::Metadata {
                path: dir.join(metadata::FILE),
                key,
                problem: format!(
                    "lists {} columns, {} has {width}",
                    n.unwrap_or_default(),
                    path.display()
                ),
            }),
            None => Ok(()),
        }
    }

    fn check_splits(&self, path: PathBuf) -> Result<(), DataError> {
        let Splits { train, test } = &self.splits;
        if train.is_empty() && test.is_empty() {
            return Err(DataError::EmptySplit {
                path,
                split: "train",
            });
        }
        let there: BTreeSet<&str> = self.sequences.iter().map(|s| &*s.id).collect();
        let mut listed = BTreeMap::new();
        for (split, ids) in [("train", train), ("test", test)] {
            for id in ids {
                if !there.contains(&**id) {
                    return Err(DataError::UnknownSequence {
                        path,
                        key: "splits",
                        id: id.clone(),
                    });
                }
                match listed.insert(id, split) {
                    None => {}
                    Some(before) if before == split => return Err(duplicate(path, id, split)),
                    Some(_) => return Err(duplicate(path, id, "splits train and test")),
                }
            }
        }
        Ok(())
    }

    pub(crate) fn warnings(&self, dir: &Path) -> Vec<DataWarning> {
        let mut warnings = Vec::new();
        let clamped = [
            ("attachment", self.attachment == Attachment::Bilateral),
            ("gauge_length", self.gauge_length.is_some()),
        ];
        let keys: Vec<_> = (clamped.into_iter())
            .filter_map(|(key, given)| given.then_some(key))
            .collect();
        if !keys.is_empty() {
            warnings.push(DataWarning::ClampedSpecimen {
                path: dir.join(metadata::FILE),
                keys,
            });
        }
        if let (Some(points), Some([lo, hi])) = (&self.rest_points, &self.object_bbox) {
            let outside = |p: &&Point3<f64>| {
                (0..3).any(|k| p[k] < lo[k] - BOX_SLACK || p[k] > hi[k] + BOX_SLACK)
            };
            let count = points.iter().filter(outside).count();
            if count > 0 {
                warnings.push(DataWarning::PointsOutsideBox {
                    path: dir.join(POINTS),
                    count,
                    total: points.len(),
                });
            }
        }
        warnings.extend(self.repeated_points(dir));
        warnings.extend(self.other_rate(dir));
        warnings.extend(self.earlier_sequences(dir));
        warnings.extend(self.copied_sequences(dir));
        warnings.extend(self.overlapping_sequences(dir));
        let Splits { train, test } = &self.splits;
        let used: BTreeSet<&String> = train.iter().chain(test).collect();
        let ids: Vec<String> = (self.sequences.iter())
            .map(|s| s.id.clone())
            .filter(|id| !used.contains(id))
            .collect();
        if !ids.is_empty() {
            warnings.push(DataWarning::UnassignedSequences {
                path: dir.to_owned(),
                ids,
            });
        }
        let ids: Vec<String> = (self.sequences.iter())
            .filter(|s| s.is_unmeasured())
            .map(|s| s.id.clone())
            .collect();
        if !ids.is_empty() {
            warnings.push(DataWarning::ZeroTorques {
                path: dir.to_owned(),
                ids,
            });
        }
        warnings
    }

    /// Sequences that were over before a sequence began whose name comes earlier.
    fn earlier_sequences(&self, dir: &Path) -> Option<DataWarning> {
        let earlier = |pair: &&[Sequence]| {
            let (begin, end) = (pair[0].time.first(), pair[1].time.last());
            pair[1].time.len() > 1 && end.zip(begin).is_some_and(|(end, begin)| end < begin)
        };
        let mut found = self.sequences.windows(2).filter(earlier);
        let pair = found.next()?;
        Some(DataWarning::EarlierSequences {
            path: dir.to_owned(),
            first: pair[1].id.clone(),
            of: pair[0].id.clone(),
            others: found.count(),
        })
    }

    /// Copied sequences: sequences with the same numbers, test sequences with exactly the angles of train sequences, and
    /// sequences with the torques of others but other angles. Planned motions, with zero torque, may repeat.
    fn copied_sequences(&self, dir: &Path) -> Vec<DataWarning> {
        let measured = |s: &&Sequence| s.torques.data().iter().any(|v| *v != 0.0);
        let (train, test) = (&self.splits.train, &self.splits.test);
        let mut by_angles = Alike::default();
        let mut by_torques = Alike::default();
        let (mut copies, mut retraced, mut reread) = (Vec::new(), Vec::new(), Vec::new());
        for s in self.sequences.iter().filter(measured) {
            let moves_alike = by_angles.before(s, |of| &of.angles);
            let reads_alike = by_torques.before(s, |of| &of.torques);
            // Of sensors that are stuck something else is said.
            let reads = s.torques.data().iter();
            let is_stuck = reads
                .clone()
                .zip(reads.skip(s.width()))
                .all(|(a, b)| a == b);
            let both_ways = moves_alike.iter().flat_map(|of| [(s, *of), (*of, s)]);
            let mut again =
                both_ways.filter(|(s, of)| test.contains(&s.id) && train.contains(&of.id));
            let pair = |s: &Sequence, of: &Sequence| (s.id.clone(), of.id.clone());
            if let Some(of) = moves_alike.iter().find(|of| of.torques == s.torques) {
                copies.push(pair(s, of));
            } else if let Some(of) = reads_alike.first().filter(|_| !is_stuck) {
                reread.push(pair(s, of));
            } else if let Some((s, of)) = again.next() {
                retraced.push(pair(s, of));
            }
        }
        let told = |pairs: &[(String, String)], warning: fn(_, _, _, _) -> DataWarning| {
            let (first, of) = pairs.first()?;
            Some(warning(
                dir.to_owned(),
                first.clone(),
                of.clone(),
                pairs.len() - 1,
            ))
        };
        let of_copies = told(&copies, |path, first, of, others| {
            DataWarning::CopiedSequences {
                path,
                first,
                of,
                others,
            }
        });
        let of_reread = told(&reread, |path, first, of, others| {
            DataWarning::CopiedTorques {
                path,
                first,
                of,
                others,
            }
        });
        let of_retraced = told(&retraced, |path, first, of, others| {
            DataWarning::RetracedSequences {
                path,
                first,
                of,
                others,
            }
        });
        [of_copies, of_reread, of_retraced]
            .into_iter()
            .flatten()
            .collect()
    }

    /// Sequences whose time stamps do not agree with `rate_hz`.
    fn other_rate(&self, dir: &Path) -> Option<DataWarning> {
        let rate_hz = self.rate_hz?;
        let step = |s: &Sequence| {
            let mut steps: Vec<f64> = s.time.windows(2).map(|t| t[1] - t[0]).collect();
            steps.sort_by(f64::total_cmp);
            steps.get(steps.len() / 2).copied()
        };
        let mut steps: Vec<(f64, &Sequence)> = (self.sequences.iter())
            .filter_map(|s| Some((step(s)?, s)))
            .collect();
        let of_rate = |step: f64, range: RangeInclusive<f64>| range.contains(&(step * rate_hz));
        if steps.iter().any(|(step, _)| of_rate(*step, ANY_OF_RATE)) {
            steps.retain(|(step, _)| !of_rate(*step, SAME_RATE));
        }
        let (step, _) = *steps.first()?;
        let ids = steps.iter().map(|(_, s)| s.id.clone()).collect();
        let path = dir.join(metadata::FILE);
        Some(DataWarning::OtherRate {
            path,
            rate_hz,
            step,
            ids,
        })
    }

    /// Rest points at exactly the position of others.
    fn repeated_points(&self, dir: &Path) -> Option<DataWarning> {
        let points = self.rest_points.as_ref()?;
        // Zero has two signs.
        let place = |p: &Point3<f64>| [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits());
        let mut first = HashMap::with_capacity(points.len());
        let mut repeated = (points.iter().enumerate()).filter_map(|(row, p)| {
            let of = *first.entry(place(p)).or_insert(row);
            (of != row).then_some((row, of))
        });
        let (row, of) = repeated.next()?;
        Some(DataWarning::RepeatedPoints {
            path: dir.join(POINTS),
            count: 1 + repeated.count(),
            total: points.len(),
            row,
            of,
        })
    }

    /// Files in `dir` that would be read with this data set but are not written by it.
    pub(crate) fn check_leftovers(&self, dir: &Path) -> Result<(), DataError> {
        if !files::is_there(dir) {
            return Ok(());
        }
        let leftover = |path| Err(DataError::Leftover { path });
        for (id, folder) in sequence_ids_or_none(dir)? {
            let velocities = folder.join("velocities.npy");
            match self.sequence(&id) {
                None => return leftover(folder),
                Some(s) if s.velocities.is_none() && velocities.exists() => {
                    return leftover(velocities);
                }
                Some(_) => {}
            }
        }
        if self.rest_points.is_none() && dir.join(POINTS).exists() {
            return leftover(dir.join(POINTS));
        }
        if self.camera.is_none() && dir.join(CAMERA).exists() {
            return leftover(dir.join(CAMERA));
        }
        match stored_field(dir)? {
            Some(path) if self.field.is_none() || path != dir.join(FIELD) => leftover(path),
            _ => Ok(()),
        }
    }
}

/// Sequences by a hash of one of their tables.
#[derive(Default)]
struct Alike<'a>(HashMap<u64, Vec<&'a Sequence>>);

impl<'a> Alike<'a> {
    /// Earlier sequences with the same table as `s`.
    fn before(
        &mut self,
        s: &'a Sequence,
        table: impl Fn(&Sequence) -> &Table,
    ) -> Vec<&'a Sequence> {
        let mut hasher = DefaultHasher::new();
        let values = table(s).data().iter();
        values.for_each(|v| v.to_bits().hash(&mut hasher));
        let there = self.0.entry(hasher.finish()).or_default();
        let same = |of: &&&Sequence| table(of) == table(s);
        let found = there.iter().filter(same).copied().collect();
        there.push(s);
        found
    }
}

/// Checks values that have the right type but may have no meaning.
pub(crate) fn check_metadata(dir: &Path, metadata: &Overrides) -> Result<(), DataError> {
    let wrong = |key, problem: String| DataError::Metadata {
        path: dir.join(metadata::FILE),
        key,
        problem,
    };
    if let Some(rate) = metadata.rate_hz.filter(|rate| !RATES.contains(rate)) {
        let (least, most) = (RATES.start(), RATES.end());
        let problem = format!("{rate:?} Hz must be from {least:e} to {most:e} Hz");
        return Err(wrong("rate_hz", problem));
    }
    if let Some(length) = metadata
        .gauge_length
        .filter(|v| !(v.is_finite() && *v > 0.0))
    {
        let problem = format!("{length:?} must be positive and finite");
        return Err(wrong("gauge_length", problem));
    }
    if metadata.gravity.is_some_and(|g| !pose::is_finite(&g)) {
        return Err(wrong("gravity", "must be finite".to_owned()));
    }
    if let Some(g) = metadata.gravity.filter(|g| g.norm() > MOST_GRAVITY) {
        let [x, y, z] = [g.x, g.y, g.z];
        let problem =
            format!("[{x:?}, {y:?}, {z:?}] m/s^2 is longer than {MOST_GRAVITY}; check its unit");
        return Err(wrong("gravity", problem));
    }
    if let Some(base) = &metadata.base_pose {
        pose::check(base).map_err(|problem| wrong("base_pose", problem))?;
    }
    if let Some([lo, hi]) = &metadata.object_bbox
        && !(0..3).all(|k| lo[k].is_finite() && hi[k].is_finite() && lo[k] <= hi[k])
    {
        let problem = "must be [[xmin, ymin, zmin], [xmax, ymax, zmax]] with min <= max";
        return Err(wrong("object_bbox", problem.to_owned()));
    }
    if let Some(joints) = &metadata.joints {
        let mut seen = BTreeSet::new();
        if let Some(name) = joints.iter().find(|j| j.is_empty() || !seen.insert(*j)) {
            return Err(wrong(
                "joints",
                format!("{name:?} is empty or occurs twice"),
            ));
        }
        if let Some(types) = &metadata.joint_types
            && types.len() != joints.len()
        {
            let problem = format!("{} types for {} joints", types.len(), joints.len());
            return Err(wrong("joint_types", problem));
        }
    }
    Ok(())
}

fn duplicate(path: PathBuf, id: &str, place: &'static str) -> DataError {
    DataError::DuplicateSequence {
        path,
        id: id.to_owned(),
        place,
    }
}
