use crate::Motion;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ops::Range;

/// Length (s) of the blocks of samples that are drawn as a whole, fewest blocks, and number of draws.
const LENGTH: f64 = 3.0;
const FEWEST: f64 = 8.0;
const DRAWS: usize = 2000;
/// Share of the draws that may lie below a lower bound.
const BELOW: f64 = 0.05;
/// 95 % of a normal distribution lie within this many standard deviations.
const Z: f64 = 1.959_963_984_540_054;

/// A statistic of sums over samples, with its bounds.
pub(crate) struct Bounded {
    pub(crate) value: f64,
    /// 95 % interval.
    pub(crate) interval: [f64; 2],
    /// Lower bound: the statistic exceeds it in 95 % of the draws.
    pub(crate) least: f64,
}

/// Block bootstrap: intervals of statistics of sums over samples. Blocks are drawn, since neighboring samples are not
/// independent.
///
/// With few blocks, draws vary less than they should, so percentiles further out are taken to compensate (T. Hesterberg,
/// What Teachers Should Know About the Bootstrap, 2015, doi:10.1080/00031305.2015.1089789, section 4.4).
pub(crate) struct Bootstrap {
    /// Each block lies within a sequence. Samples are numbered through from one sequence to the next.
    blocks: Vec<Range<usize>>,
    rng: Pcg64Mcg,
}

impl Bootstrap {
    /// Of the samples of `motions`.
    pub(crate) fn new(motions: &[&Motion], seed: u64) -> Self {
        let duration = |m: &&Motion| match (m.clock.first(), m.clock.last()) {
            (Some(first), Some(last)) => last - first,
            _ => 0.0,
        };
        let length = LENGTH.min(motions.iter().map(duration).sum::<f64>() / FEWEST);
        let mut blocks = Vec::new();
        let mut first = 0;
        for motion in motions {
            let mut start = 0;
            for row in 0..motion.len() {
                let is_long = motion.clock[row] - motion.clock[start] >= length;
                if is_long || row + 1 == motion.len() {
                    blocks.push(first + start..first + row + 1);
                    start = (row + 1).min(motion.len() - 1);
                }
            }
            first += motion.len();
        }
        Self {
            blocks,
            rng: Pcg64Mcg::seed_from_u64(seed),
        }
    }

    /// The `statistic` of `width` sums over all samples, with its intervals. `add` adds a sample to the sums.
    pub(crate) fn intervals(
        &mut self,
        width: usize,
        add: impl Fn(usize, &mut [f64]),
        statistic: impl Fn(&[f64]) -> Vec<f64>,
    ) -> Vec<Bounded> {
        let mut of_blocks = vec![0.0; self.blocks.len() * width];
        for (block, sums) in self.blocks.iter().zip(of_blocks.chunks_exact_mut(width)) {
            block.clone().for_each(|sample| add(sample, sums));
        }
        let of = |picks: &mut dyn Iterator<Item = usize>| {
            let mut sums = vec![0.0; width];
            for b in picks {
                let block = &of_blocks[b * width..][..width];
                sums.iter_mut().zip(block).for_each(|(s, v)| *s += v);
            }
            statistic(&sums)
        };
        let n = self.blocks.len();
        let whole = of(&mut (0..n));
        let rng = &mut self.rng;
        let draws: Vec<Vec<f64>> = (0..DRAWS)
            .map(|_| of(&mut (0..n).map(|_| rng.random_range(0..n))))
            .collect();
        let [outside, below] = [tail(n), BELOW].map(|share| (share * DRAWS as f64) as usize);
        let estimated = |(k, value): (usize, &f64)| {
            let mut drawn: Vec<f64> = draws.iter().map(|d| d[k]).collect();
            drawn.sort_by(f64::total_cmp);
            Bounded {
                value: *value,
                interval: [drawn[outside], drawn[DRAWS - 1 - outside]],
                least: drawn[below],
            }
        };
        whole.iter().enumerate().map(estimated).collect()
    }
}

/// Share of the draws of `n` blocks that lie beyond either end of a 95 % interval.
fn tail(n: usize) -> f64 {
    let n = n.max(2) as f64;
    let deviations = (n / (n - 1.0)).sqrt() * student(n - 1.0);
    0.5 * libm::erfc(deviations / std::f64::consts::SQRT_2)
}

/// 95 % of Student's distribution with so many degrees of freedom lie within this (Fisher and Cornish's expansion: 1 % too
/// small with three, 24 % with one).
fn student(freedom: f64) -> f64 {
    let z = |power| Z.powi(power);
    Z + (z(3) + Z) / (4.0 * freedom)
        + (5.0 * z(5) + 16.0 * z(3) + 3.0 * Z) / (96.0 * freedom.powi(2))
        + (3.0 * z(7) + 19.0 * z(5) + 17.0 * z(3) - 15.0 * Z) / (384.0 * freedom.powi(3))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against tables of Student's distribution.
    #[test]
    fn val_student() {
        for (freedom, quantile) in [(3.0, 3.182), (7.0, 2.365), (15.0, 2.131), (60.0, 2.000)] {
            let found = student(freedom);
            assert!((found / quantile - 1.0).abs() < 0.01, "{freedom}: {found}");
        }
        assert!((tail(100_000) - 0.025).abs() < 1e-5);
    }

    /// Of recordings of twenty seconds, with errors that last for half a second, nine in ten intervals at least hold the truth:
    /// that three fifths of the energy are closed.
    #[test]
    fn val_intervals_hold_the_truth() {
        let (rows, step) = (100, 0.1);
        let motion = Motion::counting(
            rows,
            vec![Range {
                start: 0,
                end: rows,
            }],
        );
        let motions = [&motion, &motion];
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let keeps = (-step / 0.5_f64).exp();
        let mut errors = |sd: f64| -> Vec<f64> {
            let mut now = rng.sample::<f64, _>(rand_distr::StandardNormal);
            (0..2 * rows)
                .map(|_| {
                    let fresh: f64 = rng.sample(rand_distr::StandardNormal);
                    now = keeps * now + (1.0 - keeps * keeps).sqrt() * fresh;
                    sd * now
                })
                .collect()
        };
        let recordings = 300;
        let holds = (0..recordings).filter(|_| {
            let (before, after) = (errors(1.0), errors(0.4_f64.sqrt()));
            let add = |k: usize, sums: &mut [f64]| {
                sums[0] += before[k].powi(2);
                sums[1] += after[k].powi(2);
            };
            let closed = |sums: &[f64]| vec![(sums[0] - sums[1]) / sums[0]];
            let found = Bootstrap::new(&motions, 1).intervals(2, add, closed);
            let [low, high] = found[0].interval;
            (low..=high).contains(&0.6)
        });
        let share = holds.count() as f64 / recordings as f64;
        assert!((0.9..=0.98).contains(&share), "{share}");
    }
}
