//! Points of an object, from any supported file format.

use crate::{ColoredPoint, DataError, DataWarning, StiffnessField, files, pcd, ply};
use nalgebra::Point3;
use std::path::Path;

/// Reads points \[m\]. The file extension determines the format:
///
/// - `.ply`: `x y z` of the element `vertex`; ascii or binary;
/// - `.pcd`: the fields `x y z`; ascii, binary or binary_compressed;
/// - `.npy`: an array of shape (N, 3);
/// - `.npz`: the points of a field.
///
/// Everything else in a cloud is skipped. Points of a `.pcd` whose coordinates are all NaN (pixels without a return) are
/// left out, with a warning.
///
/// # Errors
/// [`DataError::Argument`] for another extension; a damaged file; no points, or more or fewer than the header says;
/// coordinates that are missing, not finite or beyond 1e6 m.
pub fn read_points(
    path: impl AsRef<Path>,
) -> Result<(Vec<Point3<f64>>, Vec<DataWarning>), DataError> {
    let path = path.as_ref();
    match &*ending(path) {
        "ply" => ply::points_of(path),
        "pcd" => pcd::points_of(path),
        "npz" => {
            let (field, warnings) = StiffnessField::open(path)?;
            Ok((field.points, warnings))
        }
        "npy" => {
            let points = files::points(path, files::read_npy(path)?)?;
            files::check_points(path, &points)?;
            Ok((points, Vec::new()))
        }
        _ => Err(DataError::Argument {
            what: "points",
            problem: format!("{} is no .ply, .pcd, .npy or .npz", path.display()),
        }),
    }
}

/// Reads the points of a `.ply` or `.pcd` file as [`read_points`] does, together with their colors.
///
/// Colors have 8 bits per channel: `red green blue` in a `.ply`, a field `rgb` or `rgba` in a `.pcd`.
///
/// # Errors
/// As [`read_points`]; points without color.
pub fn read_cloud(
    path: impl AsRef<Path>,
) -> Result<(Vec<ColoredPoint>, Vec<DataWarning>), DataError> {
    let path = path.as_ref();
    match &*ending(path) {
        "ply" => ply::cloud_of(path),
        "pcd" => pcd::cloud_of(path),
        _ => Err(DataError::Argument {
            what: "cloud",
            problem: format!("{} is no .ply or .pcd", path.display()),
        }),
    }
}

fn ending(path: &Path) -> String {
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    ending.to_ascii_lowercase()
}
