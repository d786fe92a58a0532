use crate::staged::Staged;
use crate::{DataError, Table, files, metadata, npy};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The arrays of a sequence.
pub(crate) const ARRAYS: [&str; 4] = ["time.npy", "angles.npy", "velocities.npy", "torques.npy"];

/// Prefix of the folder of a sequence.
pub(crate) const PREFIX: &str = "seq_";

/// Largest absolute time stamp (s).
const LATEST: f64 = 1e12;
/// Shortest accepted step between samples (s): that of the highest sample rate, rounded. Speeds are computed from it.
const SHORTEST: f64 = 0.5e-9;

/// One touch sequence: `T` samples of `d` joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    /// The ID; its folder is `seq_<ID>`.
    pub id: String,
    /// Time stamps \[s\], length `T`: they increase by at least half a nanosecond and lie within 1e12 s of zero.
    pub time: Vec<f64>,
    /// Joint angles \[rad\] (prismatic: positions \[m\]), `T` x `d`.
    pub angles: Table,
    /// Joint velocities [rad/s or m/s], `T` x `d`, if recorded.
    pub velocities: Option<Table>,
    /// Joint torques \[N m\] (prismatic: forces \[N\]), `T` x `d`.
    pub torques: Table,
    /// Rows, increasing, at which a new touch begins; `[0]` by default.
    ///
    /// The contact state is reset at these rows and at row 0, whether that is among them or not
    /// ([`touches`](Self::touches)).
    pub touch_starts: Vec<usize>,
    /// Free labels, never a hint of a cause. A tag `"key": value` in the file is read as `key=value`.
    pub tags: Vec<String>,
}

impl Sequence {
    /// File of a predicted sequence with the standard deviations of its torques; it is not read.
    pub const DEVIATIONS: &'static str = "torques_sd.npy";

    /// A sequence with a single touch, without velocities and tags.
    pub fn new(id: impl Into<String>, time: Vec<f64>, angles: Table, torques: Table) -> Self {
        Self {
            id: id.into(),
            time,
            angles,
            velocities: None,
            torques,
            touch_starts: vec![0],
            tags: Vec::new(),
        }
    }

    /// Number of samples `T`.
    pub fn len(&self) -> usize {
        self.angles.rows()
    }

    /// Whether all torques are zero, as in a planned motion that was not executed: nothing was measured.
    pub fn is_unmeasured(&self) -> bool {
        self.torques.data().iter().all(|tau| *tau == 0.0)
    }

    /// True if there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of joints `d`.
    pub fn width(&self) -> usize {
        self.angles.cols()
    }

    /// The rows of each touch, in order. Together they cover all rows: the first touch begins at row 0 even if
    /// [`touch_starts`](Self::touch_starts) begins later.
    ///
    /// ```
    /// # use vsf_data::{Sequence, Table};
    /// # let t = Table::new(1, vec![0.0; 30])?;
    /// # let mut sequence = Sequence { id: "0".into(), time: vec![], angles: t.clone(),
    /// #     velocities: None, torques: t, touch_starts: vec![0], tags: vec![] };
    /// sequence.touch_starts = vec![0, 10, 25];
    /// assert_eq!(sequence.touches().collect::<Vec<_>>(), [0..10, 10..25, 25..30]);
    /// # Ok::<(), vsf_data::DataError>(())
    /// ```
    pub fn touches(&self) -> impl Iterator<Item = Range<usize>> {
        let later = || self.touch_starts.iter().copied().filter(|&row| row > 0);
        std::iter::once(0)
            .chain(later())
            .zip(later().chain([self.len()]))
            .map(|(start, end)| start..end)
    }

    pub(crate) fn load(folder: &Path, id: &str, rate_hz: Option<f64>) -> Result<Self, DataError> {
        let read = |name: &str| {
            let path = folder.join(name);
            let array = files::read_npy(&path)?;
            Ok::<_, DataError>((path, array))
        };
        let table = |name: &str| {
            let (path, array) = read(name)?;
            files::table(&path, array)
        };
        let angles = table("angles.npy")?;
        let torques = table("torques.npy")?;
        let velocities = match table("velocities.npy") {
            Ok(table) => Some(table),
            Err(DataError::Missing { .. }) => None,
            Err(e) => return Err(e),
        };
        let time = match read("time.npy") {
            Ok((path, array)) => files::vector(&path, array)?,
            Err(DataError::Missing { .. }) => match rate_hz {
                Some(rate) => (0..angles.rows()).map(|k| k as f64 / rate).collect(),
                None => {
                    return Err(DataError::MissingKey {
                        path: folder.to_owned(),
                        key: "rate_hz",
                        hint: "the sequence has no time.npy; give the sample rate in Hz",
                    });
                }
            },
            Err(e) => return Err(e),
        };
        Ok(Self {
            id: id.to_owned(),
            time,
            angles,
            velocities,
            torques,
            touch_starts: vec![0],
            tags: Vec::new(),
        })
    }

