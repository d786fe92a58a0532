use crate::{Features, Regressor, Samples, Seen, VisionError};
use nalgebra::Point3;
use vsf_core::{Belief, CoreError};

/// Extrapolates a field from its touched points to all others (section III-D). Visible points are predicted
/// from position and color, hidden points from position alone, each kind by its own regressor.
///
/// A hidden point may be empty space. The stiffness of a point is therefore modeled as `K_i = o_i k_i`. The
/// regressors learn `k_i`, the stiffness of the material. `o_i` says whether there is any, with the
/// probability of [`Seen::occupancy`]. This probability is an addition to the paper; `fade = f64::INFINITY`
/// disables it.
///
/// The result is a [`Belief`] about all points. It can serve as the prior of any estimator, so that later
/// touches correct it, and it can be computed anew after every sequence. [`Extrapolation::predict`]
/// predicts touched points too, as if they had not been touched. Use that as the prior if the same touches
/// are taken in again; their estimates would count them twice.
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
///     in_picture: vec![true; n],
///     colors: (0..n).map(|i| if brown(i) { [120, 80, 40] } else { [40, 140, 40] }).collect(),
///     heights: vec![0.0; n],
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
#[derive(Clone)]
pub struct Extrapolation {
    visible: Box<dyn Regressor>,
    hidden: Box<dyn Regressor>,
    fade: f64,
    learned: Option<Learned>,
}

/// What the regressors have learned from.
#[derive(Debug, Clone)]
struct Learned {
    /// Whether visible points have a regressor of their own.
    by_color: bool,
    prior_variance: f64,
}

impl Extrapolation {
    /// Default length scale over which occupancy fades behind the seen surface (m).
    pub const FADE: f64 = 0.03;
    /// Touched points with an occupancy below this are not learned from.
    pub const LEAST_OCCUPANCY: f64 = 0.05;

    /// Creates an extrapolation with regressors for visible and for hidden points.
    pub fn new(visible: impl Regressor + 'static, hidden: impl Regressor + 'static) -> Self {
        Self {
            visible: Box::new(visible),
            hidden: Box::new(hidden),
            fade: Self::FADE,
            learned: None,
        }
    }

    /// Sets the length scale over which occupancy fades behind the seen surface (m, > 0).
    #[must_use]
    pub fn with_fade(mut self, fade: f64) -> Self {
        self.fade = fade;
        self
    }

    /// Learns from the touched points of a field.
    ///
    /// `prior_variance` (N²/m²) is the variance of a point before it was touched. The more a touch has
    /// reduced it, the more information the point carries. With fewer than 2 touched points in sight,
    /// visible points are predicted from position alone, like hidden ones.
    ///
    /// # Errors
    /// Lengths that differ, a view that [`Seen::check`] refuses, a length or variance that is not positive,
    /// fewer than 2 touched points on or shortly behind the seen surface, or what the regressors refuse.
    pub fn fit(
        &mut self,
        points: &[Point3<f64>],
        seen: &Seen,
        field: &Belief<f64>,
        touched: &[bool],
        prior_variance: f64,
    ) -> Result<(), VisionError> {
        CoreError::check_len("seen points", seen.len(), points.len())?;
        let known = Known::new(seen, field, touched, prior_variance, self.fade)?;
        let samples =
            |of: &[usize], with_colors| known.samples(of, seen.features(points, of, with_colors)?);
        let mut hidden = self.hidden.fresh();
        hidden.fit(&samples(&known.points, false)?)?;
        let in_sight = known.points.iter().copied();
        let in_sight: Vec<usize> = in_sight.filter(|&i| seen.visible[i]).collect();
        let by_color = in_sight.len() >= 2;
        if by_color {
            self.visible.fit(&samples(&in_sight, true)?)?;
        }
        self.hidden = hidden;
        self.learned = Some(Learned {
            by_color,
            prior_variance,
        });
        Ok(())
    }

    /// Predicts the belief about points, touched or not, from appearance and position. Points outside the
    /// picture have mean 0 and the variance of the prior, since nothing is known of them.
    ///
    /// # Errors
    /// [`VisionError::NotFitted`], lengths that differ, a view that [`Seen::check`] refuses, predictions
    /// that [`Predictions::check`](crate::Predictions::check) refuses, or a belief that is not
    /// representable.
    pub fn predict(&self, points: &[Point3<f64>], seen: &Seen) -> Result<Belief<f64>, VisionError> {
        let by = "Extrapolation";
        let learned = self.learned.as_ref().ok_or(VisionError::NotFitted { by })?;
        let n = points.len();
        CoreError::check_len("seen points", seen.len(), n)?;
        let occupancy = seen.occupancy(self.fade)?;
        let (mut mean, mut variance) = (vec![0.0; n], vec![0.0; n]);
        for (regressor, with_colors) in [(&self.visible, true), (&self.hidden, false)] {
            let of: Vec<usize> = (0..n)
                .filter(|&i| (learned.by_color && seen.visible[i]) == with_colors)
                .collect();
            if of.is_empty() {
                continue;
            }
            let found = regressor.predict(&seen.features(points, &of, with_colors)?)?;
            found.check(of.len())?;
            for ((&i, k), v) in of.iter().zip(found.mean).zip(found.variance) {
                (mean[i], variance[i]) = occupied(k.max(0.0), v, occupancy[i]);
                let least = 1e-6 * learned.prior_variance;
                // `max` would take NaN, of squares that overflow, for the least.
                if variance[i] < least {
                    variance[i] = least;
                }
            }
        }
        for i in (0..n).filter(|&i| !seen.in_picture[i]) {
            (mean[i], variance[i]) = (0.0, learned.prior_variance);
        }
        Ok(Belief::new(mean, variance)?)
    }

