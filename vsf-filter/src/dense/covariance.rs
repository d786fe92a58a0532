#[cfg(feature = "serde")]
mod state;
mod touch;

use super::channels::Channels;
use super::gain::Gain;
use super::innovation::{self, Innovation, norm};
use super::joint::{Joint, JointEstimator};
use super::mode::Mode;
use super::product::Workspace;
use super::projection::{Projection, Shown};
use super::square::{OCTET, Square, dispatch, zero};
use super::tiles::Tiles;
use super::touched::Touched;
use crate::prior::FieldPrior;
use crate::values::{all_finite, all_positive};
use faer::Mat;
use vsf_core::{Belief, CoreError, Estimator, Observation, Prediction, Scalar, UpdateReport};

/// Exact recursive Gaussian filter in covariance form. It keeps one mean per point and the covariance of
/// all touched points.
///
/// An update uses the gain `P W^T (W P W^T + R)^-1`. It gives the posterior of eq. 5 without its `n x n`
/// inverse, in `O(n² d)` for `n` touched points and `d` channels, against `O(n³)` of
/// [`crate::InformationFilter`]. With 7 channels and 4100 contacts of 4300 touched points it takes 6.2 ms
/// of processor time in `f32` and 12.0 ms in `f64` (AMD Zen 4; `benches/dense.rs`), shared by the threads.
/// Following the constrained mean takes another 2.3 ms in `f32`, on one thread.
///
/// The covariance takes `n² / 2` numbers. A point enters it with its first touch and costs nothing before,
/// whatever the size of the field.
///
/// # Priors
/// Any [`FieldPrior`] will do. [`Estimator::reset`] takes marginals and thus an independent prior;
/// [`JointEstimator::restart`] takes any prior.
///
/// Points that are touched for the first time are conditioned on those touched before:
/// - independent prior: free;
/// - shared level: one more pass over the covariance;
/// - smooth in space: `O(n² b)` for `b` new points. The factor of the prior takes another `n²` to `4 n²`
///   numbers of `f64`.
///
/// [`JointEstimator::include`] pays this cost ahead of time.
///
/// # Untouched points
/// For points that were neither touched nor included, [`Estimator::belief`] shows the marginals of the
/// prior. With an independent prior that is their posterior. With a correlated prior, touches carry
/// information about them too. [`JointEstimator::extrapolate`] computes their posterior, in `O(n²)` per
/// point, and [`Estimator::field`] the means of all, in `O(n)` per point. [`Estimator::predict`] makes use
/// of it.
///
/// # Signs
/// By default ([`Projection::Constrained`]) the mean of the belief is the mode of the posterior within
/// `K >= 0`: the optimum that [`crate::BatchMap`] finds from all readings at once. [`Estimator::predict`],
/// `prefit` and `postfit` refer to that mode, and `projected` counts the points that it holds at zero.
/// `nis`, log-likelihood and whitened residual refer to the Gaussian posterior, which is updated as if
/// there were no constraint.
///
/// An update corrects the mode, in at most 16 blocks of 64 points, the worst first. It stops at a
/// [`CovarianceFilter::kkt_residual`] of at most 1e-6 (8e-6 in `f32`); what is left after 16 blocks is
/// corrected by the next updates. [`CovarianceFilter::settle`] corrects all of it at once, and
/// [`Estimator::field`] shows the settled result. The corrections of updates are slow where readings tie
/// points together far more tightly than the prior lets them vary (`W P W^T` of points at zero above some
/// 1e5 times the noise). There the residual stays large, and the mean may be off by as much as a prior sd.
///
/// Variances of points with `K > 0` are the marginals of the Gaussian posterior. For points held at zero
/// they are the mean squared distance from zero of that Gaussian, truncated to the tail that `K_i >= 0`
/// leaves. Both treat the other points at zero as free, where [`crate::BatchFit`] treats them as known:
/// they are upper bounds of the variances that it reports.
///
/// # Numerical accuracy
/// In `f32`, variances err by about a millionth of the *prior's*. (After 1000 updates of 300 points, with
/// variances down to 5e-4 of the prior's: variances by 7e-7, means of the Gaussian by 2e-4 of their sd, and
/// constrained means by 1.2e-3 of their sd.) When the posterior variance itself falls to that level, as
/// with a very wide prior, it is lost: updates then end with [`CoreError::NotPositiveDefinite`] and leave
/// the belief as it was. Use `f64` there.
///
/// At most 32768 points can be touched: an update that touches more is refused with [`CoreError::TooMany`].
///
/// Results are the same bits for any number of threads (of the rayon pool that `update` runs in).
/// Processors without fused multiply-add differ in the last bits. On one thread, an update that touches no
/// new point does not allocate.
///
/// # Reference
/// R. E. Kalman, *A New Approach to Linear Filtering and Prediction Problems*, J. Basic Eng. 82 (1960), doi
/// 10.1115/1.3662552. For conditioning new points: C. E. Rasmussen, C. K. I. Williams, *Gaussian Processes
/// for Machine Learning*, MIT Press 2006, appendix A.2.
///
/// ```
/// use vsf_core::{Belief, Estimator, Noise, Observation};
/// use vsf_filter::{CovarianceFilter, FieldPrior, JointEstimator};
/// // Two springs of about the same stiffness, and only one is touched.
/// let prior = FieldPrior::from(Belief::<f64>::uniform(2, 5.0, 1.0)?).with_level(10.0)?;
/// let mut filter = CovarianceFilter::<f64>::new(prior)?;
/// let mut obs = Observation::new(Noise::uniform(1, 0.1)?);
/// obs.rebuild(2, &[0], &[20.0], |_, w| w[0] = 1.0)?;
/// filter.update(&obs)?;
/// assert!((filter.belief().mean()[0] - 20.0).abs() < 0.1);
/// let other = filter.extrapolate(&[1])?;
/// assert!((other.mean()[0] - 19.8).abs() < 0.1 && other.variance()[0] < 2.1);
/// # Ok::<(), vsf_core::CoreError>(())
/// ```
#[derive(Debug, Clone)]
pub struct CovarianceFilter<T: Scalar> {
    shown: Shown<T>,
    touched: Touched,
    covariance: Tiles<T>,
    /// By slot, before projection.
    mean: Vec<T>,
    variance: Vec<T>,
    /// With [`Projection::Constrained`].
    mode: Option<Mode<T>>,
    scratch: Scratch<T>,
}

