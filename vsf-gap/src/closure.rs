use crate::bootstrap::Bootstrap;
use crate::evidence::{Factor, Spread};
use crate::fitted::Fitted;
use crate::{Campaign, ContactLog, GapError, JointNoise, Model, Motion};
use std::ops::Range;
use std::sync::Arc;
use vsf_core::CoreError;

/// Rounds of removing points whose stiffness came out negative.
const ROUNDS: usize = 3;

/// Residuals of a model on sequences, per sample and joint.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Residuals {
    /// Number of joints.
    pub joints: usize,
    /// Measured minus predicted (N m or N), one vector per sequence: sample after sample, with all joints of each.
    pub rows: Vec<Vec<f64>>,
    /// Predictions of the model (N m or N), in the same layout.
    pub predicted: Vec<Vec<f64>>,
}

/// How far a model closes the gap of another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Closure {
    /// `(G0² - G1²) / (G0² - F²)`. Never NaN: 0 if the first model leaves no gap.
    pub fraction: f64,
    /// 95 % interval, by block bootstrap.
    pub interval: [f64; 2],
    /// Lower bound: the fraction exceeds it in 95 % of the draws.
    pub least: f64,
}

impl Residuals {
    /// Mean over samples of the norm of the residual.
    pub fn mean_error(&self) -> f64 {
        self.mean_error_of(|_| true)
    }

    /// Mean norm over the samples for which `holds`, given the index among all samples, is true.
    pub(crate) fn mean_error_of(&self, holds: impl Fn(usize) -> bool) -> f64 {
        let of = self.squares().enumerate().filter(|(k, _)| holds(*k));
        let norms: Vec<f64> = of.map(|(_, square)| square.sqrt()).collect();
        norms.iter().sum::<f64>() / norms.len().max(1) as f64
    }

    /// Mean over samples of the squared norm.
    pub fn mean_square(&self) -> f64 {
        let squares: Vec<f64> = self.squares().collect();
        squares.iter().sum::<f64>() / squares.len().max(1) as f64
    }

    /// Residuals of some samples of a sequence, given by its index.
    pub(crate) fn of(&self, (sequence, rows): &(usize, Range<usize>)) -> &[f64] {
        &self.rows[*sequence][rows.start * self.joints..rows.end * self.joints]
    }

    /// Squared norm of every sample.
    fn squares(&self) -> impl Iterator<Item = f64> + '_ {
        let samples = (self.rows.iter()).flat_map(|rows| rows.chunks_exact(self.joints.max(1)));
        samples.map(|r| r.iter().map(|v| v * v).sum())
    }
}

/// Mean norm of pure noise.
pub(crate) fn noise_norm(noise: &[JointNoise]) -> f64 {
    let variance: f64 = noise.iter().map(|n| n.sd * n.sd).sum();
    let fourth: f64 = noise.iter().map(|n| n.sd.powi(4)).sum();
    if fourth == 0.0 {
        return variance.sqrt();
    }
    // Mean of a chi distribution of as many degrees of freedom as give the same spread (B. L. Welch and F. E.
    // Satterthwaite): exact for equal channels, off by 1.5 % at most for others.
    let freedom = variance * variance / fourth;
    let ratio = (libm::lgamma(0.5 * (freedom + 1.0)) - libm::lgamma(0.5 * freedom)).exp();
    (2.0 * variance / freedom).sqrt() * ratio
}

