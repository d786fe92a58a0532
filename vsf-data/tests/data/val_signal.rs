//! Derivatives against closed forms.

use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use vsf_data::{DataError, Sequence, Table, differentiate, tare};

/// Uneven stamps: 100 Hz with 30 % jitter, no two the same.
fn stamps(n: usize) -> Vec<f64> {
    (0..n)
        .map(|k| 3.0 + 0.01 * (k as f64 + 0.3 * (1.7 * k as f64).sin()))
        .collect()
}

fn column(values: impl Iterator<Item = f64>) -> Table {
    Table::new(1, values.collect()).unwrap()
}

#[test]
fn parabolas_are_exact_up_to_the_ends() {
    let t = stamps(50);
    let x = Table::new(
        2,
        t.iter()
            .flat_map(|t| [2.0 - t + 5.0 * t * t, -0.5 * t])
            .collect(),
    )
    .unwrap();
    for half_window in [1, 2, 7, 100] {
        let v = differentiate(&t, &x, half_window).unwrap();
        for (row, t) in v.iter().zip(&t) {
            assert!(
                (row[0] - (10.0 * t - 1.0)).abs() < 1e-8,
                "{half_window} {t} {}",
                row[0]
            );
            assert!((row[1] + 0.5).abs() < 1e-9);
        }
    }
}

#[test]
fn the_narrow_window_is_the_central_difference() {
    let t: Vec<f64> = (0..9).map(|k| 0.25 * f64::from(k)).collect();
    let x = column(t.iter().map(|t| t.exp()));
    let v = differentiate(&t, &x, 1).unwrap();
    for k in 1..8 {
        let central = (x[k + 1][0] - x[k - 1][0]) / 0.5;
        assert!((v[k][0] - central).abs() < 1e-12);
    }
    let first = (-3.0 * x[0][0] + 4.0 * x[1][0] - x[2][0]) / 0.5;
    assert!((v[0][0] - first).abs() < 1e-12);
}

#[test]
fn the_error_on_a_sine_falls_with_the_square_of_the_step() {
    let error = |n: usize| {
        let t: Vec<f64> = (0..n).map(|k| k as f64 / n as f64).collect();
        let v = differentiate(&t, &column(t.iter().map(|t| (6.0 * t).sin())), 2).unwrap();
        let worst = t
            .iter()
            .zip(v.data())
            .map(|(t, v)| (v - 6.0 * (6.0 * t).cos()).abs());
        worst.fold(0.0, f64::max)
    };
    let order = (error(100) / error(400)).log2() / 2.0;
    assert!((order - 2.0).abs() < 0.1, "{order}");
}

#[test]
fn smoothing_divides_the_noise_as_documented() {
    // White noise with even stamps: variance of the slope 12 / (m (m^2 - 1) h^2) for the centered
    // window of m samples, against 1 / (2 h^2) for the central difference.
    let n = 20_000;
    let mut state = 1u64;
    let mut noise = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let x = column((0..n).map(|_| noise()));
    let t: Vec<f64> = (0..n).map(|k| k as f64).collect();
    for half_window in [1usize, 3, 8] {
        let m = (2 * half_window + 1) as f64;
        let v = differentiate(&t, &x, half_window).unwrap();
        let inner = &v.data()[half_window..n - half_window];
        let variance = inner.iter().map(|v| v * v).sum::<f64>() / inner.len() as f64;
        let expected = 12.0 / (m * (m * m - 1.0)) / 12.0;
        assert!(
            (variance / expected - 1.0).abs() < 0.08,
            "{half_window}: {}",
            variance / expected
        );
    }
}

