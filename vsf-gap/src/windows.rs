use crate::{Campaign, JointNoise, Motion};
use std::ops::Range;
use vsf_data::Table;

/// Most rows (windows times joints) that a diagnosis works with.
const MOST_ROWS: usize = 1300;
/// Longest window where something may be touched (s), unless it has few samples. Longer windows smear what effects do
/// quickly.
const LONGEST: f64 = 0.35;
/// Few samples, for a window.
const FEW: usize = 5;
/// In long recordings, longest time of samples that are averaged before contact is run (s). With coarser samples, contact
/// is so rough that it looks like padding.
const COARSEST: f64 = 0.046;
/// Windows are placed within their intervals by multiples of the golden ratio, so they never fall into step with touches.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// Correlations of noise below this count as zero.
const FADED: f64 = 1e-9;

/// Consecutive samples that are averaged. In long recordings, there are samples between one window and the next.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Window {
    /// Index of the sequence.
    pub(crate) sequence: usize,
    /// Index of the run of consecutive samples that it is cut from, usually a touch.
    pub(crate) run: usize,
    /// Samples.
    pub(crate) rows: Range<usize>,
    /// Middle of its time in the session (s).
    pub(crate) clock: f64,
}

impl Window {
    /// Whether the window is in the same touch as an earlier one, with less than a window between them.
    pub(crate) fn follows(&self, before: &Self) -> bool {
        self.run == before.run && self.rows.start - before.rows.end < before.rows.len()
    }
}

/// The windows of some sequences. Row `i d + j` of a vector over windows is joint `j` in window `i`.
#[derive(Debug, Clone)]
pub(crate) struct Windows {
    /// The windows in order.
    pub(crate) list: Vec<Window>,
    /// Number of joints.
    pub(crate) joints: usize,
}

impl Windows {
    /// The rows of each sequence.
    pub(crate) fn rows_of_sequences(&self) -> Vec<Range<usize>> {
        let mut end = 0;
        let of = |own: &[Window]| {
            let start = end;
            end += own.len() * self.joints;
            start..end
        };
        let sequences = self.list.chunk_by(|w, v| w.sequence == v.sequence);
        sequences.map(of).collect()
    }

    /// Windows at about equal distances, such that there are not many more than 1300 rows. None spans two touches, unless
    /// there are too many touches. A window that reaches `longest` (s) does not fill its interval.
    pub(crate) fn new(motions: &[&Motion], joints: usize, longest: f64) -> Self {
        let spacing = spacing(motions, joints);
        let touches: usize = motions.iter().map(|m| m.touches.len()).sum();
        let many = touches * joints > MOST_ROWS;
        let (mut list, mut run) = (Vec::new(), 0);
        for (sequence, motion) in motions.iter().enumerate() {
            let whole = 0..motion.len();
            let ranges = if many {
                std::slice::from_ref(&whole)
            } else {
                &motion.touches
            };
            for range in ranges {
                let size = samples_within(longest, &motion.clock[range.clone()]).max(FEW);
                let parts = range.len().div_ceil(spacing).max(1);
                for k in 0..parts {
                    let cut = |k: usize| range.start + k * range.len() / parts;
                    let place = cut(k)..cut(k + 1);
                    let spare = place.len().saturating_sub(size) as f64;
                    let start =
                        place.start + ((GOLDEN * list.len() as f64).fract() * spare) as usize;
                    let rows = start..place.end.min(start.saturating_add(size));
                    if !rows.is_empty() {
                        let clock = motion.clock[rows.start + rows.len() / 2];
                        list.push(Window {
                            sequence,
                            run,
                            rows,
                            clock,
                        });
                    }
                }
                run += 1;
            }
        }
        Self { list, joints }
    }

    /// Number of samples in windows of some sequences.
    pub(crate) fn samples(&self, of: impl Fn(usize) -> bool) -> usize {
        let own = self.list.iter().filter(|w| of(w.sequence));
        own.map(|w| w.rows.len()).sum()
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.list.len() * self.joints
    }