    /// Calls [`fit`](Self::fit) and returns the belief about all points: touched points as in `field`, the
    /// others as predicted.
    ///
    /// # Errors
    /// As [`fit`](Self::fit) and [`predict`](Self::predict).
    pub fn extend(
        &mut self,
        points: &[Point3<f64>],
        seen: &Seen,
        field: &Belief<f64>,
        touched: &[bool],
        prior_variance: f64,
    ) -> Result<Belief<f64>, VisionError> {
        self.fit(points, seen, field, touched, prior_variance)?;
        let mut belief = self.predict(points, seen)?;
        let (mean, variance) = belief.parts_mut();
        for i in (0..points.len()).filter(|&i| touched[i]) {
            (mean[i], variance[i]) = (field.mean()[i], field.variance()[i]);
        }
        Ok(belief)
    }
}

impl std::fmt::Debug for Extrapolation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Extrapolation")
            .field("fade", &self.fade)
            .field("learned", &self.learned)
            .finish_non_exhaustive()
    }
}

/// Points of whose variance the touches took a smaller share than this tell nothing.
const LEAST_TOLD: f64 = 1e-6;
/// Least number of points to learn from.
const LEAST: usize = 2;

/// The touched points of a field where there is probably something, `K_i = o_i k_i`, and whose readings
/// tell how stiff it is.
pub(crate) struct Known<'a> {
    /// Which they are.
    pub points: Vec<usize>,
    field: &'a Belief<f64>,
    occupancy: Vec<f64>,
    prior_variance: f64,
}

impl<'a> Known<'a> {
    pub fn new(
        seen: &Seen,
        field: &'a Belief<f64>,
        touched: &[bool],
        prior_variance: f64,
        fade: f64,
    ) -> Result<Self, VisionError> {
        let n = seen.len();
        CoreError::check_len("field", field.len(), n)?;
        CoreError::check_len("touched flags", touched.len(), n)?;
        if !(prior_variance > 0.0 && prior_variance.is_finite()) {
            return Err(CoreError::Parameter {
                name: "variance of the prior",
                value: prior_variance,
                range: "> 0 N²/m²",
            }
            .into());
        }
        let occupancy = seen.occupancy(fade)?;
        let in_sight =
            (0..n).filter(|&i| touched[i] && occupancy[i] >= Extrapolation::LEAST_OCCUPANCY);
        let in_sight: Vec<usize> = in_sight.collect();
        if in_sight.len() < LEAST {
            return Err(VisionError::Unseen {
                touched: touched.iter().filter(|t| **t).count(),
                seen: in_sight.len(),
            });
        }
        let mut known = Self {
            points: in_sight,
            field,
            occupancy,
            prior_variance,
        };
        let told = known.points.iter().copied();
        known.points = told.filter(|&i| known.told(i) >= LEAST_TOLD).collect();
        match known.points.len() {
            told if told < LEAST => Err(VisionError::Untold { told }),
            _ => Ok(known),
        }
    }

    /// Share of the prior's variance that the touches took off point `i`.
    fn told(&self, i: usize) -> f64 {
        1.0 - self.field.variance()[i] / self.prior_variance
    }

    /// Samples of the stiffness `k_i` of the material at the points `of`, with the given features.
    ///
    /// A mean with variance `V` under a prior with variance `p` counts as `1 - V/p` readings: points that
    /// are touched together share the information of a reading, and `n` of them count as one. For the same
    /// reason the mean is used as it is. Removing the prior from it for each point by itself, by
    /// `m / (1 - V/p)`, would attribute the whole reading to each of them.
    pub fn samples(&self, of: &[usize], features: Features) -> Result<Samples, VisionError> {
        let one = |&i: &usize| {
            let (o, told) = (self.occupancy[i], self.told(i));
            let variance = self.field.variance()[i] / told;
            (self.field.mean()[i] / o, variance / (o * o))
        };
        let (targets, variances) = of.iter().map(one).unzip();
        Samples::new(features, targets, variances)
    }
}

/// Mean and variance of a stiffness `N(k, v)` that is there with probability `o` and 0 otherwise.
fn occupied(k: f64, v: f64, o: f64) -> (f64, f64) {
    let mean = o * k;
    (mean, o * (v + k * k) - mean * mean)
}
