use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;
use vsf_core::CoreError;

/// As far as whole numbers are exact.
const MOST_CUBES: f64 = 9e15;

/// A colored point cloud in the world frame (m).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointCloud {
    /// Positions.
    pub positions: Vec<Point3<f64>>,
    /// Colors (red, green, blue), one per position.
    pub colors: Vec<[u8; 3]>,
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Thins the cloud to one point per occupied cube of edge `size` (m, > 0): the mean of the positions
    /// and colors in it. The result is ordered by cube, whatever the order of the points.
    ///
    /// # Errors
    /// A size that is not positive and finite or so small that cubes cannot be counted, a coordinate that
    /// is not finite, or a number of colors other than that of points.
    pub fn downsampled(&self, size: f64) -> Result<Self, CoreError> {
        if !(size > 0.0 && size.is_finite()) {
            return Err(CoreError::Parameter {
                name: "voxel size",
                value: size,
                range: "> 0 m",
            });
        }
        self.check()?;
        for (index, p) in self.positions.iter().enumerate() {
            if let Some(&value) = p.iter().find(|x| !x.is_finite()) {
                return Err(CoreError::NotFinite {
                    what: "positions of the cloud",
                    index,
                    value,
                });
            }
        }
        let mut cubes: BTreeMap<[i64; 3], (Vector3<f64>, [u64; 3], u64)> = BTreeMap::new();
        for (p, c) in self.positions.iter().zip(&self.colors) {
            if p.iter().any(|x| (x / size).abs() >= MOST_CUBES) {
                return Err(CoreError::Parameter {
                    name: "voxel size",
                    value: size,
                    range: "so large that cubes between the origin and each point can be counted",
                });
            }
            let cube = [0, 1, 2].map(|k| (p[k] / size).floor() as i64);
            let (sum, color, count) = cubes.entry(cube).or_default();
            *sum += p.coords;
            (0..3).for_each(|k| color[k] += u64::from(c[k]));
            *count += 1;
        }
        let mean = |(sum, color, count): &(Vector3<f64>, [u64; 3], u64)| {
            let colors = color.map(|c| ((c + count / 2) / count) as u8);
            (Point3::from(sum / *count as f64), colors)
        };
        let (positions, colors) = cubes.values().map(mean).unzip();
        Ok(Self { positions, colors })
    }

    /// The points whose flag in `keep` is true.
    ///
    /// # Errors
    /// A number of flags or colors other than that of points.
    pub fn filtered(&self, keep: &[bool]) -> Result<Self, CoreError> {
        self.check()?;
        CoreError::check_len("flags", keep.len(), self.len())?;
        let all = self.positions.iter().zip(&self.colors).zip(keep);
        let (positions, colors) = all.filter(|(_, k)| **k).map(|((p, c), _)| (*p, *c)).unzip();
        Ok(Self { positions, colors })
    }

    fn check(&self) -> Result<(), CoreError> {
        CoreError::check_len("colors", self.colors.len(), self.len())
    }
}
