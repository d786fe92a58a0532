use crate::FieldPrior;
use faer::linalg::solvers::{DenseSolveCore, Llt, Solve};
use faer::{Mat, Side};
use vsf_core::{Belief, CoreError, Observation, SymmetricFactor};

/// Most exchanges of the whole infeasible set before single exchanges guarantee the end.
const FULL_EXCHANGES: usize = 3;

/// The true constrained optimum over all observations at once: the non-negative maximum a
/// posteriori field
///
/// `argmin_{K >= 0} sum_t |tau_t - W_t K|²_{R_t^-1} + |K - mean|²_{diag(variance)^-1}`.
///
/// Observations are gathered into normal equations of the touched points; `n` of them take
/// `8 n²` bytes, a solution `O(n³)` time. Points never touched keep the prior.
///
/// # Reference
/// Block principal pivoting: J. Kim, H. Park, *Fast Nonnegative Matrix Factorization: an
/// Active-Set-Like Method*, SIAM J. Sci. Comput. 33 (2011), doi 10.1137/110821172.
///
/// ```
/// use vsf_core::{Belief, Noise, Observation};
/// use vsf_filter::BatchMap;
/// let mut obs = Observation::new(Noise::uniform(1, 0.1)?);
/// let mut batch = BatchMap::new(2, [0, 1])?;
/// for (w, force) in [([1.0, 1.0], 3.0), ([1.0, -1.0], 5.0)] {
///     obs.rebuild(2, &[0, 1], &[force], |k, column| column[0] = w[k])?;
///     batch.add(&obs, 1.0)?;
/// }
/// // Unconstrained, the answer would be (4, -1).
/// let fit = batch.solve(&Belief::uniform(2, 0.0, 100.0)?)?;
/// assert_eq!(fit.belief.mean()[1], 0.0);
/// assert!((fit.belief.mean()[0] - 4.0).abs() < 1e-4 && fit.kkt_residual < 1e-9);
/// # Ok::<(), vsf_core::CoreError>(())
/// ```
#[derive(Debug, Clone)]
pub struct BatchMap {
    points: Vec<u32>,
    slot: Vec<u32>,
    gram: Mat<f64>,
    rhs: Vec<f64>,
}

/// A solution of [`BatchMap`].
#[derive(Debug, Clone, PartialEq)]
pub struct BatchFit {
    /// Means: the optimum. Variances: the marginals of the Gaussian posterior of the points with
    /// `K > 0`; points held at zero have their
    /// conditional variance, a lower bound of the marginal one.
    pub belief: Belief<f64>,
    /// Largest violation of the optimality conditions, relative to the largest gradient at zero.
    pub kkt_residual: f64,
    /// Factorisations needed.
    pub iterations: usize,
}

impl BatchMap {
    /// Empty normal equations of a field of `field_len` points, for the given touched points
    /// (strictly increasing).
    ///
    /// # Errors
    /// Points out of order or beyond the field.
    pub fn new(field_len: usize, points: impl IntoIterator<Item = u32>) -> Result<Self, CoreError> {
        let points: Vec<u32> = points.into_iter().collect();
        let mut slot = vec![u32::MAX; field_len];
        for (k, &p) in points.iter().enumerate() {
            if k > 0 && p <= points[k - 1] {
                let previous = points[k - 1] as usize;
                return Err(CoreError::Unordered {
                    previous,
                    index: p as usize,
                });
            }
            *slot.get_mut(p as usize).ok_or(CoreError::OutOfRange {
                what: "touched point",
                index: p as usize,
                len: field_len,
            })? = k as u32;
        }
        let n = points.len();
        Ok(Self {
            points,
            slot,
            gram: Mat::zeros(n, n),
            rhs: vec![0.0; n],
        })
    }

    /// Adds an observation with a weight: 1 takes it in, -1 takes it out again.
    ///
    /// # Errors
    /// A point that was not announced, a weight that is not finite.
    pub fn add(&mut self, obs: &Observation<f64>, weight: f64) -> Result<(), CoreError> {
        CoreError::check_finite("weight", &[weight])?;
        obs.check_fits(self.slot.len())?;
        let unknown = obs
            .points()
            .iter()
            .find(|&&p| self.slot[p as usize] == u32::MAX);
        if let Some(&p) = unknown {
            let len = self.points.len();
            return Err(CoreError::OutOfRange {
                what: "untouched point",
                index: p as usize,
                len,
            });
        }
        let (d, n) = (obs.dim(), obs.len());
        let mut factor = SymmetricFactor::default();
        factor.factor("noise covariance", d, obs.noise().covariance())?;
        // Whitened columns, one after another.
        let mut white = vec![0.0; d * n];
        for (k, column) in white.chunks_mut(d.max(1)).enumerate() {
            column
                .iter_mut()
                .enumerate()
                .for_each(|(i, c)| *c = obs.row(i)[k]);
            factor.solve_lower(column);
        }
        let mut tau = obs.reading().to_vec();
        factor.solve_lower(&mut tau);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        for (k, a) in white.chunks(d.max(1)).enumerate() {
            let row = self.slot[obs.points()[k] as usize] as usize;
            self.rhs[row] += weight * dot(a, &tau);
            // The lower triangle: points and slots increase together.
            for (l, b) in white.chunks(d.max(1)).enumerate().take(k + 1) {
                let col = self.slot[obs.points()[l] as usize] as usize;
                self.gram[(row, col)] += weight * dot(a, b);
            }
        }
        Ok(())
    }

