//! The diagonal filter against numbers made by other software (see `golden/README.md`).

use crate::common::{archive, golden_observations};
use ndarray::{Array1, Array2};
use ndarray_npy::ReadableElement;
use vsf_core::{Belief, Estimator, Observation};
use vsf_filter::{BatchMap, DiagonalForm, DiagonalKalman, MemoryReplay, ReplayConfig};

fn matrix<T: ReadableElement>(name: &str, key: &str) -> Array2<T> {
    archive(name).by_name(key).unwrap()
}

struct Problem {
    observations: Vec<Observation<f64>>,
    prior: Belief<f64>,
    x_true: Array1<f64>,
}

fn problem() -> Problem {
    let (observations, x_true) = golden_observations();
    let n = x_true.len();
    Problem {
        observations,
        prior: Belief::uniform(n, 0.0, 0.1).unwrap(),
        x_true,
    }
}

fn compare(filter: &mut dyn FnMut(usize) -> Belief<f64>, key: &str) {
    let mean: Array2<f64> = matrix("ekf_diag.npz", &format!("mu_{key}"));
    let variance: Array2<f64> = matrix("ekf_diag.npz", &format!("var_{key}"));
    for t in 0..mean.dim().0 {
        let belief = filter(t);
        for i in 0..belief.len() {
            let (dm, dv) = (
                belief.mean()[i] - mean[[t, i]],
                belief.variance()[i] - variance[[t, i]],
            );
            assert!(
                dm.abs() < 1e-12,
                "{key} step {t} point {i}: mean off by {dm:e}"
            );
            assert!(
                dv.abs() < 1e-12,
                "{key} step {t} point {i}: variance off by {dv:e}"
            );
        }
    }
}

#[test]
fn single_updates() {
    let p = problem();
    for (form, key) in [
        (DiagonalForm::Printed, "information"),
        (DiagonalForm::InnovationUpdated, "kalman"),
    ] {
        let mut filter = DiagonalKalman::with_form(p.prior.clone(), form);
        compare(
            &mut |t| {
                filter.update(&p.observations[t]).unwrap();
                filter.belief().clone()
            },
            key,
        );
    }
}

#[test]
fn replay_with_given_draws() {
    let p = problem();
    for (form, key, draws) in [
        (
            DiagonalForm::Printed,
            "information_replay10",
            "replay_idx_information",
        ),
        (
            DiagonalForm::InnovationUpdated,
            "kalman_replay10",
            "replay_idx",
        ),
    ] {
        let draws: Array2<i64> = matrix("ekf_diag.npz", draws);
        let inner = DiagonalKalman::with_form(p.prior.clone(), form);
        let mut filter = MemoryReplay::new(inner, ReplayConfig::default()).unwrap();
        compare(
            &mut |t| {
                let replays: Vec<usize> = draws.row(t).iter().map(|&j| j as usize).collect();
                filter.update_with(&p.observations[t], &replays).unwrap();
                filter.belief().clone()
            },
            key,
        );
    }
}

/// Mean distance to the true field: replay with the default form must beat the bare filter.
#[test]
fn replay_comes_closer_to_the_truth() {
    let p = problem();
    let error = |e: &mut dyn Estimator<Scalar = f64>| -> f64 {
        p.observations.iter().for_each(|o| {
            e.update(o).unwrap();
        });
        let pairs = e.belief().mean().iter().zip(&p.x_true);
        pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let plain = error(&mut DiagonalKalman::new(p.prior.clone()));
    let inner = DiagonalKalman::new(p.prior.clone());
    let replayed = error(&mut MemoryReplay::new(inner, ReplayConfig::default()).unwrap());
    assert!(replayed < plain, "replayed {replayed}, plain {plain}");
}

#[test]
fn batch_optimum() {
    let p = problem();
    let expected: Array1<f64> = archive("quadprog.npz").by_name("x_exact_nnls").unwrap();
    let batch = BatchMap::new(p.prior.len(), [&p.observations[..]]).unwrap();
    let fit = batch.solve(&p.prior.into(), 1.0).unwrap();
    let residual = fit.kkt_residual();
    assert!(residual < 1e-10, "KKT residual {residual:e}");
    for (i, (a, b)) in fit.mean().iter().zip(&expected).enumerate() {
        assert!((a - b).abs() < 1e-8, "point {i}: {a} instead of {b}");
    }
}