/// Buffers of an update.
#[derive(Debug, Clone, Default)]
struct Scratch<T> {
    slots: Vec<usize>,
    w: Channels<T>,
    /// `P W^T`, then `P W^T L^-T`.
    gain: Channels<T>,
    work: Workspace<T>,
    innovation: Innovation,
    /// `L^-1`, a square `[channel of y][channel of v]` for every pair of groups.
    whitening: Vec<Square<T>>,
    /// `L^-1 r`.
    shift: Vec<T>,
    /// `tau - W x` of the mode, then whitened.
    residual: Vec<f64>,
    prefit: f64,
    mean: Vec<T>,
    variance: Vec<T>,
}

impl<T: Scalar> CovarianceFilter<T> {
    /// Creates a filter that starts from a prior (a [`FieldPrior`] or a [`Belief`]), with the default
    /// projection.
    ///
    /// # Errors
    /// Variances beyond the range of `T`.
    pub fn new(prior: impl Into<FieldPrior>) -> Result<Self, CoreError> {
        Self::with_projection(prior, Projection::default())
    }

    /// Creates a filter with the given projection.
    ///
    /// # Errors
    /// Variances beyond the range of `T`.
    pub fn with_projection(
        prior: impl Into<FieldPrior>,
        projection: Projection,
    ) -> Result<Self, CoreError> {
        let prior = prior.into();
        Ok(Self {
            shown: Shown::new(&prior, projection)?,
            touched: Touched::new(prior),
            covariance: Tiles::new(),
            mean: Vec::new(),
            variance: Vec::new(),
            mode: (projection == Projection::Constrained).then(Mode::new),
            scratch: Scratch::default(),
        })
    }

    /// How negative means are handled.
    pub fn projection(&self) -> Projection {
        self.shown.projection
    }

    /// Distance of the mean from the optimum of [`Projection::Constrained`], in standard deviations of the
    /// prior; 0 with other projections.
    ///
    /// It is the largest `|min(x_i, lambda_i P_ii)|` of `x = mu + P lambda`, where `lambda >= 0` are the
    /// multipliers of `K >= 0`.
    pub fn kkt_residual(&self) -> f64 {
        self.mode.as_ref().map_or(0.0, Mode::residual)
    }

