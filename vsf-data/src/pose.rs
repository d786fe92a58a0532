//! Rigid poses as 4x4 row-major matrices.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Largest entry of `R^T R - I` that counts as rounding in a file written with f32.
const TOLERANCE: f64 = 1e-6;

/// Largest distance from the origin, also of rest points \[m\].
pub(crate) const FARTHEST: f64 = 1e6;

pub(crate) type Rows4 = [[f64; 4]; 4];

/// The pose, or why the matrix is not one.
pub(crate) fn from_rows(m: &Rows4) -> Result<Isometry3<f64>, String> {
    if m.iter().flatten().any(|v| !v.is_finite()) {
        return Err("the matrix has an entry that is not finite".to_owned());
    }
    if m[3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(format!(
            "the last row of a pose is 0 0 0 1, found {:?} (row-major 4x4?)",
            m[3]
        ));
    }
    let R = Matrix3::from_fn(|i, j| m[i][j]);
    let error = (R.transpose() * R - Matrix3::identity()).amax();
    if error > TOLERANCE {
        return Err(format!(
            "not a rigid transform: R^T R differs from the identity by {error:.1e}"
        ));
    }
    if R.determinant() < 0.0 {
        return Err("not a rigid transform: the rotation mirrors (determinant -1)".to_owned());
    }
    let translation = Vector3::new(m[0][3], m[1][3], m[2][3]);
    if let Some(far) = translation.iter().find(|v| v.abs() > FARTHEST) {
        return Err(format!(
            "the translation has {far:?} m, beyond 1e6 m; check its unit"
        ));
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(R));
    Ok(Isometry3::from_parts(
        Translation3::from(translation),
        UnitQuaternion::new_normalize(rotation.into_inner()),
    ))
}

pub(crate) fn to_rows(pose: &Isometry3<f64>) -> Rows4 {
    let m = pose.to_homogeneous();
    [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| m[(i, j)]))
}

/// Checks a pose from a caller.
pub(crate) fn check(pose: &Isometry3<f64>) -> Result<(), String> {
    from_rows(&to_rows(pose)).map(drop)
}

pub(crate) fn is_finite(v: &Vector3<f64>) -> bool {
    v.iter().all(|c| c.is_finite())
}
