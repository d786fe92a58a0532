use super::algebra::{add_product, product};
use super::channels::Channels;
use super::gain::Gain;
use super::innovation::Innovation;
use super::joint::{Joint, JointEstimator};
use super::product::Workspace;
use super::projection::{Projection, Shown};
use super::square::{OCTET, Square, dispatch, zero};
use super::tiles::Tiles;
use super::touched::{Conditional, Touched};
use crate::kernel::{all_finite, all_positive};
use crate::prior::FieldPrior;
use faer::Mat;
use vsf_core::{Belief, CoreError, Estimator, Observation, Prediction, Scalar, UpdateReport};

/// New points taken in at once.
const CHUNK: usize = 32;

/// Exact recursive Gaussian filter in covariance form: one mean per point and the covariance of all
/// touched points.
///
/// An update takes the gain `P W^T (W P W^T + R)^-1`: the posterior of eq. 5 without its `n x n`
/// inverse, in `O(n² d)` for `n` touched points and `d` channels, against `O(n³)` of
/// [`crate::InformationFilter`]: 6.4 ms of processor time in `f32` and 13 ms in `f64` for 7 channels
/// and 4100 contacts of 4300 touched points (AMD Zen 4; `benches/dense.rs`), shared by the threads.
/// The covariance takes `n² / 2` numbers. A point enters with its first touch and costs nothing
/// before, whatever the size of the field.
///
/// # Priors
/// Any [`FieldPrior`]: [`Estimator::reset`] takes marginals and so an independent prior,
/// [`JointEstimator::restart`] takes the others. Points that are touched for the first time follow
/// from the touched ones by the prior. That is free for an independent prior, one more pass over
/// the covariance for a shared level, and `O(n² b)` for `b` new points that are smooth in space,
/// where the factor of the prior takes another `n²` to `4 n²` numbers of `f64`.
/// [`JointEstimator::include`] pays ahead of time.
///
/// # Untouched points
/// [`Estimator::belief`] shows the prior's marginals of points that were neither touched nor
/// included. For an independent prior that is their posterior. For a correlated one touches say
/// something of them too: [`JointEstimator::extrapolate`] tells what, in `O(n²)` a point, and
/// [`Estimator::predict`] makes use of it.
///
/// # Signs
/// With [`Projection::OutputOnly`] the belief shows `max(mean, 0)`, point by point. Where points
/// are strongly correlated, `W` times those means is no longer what the filter expects to read;
/// [`Estimator::predict`], `prefit` and `nis` are those of the Gaussian itself, `postfit` is of the
/// belief.
///
/// # Numbers
/// In `f32` variances err by about a millionth of the *prior's* (7e-7 after 1000 updates of 300
/// points; means by 2e-4 of their sd, with variances down to 5e-4 of the prior's). When the
/// posterior itself comes down to that, in a very wide prior, it is lost: updates then end with
/// [`CoreError::NotPositiveDefinite`] and leave the belief as it was. Take `f64` there.
///
/// The same bits come out for any number of threads (of the rayon pool that `update` runs in);
/// processors without fused multiply-add round the last bits otherwise. On one thread an update
/// that touches no new point does not allocate.
///
/// # Reference
/// R. E. Kalman, *A New Approach to Linear Filtering and Prediction Problems*, J. Basic Eng. 82
/// (1960), doi 10.1115/1.3662552. Given new points: C. E. Rasmussen, C. K. I. Williams, *Gaussian
/// Processes for Machine Learning*, MIT Press 2006, appendix A.2.
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
    mean: Vec<T>,
    variance: Vec<T>,
}

impl<T: Scalar> CovarianceFilter<T> {
    /// A filter that starts from a prior (a [`FieldPrior`] or a [`Belief`]), with the default
    /// projection.
    ///
    /// # Errors
    /// Variances beyond the range of `T`.
    pub fn new(prior: impl Into<FieldPrior>) -> Result<Self, CoreError> {
        Self::with_projection(prior, Projection::default())
    }

    /// A filter with a given projection.
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
            scratch: Scratch::default(),
        })
    }

    /// What happens to negative means.
    pub fn projection(&self) -> Projection {
        self.shown.projection
    }

    fn show(&mut self) -> usize {
        let points = self.touched.points();
        self.shown.show(points, &mut self.mean, &self.variance)
    }

    /// Takes points into the joint state. Changes nothing that is known.
    fn touch(&mut self, points: &[u32]) -> Result<(), CoreError> {
        if points.iter().all(|&p| self.touched.slot(p).is_some()) {
            return Ok(());
        }
        let unseen = self.touched.unseen(points)?;
        unseen
            .chunks(CHUNK)
            .try_for_each(|chunk| self.append(chunk))
    }

    /// New points `K_b = mean_b + share onto^T (K_t - mean_t) + rest` of the prior.
    fn append(&mut self, unseen: &[u32]) -> Result<(), CoreError> {
        let n = self.touched.len();
        let conditional = self.touched.condition(unseen)?;
        let Conditional { onto, share, .. } = &conditional;
        let sums = onto.ncols();
        let Scratch { w, gain, work, .. } = &mut self.scratch;
        w.clear(n, sums);
        for i in 0..sums {
            (0..n).for_each(|slot| w.set(slot, i, T::from_f64(onto[(slot, i)])));
        }
        self.covariance.times(w, gain, work);
        let spread = Mat::from_fn(n, sums, |slot, i| gain.get(slot, i).to_f64());
        let spread = product(spread.as_ref(), share.transpose());
        let onto = product(onto.as_ref(), share.transpose());
        let mut own = conditional.covariance.clone();
        add_product(&mut own, 1.0, onto.transpose(), spread.as_ref());

        let prior_mean = self.touched.prior().mean();
        let mean = |b: usize| {
            let known = self.touched.points().iter().zip(&self.mean).enumerate();
            let moved = known
                .map(|(slot, (&p, now))| onto[(slot, b)] * (now.to_f64() - prior_mean[p as usize]));
            T::from_f64(prior_mean[unseen[b] as usize] + moved.sum::<f64>())
        };
        let mean: Vec<T> = (0..unseen.len()).map(mean).collect();
        let variance = |b: usize| T::from_f64(own[(b, b)]);
        let variance: Vec<T> = (0..unseen.len()).map(variance).collect();
        check_means(&mean)?;
        check_variances(&variance, unseen)?;

        self.mean.extend(mean);
        self.variance.extend(variance);
        for b in 0..unseen.len() {
            self.covariance.push();
            if sums > 0 {
                for slot in 0..n {
                    let value = T::from_f64(spread[(slot, b)]);
                    self.covariance.set(n + b, slot, value);
                }
            }
            for c in 0..=b {
                let value = T::from_f64(own[(b, c)]);
                self.covariance.set(n + b, n + c, value);
            }
        }
        self.touched.append(unseen, &conditional);
        Ok(())
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
            mean,
            variance,
            ..
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
        innovation.each_whitening(|i, j, x| {
            whitening[i / OCTET * groups + j / OCTET][j % OCTET].0[i % OCTET] = T::from_f64(x);
        });
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
        check_variances(variance, self.touched.points())
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
        (self.mean[slot], self.variance[slot])
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
        self.show();
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
        let projected = self.show();
        let innovation = &self.scratch.innovation;
        Ok(self.shown.report(obs, innovation, projected))
    }

    fn whitened_residual(&self) -> &[f64] {
        &self.shown.whitened
    }

    fn predict(&self, obs: &Observation<T>, out: &mut Prediction) -> Result<(), CoreError> {
        self.predict_jointly(obs, out)
    }
}
