//! The diagonal filter against closed forms, and the documented divergence of eq. 7 as printed.

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use vsf_core::{Belief, Estimator, FilterHealth, Noise, Observation, Scalar};
use vsf_filter::{DiagonalForm, DiagonalKalman};
use vsf_testkit::{LinearWorld, normal};

const FORMS: [DiagonalForm; 3] = [
    DiagonalForm::Innovation,
    DiagonalForm::InnovationUpdated,
    DiagonalForm::Printed,
];

/// Residual norms of 30 updates by one reading: 3000 contacts, |w| <= 0.015, sigma_tau = 1 and
/// sigma_0 = 10.
fn residuals(form: DiagonalForm) -> Vec<f64> {
    let n = 3000;
    let mut world = LinearWorld::new(n, 0.0, 1.0, 5);
    let obs = world
        .reading(n, n, 7, 0.015, 1.0)
        .observation::<f64>(n)
        .unwrap();
    let prior = Belief::uniform(n, 0.0, 10.0).unwrap();
    let mut filter = DiagonalKalman::with_form(prior, form);
    let reports = (0..30).map(|_| filter.update(&obs).unwrap());
    reports.flat_map(|r| [r.prefit, r.postfit]).collect()
}

#[test]
fn eq7_as_printed_diverges_for_a_wide_prior() {
    let r = residuals(DiagonalForm::Printed);
    let peak = r.iter().fold(0.0f64, |a, b| a.max(*b));
    eprintln!(
        "printed: residual {:.3} -> peak {peak:.3}, last {:.3}",
        r[0], r[59]
    );
    assert!(peak > 5.0 * r[0], "residual {} -> {peak}", r[0]);
}

#[test]
fn the_gain_forms_never_let_the_residual_grow() {
    for form in [DiagonalForm::Innovation, DiagonalForm::InnovationUpdated] {
        let r = residuals(form);
        eprintln!("{form:?}: residual {:.3} -> {:.3}", r[0], r[59]);
        for pair in r.windows(2) {
            assert!(
                pair[1] <= pair[0] * (1.0 + 1e-12),
                "{form:?}: {} -> {}",
                pair[0],
                pair[1]
            );
        }
    }
}

/// One point and one channel: all gains are `v w / (v w² + R)`, of the variance before or after.
#[test]
fn one_point_is_the_scalar_kalman_filter() {
    for form in FORMS {
        let (mut m, mut v, r) = (1.5, 4.0, 0.09);
        let mut filter = DiagonalKalman::with_form(Belief::new(vec![m], vec![v]).unwrap(), form);
        let mut obs = Observation::new(Noise::uniform(1, 0.3).unwrap());
        for (w, tau) in [(0.2, 0.5), (-0.1, -0.3), (0.05, 0.0), (0.3, 1.2)] {
            obs.rebuild(1, &[0], &[tau], |_, c| c[0] = w).unwrap();
            let report = filter.update(&obs).unwrap();
            let (s, e) = (v * w * w + r, tau - w * m);
            let after = v * r / s;
            m += e * match form {
                DiagonalForm::Innovation => v * w / s,
                DiagonalForm::InnovationUpdated => after * w / (after * w * w + r),
                DiagonalForm::Printed => after * w / r,
                other => panic!("{other:?}"),
            };
            v = after;
            assert!((filter.belief().mean()[0] - m).abs() < 1e-13, "{form:?}");
            assert!(
                (filter.belief().variance()[0] - v).abs() < 1e-13,
                "{form:?}"
            );
            assert!((report.nis - e * e / s).abs() < 1e-12, "{form:?}");
            let log = -0.5 * (e * e / s + (std::f64::consts::TAU * s).ln());
            assert!((report.log_likelihood - log).abs() < 1e-12, "{form:?}");
        }
    }
}

/// After one observation the default form has the exact posterior mean `(P^-1 + W^T R^-1 W)^-1 (P^-1 m + W^T R^-1 tau)`, correlated noise included. The variances of
/// eq. 7 are the inverses of the precision's diagonal, too small; its own are between these and the exact
/// ones, the diagonal of the precision's inverse.
#[test]
fn one_observation_gives_the_exact_posterior_mean() {
    let (n, d) = (23, 4);
    let mut world = LinearWorld::new(n, 8.0, 1.0, 9);
    let reading = world.reading(n, n, d, 0.2, 0.2);
    let a = DMatrix::from_fn(d, d, |i, j| {
        if i == j {
            0.3
        } else {
            0.05 * (i + 2 * j) as f64
        }
    });
    let r = &a * a.transpose();
    let mut obs = Observation::<f64>::new(Noise::full(d, r.iter().copied().collect()).unwrap());
    obs.rebuild(n, &reading.points, &reading.tau, |k, w| {
        w.copy_from_slice(&reading.columns[k]);
    })
    .unwrap();
    let mean = DVector::from_fn(n, |i, _| 7.0 + 0.1 * i as f64);
    let variance = DVector::from_fn(n, |i, _| 0.5 + 0.05 * i as f64);

    let w = DMatrix::from_fn(d, n, |i, k| reading.columns[k][i]);
    let r_inv = r.try_inverse().unwrap();
    let precision =
        DMatrix::from_diagonal(&variance.map(|v| 1.0 / v)) + w.transpose() * &r_inv * &w;
    let rhs = mean.component_div(&variance)
        + w.transpose() * &r_inv * DVector::from_column_slice(&reading.tau);
    let exact = precision.clone().lu().solve(&rhs).unwrap();
    let covariance = precision.clone().try_inverse().unwrap();

    let prior = Belief::new(mean.as_slice().to_vec(), variance.as_slice().to_vec()).unwrap();
    for form in FORMS {
        let mut filter = DiagonalKalman::with_form(prior.clone(), form);
        filter.update(&obs).unwrap();
        let belief = filter.belief();
        for i in 0..n {
            let (mean, variance) = (belief.mean()[i], belief.variance()[i]);
            let (eq7, whole) = (1.0 / precision[(i, i)], covariance[(i, i)]);
            if form == DiagonalForm::Innovation {
                assert!((mean - exact[i]).abs() < 1e-11, "mean {i}: {mean}");
                assert!(eq7 < variance && variance < whole, "variance {i}");
            } else {
                assert!((variance - eq7).abs() < 1e-13, "{form:?}, variance {i}");
            }
        }
    }
}

