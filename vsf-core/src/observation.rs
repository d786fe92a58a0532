use crate::{CoreError, Noise, Scalar};

/// One linear observation of the field: `reading = sum_k column_k K[points_k] + noise` (eq. 4).
///
/// Only touched points are stored. The matrix is row-major (`d` rows of `len` entries), so that
/// estimators stream over the points. An observation is valid by construction: point indices are
/// strictly increasing and below the size of the field, and every number is finite.
#[derive(Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "crate::state::ObservationParts<T>")
)]
pub struct Observation<T: Scalar> {
    points: Vec<u32>,
    rows: Vec<T>,
    reading: Vec<T>,
    noise: Noise,
    /// Buffer for one column.
    #[cfg_attr(feature = "serde", serde(skip))]
    column: Vec<f64>,
}

impl<T: Scalar> PartialEq for Observation<T> {
    fn eq(&self, other: &Self) -> bool {
        self.points == other.points
            && self.rows == other.rows
            && self.reading == other.reading
            && self.noise == other.noise
    }
}

impl<T: Scalar> Clone for Observation<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.noise.clone());
        copy.clone_from(self);
        copy
    }

    /// Copies into the existing memory.
    fn clone_from(&mut self, source: &Self) {
        self.points.clone_from(&source.points);
        self.rows.clone_from(&source.rows);
        self.reading.clone_from(&source.reading);
        self.noise.clone_from(&source.noise);
        self.column.clone_from(&source.column);
    }
}

impl<T: Scalar> Observation<T> {
    /// Creates an observation without contacts and with a zero reading of `noise.dim()` channels.
    pub fn new(noise: Noise) -> Self {
        Self {
            points: Vec::new(),
            rows: Vec::new(),
            reading: vec![T::ZERO; noise.dim()],
            column: vec![0.0; noise.dim()],
            noise,
        }
    }

    /// Replaces points, columns and reading, reusing the memory.
    ///
    /// `column(k, w)` writes the `d` entries of `w_{points[k]}` into `w`.
    ///
    /// # Errors
    /// Point indices out of order or `>= field_len`; a reading whose length differs from the noise's, or whose square
    /// in units of the noise overflows; a value that is not finite in `T`. The observation is then empty.
    pub fn rebuild(
        &mut self,
        field_len: usize,
        points: &[u32],
        reading: &[f64],
        column: impl FnMut(usize, &mut [f64]),
    ) -> Result<(), CoreError> {
        let result = self
            .begin(field_len, points, reading)
            .and_then(|()| self.write_columns(column));
        self.or_empty(result)
    }

    /// Like [`Observation::rebuild`], for sensors that work row by row: `rows(w)` writes all
    /// `d x points.len()` entries of the row-major matrix.
    ///
    /// # Errors
    /// As [`Observation::rebuild`].
    ///
    /// ```
    /// # use vsf_core::{Noise, Observation};
    /// let mut obs = Observation::<f32>::new(Noise::uniform(2, 0.1)?);
    /// obs.rebuild_rows(9, &[3, 4, 7], &[1.0, 2.0], |w| {
    ///     w[..3].copy_from_slice(&[0.1, 0.2, 0.3]);
    ///     w[3..].copy_from_slice(&[0.4, 0.5, 0.6]);
    /// })?;
    /// assert_eq!(obs.row(1), [0.4, 0.5, 0.6]);
    /// # Ok::<(), vsf_core::CoreError>(())
    /// ```
    pub fn rebuild_rows(
        &mut self,
        field_len: usize,
        points: &[u32],
        reading: &[f64],
        rows: impl FnOnce(&mut [T]),
    ) -> Result<(), CoreError> {
        let result = self.begin(field_len, points, reading).and_then(|()| {
            rows(&mut self.rows);
            self.check_rows()
        });
        self.or_empty(result)
    }

    fn or_empty(&mut self, result: Result<(), CoreError>) -> Result<(), CoreError> {
        if result.is_err() {
            self.clear();
        }
        result
    }

    /// Writes everything but the entries of the matrix.
    fn begin(
        &mut self,
        field_len: usize,
        points: &[u32],
        reading: &[f64],
    ) -> Result<(), CoreError> {
        let d = self.dim();
        check_reading::<T>(reading, &self.noise)?;
        for pair in points.windows(2) {
            if pair[1] <= pair[0] {
                return Err(CoreError::Unordered {
                    previous: pair[0] as usize,
                    index: pair[1] as usize,
                });
            }
        }
        if let Some(&last) = points.last()
            && last as usize >= field_len
        {
            return Err(CoreError::OutOfRange {
                what: "observed point",
                index: last as usize,
                len: field_len,
            });
        }
        self.points.clear();
        self.points.extend_from_slice(points);
        self.write_reading(reading);
        self.rows.resize(d * points.len(), T::ZERO);
        Ok(())
    }

