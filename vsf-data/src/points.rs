//! Points of an object, whatever file they come in.

use crate::{DataError, StiffnessField, files, read_pcd_points, read_ply_points};
use nalgebra::Point3;
use std::path::Path;

/// Reads points \[m\] by the ending of the file: `.ply`, `.pcd`, `.npy` (an array of shape (N, 3)), or
/// `.npz` (those of a field).
///
/// # Errors
/// [`DataError::Argument`] for another ending; a damaged file, no points, coordinates that are not
/// finite.
pub fn read_points(path: impl AsRef<Path>) -> Result<Vec<Point3<f64>>, DataError> {
    let path = path.as_ref();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    match &*ending.to_ascii_lowercase() {
        "ply" => read_ply_points(path),
        "pcd" => read_pcd_points(path),
        "npz" => Ok(StiffnessField::open(path)?.0.points),
        "npy" => {
            let points = files::points(path, files::read_npy(path)?)?;
            files::check_points(path, &points)?;
            Ok(points)
        }
        _ => Err(DataError::Argument {
            what: "points",
            problem: format!("{} is no .ply, .pcd, .npy or .npz", path.display()),
        }),
    }
}