    pub(crate) fn stage(&self, dir: &Path, staged: &mut Staged) -> Result<(), DataError> {
        let folder = self.folder(dir);
        staged.file(
            &folder.join("time.npy"),
            &npy::encode(&[self.time.len()], &self.time),
        )?;
        for (name, table) in self.tables() {
            staged.file(&folder.join(name), &table.npy())?;
        }
        Ok(())
    }

    pub(crate) fn folder(&self, dir: &Path) -> PathBuf {
        dir.join(format!("{PREFIX}{}", self.id))
    }

    fn tables(&self) -> impl Iterator<Item = (&'static str, &Table)> {
        let velocities = self.velocities.as_ref().map(|v| ("velocities.npy", v));
        [("angles.npy", &self.angles), ("torques.npy", &self.torques)]
            .into_iter()
            .chain(velocities)
    }

    /// Checks everything that the format promises about one sequence, as [`Dataset::open`] does: arrays of matching shape,
    /// finite numbers, time stamps that increase, and touches that begin within the rows and in order.
    ///
    /// # Errors
    /// The first problem. It names the file that [`Dataset::save`] would write, in the folder `.`.
    ///
    /// ```
    /// # use vsf_data::{Sequence, Table};
    /// let [angles, torques] = [Table::new(2, vec![0.0; 6])?, Table::new(2, vec![0.0; 4])?];
    /// let short = Sequence::new("a", vec![0.0, 0.1, 0.2], angles, torques);
    /// let error = short.check().unwrap_err();
    /// assert_eq!(error.to_string(), "./seq_a/torques.npy: 2 rows, but angles.npy has 3");
    /// # Ok::<(), vsf_data::DataError>(())
    /// ```
    ///
    /// [`Dataset::open`]: crate::Dataset::open
    /// [`Dataset::save`]: crate::Dataset::save
    pub fn check(&self) -> Result<(), DataError> {
        self.check_in(Path::new("."))
    }

    /// [`check`](Self::check), with files named below `dir`.
    pub(crate) fn check_in(&self, dir: &Path) -> Result<(), DataError> {
        let folder = self.folder(dir);
        if self.id.is_empty() || self.id.contains(['/', '\\', '\0']) {
            return Err(DataError::SequenceId {
                path: dir.to_owned(),
                id: self.id.clone(),
            });
        }
        if self.is_empty() {
            return Err(DataError::Empty {
                path: folder.join("angles.npy"),
                what: "the sequence",
            });
        }
        for (name, table) in self.tables() {
            let path = folder.join(name);
            self.check_rows(&path, table.rows())?;
            if table.cols() != self.width() {
                return Err(DataError::Shape {
                    path,
                    got: vec![table.rows(), table.cols()],
                    expected: format!("{} columns, as angles.npy has", self.width()),
                });
            }
            if let Some((row, column, value)) = table.first_not_finite() {
                return Err(DataError::NotFinite {
                    path,
                    row,
                    column: format!("joint {}", column + 1),
                    value,
                });
            }
        }
        self.check_time(folder.join("time.npy"))?;
        self.check_touch_starts(dir)
    }

    fn check_rows(&self, path: &Path, got: usize) -> Result<(), DataError> {
        if got == self.len() {
            return Ok(());
        }
        Err(DataError::Rows {
            path: path.to_owned(),
            got,
            reference: "angles.npy".to_owned(),
            expected: self.len(),
        })
    }

    fn check_time(&self, path: PathBuf) -> Result<(), DataError> {
        self.check_rows(&path, self.time.len())?;
        if let Some(row) = self.time.iter().position(|t| !t.is_finite()) {
            return Err(DataError::NotFinite {
                path,
                row,
                column: String::new(),
                value: self.time[row],
            });
        }
        if let Some(row) = self.time.iter().position(|t| t.abs() > LATEST) {
            return Err(DataError::FarTime {
                path,
                row,
                value: self.time[row],
            });
        }
        match self.time.windows(2).position(|w| w[1] - w[0] < SHORTEST) {
            None => Ok(()),
            Some(k) => Err(DataError::TimeOrder {
                path,
                row: k + 1,
                previous: self.time[k],
                value: self.time[k + 1],
            }),
        }
    }

    fn check_touch_starts(&self, dir: &Path) -> Result<(), DataError> {
        let starts = &self.touch_starts;
        for (index, &row) in starts.iter().enumerate() {
            let problem = if row >= self.len() {
                format!("the sequence has {} rows, counted from 0", self.len())
            } else if index > 0 && row <= starts[index - 1] {
                format!(
                    "rows must increase, the entry before is {}",
                    starts[index - 1]
                )
            } else {
                continue;
            };
            return Err(DataError::TouchStarts {
                path: dir.join(metadata::FILE),
                id: self.id.clone(),
                index,
                row,
                problem,
            });
        }
        Ok(())
    }
}
