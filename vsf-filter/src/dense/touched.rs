use super::algebra::{PAR, add_product, solve_lower, solve_lower_transposed};
use crate::cholesky::cholesky;
use crate::limit::check_entries;
use crate::prior::FieldPrior;
use faer::{Mat, MatRef};
use vsf_core::CoreError;

/// No slot.
const UNTOUCHED: u32 = u32::MAX;

/// The touched points of a dense filter, numbered by *slots* in the order of their first touch,
/// and what the prior says of other points given these.
#[derive(Debug, Clone)]
pub(super) struct Touched {
    prior: FieldPrior,
    pub(super) points: Vec<u32>,
    pub(super) slots: Vec<u32>,
    pub(super) link: Link,
}

/// What links points a priori.
#[derive(Debug, Clone)]
pub(super) enum Link {
    Nothing,
    /// A level of this variance, which `sum 1 / local variance` of the touched points tell about.
    Level {
        variance: f64,
        precision: f64,
    },
    /// Anything, by the Cholesky factor of the covariance of the touched points (lower triangle).
    Field {
        root: Mat<f64>,
    },
}

/// Prior of new points given the touched ones: `K_b = mean_b + share sums + rest` with
/// `sums = onto^T (K_t - mean_t)` and `rest ~ N(0, covariance)`.
pub(super) struct Conditional {
    /// Touched x sums: as many sums as are needed, none for independent points.
    pub(super) onto: Mat<f64>,
    /// New x sums.
    pub(super) share: Mat<f64>,
    pub(super) covariance: Mat<f64>,
    /// Cholesky factor of `covariance`, lower triangle.
    pub(super) corner: Mat<f64>,
    /// New rows of [`Link::Field`] left of the diagonal, transposed.
    cross: Mat<f64>,
}

impl Touched {
    pub(super) fn new(prior: FieldPrior) -> Self {
        let link = match prior.level_alone() {
            Some(variance) => Link::Level {
                variance,
                precision: 0.0,
            },
            None if prior.is_independent() => Link::Nothing,
            None => Link::Field { root: Mat::new() },
        };
        Self {
            points: Vec::new(),
            slots: vec![UNTOUCHED; prior.len()],
            prior,
            link,
        }
    }

    pub(super) fn prior(&self) -> &FieldPrior {
        &self.prior
    }

    /// Adds a variance to every point's own part, before it is touched. Only for independent points:
    /// what others tell of a point is about its value before.
    pub(super) fn diffuse(&mut self, variance: f64) {
        self.prior.diffuse(variance);
    }

    /// Touched points by slot.
    pub(super) fn points(&self) -> &[u32] {
        &self.points
    }

    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    pub(super) fn slot(&self, point: u32) -> Option<usize> {
        let slot = *self.slots.get(point as usize)?;
        (slot != UNTOUCHED).then_some(slot as usize)
    }

    /// Whether there is room for so many new points, of a filter that holds so many bytes of a pair of them.
    pub(super) fn check_room(&self, new: usize, held: usize) -> Result<(), CoreError> {
        let all = self.len() + new;
        // The factor, and a larger one while it grows.
        let of_link = match self.link {
            Link::Field { .. } => 2 * size_of::<f64>(),
            Link::Nothing | Link::Level { .. } => 0,
        };
        check_entries(all, all, held + of_link, "touched points of a dense filter")
    }

