use super::algebra::{PAR, add_product, inverse_lower, product, solve_lower};
use super::innovation::Innovation;
use super::joint::{Joint, JointEstimator};
use super::projection::{Projection, Shown};
use super::touched::{Conditional, Touched};
use crate::cholesky::cholesky;
use crate::limit::FACTORIZED;
use crate::prior::FieldPrior;
use crate::values::all_positive;
use faer::Mat;
use vsf_core::{
    Belief, CoreError, Estimator, Observation, Prediction, Scalar, SymmetricFactor, UpdateReport,
};

/// Exact recursive Gaussian filter in information form (eq. 5 of the paper). An update adds `W^T R^-1 W` to
/// the precision matrix of the touched points; the mean follows from its Cholesky factor.
///
/// An update costs `O(n³)` for `n` touched points: seconds for thousands, where [`crate::CovarianceFilter`]
/// reaches the same posterior in milliseconds. It is the paper's own form and serves as an oracle:
/// information is only added, never subtracted, so rounding cannot make the matrix indefinite. Everything
/// is computed in `f64`; `T` is the type of observations and belief. An update allocates.
///
/// At most 32768 points can be touched. Priors and untouched points are handled as in
/// [`crate::CovarianceFilter`]. Points touched for the first time under a correlated prior cost `O(n³)`
/// too. With [`Projection::OutputOnly`], the default here, [`Estimator::predict`], `prefit` and `nis` refer
/// to the Gaussian itself, `postfit` to the belief.
///
/// ```
/// use vsf_core::{Belief, Estimator, Noise, Observation};
/// use vsf_filter::{CovarianceFilter, InformationFilter};
/// let prior = Belief::<f64>::uniform(2, 0.0, 10.0)?;
/// let mut filters: [Box<dyn Estimator<Scalar = f64>>; 2] = [
///     Box::new(InformationFilter::new(prior.clone())?),
///     Box::new(CovarianceFilter::new(prior)?),
/// ];
/// let mut obs = Observation::new(Noise::uniform(1, 0.1)?);
/// obs.rebuild(2, &[0, 1], &[3.0], |k, w| w[0] = [1.0, 0.5][k])?;
/// for filter in &mut filters {
///     filter.update(&obs)?;
///     assert!((filter.belief().mean()[1] - 1.2).abs() < 1e-3);
/// }
/// # Ok::<(), vsf_core::CoreError>(())
/// ```
#[derive(Debug, Clone)]
pub struct InformationFilter<T: Scalar> {
    shown: Shown<T>,
    touched: Touched,
    gaussian: Gaussian,
    innovation: Innovation,
    noise: SymmetricFactor,
}

/// A Gaussian of the touched points, by slots.
#[derive(Debug, Clone)]
struct Gaussian {
    /// `Lambda`, lower triangle.
    precision: Mat<f64>,
    /// `L^-1` with `L L^T = Lambda`; its upper triangle is zero.
    whitener: Mat<f64>,
    mean: Vec<f64>,
    variance: Vec<f64>,
}

impl<T: Scalar> InformationFilter<T> {
    /// Creates a filter that starts from a prior (a [`FieldPrior`] or a [`Belief`]), with
    /// [`Projection::OutputOnly`].
    ///
    /// # Errors
    /// Variances beyond the range of `T`.
    pub fn new(prior: impl Into<FieldPrior>) -> Result<Self, CoreError> {
        Self::with_projection(prior, Projection::OutputOnly)
    }

    /// Creates a filter with the given projection.
    ///
    /// # Errors
    /// Variances beyond the range of `T`, or [`Projection::Constrained`], which only
    /// [`crate::CovarianceFilter`] supports.
    pub fn with_projection(
        prior: impl Into<FieldPrior>,
        projection: Projection,
    ) -> Result<Self, CoreError> {
        if projection == Projection::Constrained {
            return Err(CoreError::Unsupported {
                what: "Projection::Constrained",
                by: std::any::type_name::<Self>(),
            });
        }
        let prior = prior.into();
        Ok(Self {
            shown: Shown::new(&prior, projection)?,
            touched: Touched::new(prior),
            gaussian: Gaussian::empty(),
            innovation: Innovation::default(),
            noise: SymmetricFactor::default(),
        })
    }

    /// How negative means are handled.
    pub fn projection(&self) -> Projection {
        self.shown.projection
    }

    fn show(&mut self) -> usize {
        let Gaussian { mean, variance, .. } = &mut self.gaussian;
        self.shown.show(self.touched.points(), mean, variance)
    }

