use crate::Motion;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ops::Range;

/// Length of a block of samples that is drawn as a whole (s), fewest blocks, and number of draws.
const LENGTH: f64 = 3.0;
const FEWEST: f64 = 8.0;
const DRAWS: usize = 400;

/// Intervals of what is made of sums over samples, by drawing blocks of them: neighbors are not independent.
pub(crate) struct Bootstrap {
    /// Each within a sequence; samples count on from one sequence to the next.
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

    /// What `statistic` makes of `width` sums over all samples, and for each of its numbers the interval that
    /// holds 95 % of the draws. `add` adds a sample to the sums.
    pub(crate) fn intervals(
        &mut self,
        width: usize,
        add: impl Fn(usize, &mut [f64]),
        statistic: impl Fn(&[f64]) -> Vec<f64>,
    ) -> (Vec<f64>, Vec<[f64; 2]>) {
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
        let interval = |k: usize| {
            let mut drawn: Vec<f64> = draws.iter().map(|d| d[k]).collect();
            drawn.sort_by(f64::total_cmp);
            [drawn[DRAWS / 40], drawn[DRAWS - 1 - DRAWS / 40]]
        };
        let intervals = (0..whole.len()).map(interval).collect();
        (whole, intervals)
    }
}
