//! Finds the mode within `K >= 0` exactly, from the set of points held at zero.

use super::algebra::{PAR, solve_lower, solve_lower_transposed};
use crate::cholesky::cholesky;
use crate::exchange::Exchanges;
use faer::Mat;

/// Most exchanges.
const MOST: usize = 500;
/// Most points held at zero, whose covariance is factored; and most multiplications of all turns, about a minute's.
const MOST_HELD: usize = 4096;
const MOST_WORK: f64 = 1e11;
/// Those of a covariance that is looked up.
const COVARIANCE: f64 = 10.0;

/// Mode and multipliers of a Gaussian of mean `mu`: `x = mu + P lambda`, both `>= 0` and one of them zero in every point.
pub(super) struct Pivoted {
    pub(super) x: Vec<f64>,
    pub(super) lambda: Vec<f64>,
}

/// [Block principal pivoting](Exchanges), starting from the points that are `held` at zero: solve for their multipliers,
/// then exchange all points that came out wrong (a negative multiplier, or a negative value).
///
/// `covariance(i, j)` is `P`. Violations up to `tolerance` are ignored, in units of the deviations of which `unit` are the
/// reciprocals. `None` if rounding prevents an end, too many points are held, or it would take minutes.
pub(super) fn pivot(
    mu: &[f64],
    covariance: impl Fn(usize, usize) -> f64,
    mut held: Vec<bool>,
    unit: &[f64],
    tolerance: f64,
) -> Option<Pivoted> {
    let n = mu.len();
    let mut exchanges = Exchanges::new(n);
    let mut work = 0.0;
    for _ in 0..MOST {
        let of: Vec<usize> = (0..n).filter(|&i| held[i]).collect();
        let held_points = of.len() as f64;
        work += held_points.powi(3) / 3.0 + COVARIANCE * held_points * n as f64;
        if of.len() > MOST_HELD || work > MOST_WORK {
            return None;
        }
        let mut factor = Mat::from_fn(of.len(), of.len(), |a, b| {
            if a >= b {
                covariance(of[a], of[b])
            } else {
                0.0
            }
        });
        cholesky("covariance of the points at zero", &mut factor, PAR).ok()?;
        let mut multipliers = Mat::from_fn(of.len(), 1, |a, _| -mu[of[a]]);
        solve_lower(&factor, &mut multipliers);
        solve_lower_transposed(&factor, &mut multipliers);
        let (mut x, mut lambda) = (mu.to_vec(), vec![0.0; n]);
        for (a, &j) in of.iter().enumerate() {
            lambda[j] = multipliers[(a, 0)];
            for (i, x) in x.iter_mut().enumerate() {
                *x += lambda[j] * covariance(i, j);
            }
        }
        of.iter().for_each(|&j| x[j] = 0.0);
        let violation = |i: usize| {
            unit[i]
                * if held[i] {
                    lambda[i] * covariance(i, i)
                } else {
                    x[i]
                }
        };
        if (0..n).any(|i| !violation(i).is_finite()) {
            return None;
        }
        let wrong: Vec<usize> = (0..n).filter(|&i| violation(i) < -tolerance).collect();
        if wrong.is_empty() {
            let zeros = x.iter_mut().chain(&mut lambda);
            zeros.for_each(|v| *v = v.max(0.0));
            return Some(Pivoted { x, lambda });
        }
        exchanges.exchange(&mut held, &wrong);
    }
    None
}
