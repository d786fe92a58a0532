//! Points of an object, whatever file they come in.

use crate::{ColoredPoint, DataError, DataWarning, StiffnessField, files, pcd, ply};
use nalgebra::Point3;
use std::path::Path;

/// Reads points \[m\] by the ending of the file: `.ply` (`x y z` of the element `vertex`; ascii or binary), `.pcd` (the
/// fields `x y z`; ascii, binary or binary_compressed), `.npy` (an array of shape (N, 3)), or `.npz` (those of a field).
/// What else is in a cloud is skipped; points of a `.pcd` whose coordinates are all NaN, pixels without a return, are left
/// out. What can be read but should be known, as of points left out, comes with them.
///
/// # Errors
/// [`DataError::Argument`] for another ending; a damaged file, more or fewer points than its header says, none,
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

/// Reads the points of a `.ply` or `.pcd` as [`read_points`] does, with their colors: 8 bits each, `red green blue` in the
/// one, a field `rgb` or `rgba` in the other.
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