    fn touch(&mut self, points: &[u32]) -> Result<(), CoreError> {
        let unseen = self.touched.unseen(points)?;
        if unseen.is_empty() {
            return Ok(());
        }
        self.touched.check_room(unseen.len(), FACTORIZED)?;
        let conditional = self.touched.condition(&unseen)?;
        let Conditional { onto, share, .. } = &conditional;
        let gain = product(onto.as_ref(), share.transpose());
        let grown = if onto.ncols() == 0 {
            self.gaussian.append(&conditional.covariance)
        } else {
            self.gaussian.extend(&gain, &conditional.corner)?
        };
        let prior_mean = self.touched.prior().mean();
        let mean = |b: usize| {
            let known = self.touched.points().iter().zip(&self.gaussian.mean);
            let moved = known
                .enumerate()
                .map(|(slot, (&p, now))| gain[(slot, b)] * (now - prior_mean[p as usize]));
            prior_mean[unseen[b] as usize] + moved.sum::<f64>()
        };
        let old = self.gaussian.mean.iter().copied();
        let mean = old.chain((0..unseen.len()).map(mean)).collect();
        self.touched.append(&unseen, &conditional);
        self.gaussian = Gaussian { mean, ..grown };
        Ok(())
    }

    /// The posterior of one observation of touched points.
    fn correct(&mut self, obs: &Observation<T>) -> Result<Gaussian, CoreError> {
        let (n, d) = (self.touched.len(), obs.dim());
        let now = &self.gaussian;
        let slots = obs.points().iter().filter_map(|&p| self.touched.slot(p));
        let slots: Vec<usize> = slots.collect();
        let mut w = Mat::<f64>::zeros(n, d);
        for i in 0..d {
            for (&slot, x) in slots.iter().zip(obs.row(i)) {
                w[(slot, i)] = x.to_f64();
            }
        }
        let gain = now.times(&w);
        self.innovation.measure(
            obs,
            |k| now.mean[slots[k]],
            |k, row| {
                row.iter_mut()
                    .enumerate()
                    .for_each(|(i, y)| *y = gain[(slots[k], i)]);
            },
        )?;

        // Eq. 5 with columns and residual whitened by the noise.
        self.noise
            .factor("noise covariance", d, obs.noise().covariance())?;
        let mut residual = self.innovation.residual.clone();
        self.noise.solve_lower(&mut residual);
        let white = |k: usize| {
            let mut column: Vec<f64> = (0..d).map(|i| obs.row(i)[k].to_f64()).collect();
            self.noise.solve_lower(&mut column);
            column
        };
        let columns: Vec<Vec<f64>> = (0..obs.len()).map(white).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let mut precision = now.precision.clone();
        let mut information = Mat::zeros(n, 1);
        for (&i, a) in slots.iter().zip(&columns) {
            information[(i, 0)] = dot(a, &residual);
            for (&j, b) in slots.iter().zip(&columns).filter(|(j, _)| **j <= i) {
                precision[(i, j)] += dot(a, b);
            }
        }
        let mut next = Gaussian::from_precision(precision)?;
        let shift = next.times(&information);
        let mean = now.mean.iter().enumerate();
        next.mean = mean.map(|(i, m)| m + shift[(i, 0)]).collect();
        let representable =
            |m: &f64, v: &f64| T::from_f64(*m).is_finite() && all_positive(&[T::from_f64(*v)]);
        if next
            .mean
            .iter()
            .zip(&next.variance)
            .all(|(m, v)| representable(m, v))
        {
            Ok(next)
        } else {
            Err(CoreError::Overflow {
                what: "mean or variance of a point",
            })
        }
    }
}

impl Gaussian {
    fn empty() -> Self {
        Self {
            precision: Mat::new(),
            whitener: Mat::new(),
            mean: Vec::new(),
            variance: Vec::new(),
        }
    }

    /// With means still missing.
    fn from_precision(precision: Mat<f64>) -> Result<Self, CoreError> {
        let n = precision.nrows();
        let mut root = precision.clone();
        cholesky("precision of the touched points", &mut root, PAR)?;
        let whitener = inverse_lower(&root);
        let variance: Vec<f64> = (0..n).map(|i| whitener.col(i).squared_norm_l2()).collect();
        Ok(Self {
            precision,
            whitener,
            mean: Vec::new(),
            variance,
        })
    }

    /// `P x`.
    fn times(&self, x: &Mat<f64>) -> Mat<f64> {
        let white = product(self.whitener.as_ref(), x.as_ref());
        product(self.whitener.transpose(), white.as_ref())
    }

