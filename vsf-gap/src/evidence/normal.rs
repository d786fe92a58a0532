//! The linear-Gaussian fit of an effect's parameters, within their bounds.

use nalgebra::{DMatrix, DVector};

/// Most rounds per parameter of a fit within bounds, and the slope at a bound (square root of nats) that counts as
/// rounding.
const ROUNDS: usize = 20;
const LEVEL_SLOPE: f64 = 1e-9;

/// The fit of an effect that is linear in its parameters.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    /// Gain of log evidence over the same model without the effect (nats).
    pub(crate) gain: f64,
    /// Parameters with the largest posterior density.
    pub(crate) theta: DVector<f64>,
    /// Their covariance.
    pub(crate) covariance: DMatrix<f64>,
}

/// Information matrix and score of whitened tangents (one column per parameter) for whitened readings.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    /// `T^T C^-1 T`.
    pub(crate) information: DMatrix<f64>,
    /// `T^T C^-1 y`.
    pub(crate) score: DVector<f64>,
    /// Information of the readings on every parameter alone, without the ties between parameters.
    own: DVector<f64>,
}

impl Normal {
    /// From tangents `t` and readings `y`, both whitened.
    pub(crate) fn new(y: &[f64], t: &[&[f64]]) -> Self {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut information = DMatrix::zeros(t.len(), t.len());
        for i in 0..t.len() {
            for j in 0..=i {
                information[(i, j)] = dot(t[i], t[j]);
                information[(j, i)] = information[(i, j)];
            }
        }
        Self {
            own: information.diagonal(),
            information,
            score: DVector::from_fn(t.len(), |i, _| dot(t[i], y)),
        }
    }

    /// Integrates the parameters out under independent priors of mean zero and deviations `sd`.
    ///
    /// Parameters that would leave their bounds are held there. They cost as much evidence as others, since they might have
    /// been anywhere inside. `None` if the numbers do not allow a fit.
    pub(crate) fn fit(&self, sd: &[f64], bounds: &[[f64; 2]]) -> Option<Fit> {
        let p = sd.len();
        let mut theta = DVector::from_fn(p, |i, _| 0.0_f64.clamp(bounds[i][0], bounds[i][1]));
        let mut held: Vec<Option<f64>> = vec![None; p];
        // A primal active set method: each round holds one more or comes to a smaller minimum.
        for _ in 0..ROUNDS * (p + 1) {
            let free: Vec<usize> = (0..p).filter(|&i| held[i].is_none()).collect();
            let fit = self.fit_free(sd, &held, &free)?;
            let reach = |&i: &usize| {
                let [low, high] = bounds[i];
                let (from, to) = (theta[i], fit.theta[i]);
                let bound = to.clamp(low, high);
                (bound != to).then(|| (i, bound, ((bound - from) / (to - from)).clamp(0.0, 1.0)))
            };
            let first = free
                .iter()
                .filter_map(reach)
                .min_by(|a, b| a.2.total_cmp(&b.2));
            if let Some((i, bound, share)) = first {
                theta += share * (&fit.theta - &theta);
                held[i] = Some(bound);
                continue;
            }
            theta.copy_from(&fit.theta);
            match self.leaves_bound(&theta, sd, bounds, &held) {
                Some(i) => held[i] = None,
                None => return fit.gain.is_finite().then_some(fit),
            }
        }
        None
    }