impl Campaign {
    /// The field of a fitted model, not negative, and the factored covariance of the readings. Points that come out
    /// negative are removed from the model, a few times over.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn field(
        &self,
        fitted: &mut Fitted<'_>,
        spread: &Spread,
    ) -> Result<(Vec<f64>, Factor), GapError> {
        let mut factor = fitted.parts.factor(spread)?;
        let mut field = fitted.stiffness(self, spread, &factor);
        for _ in 0..ROUNDS {
            if field.iter().all(|k| *k >= 0.0) {
                break;
            }
            fitted.leave_out(self, |p| field[p as usize] < 0.0);
            factor = fitted.parts.factor(spread)?;
            field = fitted.stiffness(self, spread, &factor);
        }
        field.iter_mut().for_each(|k| *k = k.max(0.0));
        Ok((field, factor))
    }

    /// Residuals of a model with its field on sequences of the session, or on parts of them.
    ///
    /// `stiffness` has one value per rest point (N/m).
    ///
    /// # Errors
    /// A field that is not finite or whose length is not the number of rest points; a sequence that the session does not
    /// hold; rows that contact cannot take.
    pub fn residuals(
        &self,
        model: &Model,
        field: &[f64],
        motions: &[&Motion],
    ) -> Result<Residuals, GapError> {
        CoreError::check_len("stiffness", field.len(), self.site.rest.len())?;
        CoreError::check_finite("stiffness", field)?;
        motions
            .iter()
            .try_for_each(|m| m.check(self.site.joints()))?;
        // What an effect has done to the object by then needs all that came before.
        let session = self.session();
        let logs = self.contact_logs(model, &session)?;
        self.residuals_in(model, field, motions, &session, &logs)
    }

    /// [`Campaign::residuals`] with the contact of the session already computed.
    ///
    /// # Errors
    /// A sequence that the session does not hold; parameters that an effect cannot take.
    pub(crate) fn residuals_in(
        &self,
        model: &Model,
        field: &[f64],
        motions: &[&Motion],
        session: &[&Motion],
        logs: &[Arc<ContactLog>],
    ) -> Result<Residuals, GapError> {
        let joints = self.site.joints();
        let mut predicted: Vec<Vec<f64>> = motions
            .iter()
            .map(|m| vec![0.0; m.len() * joints])
            .collect();
        // What is asked for may be a part of a sequence of the session.
        let mut places = vec![Vec::new(); session.len()];
        for (k, asked) in motions.iter().enumerate().filter(|(_, m)| !m.is_empty()) {
            let found = session.iter().enumerate().find_map(|(s, m)| {
                let first = (m.clock.iter()).position(|t| *t == asked.begin())?;
                let inside = m.id == asked.id && first + asked.len() <= m.len();
                inside.then_some((s, first))
            });
            let (s, first) = found.ok_or_else(|| GapError::UnknownSequence {
                id: asked.id.clone(),
            })?;
            places[s].push((k, first..first + asked.len()));
        }
        self.predict(model, session, logs, |s, row, touch, terms| {
            for (k, rows) in places[s].iter().filter(|(_, rows)| rows.contains(&row)) {
                let own = (row - rows.start) * joints;
                terms.apply(touch, field, &mut predicted[*k][own..][..joints]);
            }
        })?;
        let rows = (motions.iter().zip(&predicted))
            .map(|(m, p)| m.reading.data().iter().zip(p).map(|(y, p)| y - p).collect())
            .collect();
        Ok(Residuals {
            joints,
            rows,
            predicted,
        })
    }
}

/// The share of the gap of `before` that `after` closes, with noise as the floor.
pub(crate) fn closure(
    before: &Residuals,
    after: &Residuals,
    noise: &[JointNoise],
    motions: &[Motion],
    seed: u64,
) -> Closure {
    let floor: f64 = noise.iter().map(|n| n.sd * n.sd).sum();
    let (before, after): (Vec<f64>, Vec<f64>) =
        (before.squares().collect(), after.squares().collect());
    let fraction = |sums: &[f64]| {
        let (gap, left) = (sums[0], sums[1]);
        vec![if gap > 0.0 {
            ((gap - left) / gap).clamp(-10.0, 10.0)
        } else {
            0.0
        }]
    };
    let add = |sample: usize, sums: &mut [f64]| {
        sums[0] += before[sample] - floor;
        sums[1] += after[sample] - floor;
    };
    let motions: Vec<&Motion> = motions.iter().collect();
    let found = &Bootstrap::new(&motions, seed).intervals(2, add, fraction)[0];
    Closure {
        fraction: found.value,
        interval: found.interval,
        least: found.least,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of a chi distribution for equal channels, and the integral over the sphere for others.
    #[test]
    fn val_mean_norm_of_noise() {
        let norm = |sds: &[f64]| {
            let correlation = 0.0;
            let of = |&sd| JointNoise { sd, correlation };
            noise_norm(&sds.iter().map(of).collect::<Vec<_>>())
        };
        assert_eq!(norm(&[]), 0.0);
        assert_eq!(norm(&[0.0, 0.0]), 0.0);
        let two_pi = std::f64::consts::TAU;
        assert!((norm(&[0.3]) / 0.3 - (4.0 / two_pi).sqrt()).abs() < 1e-12);
        assert!((norm(&[0.0, 0.3]) / 0.3 - (4.0 / two_pi).sqrt()).abs() < 1e-12);
        assert!((norm(&[2.0; 2]) / 2.0 - (two_pi / 4.0).sqrt()).abs() < 1e-12);
        // Of two channels: sqrt(pi/2) times the mean of the root of a sum of squares over the circle.
        let circle = |a: f64, b: f64| {
            let at = |k: u32| (two_pi * f64::from(k) / 1e4).sin_cos();
            let root = |k| (a * at(k).0).hypot(b * at(k).1);
            (0..10_000).map(root).sum::<f64>() / 1e4 * (two_pi / 4.0).sqrt()
        };
        for (a, b) in [(1.0, 0.1), (1.0, 0.5), (3.0, 2.0)] {
            let (found, expected) = (norm(&[a, b]), circle(a, b));
            assert!((found / expected - 1.0).abs() < 0.015, "{found} {expected}");
        }
    }
}