    /// The touched points.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// The non-negative optimum under an independent Gaussian prior.
    ///
    /// # Errors
    /// A prior of another size than the field, normal equations that are not positive definite.
    pub fn solve(&self, prior: &FieldPrior) -> Result<BatchFit, CoreError> {
        CoreError::check_len("prior", prior.len(), self.slot.len())?;
        let n = self.points.len();
        let at = |k: usize| self.points[k] as usize;
        let inverse = if prior.is_independent() {
            Mat::from_fn(n, n, |i, j| {
                if i == j {
                    1.0 / prior.covariance(at(i), at(i))
                } else {
                    0.0
                }
            })
        } else {
            let c = Mat::from_fn(n, n, |i, j| prior.covariance(at(i), at(j)));
            let all: Vec<usize> = (0..n).collect();
            factor(&c, &all)?.inverse()
        };
        let rhs: Vec<f64> = (0..n)
            .map(|k| {
                self.rhs[k]
                    + (0..n)
                        .map(|j| inverse[(k, j)] * prior.mean()[at(j)])
                        .sum::<f64>()
            })
            .collect();
        let hessian = Mat::from_fn(n, n, |i, j| {
            self.gram[(i.max(j), i.min(j))] + inverse[(i, j)]
        });
        let scale = rhs.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        let tolerance = 1e-12 * scale;

        let mut free = vec![true; n];
        let mut fewest = n + 1;
        let mut patience = FULL_EXCHANGES;
        let mut iterations = 0;
        let (mut x, mut gradient);
        loop {
            iterations += 1;
            x = solve_free(&hessian, &rhs, &free)?;
            gradient = (0..n)
                .map(|i| (0..n).map(|j| hessian[(j, i)] * x[j]).sum::<f64>() - rhs[i])
                .collect::<Vec<f64>>();
            let wrong: Vec<usize> = (0..n)
                .filter(|&i| {
                    if free[i] {
                        x[i] < 0.0
                    } else {
                        gradient[i] < -tolerance
                    }
                })
                .collect();
            if wrong.is_empty() {
                break;
            }
            if wrong.len() < fewest {
                (fewest, patience) = (wrong.len(), FULL_EXCHANGES);
            } else {
                patience = patience.saturating_sub(1);
            }
            // With patience gone, only the last wrong point moves: finite, but slow.
            let from = if patience == 0 { wrong.len() - 1 } else { 0 };
            wrong[from..].iter().for_each(|&i| free[i] = !free[i]);
        }
        let kkt = |i: usize| {
            if free[i] {
                gradient[i].abs()
            } else {
                (-gradient[i]).max(0.0)
            }
        };
        let kkt_residual = (0..n).map(kkt).fold(0.0, f64::max) / scale.max(f64::MIN_POSITIVE);
        let mut belief = self.posterior(&prior.marginals()?, &hessian, &free, &x)?;
        if !prior.is_independent() {
            let dev: Vec<f64> = (0..n).map(|k| x[k] - prior.mean()[at(k)]).collect();
            let alpha: Vec<f64> = (0..n)
                .map(|i| (0..n).map(|j| inverse[(i, j)] * dev[j]).sum())
                .collect();
            let slot = &self.slot;
            let m = belief.parts_mut().0;
            for p in 0..prior.len() {
                if slot[p] == u32::MAX {
                    m[p] = (prior.mean()[p]
                        + (0..n)
                            .map(|k| prior.covariance(p, at(k)) * alpha[k])
                            .sum::<f64>())
                    .max(0.0);
                }
            }
        }
        Ok(BatchFit {
            belief,
            kkt_residual,
            iterations,
        })
    }

    fn posterior(
        &self,
        prior: &Belief<f64>,
        hessian: &Mat<f64>,
        free: &[bool],
        x: &[f64],
    ) -> Result<Belief<f64>, CoreError> {
        let mut mean = prior.mean().to_vec();
        let mut variance = prior.variance().to_vec();
        for (k, &p) in self.points.iter().enumerate() {
            mean[p as usize] = x[k];
            variance[p as usize] = 1.0 / hessian[(k, k)];
        }
        let set: Vec<usize> = (0..free.len()).filter(|&i| free[i]).collect();
        if !set.is_empty() {
            let covariance = factor(hessian, &set)?.inverse();
            for (a, &i) in set.iter().enumerate() {
                variance[self.points[i] as usize] = covariance[(a, a)];
            }
        }
        Belief::new(mean, variance)
    }
}

fn factor(hessian: &Mat<f64>, set: &[usize]) -> Result<Llt<f64>, CoreError> {
    let part = Mat::from_fn(set.len(), set.len(), |a, b| hessian[(set[a], set[b])]);
    Llt::new(part.as_ref(), Side::Lower).map_err(|_| CoreError::NotPositiveDefinite {
        what: "normal equations",
        pivot: 0,
        value: f64::NAN,
    })
}

/// Minimiser over the free points, the others at zero.
fn solve_free(hessian: &Mat<f64>, rhs: &[f64], free: &[bool]) -> Result<Vec<f64>, CoreError> {
    let set: Vec<usize> = (0..free.len()).filter(|&i| free[i]).collect();
    let mut x = vec![0.0; free.len()];
    if !set.is_empty() {
        let part = Mat::from_fn(set.len(), 1, |a, _| rhs[set[a]]);
        let solution = factor(hessian, &set)?.solve(&part);
        set.iter()
            .enumerate()
            .for_each(|(a, &i)| x[i] = solution[(a, 0)]);
    }
    Ok(x)
}
