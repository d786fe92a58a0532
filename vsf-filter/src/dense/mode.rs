use super::channels::Channels;
use super::columns::Vector;
use super::pivoting::pivot;
use super::square::{BANDS, Kernel, OCTET, Octet, Square, TILE, add_scaled, dispatch, zero};
use super::tiles::Tiles;
use crate::truncated::second_moment;
use vsf_core::Scalar;

/// Blocks of 64 points whose multipliers an update corrects at most.
const BLOCKS: usize = 16;
/// Sweeps over the multipliers of one block.
const SWEEPS: usize = 8;
/// Violation that counts as none, in units of the prior's sd: in an update, and when settled.
const TOLERANCE: f64 = 1e-6;
const SETTLED: f64 = 1e-10;
/// Roundings that no tolerance goes below.
const ROUNDINGS: f64 = 64.0;
/// Distance from zero, in standard deviations, that is as good as any other.
const FAR: f64 = 1e9;
/// Turns of every block before settling looks for the points at zero itself, and after which it gives up where that fails.
const FEW_TURNS: usize = 50;
const TURNS: usize = 2000;

/// The mode of a Gaussian `N(mu, P)` within `K >= 0`: the minimum of `(K - mu)^T P^-1 (K - mu)`.
///
/// With multipliers `lambda` of the constraints it is `x = mu + P lambda` where `lambda >= 0`,
/// `x >= 0` and one of the two is zero in every point. `x` is the mean of the Gaussian whose
/// information vector has gained `lambda`: readings move it by the gain that moves `mu`. The
/// multipliers are then found by block coordinate descent on the dual problem, a quadratic in
/// `lambda >= 0` whose matrix is `P`, from those of the reading before.
///
/// # Reference
/// C. Hildreth, *A quadratic programming procedure*, Naval Research Logistics 4 (1957), doi
/// 10.1002/nav.3800040113.
#[derive(Debug, Clone)]
pub(super) struct Mode<T> {
    /// By slot, in blocks; padded by zeros.
    x: Vec<Vector<T>>,
    lambda: Vec<Vector<T>>,
    /// `P_ii`, padded by ones.
    variance: Vec<Vector<T>>,
    /// One over the prior's sd, padded by zeros.
    unit: Vec<Vector<T>>,
    len: usize,
    residual: f64,
    /// `x` after a reading, or before a descent.
    next: Vec<Vector<T>>,
    /// `lambda` before a descent.
    before: Vec<Vector<T>>,
    tile: Vec<Square<T>>,
    inner: Vec<Octet<T>>,
}

impl<T: Scalar> Mode<T> {
    pub(super) fn new() -> Self {
        Self {
            x: Vec::new(),
            lambda: Vec::new(),
            variance: Vec::new(),
            unit: Vec::new(),
            len: 0,
            residual: 0.0,
            next: Vec::new(),
            before: Vec::new(),
            tile: Vec::new(),
            inner: Vec::new(),
        }
    }

    /// `x` of a slot, which may still lack a correction.
    pub(super) fn x(&self, slot: usize) -> T {
        at(&self.x, slot)
    }

    /// Whether a slot is held at zero.
    pub(super) fn is_held(&self, slot: usize) -> bool {
        let pull = at(&self.lambda, slot) * at(&self.variance, slot);
        self.x(slot) < pull.max(T::ZERO)
    }

    /// Mean of a slot, and variance: about zero and of the part above zero where it is held there.
    pub(super) fn marginal(&self, slot: usize) -> (T, T) {
        let variance = at(&self.variance, slot);
        if !self.is_held(slot) {
            return (self.x(slot), variance);
        }
        let distance = at(&self.lambda, slot).to_f64() * variance.to_f64().sqrt();
        let moment = T::from_f64(second_moment::<32>(distance.min(FAR)));
        (T::ZERO, variance * moment.max(T::EPSILON * T::EPSILON))
    }

    /// `lambda` of a slot.
    #[cfg(feature = "serde")]
    pub(super) fn multiplier(&self, slot: usize) -> T {
        at(&self.lambda, slot)
    }

