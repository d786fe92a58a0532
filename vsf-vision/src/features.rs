use crate::neighbors::check_reach;
use crate::{VisionError, lab};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use vsf_core::CoreError;

/// Named features of points: one row per point. All numbers are finite, and names are unique.
///
/// Columns are added one after the other; any array with one number per point can be a feature.
///
/// ```
/// use vsf_core::nalgebra::Point3;
/// use vsf_vision::Features;
/// let points = [Point3::origin(), Point3::new(0.1, 0.0, 0.3)];
/// let features = Features::new(2)
///     .with_positions(&points)?
///     .with_rgb(&[[30, 120, 40], [110, 80, 50]])?
///     .with_column("age", &[1.0, 2.0])?;
/// assert_eq!(features.names(), ["x", "y", "z", "red", "green", "blue", "age"]);
/// assert_eq!(features.row(1)[2], 0.3);
/// # Ok::<(), vsf_vision::VisionError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "FeaturesParts")]
pub struct Features {
    names: Vec<String>,
    len: usize,
    /// Row by row.
    data: Vec<f64>,
}

/// What is read in obeys the rules of the constructors.
#[derive(Deserialize)]
#[serde(rename = "Features")]
struct FeaturesParts {
    names: Vec<String>,
    len: usize,
    data: Vec<f64>,
}

impl TryFrom<FeaturesParts> for Features {
    type Error = VisionError;

    fn try_from(parts: FeaturesParts) -> Result<Self, VisionError> {
        let FeaturesParts { names, len, data } = parts;
        check_unique(&names)?;
        CoreError::check_len("features", data.len(), len.saturating_mul(names.len()))?;
        CoreError::check_finite("features", &data)?;
        Ok(Self { names, len, data })
    }
}

fn check_unique(names: &[String]) -> Result<(), VisionError> {
    let mut seen = HashSet::with_capacity(names.len());
    match names.iter().find(|name| !seen.insert(*name)) {
        None => Ok(()),
        Some(name) => Err(VisionError::Duplicate { name: name.clone() }),
    }
}

impl Features {
    /// Creates a table of `len` rows without columns.
    pub fn new(len: usize) -> Self {
        Self {
            names: Vec::new(),
            len,
            data: Vec::new(),
        }
    }

    /// Adds a column of one number per point.
    ///
    /// # Errors
    /// A number of values other than that of rows, a value that is not finite, or a name that is taken.
    pub fn with_column(self, name: &str, values: &[f64]) -> Result<Self, VisionError> {
        let rows = values.iter().map(|v| [*v]);
        self.with([name], rows)
    }

    /// Adds `x`, `y`, `z` (m).
    ///
    /// # Errors
    /// As [`Features::with_column`].
    pub fn with_positions(self, points: &[Point3<f64>]) -> Result<Self, VisionError> {
        let rows = points.iter().map(|p| [p.x, p.y, p.z]);
        self.with(["x", "y", "z"], rows)
    }

    /// Adds the unit normal as `normal_x`, `normal_y`, `normal_z`.
    ///
    /// # Errors
    /// As [`Features::with_column`].
    pub fn with_normals(self, normals: &[Vector3<f64>]) -> Result<Self, VisionError> {
        let rows = normals.iter().map(|n| [n.x, n.y, n.z]);
        self.with(["normal_x", "normal_y", "normal_z"], rows)
    }

    /// Adds `red`, `green`, `blue` (0 to 1).
    ///
    /// # Errors
    /// As [`Features::with_column`].
    pub fn with_rgb(self, colors: &[[u8; 3]]) -> Result<Self, VisionError> {
        let rows = colors.iter().map(|c| c.map(|v| f64::from(v) / 255.0));
        self.with(["red", "green", "blue"], rows)
    }

    /// Adds CIELAB color as `L`, `a`, `b`, see [`lab`].
    ///
    /// # Errors
    /// As [`Features::with_column`].
    pub fn with_lab(self, colors: &[[u8; 3]]) -> Result<Self, VisionError> {
        self.with(["L", "a", "b"], colors.iter().map(|c| lab(*c)))
    }