    fn write_reading(&mut self, reading: &[f64]) {
        let pairs = self.reading.iter_mut().zip(reading);
        pairs.for_each(|(to, &from)| *to = T::from_f64(from));
    }

    fn write_columns(
        &mut self,
        mut column: impl FnMut(usize, &mut [f64]),
    ) -> Result<(), CoreError> {
        let n = self.points.len();
        for (k, &point) in self.points.iter().enumerate() {
            self.column.fill(0.0);
            column(k, &mut self.column);
            for (i, &w) in self.column.iter().enumerate() {
                self.rows[i * n + k] = T::from_f64(w);
                if !self.rows[i * n + k].is_finite() {
                    return Err(Self::bad_column(point, w));
                }
            }
        }
        Ok(())
    }

    fn check_rows(&self) -> Result<(), CoreError> {
        // No early exit, which would keep the loop from vectorizing.
        if self.rows.iter().fold(true, |ok, w| ok & w.is_finite()) {
            return Ok(());
        }
        let entries = self.rows.iter().zip(self.points.iter().cycle());
        entries
            .filter(|(w, _)| !w.is_finite())
            .try_for_each(|(w, &point)| Err(Self::bad_column(point, w.to_f64())))
    }

    fn bad_column(point: u32, value: f64) -> CoreError {
        CoreError::NotFinite {
            what: "observation column of point",
            index: point as usize,
            value,
        }
    }

    /// Replaces the noise, for sensors whose noise changes with time.
    ///
    /// # Errors
    /// Noise of another dimension, or so small that the squared reading in units of it overflows. Nothing is changed
    /// then.
    pub fn set_noise(&mut self, noise: &Noise) -> Result<(), CoreError> {
        self.check_noise(noise)?;
        self.noise.clone_from(noise);
        Ok(())
    }

    /// Replaces the noise by independent noise with one standard deviation per channel, reusing the memory.
    ///
    /// # Errors
    /// As [`Noise::per_channel`] and [`Observation::set_noise`]. Nothing is changed then.
    pub fn set_noise_sd(&mut self, sd: &[f64]) -> Result<(), CoreError> {
        CoreError::check_len("noise", sd.len(), self.dim())?;
        // Invalid deviations are rejected by the noise below.
        if sd.iter().all(|sd| *sd > 0.0) {
            check_scale(self.reading.iter().copied(), sd.iter().copied())?;
        }
        self.noise.set_per_channel(sd)
    }

    /// Removes all contacts and sets the reading to zero, as in a new observation. The noise stays.
    pub fn clear(&mut self) {
        self.points.clear();
        self.rows.clear();
        self.reading.fill(T::ZERO);
    }

    /// Copies an observation of another number type into this one, reusing the memory.
    ///
    /// # Errors
    /// A number beyond the range of `T`; the observation is then empty.
    pub fn cast_from<U: Scalar>(&mut self, other: &Observation<U>) -> Result<(), CoreError> {
        fn cast<T: Scalar, U: Scalar>(to: &mut Vec<T>, from: &[U]) -> bool {
            to.clear();
            to.extend(from.iter().map(|v| T::from_f64(v.to_f64())));
            to.iter().all(|v| v.is_finite())
        }
        self.noise.clone_from(&other.noise);
        self.column.clone_from(&other.column);
        self.points.clone_from(&other.points);
        let fits = cast(&mut self.rows, &other.rows) & cast(&mut self.reading, &other.reading);
        if fits {
            return Ok(());
        }
        self.clear();
        Err(CoreError::Overflow {
            what: "observation in another number type",
        })
    }

    /// Checks that [`Observation::set_noise`] would accept this noise.
    ///
    /// # Errors
    /// As [`Observation::set_noise`].
    pub fn check_noise(&self, noise: &Noise) -> Result<(), CoreError> {
        CoreError::check_len("noise", noise.dim(), self.dim())?;
        check_scale(self.reading.iter().copied(), sds(noise))
    }

    /// Replaces the reading.
    ///
    /// # Errors
    /// Another number of channels, a value that is not finite in `T`, or one whose square in units of the noise
    /// overflows. Nothing is changed then.
    pub fn set_reading(&mut self, reading: &[f64]) -> Result<(), CoreError> {
        check_reading::<T>(reading, &self.noise)?;
        self.write_reading(reading);
        Ok(())
    }

    /// Number of channels `d`.
    pub fn dim(&self) -> usize {
        self.noise.dim()
    }

