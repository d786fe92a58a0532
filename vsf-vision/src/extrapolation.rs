use crate::{Regressor, Samples, Seen, VisionError};
use nalgebra::Point3;
use vsf_core::{Belief, CoreError};

/// Extrapolates a field from its touched points to all others (section III-D): for visible points
/// by position and colour, for hidden ones by position alone, each with its own regressor.
///
/// A hidden point may be empty space. The stiffness of a point is taken as `K_i = o_i k_i`: `k_i`
/// is what the regressors learn, the stiffness of what is there, and `o_i` says whether anything
/// is, with the probability of [`Seen::occupancy`]. That probability comes on top of the paper;
/// `fade = f64::INFINITY` leaves it out.
///
/// The answer is a [`Belief`] about all points: it enters any estimator as its prior, so that later
/// touches correct it, and can be made again after every sequence.
///
/// ```
/// use vsf_core::{Belief, nalgebra::Point3};
/// use vsf_vision::{Extrapolation, Ridge, Seen};
/// // A row of points, brown and stiff at even places, green and soft at odd ones, all in sight.
/// let n = 40;
/// let points: Vec<_> = (0..n).map(|i| Point3::new(0.01 * i as f64, 0.0, 0.0)).collect();
/// let brown = |i: usize| i % 2 == 0;
/// let seen = Seen {
///     visible: vec![true; n],
///     behind: vec![0.0; n],
///     colors: (0..n).map(|i| if brown(i) { [120, 80, 40] } else { [40, 140, 40] }).collect(),
/// };
/// // The first half has been touched: 20 and 5 N/m.
/// let touched: Vec<bool> = (0..n).map(|i| i < n / 2).collect();
/// let truth = |i: usize| if brown(i) { 20.0 } else { 5.0 };
/// let mean = (0..n).map(|i| if touched[i] { truth(i) } else { 0.0 }).collect();
/// let variance = (0..n).map(|i| if touched[i] { 0.1 } else { 100.0 }).collect();
/// let field = Belief::new(mean, variance)?;
///
/// let mut extrapolation = Extrapolation::new(Ridge::new(), Ridge::new());
/// let all = extrapolation.extend(&points, &seen, &field, &touched, 100.0)?;
/// assert!(all.mean()[n - 2] > 2.0 * all.mean()[n - 1]); // brown, green
/// assert_eq!(all.mean()[0], 20.0); // touched: as it was
/// # Ok::<(), vsf_vision::VisionError>(())
/// ```
pub struct Extrapolation {
    visible: Box<dyn Regressor>,
    hidden: Box<dyn Regressor>,
    fade: f64,
}

impl Extrapolation {
    /// Default length over which space behind the seen surface becomes empty (m).
    pub const FADE: f64 = 0.03;
    /// Occupancy below which a touched point says nothing about what is there.
    const LEAST_OCCUPANCY: f64 = 0.05;

    /// Regressors for visible and for hidden points.
    pub fn new(visible: impl Regressor + 'static, hidden: impl Regressor + 'static) -> Self {
        Self {
            visible: Box::new(visible),
            hidden: Box::new(hidden),
            fade: Self::FADE,
        }
    }

    /// Another length over which space behind the seen surface becomes empty (m, > 0).
    pub fn with_fade(mut self, fade: f64) -> Self {
        self.fade = fade;
        self
    }

    /// The belief about all points: touched ones as in `field`, the others extrapolated from them.
    /// `prior_variance` (N²/m²) is that of a point before it was touched; how far a touch has
    /// lowered it says how much the point has to tell. Without a touched visible point, or with one
    /// alone, visible points are extrapolated by position, as hidden ones.
    ///
    /// # Errors
    /// Lengths that differ, a fade length that is not positive, fewer than 2 touched points, what the
    /// regressors refuse.
    pub fn extend(
        &mut self,
        points: &[Point3<f64>],
        seen: &Seen,
        field: &Belief<f64>,
        touched: &[bool],
        prior_variance: f64,
    ) -> Result<Belief<f64>, VisionError> {
        let n = points.len();
        CoreError::check_len("seen points", seen.len(), n)?;
        CoreError::check_len("field", field.len(), n)?;
        CoreError::check_len("touched flags", touched.len(), n)?;
        let occupancy = seen.occupancy(self.fade)?;
        let known: Vec<usize> = (0..n)
            .filter(|&i| touched[i] && occupancy[i] >= Self::LEAST_OCCUPANCY)
            .collect();
        let target = |i: usize| field.mean()[i] / occupancy[i];
        let noise =
            |i: usize| own_variance(field.variance()[i], prior_variance) / occupancy[i].powi(2);
        let seen_known: Vec<usize> = known.iter().copied().filter(|&i| seen.visible[i]).collect();
        let by_color = seen_known.len() >= 2;
        let (mut mean, mut variance) = (field.mean().to_vec(), field.variance().to_vec());
        for colored in [true, false] {
            let unknown: Vec<usize> = (0..n)
                .filter(|&i| !touched[i] && (by_color && seen.visible[i]) == colored)
                .collect();
            if unknown.is_empty() {
                continue;
            }
            let (regressor, known) = match colored {
                true => (&mut self.visible, &seen_known),
                false => (&mut self.hidden, &known),
            };
            regressor.fit(&Samples::new(
                seen.features(points, known, colored)?,
                known.iter().map(|&i| target(i)).collect(),
                known.iter().map(|&i| noise(i)).collect(),
            )?)?;
            let found = regressor.predict(&seen.features(points, &unknown, colored)?)?;
            for ((&i, k), v) in unknown.iter().zip(found.mean).zip(found.variance) {
                (mean[i], variance[i]) = occupied(k.max(0.0), v, occupancy[i], prior_variance);
            }
        }
        Ok(Belief::new(mean, variance)?)
    }
}

/// Variance that the touches alone leave: `1 / (1/posterior - 1/prior)`, at most 1e6 times the
/// prior's.
fn own_variance(posterior: f64, prior: f64) -> f64 {
    let most = 1e6 * prior;
    match 1.0 / posterior - 1.0 / prior {
        precision if precision * most > 1.0 => 1.0 / precision,
        _ => most,
    }
}

/// Mean and variance of a stiffness `N(k, v)` that is there with probability `o` and 0 otherwise;
/// the variance is at least a millionth of the prior's.
fn occupied(k: f64, v: f64, o: f64, prior_variance: f64) -> (f64, f64) {
    let mean = o * k;
    let variance = o * (v + k * k) - mean * mean;
    (mean, variance.max(1e-6 * prior_variance))
}
