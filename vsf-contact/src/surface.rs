use crate::{ContactConfig, Sdf};
use nalgebra::{Point3, Vector3};

/// Newton corrections of a projection to the surface.
pub(crate) const PROJECTION_STEPS: usize = 4;
/// Largest gap (m) whose correction is not verified by another sample. The correction is exact for an
/// exact distance, and leaves a small share of the gap for an interpolated one.
pub(crate) const PROJECTION_TOLERANCE: f64 = 2e-5;

/// A link's surface, offset by the threshold, in the frame of the link.
pub(crate) struct Surface<'a> {
    pub sdf: &'a dyn Sdf,
    pub config: &'a ContactConfig,
}

/// A place on that surface, and the normal there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Anchor {
    pub place_L: Point3<f64>,
    pub normal_L: Vector3<f64>,
}

impl Surface<'_> {
    /// The place on the surface next to another one.
    pub fn project(&self, p_L: &Point3<f64>) -> Anchor {
        let (mut gap, mut anchor) = self.correct(p_L);
        for _ in 1..PROJECTION_STEPS {
            if gap.abs() <= PROJECTION_TOLERANCE {
                break;
            }
            (gap, anchor) = self.correct(&anchor.place_L);
        }
        anchor
    }

    /// One correction: the gap that it closes, and where it leads.
    fn correct(&self, p_L: &Point3<f64>) -> (f64, Anchor) {
        let s = self.sdf.sample(p_L);
        let gap = s.distance - self.config.level();
        let anchor = Anchor {
            place_L: p_L - s.normal * gap,
            normal_L: s.normal,
        };
        (gap, anchor)
    }

    /// Whether a point stays in contact, given the normal component and the square of its displacement:
    /// it is pressed, or pulled no farther than its adhesion.
    pub fn holds(&self, normal: f64, square: f64) -> bool {
        normal >= 0.0 || square <= self.config.adhesion * self.config.adhesion
    }
}