    /// Brings the mean of [`Projection::Constrained`] to the optimum: a [`CovarianceFilter::kkt_residual`]
    /// of 1e-10 (8e-6 in `f32`).
    ///
    /// Call it after the last reading, for a field to keep. Where correcting the points one after the other
    /// takes too long, it solves for the `m` points that are held at zero, in `O(m³)`. If more than 4096
    /// are held, or rounding prevents an end, it gives up after 2000 turns; the residual then shows it.
    /// Does nothing with other projections.
    pub fn settle(&mut self) {
        if let Some(mode) = &mut self.mode {
            mode.settle(&self.covariance, &self.mean);
            self.show();
        }
    }

    /// Shows the posterior; returns how many points the projection moved.
    fn show(&mut self) -> usize {
        let points = self.touched.points();
        match &self.mode {
            None => self.shown.show(points, &mut self.mean, &self.variance),
            Some(mode) => self.shown.show_mode(points, mode),
        }
    }

    /// Shows the posterior after a change.
    fn follow(&mut self) -> usize {
        if let Some(mode) = &mut self.mode {
            mode.follow(&self.covariance);
        }
        self.show()
    }

    /// The posterior of one observation of touched points, into the buffers.
    fn correct(&mut self, obs: &Observation<T>) -> Result<(), CoreError> {
        let Scratch {
            slots,
            w,
            gain,
            work,
            innovation,
            whitening,
            shift,
            residual,
            prefit,
            mean,
            variance,
        } = &mut self.scratch;
        slots.clear();
        slots.extend(obs.points().iter().filter_map(|&p| self.touched.slot(p)));
        let d = obs.dim();
        w.clear(self.touched.len(), d);
        for i in 0..d {
            for (&slot, &x) in slots.iter().zip(obs.row(i)) {
                w.set(slot, i, x);
            }
        }
        let groups = w.groups();
        self.covariance.settle(groups);
        self.covariance.times(w, gain, work);
        innovation.measure(
            obs,
            |k| self.mean[slots[k]].to_f64(),
            |k, row| {
                for (i, y) in row.iter_mut().enumerate() {
                    *y = gain.get(slots[k], i).to_f64();
                }
            },
        )?;
        whitening.clear();
        whitening.resize(groups * groups, zero());
        for (i, row) in innovation.whitening().chunks_exact(d.max(1)).enumerate() {
            for (j, &x) in row.iter().enumerate().take(i + 1) {
                whitening[i / OCTET * groups + j / OCTET][j % OCTET].0[i % OCTET] = T::from_f64(x);
            }
        }
        shift.clear();
        shift.extend(innovation.whitened.iter().map(|&x| T::from_f64(x)));
        shift.resize(groups * OCTET, T::ZERO);
        mean.clone_from(&self.mean);
        variance.clone_from(&self.variance);
        dispatch(Gain {
            gain,
            whitening,
            shift,
            mean,
            variance,
        });
        check_means(mean)?;
        check_variances(variance, self.touched.points())?;
        let Some(mode) = &mut self.mode else {
            return Ok(());
        };
        innovation::residual(obs, |k| mode.x(slots[k]).to_f64(), residual);
        *prefit = norm(residual);
        innovation.whiten(residual);
        shift.clear();
        shift.extend(residual.iter().map(|&x| T::from_f64(x)));
        shift.resize(groups * OCTET, T::ZERO);
        if mode.prepare(gain, shift) {
            return Ok(());
        }
        Err(CoreError::Overflow {
            what: "mean stiffness of a point",
        })
    }
}

fn check_means<T: Scalar>(mean: &[T]) -> Result<(), CoreError> {
    if all_finite(mean) {
        return Ok(());
    }
    Err(CoreError::Overflow {
        what: "mean stiffness of a point",
    })
}

fn check_variances<T: Scalar>(variance: &[T], points: &[u32]) -> Result<(), CoreError> {
    match variance.iter().position(|v| !all_positive(&[*v])) {
        None => Ok(()),
        Some(k) => Err(CoreError::NotPositiveDefinite {
            what: "posterior covariance of the touched points",
            pivot: points[k] as usize,
            value: variance[k].to_f64(),
        }),
    }
}

impl<T: Scalar> Joint<T> for CovarianceFilter<T> {
    fn touched(&self) -> &Touched {
        &self.touched
    }