    /// Those of `points` that were never touched, each once, increasing.
    pub(super) fn unseen(&self, points: &[u32]) -> Result<Vec<u32>, CoreError> {
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

    /// The prior of `b` unseen points given the touched ones: `O(n² b)` when they are smooth in
    /// space, else `O(n + b³)`.
    pub(super) fn condition(&self, unseen: &[u32]) -> Result<Conditional, CoreError> {
        let (n, b) = (self.len(), unseen.len());
        let mut cross = Mat::new();
        let (onto, share, covariance) = match &self.link {
            Link::Nothing => (Mat::zeros(n, 0), Mat::zeros(b, 0), self.own(unseen, 0.0)),
            Link::Level {
                variance,
                precision,
            } => {
                let (onto, level) = self.level(*variance, *precision);
                (onto, Mat::full(b, 1, 1.0), self.own(unseen, level))
            }
            Link::Field { root } => {
                cross = self.prior_covariance(&self.points, unseen);
                solve_lower(root, &mut cross);
                let mut rest = self.prior_covariance(unseen, unseen);
                add_product(&mut rest, -1.0, cross.transpose(), cross.as_ref());
                let mut onto = cross.clone();
                solve_lower_transposed(root, &mut onto);
                (onto, Mat::identity(b, b), rest)
            }
        };
        let mut corner = covariance.clone();
        cholesky("prior covariance of the touched points", &mut corner, PAR)?;
        Ok(Conditional {
            onto,
            share,
            covariance,
            corner,
            cross,
        })
    }

    /// Numbers new points, in their order, by the conditional made for them.
    pub(super) fn append(&mut self, unseen: &[u32], conditional: &Conditional) {
        let n = self.len();
        for &p in unseen {
            self.slots[p as usize] = self.points.len() as u32;
            self.points.push(p);
        }
        let rows = self.len();
        match &mut self.link {
            Link::Nothing => {}
            Link::Level { precision, .. } => {
                let local = unseen
                    .iter()
                    .map(|&p| self.prior.local_variance(p as usize));
                *precision += local.map(|v| 1.0 / v).sum::<f64>();
            }
            Link::Field { root } => {
                let capacity = rows.next_power_of_two();
                if capacity > n.next_power_of_two() {
                    root.reserve(capacity, capacity);
                }
                let Conditional { cross, corner, .. } = conditional;
                root.resize_with(rows, rows, |i, j| match (i < n, j < n) {
                    (true, _) => 0.0,
                    (false, true) => cross[(j, i - n)],
                    (false, false) => corner[(i - n, j - n)],
                });
            }
        }
    }

    /// Sums `sum_k weights[(k, i)] (K - mean)[unseen_k]`, one per column, in terms of the touched
    /// points: their weights in the sums' expectation, and the variances that remain.
    ///
    /// `O(n² d + n b + b²)` for `d` sums of `b` points when they are smooth in space, else
    /// `O((n + b) d)`.
    pub(super) fn project(&self, unseen: &[u32], weights: MatRef<'_, f64>) -> (Mat<f64>, Vec<f64>) {
        let d = weights.ncols();
        let sum = |i: usize, term: &dyn Fn(usize) -> f64| -> f64 {
            (0..unseen.len()).map(|k| weights[(k, i)] * term(k)).sum()
        };
        let alone = |i: usize| {
            sum(i, &|k| {
                weights[(k, i)] * self.prior.local_variance(unseen[k] as usize)
            })
        };
        match &self.link {
            Link::Nothing => (Mat::zeros(self.len(), d), (0..d).map(alone).collect()),
            Link::Level {
                variance,
                precision,
            } => {
                let (onto, level) = self.level(*variance, *precision);
                let total: Vec<f64> = (0..d).map(|i| sum(i, &|_| 1.0)).collect();
                (
                    Mat::from_fn(self.len(), d, |slot, i| onto[(slot, 0)] * total[i]),
                    (0..d)
                        .map(|i| alone(i) + level * total[i].powi(2))
                        .collect(),
                )
            }
            Link::Field { root } => {
                let mut onto = self.prior_times(&self.points, unseen, weights);
                let own = self.prior_times(unseen, unseen, weights);
                solve_lower(root, &mut onto);
                let known = |i: usize| onto.col(i).squared_norm_l2();
                let variance = (0..d)
                    .map(|i| sum(i, &|k| own[(k, i)]) - known(i))
                    .collect();
                solve_lower_transposed(root, &mut onto);
                (onto, variance)
            }
        }
    }

    /// How far the prior mean of every point that was never touched moves, given how far the touched points are off
    /// theirs; of points that nothing links, none.
    pub(super) fn shifts(&self, offsets: &[f64]) -> Vec<(usize, f64)> {
        let unseen = (0..self.slots.len()).filter(|&p| self.slots[p] == UNTOUCHED);
        match &self.link {
            Link::Nothing => Vec::new(),
            Link::Level {
                variance,
                precision,
            } => {
                let (onto, _) = self.level(*variance, *precision);
                let level = onto.col(0).iter().zip(offsets).map(|(w, o)| w * o).sum();
                unseen.map(|p| (p, level)).collect()
            }
            Link::Field { root } => {
                let mut pull = Mat::from_fn(offsets.len(), 1, |slot, _| offsets[slot]);
                solve_lower(root, &mut pull);
                solve_lower_transposed(root, &mut pull);
                let shift = |p: usize| -> f64 {
                    let touched = self.points.iter().zip(pull.col(0).iter());
                    touched
                        .map(|(&t, a)| self.prior.covariance(p, t as usize) * a)
                        .sum()
                };
                unseen.map(|p| (p, shift(p))).collect()
            }
        }
    }

    /// Weights of the touched points in the expected level, and the level's variance given them.
    fn level(&self, variance: f64, precision: f64) -> (Mat<f64>, f64) {
        let left = variance / (1.0 + variance * precision);
        let local = |slot: usize| self.prior.local_variance(self.points[slot] as usize);
        let onto = Mat::from_fn(self.len(), 1, |slot, _| left / local(slot));
        (onto, left)
    }

    /// Covariance of points that share nothing but a level of a given variance.
    fn own(&self, points: &[u32], level: f64) -> Mat<f64> {
        Mat::from_fn(points.len(), points.len(), |i, j| {
            let local = if i == j {
                self.prior.local_variance(points[i] as usize)
            } else {
                0.0
            };
            level + local
        })
    }

    fn prior_covariance(&self, rows: &[u32], columns: &[u32]) -> Mat<f64> {
        Mat::from_fn(rows.len(), columns.len(), |i, j| {
            self.prior.covariance(rows[i] as usize, columns[j] as usize)
        })
    }

    /// Prior covariance of two sets of points times a matrix, without holding the former.
    fn prior_times(&self, rows: &[u32], columns: &[u32], x: MatRef<'_, f64>) -> Mat<f64> {
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