    /// The window of every sample of every sequence.
    pub(crate) fn index(&self, motions: &[&Motion]) -> Vec<Vec<Option<u32>>> {
        let mut index: Vec<_> = motions.iter().map(|m| vec![None; m.len()]).collect();
        for (i, w) in self.list.iter().enumerate() {
            index[w.sequence][w.rows.clone()].fill(Some(i as u32));
        }
        index
    }

    /// Means over windows of one table per sequence.
    pub(crate) fn means<'a>(&self, tables: impl Fn(usize) -> &'a Table) -> Vec<f64> {
        let mut out = vec![0.0; self.rows()];
        for (w, out) in self.list.iter().zip(out.chunks_mut(self.joints)) {
            let table = tables(w.sequence);
            for row in w.rows.clone() {
                out.iter_mut().zip(&table[row]).for_each(|(o, v)| *o += v);
            }
            out.iter_mut().for_each(|o| *o /= w.rows.len() as f64);
        }
        out
    }

    /// Covariance of the noise: row, column and value in the lower triangle, where it matters, the diagonal first.
    pub(crate) fn noise(&self, noise: &[JointNoise]) -> Vec<(usize, usize, f64)> {
        let d = self.joints;
        let mut entries = Vec::with_capacity(2 * self.rows());
        for (i, w) in self.list.iter().enumerate() {
            let own = noise.iter().map(|n| n.of_means(w.rows.len()).sd.powi(2));
            entries.extend(own.enumerate().map(|(j, v)| (i * d + j, i * d + j, v)));
        }
        for (i, w) in self.list.iter().enumerate() {
            for (j, n) in noise.iter().enumerate() {
                let least = FADED * entries[i * d + j].2;
                let later = self.list.iter().enumerate().skip(i + 1);
                let own = later.take_while(|(_, v)| v.run == w.run).map(|(k, v)| {
                    let gap = v.rows.start - w.rows.end;
                    let value = n.covariance_of_means(w.rows.len(), v.rows.len(), gap);
                    (k * d + j, i * d + j, value)
                });
                entries.extend(own.take_while(|e| e.2 > least));
            }
        }
        entries
    }

    /// Standard deviation of the shift of every row by the tare: the noise of the tare's mean, one error per joint and
    /// sequence. Samples of the tare itself have zero mean.
    pub(crate) fn zeros(&self, motions: &[&Motion], noise: &[JointNoise]) -> Vec<f64> {
        let of = |w: &Window| {
            let tare = motions[w.sequence].tare;
            let inside = tare.clamp(w.rows.start, w.rows.end) - w.rows.start;
            let outside = 1.0 - inside as f64 / w.rows.len() as f64;
            noise.iter().map(move |n| match tare {
                0 => 0.0,
                tare => outside * n.of_means(tare).sd,
            })
        };
        self.list.iter().flat_map(of).collect()
    }
}

/// Number of samples from one window to the next.
fn spacing(motions: &[&Motion], joints: usize) -> usize {
    let samples: usize = motions.iter().map(|m| m.len()).sum();
    (samples * joints).div_ceil(MOST_ROWS).max(1)
}

/// Number of samples in a time (s), by the mean of their steps; none without a step.
fn samples_within(time: f64, clock: &[f64]) -> usize {
    match clock {
        [first, .., last] => (time * (clock.len() - 1) as f64 / (last - first)) as usize,
        _ => 0,
    }
}

impl Campaign {
    /// Windows of some sequences. In free air they may be of any length, since means over any time are also those of the
    /// model.
    pub(crate) fn windows(&self, motions: &[&Motion]) -> Windows {
        let longest = if self.site.rest.is_empty() {
            f64::INFINITY
        } else {
            LONGEST
        };
        Windows::new(motions, self.site.joints(), longest)
    }

