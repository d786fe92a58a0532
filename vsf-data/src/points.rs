//! Points of an object, whatever file they come in.

use crate::{DataError, DataWarning, StiffnessField, files, pcd, ply};
use nalgebra::Point3;
use std::path::Path;

/// Reads points \[m\] by the ending of the file: `.ply`, `.pcd`, `.npy` (an array of shape (N, 3)), or
/// `.npz` (those of a field). What can be read but should be known comes with them.
///
/// # Errors
/// [`DataError::Argument`] for another ending; a damaged file, no points, coordinates that are not
/// finite.
pub fn read_points(
    path: impl AsRef<Path>,
) -> Result<(Vec<Point3<f64>>, Vec<DataWarning>), DataError> {
    let path = path.as_ref();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    match &*ending.to_ascii_lowercase() {
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
