use crate::{Features, RgbdView, Sight, VisionError};
use nalgebra::Point3;
use vsf_core::CoreError;

/// What one view says about the rest points of a field.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Seen {
    /// Whether the point lies on the surface that the camera sees.
    pub visible: Vec<bool>,
    /// How far behind that surface it lies (m), along the camera's z; 0 on it. Infinite where nothing is
    /// there, in front of the surface, and out of the picture.
    pub behind: Vec<f64>,
    /// Whether the point lies in the picture; of others the view says nothing.
    pub in_picture: Vec<bool>,
    /// Color of the surface in front of it; black where there is none.
    pub colors: Vec<[u8; 3]>,
    /// How high it lies above the lowest of the points that were looked at (m).
    pub heights: Vec<f64>,
}

impl Seen {
    /// Looks at points; those within `tolerance` (m, >= 0) of the surface are visible. The
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

    /// What is said about the points `of` alone, in that order.
    ///
    /// # Errors
    /// A point that is not there, as [`check`](Self::check).
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

    /// Checks that something is said of every point, and that no point lies before the surface.
    ///
    /// # Errors
    /// Lengths that differ, a depth behind the surface that is negative or NaN.
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

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.visible.is_empty()
    }

    /// How likely there is something at each point: 1 on the surface, falling by `1/e` for every
    /// `fade` (m, > 0) behind it. The volume that a camera cannot see into is mostly empty, the more
    /// so the deeper. 0 out of the picture, where nothing suggests that there is anything.
    ///
    /// # Errors
    /// A length that is not positive, as [`check`](Self::check).
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

    /// What the points `of` look like, by features that mean the same on every object: color of the
    /// surface in front of them (CIELAB), `depth` behind it (m), and `height` above the lowest of all
    /// points (m).
    ///
    /// # Errors
    /// One of `of` that is not there or has nothing in front of it, as [`check`](Self::check).
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