    fn marginal(&self, slot: usize) -> (T, T) {
        match &self.mode {
            None => (self.mean[slot], self.variance[slot]),
            Some(mode) => mode.marginal(slot),
        }
    }

    fn slot_covariance(&self, i: usize, j: usize) -> T {
        if i == j {
            self.variance[i]
        } else {
            self.covariance.get(i, j)
        }
    }

    fn spread(&self, weights: &Mat<f64>) -> Vec<f64> {
        let (mut w, mut y) = (Channels::default(), Channels::default());
        w.clear(weights.nrows(), weights.ncols());
        for i in 0..weights.ncols() {
            for slot in 0..weights.nrows() {
                w.set(slot, i, T::from_f64(weights[(slot, i)]));
            }
        }
        self.covariance.times(&w, &mut y, &mut Workspace::default());
        let spread = |i| {
            let products = (0..weights.nrows()).map(|s| weights[(s, i)] * y.get(s, i).to_f64());
            products.sum()
        };
        (0..weights.ncols()).map(spread).collect()
    }
}

impl<T: Scalar> JointEstimator for CovarianceFilter<T> {
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
        self.follow();
        Ok(())
    }

    fn extrapolate(&self, points: &[u32]) -> Result<Belief<T>, CoreError> {
        self.marginals(points)
    }
}

impl<T: Scalar> Estimator for CovarianceFilter<T> {
    type Scalar = T;

    fn belief(&self) -> &Belief<T> {
        &self.shown.belief
    }

    /// Shows the [settled](CovarianceFilter::settle) mode; the filter itself is not settled by this.
    fn field(&self) -> Result<Belief<T>, CoreError> {
        let Some(mode) = &self.mode else {
            return self.whole(&self.shown.belief, |slot| self.mean[slot]);
        };
        let (mut mode, mut shown) = (mode.clone(), self.shown.clone());
        mode.settle(&self.covariance, &self.mean);
        shown.show_mode(self.touched.points(), &mode);
        self.whole(&shown.belief, |slot| mode.marginal(slot).0)
    }

    fn reset(&mut self, prior: Belief<T>) -> Result<(), CoreError> {
        self.restart(prior.into())
    }

    fn update(&mut self, obs: &Observation<T>) -> Result<UpdateReport, CoreError> {
        obs.check_fits(self.shown.belief.len())?;
        self.touch(obs.points())?;
        self.correct(obs)?;
        let scratch = &mut self.scratch;
        if !obs.is_empty() {
            self.covariance.downdate(&scratch.gain);
        }
        std::mem::swap(&mut self.mean, &mut scratch.mean);
        std::mem::swap(&mut self.variance, &mut scratch.variance);
        if let Some(mode) = &mut self.mode {
            mode.commit(&self.variance);
        }
        let projected = self.follow();
        let Scratch {
            innovation, prefit, ..
        } = &self.scratch;
        let report = self.shown.report(obs, innovation, projected);
        Ok(if self.mode.is_some() {
            UpdateReport {
                prefit: *prefit,
                ..report
            }
        } else {
            report
        })
    }

    /// Refused in two cases. With a correlated prior, what touched points say of the others refers to their
    /// stiffness at the first touch. With [`Projection::Constrained`], the readings that hold a point at
    /// zero refer to its stiffness at that time.
    fn diffuse(&mut self, variance: T) -> Result<(), CoreError> {
        let refused = if !self.touched.prior().is_independent() {
            "a field that changes with time (Estimator::diffuse), with a correlated prior,"
        } else if self.mode.is_some() {
            "a field that changes with time (Estimator::diffuse), with Projection::Constrained,"
        } else {
            self.shown.belief.diffuse(variance)?;
            self.touched.diffuse(variance.to_f64());
            self.covariance.add_to_diagonal(variance);
            self.variance.iter_mut().for_each(|v| *v += variance);
            return Ok(());
        };
        Err(CoreError::Unsupported {
            what: refused,
            by: std::any::type_name::<Self>(),
        })
    }

    fn whitened_residual(&self) -> &[f64] {
        &self.shown.whitened
    }

    fn predict(&self, obs: &Observation<T>, out: &mut Prediction) -> Result<(), CoreError> {
        self.predict_jointly(obs, out)
    }
}
