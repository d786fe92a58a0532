use nalgebra::{Point3, Vector3};
use vsf_core::CoreError;

/// An axis-aligned box in the world frame (m), such as the one around the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    min: Point3<f64>,
    max: Point3<f64>,
}

impl Bounds {
    /// Creates the box between two corners.
    ///
    /// # Errors
    /// A coordinate that is not finite, or an edge whose length is not positive.
    pub fn new(min: Point3<f64>, max: Point3<f64>) -> Result<Self, CoreError> {
        CoreError::check_finite("bounds", &[min.x, min.y, min.z, max.x, max.y, max.z])?;
        match (max - min)
            .iter()
            .find(|edge| **edge <= 0.0 || !edge.is_finite())
        {
            None => Ok(Self { min, max }),
            Some(&value) => Err(CoreError::Parameter {
                name: "edge of the bounds",
                value,
                range: "> 0 m",
            }),
        }
    }

    /// Smallest corner.
    pub fn min(&self) -> Point3<f64> {
        self.min
    }

    /// Largest corner.
    pub fn max(&self) -> Point3<f64> {
        self.max
    }

    /// Lengths of the edges.
    pub fn size(&self) -> Vector3<f64> {
        self.max - self.min
    }

    /// Whether a point lies inside or on the border.
    pub fn contains(&self, p_W: &Point3<f64>) -> bool {
        (0..3).all(|k| (self.min[k]..=self.max[k]).contains(&p_W[k]))
    }
}