    /// How many samples may be averaged into one before contact is run: a fifth of a window of the train sequences. In
    /// recordings so long that windows skip samples, not too many of any touch.
    pub(crate) fn averaged(&self) -> usize {
        let motions: Vec<&Motion> = self.train.iter().collect();
        let touches = || {
            motions
                .iter()
                .flat_map(|m| m.touches.iter().map(|t| &m.clock[t.clone()]))
        };
        let fewest = |time: f64| touches().map(|clock| samples_within(time, clock)).min();
        let spacing = spacing(&motions, self.site.joints());
        match (fewest(LONGEST), fewest(COARSEST)) {
            (Some(longest), Some(coarsest)) if spacing > longest => coarsest.min(spacing / FEW),
            _ => spacing / FEW,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use faer::Mat;

    /// Ten samples a second: as long as a window may be, they are of five.
    #[test]
    fn windows_hold_every_sample_once_until_they_are_too_long() {
        for (touches, samples) in [(1, 700), (3, 2000), (3, 50_000), (900, 7), (40_000, 3)] {
            let ranges = (0..touches).map(|t| t * samples..(t + 1) * samples);
            let motion = Motion::counting(touches * samples, ranges.collect());
            let windows = Windows::new(&[&motion], 1, LONGEST);
            let fits = touches * samples <= FEW * MOST_ROWS;
            let mut next = 0;
            for w in &windows.list {
                assert!((1..=FEW).contains(&w.rows.len()));
                assert!(w.rows.start == next || !fits && w.rows.start > next);
                next = w.rows.end;
            }
            assert!(!fits || next == motion.len());
            assert!(
                windows.rows() <= MOST_ROWS + touches.min(MOST_ROWS),
                "{touches}"
            );
        }
    }

    /// Touches that are all alike, of two windows each: no part of them stays unseen.
    #[test]
    fn windows_do_not_keep_step_with_touches() {
        let (touches, samples) = (100, 500);
        let ranges = (0..touches).map(|t| t * samples..(t + 1) * samples);
        let motion = Motion::counting(touches * samples, ranges.collect());
        let windows = Windows::new(&[&motion], 7, LONGEST);
        assert_eq!(windows.list.len(), 2 * touches);
        let mut seen = [0; 20];
        for w in &windows.list {
            assert_eq!(w.rows.len(), FEW);
            seen[w.rows.start % samples * 20 / samples] += 1;
        }
        assert!(seen.iter().all(|count| *count > 5), "{seen:?}");
        let whole = Windows::new(&[&motion], 7, f64::INFINITY);
        assert_eq!(whole.samples(|_| true), motion.len());
    }

    /// Against `A S A^T`, S the covariance of the samples of AR(1) noise that begins afresh with every touch.
    #[test]
    fn val_noise_of_windows_is_that_of_averaged_samples() {
        for samples in [600, 2000] {
            check_noise(samples);
        }
    }

    fn check_noise(samples: usize) {
        let (touches, joints) = (3, 2);
        let ranges = (0..touches).map(|t| t * samples..(t + 1) * samples);
        let motion = Motion::counting(touches * samples, ranges.collect());
        let windows = Windows::new(&[&motion], joints, LONGEST);
        let noise =
            [(0.3, 0.9), (2.0, 0.2)].map(|(sd, correlation)| JointNoise { sd, correlation });
        let n = windows.rows();
        let mut found = Mat::<f64>::zeros(n, n);
        for (row, col, value) in windows.noise(&noise) {
            assert!(row >= col);
            found[(row, col)] += value;
        }
        for (k, v) in windows.list.iter().enumerate() {
            for (i, w) in windows.list.iter().enumerate().take(k + 1) {
                for (j, noise) in noise.iter().enumerate() {
                    let of = |a: usize, b: usize| {
                        if a / samples == b / samples {
                            noise.sd.powi(2) * noise.correlation.powi(a.abs_diff(b) as i32)
                        } else {
                            0.0
                        }
                    };
                    let pairs = v
                        .rows
                        .clone()
                        .flat_map(|a| w.rows.clone().map(move |b| of(a, b)));
                    let expected = pairs.sum::<f64>() / (v.rows.len() * w.rows.len()) as f64;
                    let found = found[(k * joints + j, i * joints + j)];
                    // What has faded is left out.
                    assert!(
                        (found - expected).abs() < 2.0 * FADED * noise.sd.powi(2),
                        "{k}, {i}: {found} {expected}"
                    );
                }
            }
        }
    }
}
