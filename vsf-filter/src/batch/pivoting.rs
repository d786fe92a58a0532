use super::quadratic::{Factor, Quadratic};
use crate::exchange::Exchanges;
use vsf_core::CoreError;

/// Sweeps of coordinate descent that guess which unknowns are free.
const SWEEPS: usize = 10;
/// Largest violation of the optimality conditions that counts as none.
const TOLERANCE: f64 = 1e-12;

/// The minimizer within `x >= 0`.
#[derive(Debug)]
pub(super) struct Optimum {
    pub(super) x: Vec<f64>,
    pub(super) gradient: Vec<f64>,
    /// Of the unknowns that are free there.
    pub(super) factor: Factor,
    /// Largest violation of the optimality conditions. With every unknown in units of
    /// `H_ii^-1/2`, relative to the largest of `b` and `x`.
    pub(super) kkt_residual: f64,
    pub(super) factorizations: usize,
}

/// [Block principal pivoting](Exchanges): solve for the free unknowns, then exchange those that came out wrong
/// (negative, or held at zero against the gradient).
///
/// # Reference
/// J. Kim, H. Park, *Fast Nonnegative Matrix Factorization: An Active-Set-Like Method and
/// Comparisons*, SIAM J. Sci. Comput. 33 (2011), doi 10.1137/110821172.
pub(super) fn minimize(problem: &dyn Quadratic) -> Result<Optimum, CoreError> {
    let n = problem.linear().len();
    let unit: Vec<f64> = problem.diagonal().iter().map(|h| 1.0 / h.sqrt()).collect();
    let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
    let size_b = largest(&mut (0..n).map(|i| problem.linear()[i].abs() * unit[i]));
    let guess = problem.descend(SWEEPS);
    let mut free: Vec<bool> = guess.iter().map(|x| *x > 0.0).collect();
    let mut factor: Option<Factor> = None;
    let mut exchanges = Exchanges::new(n);
    let mut factorizations = 0;
    while exchanges.singles() <= 100 * n {
        let near = factor
            .as_ref()
            .and_then(|f| problem.minimizer_near(f, &free));
        let is_near = near.is_some();
        let x = if let Some(x) = near {
            x
        } else {
            factorizations += 1;
            let new = problem.factor((0..n).filter(|&i| free[i]).collect())?;
            let x = problem.minimizer(&new);
            factor = Some(new);
            x
        };
        let gradient = problem.gradient(&x);
        for values in [&x, &gradient] {
            if values.iter().any(|v| !v.is_finite()) {
                return Err(CoreError::Overflow { what: "stiffness" });
            }
        }
        let size = largest(&mut (0..n).map(|i| x[i].abs() / unit[i])).max(size_b);
        let slope = |i: usize| gradient[i] * unit[i];
        // The gradient of free unknowns is rounding, and that of the others no better.
        let rounding = largest(&mut (0..n).filter(|&i| free[i]).map(|i| slope(i).abs()));
        let tolerance = (TOLERANCE * size).max(4.0 * rounding);
        let is_wrong = |i: &usize| {
            if free[*i] {
                x[*i] < 0.0
            } else {
                slope(*i) < -tolerance
            }
        };
        let wrong: Vec<usize> = (0..n).filter(is_wrong).collect();
        if wrong.is_empty() {
            // The end is solved with a factor of its own.
            if let Some(factor) = factor.take_if(|_| !is_near) {
                let held = largest(&mut (0..n).filter(|&i| !free[i]).map(|i| -slope(i)));
                return Ok(Optimum {
                    x,
                    gradient,
                    factor,
                    kkt_residual: rounding.max(held) / size.max(f64::MIN_POSITIVE),
                    factorizations,
                });
            }
            factor = None;
            continue;
        }
        exchanges.exchange(&mut free, &wrong);
    }
    // Only rounding can make the exchanges go round in circles.
    Err(CoreError::other(
        "the points at zero of the batch optimum did not settle: prior and noise are further apart than numbers \
         of 64 bits can tell; give a larger noise sd or a smaller prior sd",
    ))
}