    fn with<const D: usize>(
        self,
        names: [&str; D],
        rows: impl ExactSizeIterator<Item = [f64; D]>,
    ) -> Result<Self, VisionError> {
        CoreError::check_len("feature", rows.len(), self.len)?;
        let width = self.width();
        let mut data = Vec::with_capacity(self.data.len() + D * self.len);
        for (index, row) in rows.enumerate() {
            if let Some(&value) = row.iter().find(|v| !v.is_finite()) {
                let what = "feature";
                return Err(CoreError::NotFinite { what, index, value }.into());
            }
            data.extend_from_slice(&self.data[index * width..(index + 1) * width]);
            data.extend(row);
        }
        let mut all = self.names;
        all.extend(names.map(str::to_owned));
        check_unique(&all)?;
        Ok(Self {
            names: all,
            len: self.len,
            data,
        })
    }

    /// The rows `indices`, in that order.
    ///
    /// # Errors
    /// A row that does not exist.
    pub fn rows_of(&self, indices: &[usize]) -> Result<Self, VisionError> {
        let mut data = Vec::with_capacity(indices.len() * self.width());
        for &index in indices {
            if index >= self.len {
                let (what, len) = ("row of features", self.len);
                return Err(CoreError::OutOfRange { what, index, len }.into());
            }
            data.extend_from_slice(self.row(index));
        }
        Ok(Self {
            names: self.names.clone(),
            len: indices.len(),
            data,
        })
    }

    /// Appends the rows of another table with the same columns.
    ///
    /// # Errors
    /// Other columns, or more rows than can be counted.
    pub fn extend(&mut self, other: &Self) -> Result<(), VisionError> {
        other.check_names(&self.names)?;
        let len = self.len.checked_add(other.len).ok_or(CoreError::TooMany {
            what: "rows of features",
            got: usize::MAX,
            max: isize::MAX as usize,
        })?;
        self.data.extend_from_slice(&other.data);
        self.len = len;
        Ok(())
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.names.len()
    }

    /// Names of the columns.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The features of one point.
    ///
    /// # Panics
    /// If `i` is not below [`Features::len`].
    pub fn row(&self, i: usize) -> &[f64] {
        &self.data[i * self.width()..(i + 1) * self.width()]
    }

    /// All numbers, row by row.
    pub fn data(&self) -> &[f64] {
        &self.data
    }

    /// Checks that the columns are those that a model was fitted on.
    ///
    /// # Errors
    /// [`VisionError::Features`], which names both.
    pub fn check_names(&self, expected: &[String]) -> Result<(), VisionError> {
        if self.names == expected {
            return Ok(());
        }
        Err(VisionError::Features {
            expected: expected.to_vec(),
            got: self.names.clone(),
        })
    }
}

/// Standard scaling: every column gets mean 0 and standard deviation 1 over the rows that the scaler was
/// fitted on. Columns that are constant there become 0.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scaler {
    names: Vec<String>,
    mean: Vec<f64>,
    /// 1 / sd, or 0.
    factor: Vec<f64>,
}

impl Scaler {
    /// Learns mean and standard deviation of every column.
    ///
    /// # Errors
    /// No rows, or numbers so large that their spread overflows.
    pub fn of(features: &Features) -> Result<Self, VisionError> {
        let n = features.len() as f64;
        if features.is_empty() {
            return Err(CoreError::TooFew {
                what: "rows of features",
                got: 0,
                least: 1,
            }
            .into());
        }
        let width = features.width();
        let column = |c: usize| features.data().iter().skip(c).step_by(width).copied();
        let mean: Vec<f64> = (0..width).map(|c| column(c).sum::<f64>() / n).collect();
        let sds: Vec<f64> = (0..width)
            .map(|c| (column(c).map(|v| (v - mean[c]).powi(2)).sum::<f64>() / n).sqrt())
            .collect();
        CoreError::check_finite("spread of features", &sds)?;
        let factor = sds.iter().zip(&mean).map(|(sd, mean)| {
            // Rounding leaves a little spread in constant columns.
            if *sd > 1e-12 * mean.abs() {
                1.0 / sd
            } else {
                0.0
            }
        });
        Ok(Self {
            names: features.names().to_vec(),
            factor: factor.collect(),
            mean,
        })
    }

    /// Scaled rows, one after the other.
    ///
    /// # Errors
    /// Columns other than those the scaler was fitted on, or numbers so far from these that squares would
    /// overflow.
    pub fn apply(&self, features: &Features) -> Result<Vec<f64>, VisionError> {
        features.check_names(&self.names)?;
        let columns = self.mean.iter().zip(&self.factor).cycle();
        let scaled = features.data().iter().zip(columns);
        let scaled: Vec<f64> = scaled
            .map(|(v, (mean, factor))| (v - mean) * factor)
            .collect();
        check_reach("feature, in standard deviations of those learned", &scaled)?;
        Ok(scaled)
    }
}