    /// The held parameter that would gain most by moving inside its bounds, if any would.
    fn leaves_bound(
        &self,
        theta: &DVector<f64>,
        sd: &[f64],
        bounds: &[[f64; 2]],
        held: &[Option<f64>],
    ) -> Option<usize> {
        let pull = &self.score - &self.information * theta;
        // Slope of the log posterior toward the inside, in units of the prior's deviation.
        let inward = |i: usize| {
            let slope = sd[i] * pull[i] - theta[i] / sd[i];
            match (held[i]?, bounds[i]) {
                (_, [low, high]) if low == high => None,
                (at, [low, _]) if at == low => Some(slope),
                _ => Some(-slope),
            }
        };
        let size = |i: usize| sd[i] * sd[i] * self.information[(i, i)] + 1.0;
        (0..sd.len())
            .filter_map(|i| Some((i, inward(i)? / size(i).sqrt())))
            .filter(|(_, slope)| *slope > LEVEL_SLOPE)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(i, _)| i)
    }

    fn fit_free(&self, sd: &[f64], held: &[Option<f64>], free: &[usize]) -> Option<Fit> {
        let (p, n) = (sd.len(), free.len());
        let at_bound = DVector::from_fn(p, |i, _| held[i].unwrap_or(0.0));
        let moved = &self.score - &self.information * &at_bound;
        // In units of the prior's deviations.
        let precision = DMatrix::from_fn(n, n, |a, b| {
            let (i, j) = (free[a], free[b]);
            sd[i] * sd[j] * self.information[(i, j)] + f64::from(u8::from(a == b))
        });
        let score = DVector::from_fn(n, |a, _| sd[free[a]] * moved[free[a]]);
        let factor = precision.cholesky()?;
        let best = factor.solve(&score);
        let of_held = self.score.dot(&at_bound)
            - 0.5 * at_bound.dot(&(&self.information * &at_bound))
            - (0..p)
                .map(|i| 0.5 * (at_bound[i] / sd[i]).powi(2))
                .sum::<f64>();
        let gain = 0.5 * score.dot(&best) - 0.5 * self.log_det(sd) + of_held;
        let inverse = factor.inverse();
        let (mut theta, mut covariance) = (at_bound, DMatrix::zeros(p, p));
        // A bound is no certainty.
        for i in (0..p).filter(|&i| held[i].is_some()) {
            covariance[(i, i)] = 1.0 / (self.own[i] + 1.0 / (sd[i] * sd[i]));
        }
        for (a, &i) in free.iter().enumerate() {
            theta[i] = sd[i] * best[a];
            for (b, &j) in free.iter().enumerate() {
                covariance[(i, j)] = sd[i] * sd[j] * inverse[(a, b)];
            }
        }
        Some(Fit {
            gain,
            theta,
            covariance,
        })
    }

    /// `log det (1 + S^1/2 I S^1/2)`: twice the cost of integrating out the parameters.
    pub(crate) fn log_det(&self, sd: &[f64]) -> f64 {
        let p = sd.len();
        let precision = DMatrix::from_fn(p, p, |i, j| {
            sd[i] * sd[j] * self.information[(i, j)] + f64::from(u8::from(i == j))
        });
        match precision.cholesky() {
            Some(factor) => (0..p).map(|i| 2.0 * factor.l_dirty()[(i, i)].ln()).sum(),
            None => f64::INFINITY,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The best of all ways to hold each of three parameters at a bound or not.
    fn best_of_all(normal: &Normal, sd: &[f64; 3], bounds: &[[f64; 2]; 3]) -> Vec<f64> {
        let precision = DMatrix::from_fn(3, 3, |i, j| {
            normal.information[(i, j)] + if i == j { sd[i].powi(-2) } else { 0.0 }
        });
        let cost =
            |theta: &DVector<f64>| 0.5 * theta.dot(&(&precision * theta)) - normal.score.dot(theta);
        let mut best: Option<DVector<f64>> = None;
        for way in 0..27_usize {
            let at = |i: usize| match way / 3_usize.pow(i as u32) % 3 {
                2 => None,
                side => Some(bounds[i][side]),
            };
            // Rows of held parameters say where they are.
            let rows = DMatrix::from_fn(3, 3, |i, j| match at(i) {
                None => precision[(i, j)],
                Some(_) => f64::from(u8::from(i == j)),
            });
            let right = DVector::from_fn(3, |i, _| at(i).unwrap_or(normal.score[i]));
            let Some(theta) = rows.lu().solve(&right) else {
                continue;
            };
            let inside = (0..3)
                .all(|i| theta[i] >= bounds[i][0] - 1e-12 && theta[i] <= bounds[i][1] + 1e-12);
            if inside && best.as_ref().is_none_or(|b| cost(&theta) < cost(b)) {
                best = Some(theta);
            }
        }
        best.map_or_else(Vec::new, |b| b.as_slice().to_vec())
    }

    /// As much as one that is found to be zero: that it might have been anywhere inside.
    #[test]
    fn val_a_parameter_held_at_zero_costs_its_share() {
        let normal = Normal::new(&[-1.0, 0.0], &[&[10.0, 0.0]]);
        let fit = normal.fit(&[1.0], &[[0.0, 5.0]]);
        let gain = fit.map_or(f64::NAN, |f| f.gain);
        assert!((gain + 0.5 * 101_f64.ln()).abs() < 1e-12, "{gain}");
    }

    proptest! {
        /// Columns that resemble each other, so that what is held may have to be let go.
        #[test]
        fn val_fits_within_bounds_are_the_best_of_all(
            columns in prop::array::uniform3(prop::array::uniform4(-1.0..1.0_f64)),
            y in prop::array::uniform4(-10.0..10.0_f64),
            alike in 0.0..0.95_f64,
            sd in prop::array::uniform3(0.1..30.0_f64),
            low in prop::array::uniform3(-2.0..0.0_f64),
            one_sided in prop::array::uniform3(any::<bool>()),
        ) {
            let mixed = columns.map(|c| -> Vec<f64> {
                let pairs = c.iter().zip(&columns[0]);
                pairs.map(|(c, first)| (1.0 - alike) * c + alike * first).collect()
            });
            let normal = Normal::new(&y, &[&mixed[0], &mixed[1], &mixed[2]]);
            let bounds = [0, 1, 2].map(|i| [if one_sided[i] { 0.0 } else { low[i] }, 1.5]);
            let fit = normal.fit(&sd, &bounds).ok_or_else(|| TestCaseError::fail("no fit"))?;
            let expected = best_of_all(&normal, &sd, &bounds);
            for (found, expected) in fit.theta.iter().zip(&expected) {
                prop_assert!((found - expected).abs() < 1e-7, "{} {expected:?}", fit.theta);
            }
        }
    }
}
