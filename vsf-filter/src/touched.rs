use crate::cholesky::cholesky;
use crate::prior::FieldPrior;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Accum, Mat, MatRef, Par};
use vsf_core::CoreError;

/// No slot.
const UNTOUCHED: u32 = u32::MAX;

/// The touched points of a dense filter, numbered by *slots* in the order of their first touch,
/// and what the prior says of other points given these.
#[derive(Debug, Clone)]
pub(crate) struct Touched {
    prior: FieldPrior,
    points: Vec<u32>,
    slots: Vec<u32>,
    /// Cholesky factor of the prior covariance of the touched points, lower triangle; empty for an
    /// independent prior, which does not need it.
    root: Mat<f64>,
}

/// Prior of new points given touched ones: `N(mean + gain^T (K_t - mean_t), covariance)`.
pub(crate) struct Conditional {
    /// Touched x new; `None` when they are independent.
    pub(crate) gain: Option<Mat<f64>>,
    pub(crate) covariance: Mat<f64>,
    /// New rows of the Cholesky factor: left of the diagonal (transposed), and the square on it.
    cross: Mat<f64>,
    pub(crate) corner: Mat<f64>,
}

impl Touched {
    pub(crate) fn new(prior: FieldPrior) -> Self {
        Self {
            points: Vec::new(),
            slots: vec![UNTOUCHED; prior.len()],
            prior,
            root: Mat::new(),
        }
    }

    pub(crate) fn prior(&self) -> &FieldPrior {
        &self.prior
    }

    /// Touched points by slot.
    pub(crate) fn points(&self) -> &[u32] {
        &self.points
    }

    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    pub(crate) fn slot(&self, point: u32) -> Option<usize> {
        let slot = *self.slots.get(point as usize)?;
        (slot != UNTOUCHED).then_some(slot as usize)
    }

    /// Those of `points` that were never touched, each once.
    pub(crate) fn unseen(&self, points: &[u32]) -> Result<Vec<u32>, CoreError> {
        let mut unseen = Vec::new();
        for &p in points {
            match self.slots.get(p as usize) {
                Some(&UNTOUCHED) => unseen.push(p),
                Some(_) => {}
                None => {
                    return Err(CoreError::OutOfRange {
                        what: "point",
                        index: p as usize,
                        len: self.slots.len(),
                    });
                }
            }
        }
        unseen.sort_unstable();
        unseen.dedup();
        Ok(unseen)
    }

    fn cross(&self, points: &[u32]) -> Mat<f64> {
        Mat::from_fn(self.len(), points.len(), |i, j| {
            self.prior
                .covariance(self.points[i] as usize, points[j] as usize)
        })
    }

    fn own(&self, points: &[u32]) -> Mat<f64> {
        Mat::from_fn(points.len(), points.len(), |i, j| {
            self.prior
                .covariance(points[i] as usize, points[j] as usize)
        })
    }

    /// The prior of `unseen` points given the touched ones. `O(n² b)` for `b` points, unless the
    /// prior is independent.
    pub(crate) fn condition(&self, unseen: &[u32]) -> Result<Conditional, CoreError> {
        let mut covariance = self.own(unseen);
        if self.prior.is_independent() {
            return Ok(Conditional {
                gain: None,
                covariance,
                cross: Mat::new(),
                corner: Mat::new(),
            });
        }
        let mut cross = self.cross(unseen);
        self.whiten(&mut cross);
        matmul(
            covariance.as_mut(),
            Accum::Add,
            cross.transpose(),
            cross.as_ref(),
            -1.0,
            Par::Seq,
        );
        let mut corner = covariance.clone();
        cholesky(
            "prior covariance of the touched points",
            &mut corner,
            Par::Seq,
        )?;
        let mut gain = cross.clone();
        self.unwhiten(&mut gain);
        Ok(Conditional {
            gain: Some(gain),
            covariance,
            cross,
            corner,
        })
    }

    /// Numbers new points, in their order, by the conditional made for them.
    pub(crate) fn append(&mut self, unseen: &[u32], conditional: &Conditional) {
        let n = self.len();
        for &p in unseen {
            self.slots[p as usize] = self.points.len() as u32;
            self.points.push(p);
        }
        if conditional.gain.is_some() {
            let rows = self.len();
            let capacity = rows.next_power_of_two();
            if capacity > n.next_power_of_two() {
                self.root.reserve(capacity, capacity);
            }
            let (cross, corner) = (&conditional.cross, &conditional.corner);
            self.root.resize_with(rows, rows, |i, j| {
                if i < n {
                    0.0
                } else if j < n {
                    cross[(j, i - n)]
                } else {
                    corner[(i - n, j - n)]
                }
            });
        }
    }

    /// `L^-1 x` with the Cholesky factor `L` of the touched points.
    fn whiten(&self, x: &mut Mat<f64>) {
        solve_lower_triangular_in_place(self.root.as_ref(), x.as_mut(), Par::Seq);
    }

    /// `L^-T x`.
    fn unwhiten(&self, x: &mut Mat<f64>) {
        solve_upper_triangular_in_place(self.root.transpose(), x.as_mut(), Par::Seq);
    }

    /// Sums `sum_k weights[(k, i)] K[unseen_k]` in terms of the touched points: their weights in
    /// the sums' expectation (`None` when independent), and the variances that remain.
    ///
    /// `O(n² d + n b + b²)` for `d` sums of `b` points.
    pub(crate) fn project(
        &self,
        unseen: &[u32],
        weights: MatRef<'_, f64>,
    ) -> (Option<Mat<f64>>, Vec<f64>) {
        if self.prior.is_independent() {
            let variance = |i| {
                let points = unseen.iter().map(|&p| p as usize).enumerate();
                points
                    .map(|(k, p)| weights[(k, i)].powi(2) * self.prior.covariance(p, p))
                    .sum()
            };
            return (None, (0..weights.ncols()).map(variance).collect());
        }
        let mut cross = self.covariance_times(&self.points, unseen, weights);
        let own = self.covariance_times(unseen, unseen, weights);
        self.whiten(&mut cross);
        let variance = |i| {
            let prior: f64 = (0..unseen.len())
                .map(|k| weights[(k, i)] * own[(k, i)])
                .sum();
            prior - cross.col(i).squared_norm_l2()
        };
        let variance = (0..weights.ncols()).map(variance).collect();
        self.unwhiten(&mut cross);
        (Some(cross), variance)
    }

    /// Prior covariance of two sets of points times a matrix.
    fn covariance_times(&self, rows: &[u32], columns: &[u32], x: MatRef<'_, f64>) -> Mat<f64> {
        let mut y = Mat::zeros(rows.len(), x.ncols());
        for (i, &p) in rows.iter().enumerate() {
            for (k, &q) in columns.iter().enumerate() {
                let covariance = self.prior.covariance(p as usize, q as usize);
                for j in 0..x.ncols() {
                    y[(i, j)] += covariance * x[(k, j)];
                }
            }
        }
        y
    }
}
