//! Signal processing of a recording: taring and time derivatives.

use crate::{DataError, Sequence, Table};
use std::ops::Range;

/// Velocity and acceleration of every joint at every sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Derivatives {
    /// Joint velocities [rad/s or m/s].
    pub velocities: Table,
    /// Joint accelerations [rad/s^2 or m/s^2].
    pub accelerations: Table,
}

/// Subtracts from every column its mean over the first `samples` rows. Zero samples change nothing.
///
/// # Errors
/// [`DataError::Argument`] if the table has fewer rows, if numbers are not finite, or if they are so large that the result
/// is not finite.
/// is not.
///
/// ```
/// use vsf_data::{Table, tare};
/// let torques = Table::new(1, vec![1.0, 3.0, 7.0])?;
/// assert_eq!(tare(&torques, 2)?.data(), [-1.0, 1.0, 5.0]);
/// # Ok::<(), vsf_data::DataError>(())
/// ```
pub fn tare(torques: &Table, samples: usize) -> Result<Table, DataError> {
    if samples > torques.rows() {
        return Err(DataError::Argument {
            what: "tare samples",
            problem: format!("{samples} of {} rows", torques.rows()),
        });
    }
    let mut tared = torques.clone();
    if samples > 0 {
        let mean: Vec<f64> = (0..torques.cols())
            .map(|col| torques.column(col).take(samples).sum::<f64>() / samples as f64)
            .collect();
        for row in tared.data_mut().chunks_exact_mut(mean.len()) {
            row.iter_mut().zip(&mean).for_each(|(v, m)| *v -= m);
        }
    }
    if let Some(value) = tared.data().iter().find(|v| !v.is_finite()) {
        return Err(DataError::Argument {
            what: "tared readings",
            problem: format!("{value} is not finite"),
        });
    }
    Ok(tared)
}

/// Time derivative of every column: at each sample, the slope of the least-squares parabola through the `2 half_window + 1`
/// nearest samples.
///
/// This is the Savitzky-Golay filter of degree 2 for any sampling times (Savitzky & Golay 1964, doi:10.1021/ac60214a047).
/// It is exact for parabolas. `half_window = 1` is the plain central difference, without smoothing. On white noise, a wider
/// window of `m` evenly spaced samples divides the variance by about `m^3 / 24`. Near the ends, the window keeps its size
/// and is no longer centered. Two samples give their straight slope.
///
/// # Errors
/// [`DataError::Argument`] for times that do not increase or do not match the rows, values that are not finite, fewer than
/// two samples, `half_window = 0`, or a slope beyond the range of `f64`.
///
/// ```
/// use vsf_data::{Table, differentiate};
/// let time = [0.0, 0.1, 0.3, 0.4];
/// let x = Table::new(1, time.iter().map(|t| t * t).collect())?;
/// let v = differentiate(&time, &x, 1)?;
/// assert!((v[2][0] - 0.6).abs() < 1e-12);
/// # Ok::<(), vsf_data::DataError>(())
/// ```
pub fn differentiate(time: &[f64], values: &Table, half_window: usize) -> Result<Table, DataError> {
    let all = std::iter::once(0..values.rows());
    derivative(time, values, half_window, all, None)
}

impl Sequence {
    /// Velocities as recorded, or estimated from the angles, and accelerations estimated from the velocities.
    ///
    /// Both estimates use [`differentiate`], touch by touch, since nothing is known between two touches. A touch of one
    /// sample with a recorded velocity gets an acceleration of zero.
    ///
    /// # Errors
    /// As [`Sequence::check`] and [`differentiate`]; in particular, a touch of one sample without recorded velocities.
    pub fn derivatives(&self, half_window: usize) -> Result<Derivatives, DataError> {
        self.check()?;
        let slope =
            |table, of_one| derivative(&self.time, table, half_window, self.touches(), of_one);
        let (velocities, of_one) = match &self.velocities {
            Some(recorded) => (recorded.clone(), Some(0.0)),
            None => (slope(&self.angles, None)?, None),
        };
        Ok(Derivatives {
            accelerations: slope(&velocities, of_one)?,
            velocities,
        })
    }
}

/// Slopes within each range; `of_one` is the slope of a range of one sample, if it may have one.
fn derivative(
    time: &[f64],
    values: &Table,
    half_window: usize,
    ranges: impl Iterator<Item = Range<usize>>,
    of_one: Option<f64>,
) -> Result<Table, DataError> {
    let wrong = |what, problem: String| Err(DataError::Argument { what, problem });
    if half_window == 0 {
        return wrong("half_window", "must be at least 1".to_owned());
    }
    if time.len() != values.rows() {
        let problem = format!("{} stamps for {} rows", time.len(), values.rows());
        return wrong("time", problem);
    }
    let not_later = time.windows(2).position(|w| w[1] <= w[0]);
    let not_finite = time.iter().position(|t| !t.is_finite());
    if let Some(row) = not_finite.or(not_later.map(|k| k + 1)) {
        let problem = format!("row {row} is not later than the row before, or not finite");
        return wrong("time", problem);
    }
    if let Some((row, column, value)) = values.first_not_finite() {
        return wrong("values", format!("row {row} column {column}: {value}"));
    }
    let mut slopes = Vec::with_capacity(values.data().len());
    for range in ranges {
        if let (Some(slope), 1) = (of_one, range.len()) {
            slopes.extend(vec![slope; values.cols()]);
            continue;
        }
        if range.len() < 2 || range.end > time.len() {
            let problem = format!("rows {range:?}: a derivative needs at least two samples");
            return wrong("values", problem);
        }
        let size = range
            .len()
            .min(half_window.saturating_mul(2).saturating_add(1));
        for row in range.clone() {
            let first = row
                .saturating_sub(half_window)
                .clamp(range.start, range.end - size);
            let weights = slope_weights(&time[first..first + size], time[row]);
            slopes.extend((0..values.cols()).map(|col| {
                // Differences to the value itself keep the digits of a small change.
                let here = values[row][col];
                let change = |k: usize| values[first + k][col] - here;
                weights
                    .iter()
                    .enumerate()
                    .map(|(k, w)| w * change(k))
                    .sum::<f64>()
            }));
        }
    }
    let slopes = Table::new(values.cols(), slopes)?;
    match slopes.first_not_finite() {
        None => Ok(slopes),
        Some((row, ..)) => wrong("values", format!("row {row}: the slope overflows")),
    }
}

/// Weights of the samples at times `t` in the slope at `at` of their least-squares parabola, computed from polynomials that
/// are orthogonal over the samples.
fn slope_weights(t: &[f64], at: f64) -> Vec<f64> {
    let n = t.len() as f64;
    let span = t[t.len() - 1] - t[0];
    let x: Vec<f64> = t.iter().map(|t| (t - at) / span).collect();
    // p1 = x - a, p2 = (x - b) p1 - c
    let a = x.iter().sum::<f64>() / n;
    let p1 = || x.iter().map(|x| x - a);
    let norm1: f64 = p1().map(|p| p * p).sum();
    let b = p1().zip(&x).map(|(p, x)| x * p * p).sum::<f64>() / norm1;
    let p2 = || p1().zip(&x).map(|(p, x)| (x - b) * p - norm1 / n);
    let norm2: f64 = p2().map(|p| p * p).sum();
    // Slope of p2 at x = 0; two samples have no parabola.
    let curve = if t.len() > 2 { -(a + b) / norm2 } else { 0.0 };
    p1().zip(p2())
        .map(|(p1, p2)| (p1 / norm1 + curve * p2) / span)
        .collect()
}