    /// With new points of given variances, independent of all others; means still missing.
    fn append(&self, covariance: &Mat<f64>) -> Self {
        let n = self.precision.nrows();
        let rows = n + covariance.nrows();
        let diagonal = |old: &Mat<f64>, new: &dyn Fn(f64) -> f64| {
            Mat::from_fn(rows, rows, |i, j| {
                if i < n && j < n {
                    old[(i, j)]
                } else if i == j {
                    new(covariance[(i - n, i - n)])
                } else {
                    0.0
                }
            })
        };
        let new = (0..covariance.nrows()).map(|b| covariance[(b, b)]);
        Self {
            precision: diagonal(&self.precision, &|v| 1.0 / v),
            whitener: diagonal(&self.whitener, &f64::sqrt),
            mean: Vec::new(),
            variance: self.variance.iter().copied().chain(new).collect(),
        }
    }

    /// With the factor `p(K_b | K_t) = N(G K_t + .., C C^T)` of new points; means still missing.
    fn extend(&self, gain: &Mat<f64>, corner: &Mat<f64>) -> Result<Self, CoreError> {
        let (n, b) = (gain.nrows(), gain.ncols());
        // C^-1 (-G, I), whose square is the factor's precision.
        let mut rows = Mat::from_fn(b, n + b, |i, j| {
            if j < n {
                -gain[(j, i)]
            } else {
                f64::from(i == j - n)
            }
        });
        solve_lower(corner, &mut rows);
        let mut precision = Mat::from_fn(n + b, n + b, |i, j| {
            if i < n && j < n {
                self.precision[(i, j)]
            } else {
                0.0
            }
        });
        add_product(&mut precision, 1.0, rows.transpose(), rows.as_ref());
        Self::from_precision(precision)
    }
}

impl<T: Scalar> Joint<T> for InformationFilter<T> {
    fn touched(&self) -> &Touched {
        &self.touched
    }

    fn marginal(&self, slot: usize) -> (T, T) {
        let Gaussian { mean, variance, .. } = &self.gaussian;
        (T::from_f64(mean[slot]), T::from_f64(variance[slot]))
    }

    fn slot_covariance(&self, i: usize, j: usize) -> T {
        let whitener = &self.gaussian.whitener;
        let pairs = whitener.col(i).iter().zip(whitener.col(j).iter());
        T::from_f64(pairs.map(|(a, b)| a * b).sum())
    }

    fn spread(&self, w: &Mat<f64>) -> Vec<f64> {
        let y = self.gaussian.times(w);
        let spread = |i| (0..w.nrows()).map(|s| w[(s, i)] * y[(s, i)]).sum();
        (0..w.ncols()).map(spread).collect()
    }
}

impl<T: Scalar> JointEstimator for InformationFilter<T> {
    fn restart(&mut self, prior: FieldPrior) -> Result<(), CoreError> {
        *self = Self::with_projection(prior, self.shown.projection)?;
        Ok(())
    }

    fn points(&self) -> &[u32] {
        self.touched.points()
    }

    fn covariance(&self, i: usize, j: usize) -> Option<T> {
        self.covariance_of(i, j)
    }

    fn include(&mut self, points: &[u32]) -> Result<(), CoreError> {
        self.touch(points)?;
        self.show();
        Ok(())
    }

    fn extrapolate(&self, points: &[u32]) -> Result<Belief<T>, CoreError> {
        self.marginals(points)
    }
}

impl<T: Scalar> Estimator for InformationFilter<T> {
    type Scalar = T;

    fn belief(&self) -> &Belief<T> {
        &self.shown.belief
    }

    fn field(&self) -> Result<Belief<T>, CoreError> {
        self.whole(&self.shown.belief, |slot| self.marginal(slot).0)
    }

    fn reset(&mut self, prior: Belief<T>) -> Result<(), CoreError> {
        self.restart(prior.into())
    }

    fn update(&mut self, obs: &Observation<T>) -> Result<UpdateReport, CoreError> {
        obs.check_fits(self.shown.belief.len())?;
        self.touch(obs.points())?;
        self.gaussian = self.correct(obs)?;
        let projected = self.show();
        Ok(self.shown.report(obs, &self.innovation, projected))
    }

    fn whitened_residual(&self) -> &[f64] {
        &self.shown.whitened
    }

    fn predict(&self, obs: &Observation<T>, out: &mut Prediction) -> Result<(), CoreError> {
        self.predict_jointly(obs, out)
    }
}