/// Points of 1e6 N/m that are pressed one after the other, deeper and deeper, and read to 0.01 N m: the
/// first readings say little about each of them, and the filter knows it.
#[test]
fn readings_much_more_precise_than_the_prior_do_not_make_it_diverge() {
    fn error<T: Scalar>(sd: f64) -> f64 {
        let (n, d) = (120, 7);
        let mut world = LinearWorld::new(n, 1e6, 3e5, 4);
        let columns: Vec<_> = world.reading(n, n, d, 0.3, 0.0).columns;
        let truth = world.stiffness.clone();
        let mut filter = DiagonalKalman::<T>::new(Belief::uniform(n, 0.0, 1.5e6).unwrap());
        let mut obs = Observation::<T>::new(Noise::uniform(d, sd).unwrap());
        let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
        for push in 0..2 {
            for step in 1..=60 {
                let touched: Vec<u32> = (0..2 * step).collect();
                let depth = |p: u32| 0.02 * f64::from(2 * step - p) / 120.0;
                let w = |p: u32, i: usize| depth(p) * columns[p as usize][i];
                let tau: Vec<f64> = (0..d)
                    .map(|i| touched.iter().map(|&p| w(p, i) * truth[p as usize]).sum())
                    .collect();
                obs.rebuild(n, &touched, &tau, |k, c| {
                    (0..d).for_each(|i| c[i] = w(touched[k], i));
                })
                .unwrap();
                let report = filter.update(&obs).unwrap();
                largest = largest.max(tau.iter().map(|t| t * t).sum::<f64>().sqrt());
                if push == 1 {
                    worst = worst.max(report.prefit);
                }
            }
        }
        worst / largest
    }
    for sd in [1.0, 0.01, 1e-4] {
        let (single, double) = (error::<f32>(sd), error::<f64>(sd));
        eprintln!("noise {sd}: f32 {single:.2e}, f64 {double:.2e} of the largest torque");
        assert!(single < 0.01 && double < 1e-3, "{sd}: {single}, {double}");
    }
}

/// A spring that takes random steps is the local-level model: the variance settles at the solution
/// of the Riccati equation, and innovations are as large as the filter says.
#[test]
fn a_spring_that_drifts_is_the_local_level_model() {
    let (w, r, q): (f64, f64, f64) = (0.5, 0.09, 0.04);
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    let mut run = |diffuse: bool| {
        let mut filter = DiagonalKalman::new(Belief::uniform(1, 50.0, 1.0).unwrap());
        let mut obs = Observation::new(Noise::uniform(1, r.sqrt()).unwrap());
        let (mut health, mut k, mut squares) = (FilterHealth::default(), 50.0, 0.0);
        for t in 0..2000 {
            k += q.sqrt() * normal(&mut rng);
            if diffuse {
                filter.diffuse(q).unwrap();
            }
            let tau = w * k + r.sqrt() * normal(&mut rng);
            obs.rebuild(1, &[0], &[tau], |_, c| c[0] = w).unwrap();
            let report = filter.update(&obs).unwrap();
            if t >= 100 {
                health.record(&report);
                squares += (filter.belief().mean()[0] - k).powi(2);
            }
        }
        (filter, health, squares / 1900.0)
    };
    let (filter, health, squares) = run(true);
    // Before an update p = q + p r / (p w² + r), after it p - q.
    let noise = r / (w * w);
    let settled = 0.5 * (q + (q * q + 4.0 * q * noise).sqrt()) - q;
    let variance = filter.belief().variance()[0];
    assert!((variance - settled).abs() < 1e-12, "{variance}, {settled}");
    let ratio = health.nis_ratio().unwrap();
    eprintln!("NIS ratio {ratio:.3}, error {squares:.4} of {settled:.4}");
    // Five standard deviations of 1900 squares; errors are correlated over some 5 steps.
    assert!((ratio - 1.0).abs() < 5.0 * (2.0f64 / 1900.0).sqrt());
    assert!((squares / settled - 1.0).abs() < 5.0 * (5.0 * 2.0f64 / 1900.0).sqrt());

    // A filter that takes the spring to be constant loses it.
    let (_, health, squares) = run(false);
    eprintln!(
        "constant: NIS ratio {:.1}, error {squares:.2}",
        health.nis_ratio().unwrap()
    );
    assert!(health.nis_ratio().unwrap() > 5.0 && squares > 10.0 * settled);
}
