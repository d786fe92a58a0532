//! Reading of whole files, and interpretation of their arrays.

use crate::npy::{self, NpyArray};
use crate::{DataError, DataWarning, Table, pose, write_file};
use nalgebra::Point3;
use std::fs::{self, File};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

/// Reads a file; [`DataError::Missing`] if there is nothing. A dangling link is not nothing.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, DataError> {
    check_kind(path)?;
    fs::read(path).map_err(|source| unreadable(path, source))
}

/// Reads a text file. Pipes and devices are refused, since they block or never end.
///
/// # Errors
/// [`DataError::Missing`]; [`DataError::Io`], also if the file is not UTF-8.
pub fn read_text(path: impl AsRef<Path>) -> Result<String, DataError> {
    let path = path.as_ref();
    let not_text = |_| {
        unreadable(
            path,
            Error::new(ErrorKind::InvalidData, "it is not UTF-8 text"),
        )
    };
    String::from_utf8(read(path)?).map_err(not_text)
}

/// A warning if the last line of a text file is not terminated.
pub(crate) fn open_ended(path: &Path, text: &[u8]) -> Option<DataWarning> {
    (!text.ends_with(b"\n")).then(|| DataWarning::NoLineEnd {
        path: path.to_owned(),
        others: 0,
    })
}

/// Opens a file for reading in parts. Returns it with its length.
pub(crate) fn open(path: &Path) -> Result<(File, u64), DataError> {
    check_kind(path)?;
    let opened = File::open(path).and_then(|file| {
        let length = file.metadata()?.len();
        Ok((file, length))
    });
    opened.map_err(|source| unreadable(path, source))
}

pub(crate) fn check_kind(path: &Path) -> Result<(), DataError> {
    let kind = match path.metadata() {
        Ok(found) => found.file_type(),
        Err(e) if path.is_symlink() => return Err(unreadable(path, e)),
        Err(e) => return Err(DataError::io("read", path, e)),
    };
    if !kind.is_file() && !kind.is_dir() {
        // Pipes wait and devices go on for ever.
        let why = "it is a pipe or a device; save it as a file";
        return Err(unreadable(path, Error::new(ErrorKind::InvalidInput, why)));
    }
    Ok(())
}

fn unreadable(path: &Path, source: Error) -> DataError {
    DataError::Io {
        action: "read",
        path: path.to_owned(),
        source,
    }
}

/// Whether a file of that name exists, even if it is a dangling link.
pub(crate) fn is_there(path: &Path) -> bool {
    path.exists() || path.is_symlink()
}

/// Entries of a folder, sorted by name.
pub(crate) fn list(path: &Path) -> Result<Vec<PathBuf>, DataError> {
    let failed = |e| DataError::io("list", path, e);
    let mut entries = fs::read_dir(path)
        .map_err(failed)?
        .map(|entry| Ok(entry.map_err(failed)?.path()))
        .collect::<Result<Vec<_>, DataError>>()?;
    entries.sort();
    Ok(entries)
}

pub(crate) fn read_npy(path: &Path) -> Result<NpyArray, DataError> {
    parse_npy(path, &read(path)?)
}

pub(crate) fn parse_npy(path: &Path, bytes: &[u8]) -> Result<NpyArray, DataError> {
    npy::parse(bytes).map_err(|source| DataError::Npy {
        path: path.to_owned(),
        source,
    })
}

/// A `(T, d)` array.
pub(crate) fn table(path: &Path, array: NpyArray) -> Result<Table, DataError> {
    match array.shape[..] {
        [_, cols] if cols > 0 => Table::new(cols, array.data),
        _ => Err(shape(path, array.shape, "(T, d), one row per sample")),
    }
}

/// A `(T,)` array.
pub(crate) fn vector(path: &Path, array: NpyArray) -> Result<Vec<f64>, DataError> {
    match array.shape[..] {
        [_] => Ok(array.data),
        _ => Err(shape(path, array.shape, "(T,), one number per sample")),
    }
}

/// A `(N, 3)` array.
pub(crate) fn points(path: &Path, array: NpyArray) -> Result<Vec<Point3<f64>>, DataError> {
    match array.shape[..] {
        [_, 3] => Ok(array.data.chunks_exact(3).map(Point3::from_slice).collect()),
        _ => Err(shape(path, array.shape, "(N, 3), one point per row")),
    }
}

/// The coordinates of points, row by row.
pub(crate) fn coordinates(points: &[Point3<f64>]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

pub(crate) fn check_points(path: &Path, points: &[Point3<f64>]) -> Result<(), DataError> {
    if points.is_empty() {
        return Err(no_points(path));
    }
    (points.iter().enumerate()).try_for_each(|(row, p)| check_point(path, row, p))
}

pub(crate) fn no_points(path: &Path) -> DataError {
    DataError::Empty {
        path: path.to_owned(),
        what: "the point cloud",
    }
}

pub(crate) fn check_point(path: &Path, row: usize, p: &Point3<f64>) -> Result<(), DataError> {
    for (axis, &value) in ["x", "y", "z"].into_iter().zip(p.iter()) {
        let path = || path.to_owned();
        if !value.is_finite() {
            return Err(DataError::NotFinite {
                path: path(),
                row,
                column: axis.to_owned(),
                value,
            });
        }
        if value.abs() > pose::FARTHEST {
            return Err(DataError::FarPoint {
                path: path(),
                row,
                axis,
                value,
            });
        }
    }
    Ok(())
}

fn shape(path: &Path, got: Vec<usize>, expected: &str) -> DataError {
    DataError::Shape {
        path: path.to_owned(),
        got,
        expected: expected.to_owned(),
    }
}

impl Table {
    /// The table as bytes of a `.npy` file with an array of shape `(rows, cols)`.
    pub fn npy(&self) -> Vec<u8> {
        npy::encode(&[self.rows(), self.cols()], self.data())
    }

    /// Writes [`npy`](Self::npy).
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn save_npy(&self, path: impl AsRef<Path>) -> Result<(), DataError> {
        write_file(path, &self.npy())
    }
}
