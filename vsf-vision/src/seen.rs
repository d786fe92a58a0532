use crate::{Features, RgbdView, Sight, VisionError};
use nalgebra::Point3;
use vsf_core::CoreError;

/// What one view shows of the rest points of a field.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Seen {
    /// Whether the point lies on the surface that the camera sees.
    pub visible: Vec<bool>,
    /// Depth of the point behind that surface (m), along the camera's z; 0 on it. Infinite in front of the
    /// surface, where nothing is there, and outside the picture.
    pub behind: Vec<f64>,
    /// Whether the point lies in the picture. The view says nothing about other points.
    pub in_picture: Vec<bool>,
    /// Color of the surface at the point's pixel; black where there is none.
    pub colors: Vec<[u8; 3]>,
    /// Height of the point above the lowest of the given points (m).
    pub heights: Vec<f64>,
}

impl Seen {
    /// Looks up points in a view. Points within `tolerance` (m, >= 0) of the surface are visible; the
    /// tolerance should cover half the spacing of the points.
    ///
    /// # Errors
    /// A tolerance that is negative or not finite.
    pub fn new(view: &RgbdView, points: &[Point3<f64>], tolerance: f64) -> Result<Self, CoreError> {
        if !(tolerance >= 0.0 && tolerance.is_finite()) {
            return Err(CoreError::Parameter {
                name: "tolerance of the surface",
                value: tolerance,
                range: ">= 0 m",
            });
        }
        let mut seen = Self::default();
        let lowest = points.iter().fold(f64::INFINITY, |z, p| z.min(p.z));
        for p in points {
            let sight = view.sight(p);
            let (behind, color) = match sight {
                Sight::Surface { behind, color } if behind >= -tolerance => {
                    (behind.max(0.0), color)
                }
                Sight::Surface { color, .. } => (f64::INFINITY, color),
                Sight::NoReturn | Sight::Outside => (f64::INFINITY, [0; 3]),
            };
            seen.visible.push(behind <= tolerance);
            seen.behind.push(behind);
            seen.in_picture.push(sight != Sight::Outside);
            seen.colors.push(color);
            seen.heights.push(p.z - lowest);
        }
        Ok(seen)
    }

    /// The entries of the points `of`, in that order.
    ///
    /// # Errors
    /// A point that does not exist, or as [`check`](Self::check).
    pub fn select(&self, of: &[usize]) -> Result<Self, CoreError> {
        self.check()?;
        self.check_points(of)?;
        Ok(Self {
            visible: of.iter().map(|&i| self.visible[i]).collect(),
            behind: of.iter().map(|&i| self.behind[i]).collect(),
            in_picture: of.iter().map(|&i| self.in_picture[i]).collect(),
            colors: of.iter().map(|&i| self.colors[i]).collect(),
            heights: of.iter().map(|&i| self.heights[i]).collect(),
        })
    }

    /// Checks that every point has all entries, and that no depth behind the surface is negative.
    ///
    /// # Errors
    /// Lengths that differ, or a depth behind the surface that is negative or NaN.
    pub fn check(&self) -> Result<(), CoreError> {
        for (what, got) in [
            ("depths behind the surface", self.behind.len()),
            ("picture flags", self.in_picture.len()),
            ("colors", self.colors.len()),
            ("heights", self.heights.len()),
        ] {
            CoreError::check_len(what, got, self.len())?;
        }
        match self.behind.iter().find(|b| b.is_nan() || **b < 0.0) {
            None => Ok(()),
            Some(&value) => Err(CoreError::Parameter {
                name: "depth behind the surface",
                value,
                range: ">= 0 m",
            }),
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.visible.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.visible.is_empty()
    }

    /// Probability that there is material at each point: 1 on the surface, falling by `1/e` for every
    /// `fade` (m, > 0) behind it, and 0 outside the picture.
    ///
    /// The volume that a camera cannot see into is mostly empty, the more so the deeper. Outside the
    /// picture nothing suggests that there is anything.
    ///
    /// # Errors
    /// A length that is not positive, or as [`check`](Self::check).
    pub fn occupancy(&self, fade: f64) -> Result<Vec<f64>, CoreError> {
        if fade.is_nan() || fade <= 0.0 {
            return Err(CoreError::Parameter {
                name: "fade length",
                value: fade,
                range: "> 0 m",
            });
        }
        self.check()?;
        let depth = (0..self.len()).map(|i| self.depth(i));
        // Also with an infinite `fade`.
        let occupancy = |b: f64| {
            if b.is_infinite() {
                0.0
            } else {
                (-b / fade).exp()
            }
        };
        Ok(depth.map(occupancy).collect())
    }

    /// Appearance of the points `of`, by features that mean the same on every object: CIELAB color of the
    /// surface in front of them, `depth` behind it (m), and `height` above the lowest of all points (m).
    ///
    /// # Errors
    /// A point of `of` that does not exist or has nothing in front of it, or as [`check`](Self::check).
    pub fn appearance(&self, of: &[usize]) -> Result<Features, VisionError> {
        self.check()?;
        self.check_points(of)?;
        let colors: Vec<_> = of.iter().map(|&i| self.colors[i]).collect();
        let depth: Vec<_> = of.iter().map(|&i| self.depth(i)).collect();
        let height: Vec<_> = of.iter().map(|&i| self.heights[i]).collect();
        let features = Features::new(of.len()).with_lab(&colors)?;
        features
            .with_column("depth", &depth)?
            .with_column("height", &height)
    }

    fn check_points(&self, of: &[usize]) -> Result<(), CoreError> {
        let len = self.len();
        match of.iter().find(|&&i| i >= len) {
            None => Ok(()),
            Some(&index) => Err(CoreError::OutOfRange {
                what: "seen point",
                index,
                len,
            }),
        }
    }

    /// Depth behind the surface, which points that are visible lie on.
    fn depth(&self, i: usize) -> f64 {
        if self.visible[i] { 0.0 } else { self.behind[i] }
    }

    /// Positions and colors of the points `of`, or positions alone.
    pub(crate) fn features(
        &self,
        points: &[Point3<f64>],
        of: &[usize],
        with_colors: bool,
    ) -> Result<Features, VisionError> {
        let positions: Vec<_> = of.iter().map(|&i| points[i]).collect();
        let features = Features::new(of.len()).with_positions(&positions)?;
        if !with_colors {
            return Ok(features);
        }
        let colors: Vec<_> = of.iter().map(|&i| self.colors[i]).collect();
        features.with_rgb(&colors)
    }
}
