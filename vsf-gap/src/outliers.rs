//! A few rows that hold much of what a model leaves: more likely a fault of the recording than an effect.

use crate::JointNoise;
use crate::closure::Residuals;
use std::ops::Range;

/// Most rows of a run, and the share of the squared errors from which on it holds much: at least this, and at least this
/// many times its share of the rows.
const ROWS: usize = 10;
const MUCH: f64 = 0.1;
const TIMES: f64 = 10.0;
/// The same number of rows before and after the run holds less than this share of what the run holds. What acts for longer
/// is no fault.
const ALONE: f64 = 0.2;
/// Noise below this share of the errors counts as none.
const SMALL: f64 = 1e-3;

/// A run of rows that holds much of the squared errors, in units of noise.
#[derive(Debug, PartialEq)]
pub(crate) struct Outlier {
    /// Index of the sequence.
    pub(crate) sequence: usize,
    /// From the first to the last row with a large error.
    pub(crate) rows: Range<usize>,
    /// The joint with the largest error there.
    pub(crate) joint: usize,
    /// The share of the squared errors that these rows hold.
    pub(crate) share: f64,
    /// The largest absolute error of that joint there (N m or N), and its root mean square in all other rows.
    pub(crate) error: f64,
    pub(crate) elsewhere: f64,
}

/// The run that holds most of the squared errors, if that is much.
pub(crate) fn outlier(residuals: &Residuals, noise: &[JointNoise]) -> Option<Outlier> {
    let d = residuals.joints.max(1);
    let of_joint = |j: usize| {
        residuals
            .rows
            .iter()
            .flat_map(move |own| own.iter().skip(j).step_by(d))
    };
    // Errors of readings without noise are compared with their own size.
    let scale = |(j, n): (usize, &JointNoise)| {
        let (count, sum) = of_joint(j).fold((0, 0.0), |(n, sum), r| (n + 1, sum + r * r));
        let rms = (sum / f64::from(count.max(1))).sqrt();
        let scale = if n.sd > SMALL * rms { n.sd } else { rms };
        scale.max(f64::MIN_POSITIVE)
    };
    let scales: Vec<f64> = noise.iter().enumerate().map(scale).collect();
    let square =
        |row: &[f64]| -> f64 { row.iter().zip(&scales).map(|(r, s)| (r / s).powi(2)).sum() };
    let squares: Vec<Vec<f64>> = (residuals.rows.iter())
        .map(|rows| rows.chunks_exact(d).map(square).collect())
        .collect();
    let all: f64 = squares.iter().flatten().sum();
    let samples: usize = squares.iter().map(Vec::len).sum();
    let run_of = |(sequence, squares): (usize, &Vec<f64>)| {
        let sums = squares.windows(ROWS).map(|run| run.iter().sum::<f64>());
        let most = sums.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((sequence, most.0, most.1))
    };
    let usual = TIMES * ROWS as f64 / samples as f64;
    let least = all * MUCH.max(usual);
    let stands_out = |(sequence, first, sum): &(usize, usize, f64)| {
        let rows = &squares[*sequence];
        let near = first.saturating_sub(ROWS)..(first + 2 * ROWS).min(rows.len());
        *sum > least && rows[near].iter().sum::<f64>() - sum <= ALONE * sum
    };
    let runs = squares
        .iter()
        .enumerate()
        .filter_map(run_of)
        .filter(stands_out);
    let (sequence, first, sum) = runs.max_by(|a, b| a.2.total_cmp(&b.2))?;
    // Those that hold a tenth of it each: one does.
    let far = |row: &usize| squares[sequence][*row] >= sum * MUCH;
    let mut rows = (first..first + ROWS).filter(far);
    let begin = rows.next()?;
    let rows = begin..rows.next_back().unwrap_or(begin) + 1;
    let peak = |j: usize| {
        let of_rows = rows
            .clone()
            .map(|row| residuals.rows[sequence][row * d + j].abs());
        of_rows.fold(0.0, f64::max)
    };
    let joint = (0..d).max_by(|a, b| {
        let of = |j: usize| peak(j) / scales[j];
        of(*a).total_cmp(&of(*b))
    })?;
    let others = residuals.rows.iter().enumerate().flat_map(|(s, own)| {
        let own = own.iter().skip(joint).step_by(d).enumerate();
        let rows = rows.clone();
        own.filter(move |(row, _)| s != sequence || !rows.contains(row))
    });
    let (count, total) = others.fold((0, 0.0), |(n, sum), (_, r)| (n + 1, sum + r * r));
    Some(Outlier {
        sequence,
        share: squares[sequence][rows.clone()].iter().sum::<f64>() / all,
        joint,
        error: peak(joint),
        elsewhere: (total / f64::from(count.max(1))).sqrt(),
        rows,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: Vec<Vec<f64>>) -> (Residuals, Vec<JointNoise>) {
        let predicted = rows.clone();
        let residuals = Residuals {
            joints: 2,
            rows,
            predicted,
        };
        let noise = [0.1, 1.0].map(|sd| JointNoise {
            sd,
            correlation: 0.0,
        });
        (residuals, noise.to_vec())
    }

    fn noisy() -> Vec<Vec<f64>> {
        let wave = |k: usize, size: f64| size * (7.0 * k as f64).sin();
        let sequence = |of: usize| {
            (0..400)
                .flat_map(|k| [wave(k + of, 0.1), wave(k, 1.0)])
                .collect()
        };
        (0..3).map(sequence).collect()
    }

    #[test]
    fn a_few_rows_are_named() {
        let (even, noise) = of(noisy());
        assert_eq!(outlier(&even, &noise), None);
        let mut rows = noisy();
        // By their noise, 5 of the first joint are more than 20 of the second.
        for (row, joint, error) in [(50, 0, 5.0), (51, 0, -4.0), (51, 1, 20.0)] {
            rows[1][2 * row + joint] = error;
        }
        let (spiked, noise) = of(rows);
        let found = outlier(&spiked, &noise).unwrap();
        assert_eq!((found.sequence, found.rows, found.joint), (1, 50..52, 0));
        assert_eq!(found.error, 5.0);
        assert!((found.elsewhere - 0.1 / 2f64.sqrt()).abs() < 1e-3);
        assert!(found.share > 0.7 && found.share < 0.8, "{}", found.share);
    }

    #[test]
    fn what_acts_for_longer_is_none() {
        let mut rows = noisy();
        rows[2]
            .iter_mut()
            .skip(2 * 100)
            .take(2 * 60)
            .for_each(|r| *r *= 20.0);
        let (pushed, noise) = of(rows);
        assert_eq!(outlier(&pushed, &noise), None);
    }

    #[test]
    fn nothing_left_or_no_noise() {
        let (nothing, noise) = of(vec![vec![0.0; 80]; 2]);
        assert_eq!(outlier(&nothing, &noise), None);
        let mut rows = noisy();
        rows[0][2 * 7] = 30.0;
        let (spiked, _) = of(rows);
        let exact = [JointNoise {
            sd: 0.0,
            correlation: 0.0,
        }; 2];
        assert_eq!(outlier(&spiked, &exact).unwrap().rows, 7..8);
        let (short, noise) = of(vec![vec![1.0; 6]]);
        assert_eq!(outlier(&short, &noise), None);
    }
}