proptest! {
    #[test]
    fn equals_least_squares_by_svd(
        steps in prop::collection::vec(0.01..1.0f64, 12),
        values in prop::collection::vec(-5.0..5.0f64, 12),
        half_window in 1..5usize,
    ) {
        let t: Vec<f64> = steps.iter().scan(0.0, |t, s| { *t += s; Some(*t) }).collect();
        let v = differentiate(&t, &column(values.iter().copied()), half_window).unwrap();
        for row in 0..12usize {
            let m = 2 * half_window + 1;
            let first = row.saturating_sub(half_window).min(12 - m);
            let A = DMatrix::from_fn(m, 3, |i, j| (t[first + i] - t[row]).powi(j as i32));
            let b = DVector::from_column_slice(&values[first..first + m]);
            let fit = A.svd(true, true).solve(&b, 1e-14).unwrap();
            prop_assert!((v[row][0] - fit[1]).abs() < 1e-7 * (1.0 + fit[1].abs()));
        }
    }

    #[test]
    fn taring_leaves_the_first_samples_without_mean(
        values in prop::collection::vec(-5.0..5.0f64, 12), samples in 1..6usize,
    ) {
        let tared = tare(&Table::new(2, values.clone()).unwrap(), samples).unwrap();
        for col in 0..2 {
            let mean = tared.column(col).take(samples).sum::<f64>();
            prop_assert!(mean.abs() < 1e-12);
            let shift = tared[0][col] - values[col];
            prop_assert!((tared[5][col] - values[10 + col] - shift).abs() < 1e-12);
        }
    }
}

fn sequence(velocities: Option<Table>) -> Sequence {
    // Two touches: x = t^2, then a jump to x = 100 - 3 t^2.
    let t = stamps(20);
    let x = |k: usize| {
        if k < 10 {
            t[k] * t[k]
        } else {
            100.0 - 3.0 * t[k] * t[k]
        }
    };
    let angles = column((0..20).map(x));
    Sequence {
        id: "0".to_owned(),
        torques: angles.clone(),
        angles,
        velocities,
        touch_starts: vec![0, 10],
        tags: vec![],
        time: t,
    }
}

#[test]
fn motion_does_not_differentiate_across_touches() {
    let s = sequence(None);
    let motion = s.derivatives(2).unwrap();
    for k in 0..20 {
        let a = if k < 10 { 2.0 } else { -6.0 };
        assert!((motion.velocities[k][0] - a * s.time[k]).abs() < 1e-8);
        assert!((motion.accelerations[k][0] - a).abs() < 1e-5);
    }
}

#[test]
fn recorded_velocities_are_kept() {
    let recorded = column(stamps(20).iter().map(|t| 1.0 + 4.0 * t));
    let motion = sequence(Some(recorded.clone())).derivatives(1).unwrap();
    assert_eq!(motion.velocities, recorded);
    assert!(
        motion
            .accelerations
            .data()
            .iter()
            .all(|a| (a - 4.0).abs() < 1e-9)
    );
}

#[test]
fn bad_arguments_are_errors() {
    let x = column([1.0, 2.0, 4.0].into_iter());
    let refused = |time: &[f64], x: &Table, w| {
        let result = differentiate(time, x, w);
        assert!(
            matches!(result, Err(DataError::Argument { .. })),
            "{result:?}"
        );
    };
    refused(&[0.0, 1.0, 2.0], &x, 0);
    refused(&[0.0, 1.0], &x, 1);
    refused(&[0.0, 1.0, 1.0], &x, 1);
    refused(&[0.0, f64::NAN, 2.0], &x, 1);
    refused(&[-f64::MAX, 0.0, f64::MAX], &x, 1);
    refused(
        &[0.0, 1e-300, 2e-300],
        &column([0.0, f64::MAX, 0.0].into_iter()),
        1,
    );
    refused(&[0.0], &column(std::iter::once(1.0)), 1);
    refused(&[0.0, 1.0], &column([0.0, f64::NAN].into_iter()), 1);
    assert!(tare(&x, 4).is_err());
    let huge = Table::new(1, vec![1.7e308, 1.7e308, 0.0]).unwrap();
    assert!(tare(&huge, 2).is_err());
    assert_eq!(tare(&x, 0).unwrap(), x);
    let mut s = sequence(None);
    s.touch_starts = vec![0, 19];
    assert!(s.derivatives(1).is_err());
    s.touch_starts = vec![7, 3, 90];
    assert!(s.derivatives(1).is_err());
    assert!(Table::new(0, vec![]).is_err());
    assert!(Table::new(2, vec![1.0]).is_err());
    assert_eq!(x.get(3), None);
    assert_eq!(x.column(1).count(), 0);
}