    /// Sets `lambda` of the last slot.
    #[cfg(feature = "serde")]
    pub(super) fn set_multiplier(&mut self, lambda: T) {
        *at_mut(&mut self.lambda, self.len - 1) = lambda;
    }

    /// Largest `|min(x, lambda P_ii)|`, in units of the prior's sd.
    pub(super) fn residual(&self) -> f64 {
        self.residual
    }

    /// Appends a slot.
    pub(super) fn push(&mut self, x: T, variance: T, prior_sd: f64) {
        let slot = self.len;
        if slot.is_multiple_of(TILE) {
            self.x.push(zero());
            self.lambda.push(zero());
            self.variance.push([Octet([T::ONE; OCTET]); BANDS]);
            self.unit.push(zero());
        }
        *at_mut(&mut self.x, slot) = x;
        *at_mut(&mut self.variance, slot) = variance;
        *at_mut(&mut self.unit, slot) = T::from_f64(1.0 / prior_sd);
        self.len += 1;
    }

    /// Prepares `x + V shift`; whether it is finite.
    pub(super) fn prepare(&mut self, gain: &Channels<T>, shift: &[T]) -> bool {
        self.next.clone_from(&self.x);
        let x = &mut self.next;
        dispatch(Shift { gain, shift, x });
        all_finite(&self.next)
    }

    /// Takes what was prepared, with new variances.
    pub(super) fn commit(&mut self, variance: &[T]) {
        std::mem::swap(&mut self.x, &mut self.next);
        for (slot, &v) in variance.iter().enumerate() {
            *at_mut(&mut self.variance, slot) = v;
        }
    }

    /// Corrects the multipliers of a few blocks, the worst first.
    pub(super) fn follow(&mut self, covariance: &Tiles<T>) {
        self.descend(covariance, above_rounding::<T>(TOLERANCE), BLOCKS);
    }

    /// Corrects multipliers until there is nothing left to correct; `mean` is `mu`.
    pub(super) fn settle(&mut self, covariance: &Tiles<T>, mean: &[T]) {
        let tolerance = above_rounding::<T>(SETTLED);
        self.descend(covariance, tolerance, FEW_TURNS * self.x.len());
        if self.residual > tolerance && !self.pivot(covariance, mean, tolerance) {
            self.descend(covariance, tolerance, TURNS * self.x.len());
        }
    }

    /// Goes to the optimum at once, from the points that are held now; whether it does. Where these are tied to each other far more
    /// tightly than the prior lets them vary, descent takes turns without end.
    fn pivot(&mut self, covariance: &Tiles<T>, mean: &[T], tolerance: f64) -> bool {
        let slots = || 0..self.len;
        let mean: Vec<f64> = mean.iter().map(|m| m.to_f64()).collect();
        let unit: Vec<f64> = slots().map(|s| at(&self.unit, s).to_f64()).collect();
        let held = slots().map(|s| self.is_held(s)).collect();
        let of = |i: usize, j: usize| {
            if i == j {
                at(&self.variance, i).to_f64()
            } else {
                covariance.get(i, j).to_f64()
            }
        };
        let Some(found) = pivot(&mean, of, held, &unit, tolerance) else {
            return false;
        };
        for slot in 0..self.len {
            *at_mut(&mut self.x, slot) = T::from_f64(found.x[slot]);
            *at_mut(&mut self.lambda, slot) = T::from_f64(found.lambda[slot]);
        }
        self.measure();
        true
    }

    fn descend(&mut self, covariance: &Tiles<T>, tolerance: f64, blocks: usize) {
        self.next.clone_from(&self.x);
        self.before.clone_from(&self.lambda);
        self.sweep(covariance, tolerance, blocks);
        if !(all_finite(&self.x) && all_finite(&self.lambda)) {
            // A covariance that is none, by rounding or by a broken state, has no mode to descend to.
            std::mem::swap(&mut self.x, &mut self.next);
            std::mem::swap(&mut self.lambda, &mut self.before);
            self.measure();
        }
    }