    /// Number of touched points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// True if no points are touched.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Indices of the touched points, strictly increasing.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// Row `i` of the observation matrix, that of channel `i < dim`: one entry per touched point.
    ///
    /// # Panics
    /// If `i >= dim` and points are touched.
    pub fn row(&self, i: usize) -> &[T] {
        let n = self.points.len();
        &self.rows[i * n..(i + 1) * n]
    }

    /// The observation matrix, row-major `d x len`.
    pub fn rows(&self) -> &[T] {
        &self.rows
    }

    /// The reading `tau`, `d` values.
    pub fn reading(&self) -> &[T] {
        &self.reading
    }

    /// The noise of the reading.
    pub fn noise(&self) -> &Noise {
        &self.noise
    }

    /// Computes `W x` for a field `x` over all points and writes it to `out` (`d` values). Sums are accumulated in `T`.
    ///
    /// # Panics
    /// If `x` is shorter than the field or `out` shorter than `d`.
    pub fn apply(&self, x: &[T], out: &mut [T]) {
        for (i, o) in out.iter_mut().enumerate().take(self.dim()) {
            *o = self
                .row(i)
                .iter()
                .zip(&self.points)
                .map(|(&w, &p)| w * x[p as usize])
                .sum();
        }
    }

    /// Checks that the touched points lie within a field of `len` points.
    ///
    /// # Errors
    /// [`CoreError::OutOfRange`] names the point beyond the field.
    pub fn check_fits(&self, len: usize) -> Result<(), CoreError> {
        match self.points.last() {
            Some(&p) if p as usize >= len => Err(CoreError::OutOfRange {
                what: "observed point",
                index: p as usize,
                len,
            }),
            _ => Ok(()),
        }
    }

    /// Memory of a copy (bytes): the struct itself, points, rows, reading and noise, without allocator overhead.
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + self.points.len() * size_of::<u32>()
            + (self.rows.len() + self.reading.len()) * size_of::<T>()
            + size_of_val(self.noise.covariance())
            + size_of_val(self.column.as_slice())
    }
}

fn check_reading<T: Scalar>(reading: &[f64], noise: &Noise) -> Result<(), CoreError> {
    CoreError::check_len("reading", reading.len(), noise.dim())?;
    CoreError::check_finite("reading", reading)?;
    check_scale(reading.iter().map(|r| T::from_f64(*r)), sds(noise))
}

/// Standard deviations of the channels.
fn sds(noise: &Noise) -> impl Iterator<Item = f64> {
    let variances = noise.covariance().iter().step_by(noise.dim() + 1);
    variances.map(|v| v.sqrt())
}

/// Checks that the squares of the reading in units of its noise stay finite: norms and likelihoods need them.
fn check_scale<T: Scalar>(
    reading: impl Iterator<Item = T>,
    sds: impl Iterator<Item = f64>,
) -> Result<(), CoreError> {
    let squares: f64 = (reading.zip(sds))
        .map(|(value, sd)| (value.to_f64() / sd).powi(2))
        .sum();
    if squares.is_finite() {
        Ok(())
    } else {
        Err(CoreError::Overflow { what: "reading" })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn observation() -> Observation<f64> {
        let mut obs = Observation::new(Noise::uniform(2, 0.5).unwrap());
        obs.rebuild_rows(9, &[2, 5], &[1.0, -1.0], |w| {
            w.copy_from_slice(&[1.0, 2.0, 3.0, 4.0]);
        })
        .unwrap();
        obs
    }

    #[test]
    fn how_it_was_written_makes_no_difference() {
        let by_rows = observation();
        let mut by_columns = by_rows.clone();
        by_columns
            .rebuild(9, &[2, 5], &[1.0, -1.0], |k, w| {
                w.copy_from_slice(&[by_rows.row(0)[k], by_rows.row(1)[k]]);
            })
            .unwrap();
        assert_eq!(by_columns, by_rows);
    }

    #[test]
    fn a_refused_reading_or_noise_changes_nothing() {
        let mut obs = observation();
        for reading in [vec![1.0], vec![f64::NAN, 0.0], vec![1e200, 0.0]] {
            obs.set_reading(&reading).unwrap_err();
        }
        obs.set_noise(&Noise::uniform(3, 1.0).unwrap()).unwrap_err();
        assert_eq!(obs, observation());
        obs.set_reading(&[1e150, 0.0]).unwrap();
        let small = Noise::uniform(2, 1e-10).unwrap();
        assert!(matches!(
            obs.set_noise(&small),
            Err(CoreError::Overflow { .. })
        ));
        obs.set_reading(&[3.0, 4.0]).unwrap();
        assert_eq!(obs.reading(), [3.0, 4.0]);
        assert_eq!(obs.rows(), observation().rows());
    }
}