    fn sweep(&mut self, covariance: &Tiles<T>, tolerance: f64, blocks: usize) {
        for _ in 0..blocks {
            let worst = self.worst();
            if self.residual <= tolerance {
                return;
            }
            covariance.diagonal(worst, &mut self.tile);
            let (mut lambda, mut step) = (self.lambda[worst], zero());
            dispatch(Sweep {
                tile: &self.tile,
                variance: &self.variance[worst],
                x: self.x[worst],
                lambda: &mut lambda,
                step: &mut step,
            });
            self.lambda[worst] = lambda;
            covariance.add_columns(worst, &step, &mut self.x, &mut self.inner);
        }
        self.measure();
    }

    /// Notes the residual.
    pub(super) fn measure(&mut self) {
        self.worst();
    }

    /// The block with the largest sum of squared violations; notes the largest violation of all.
    fn worst(&mut self) -> usize {
        let (mut worst, mut most, mut largest) = (0, T::ZERO, T::ZERO);
        for block in 0..self.x.len() {
            let (mut sum, mut peak) = (Octet([T::ZERO; OCTET]), Octet([T::ZERO; OCTET]));
            for band in 0..BANDS {
                let of = |values: &[Vector<T>]| values[block][band];
                let (x, lambda) = (of(&self.x), of(&self.lambda));
                let (variance, unit) = (of(&self.variance), of(&self.unit));
                for l in 0..OCTET {
                    let pull = lambda.0[l] * variance.0[l];
                    let violation = if x.0[l] < pull { x.0[l] } else { pull } * unit.0[l];
                    let square = violation * violation;
                    sum.0[l] += square;
                    peak.0[l] = peak.0[l].max(square);
                }
            }
            largest = peak.0.into_iter().fold(largest, T::max);
            let sum = sum.0.into_iter().sum();
            if sum > most {
                (worst, most) = (block, sum);
            }
        }
        self.residual = largest.to_f64().sqrt();
        worst
    }
}

/// A tolerance that rounding leaves room for.
fn above_rounding<T: Scalar>(tolerance: f64) -> f64 {
    tolerance.max(ROUNDINGS * T::EPSILON.to_f64())
}

fn all_finite<T: Scalar>(values: &[Vector<T>]) -> bool {
    let finite = |octet: &Octet<T>| octet.0.iter().all(|x| x.is_finite());
    values.iter().flatten().all(finite)
}

fn at<T: Scalar>(values: &[Vector<T>], slot: usize) -> T {
    values[slot / TILE][slot % TILE / OCTET].0[slot % OCTET]
}

fn at_mut<T: Scalar>(values: &mut [Vector<T>], slot: usize) -> &mut T {
    &mut values[slot / TILE][slot % TILE / OCTET].0[slot % OCTET]
}

/// `x += V shift`.
struct Shift<'a, T> {
    gain: &'a Channels<T>,
    shift: &'a [T],
    x: &'a mut [Vector<T>],
}

impl<T: Scalar> Kernel for Shift<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        for (group, shift) in self.shift.chunks_exact(OCTET).enumerate() {
            for (x, v) in self.x.iter_mut().flatten().zip(self.gain.group(group)) {
                for (x, v) in x.0.iter_mut().zip(v) {
                    *x += v.0.iter().zip(shift).map(|(&v, &s)| v * s).sum();
                }
            }
        }
    }
}

/// Coordinate descent on the multipliers of one block, `step` in all.
struct Sweep<'a, T> {
    tile: &'a [Square<T>],
    variance: &'a Vector<T>,
    x: Vector<T>,
    lambda: &'a mut Vector<T>,
    step: &'a mut Vector<T>,
}

impl<T: Scalar> Kernel for Sweep<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(mut self) {
        for i in (0..SWEEPS).flat_map(|_| 0..TILE) {
            let (band, lane) = (i / OCTET, i % OCTET);
            let old = self.lambda[band].0[lane];
            let new = (old - self.x[band].0[lane] / self.variance[band].0[lane]).max(T::ZERO);
            let step = new - old;
            if step == T::ZERO || !step.is_finite() {
                continue;
            }
            self.lambda[band].0[lane] = new;
            self.step[band].0[lane] += step;
            for (x, squares) in self.x.iter_mut().zip(self.tile.chunks_exact(BANDS)) {
                add_scaled::<T, FMA>(x, step, &squares[band][lane]);
            }
        }
    }
}
