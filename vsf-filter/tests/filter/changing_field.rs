//! Memory replay of a field that changes: what past readings still say, and that it is followed.

use crate::common::Probe;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use vsf_core::{Belief, CoreError, Estimator, FilterHealth, Noise, Observation};
use vsf_filter::{
    CovarianceFilter, DiagonalKalman, FieldPrior, JointEstimator, MemoryReplay, Projection,
    ReplayConfig,
};
use vsf_testkit::{LinearWorld, normal};

/// The noise of a past reading is `R + q W W^T` with the steps since then, whenever and however
/// often it is drawn.
#[test]
fn past_readings_fade_by_the_steps_since() {
    let (n, d) = (12, 3);
    let prior = Belief::uniform(n, 5.0, 1.0).unwrap();
    let (probe, orders) = Probe::new(prior.clone());
    let mut filter = MemoryReplay::new(probe, ReplayConfig::default()).unwrap();
    let mut world = LinearWorld::new(n, 5.0, 1.0, 1);
    let mut observe = || {
        let mut obs = world.reading(n, 6, d, 0.5, 0.1).observation(n).unwrap();
        let r = vec![0.02, 0.01, 0.0, 0.01, 0.02, 0.005, 0.0, 0.005, 0.01];
        obs.set_noise(&Noise::full(d, r).unwrap()).unwrap();
        obs
    };
    let (first, second) = (observe(), observe());
    let check = |obs: &Observation<f64>, q: f64, got: &Noise| {
        let w = DMatrix::from_row_slice(d, obs.len(), obs.rows());
        let expected =
            DMatrix::from_row_slice(d, d, obs.noise().covariance()) + q * &w * w.transpose();
        for (got, expected) in got.covariance().iter().zip(expected.iter()) {
            assert!((got - expected).abs() < 1e-13, "{got}, expected {expected}");
        }
    };
    filter.diffuse(7e-3).unwrap();
    filter.update_with(&first, &[0]).unwrap();
    filter.diffuse(2.5e-3).unwrap();
    filter.update_with(&second, &[1, 0]).unwrap();
    filter.diffuse(5e-3).unwrap();
    filter.diffuse(1.25e-3).unwrap();
    filter.update_with(&first, &[0, 1, 0]).unwrap();
    let seen = std::mem::take(&mut orders.lock().unwrap().seen);
    let noises: Vec<&Noise> = seen.iter().map(Observation::noise).collect();
    let expected = [
        (&first, 0.0),
        (&first, 0.0),
        (&second, 0.0),
        (&second, 0.0),
        (&first, 2.5e-3),
        (&first, 0.0),
        (&first, 8.75e-3),
        (&second, 6.25e-3),
        (&first, 8.75e-3),
    ];
    assert_eq!(noises.len(), expected.len());
    for ((obs, q), noise) in expected.iter().zip(&noises) {
        check(obs, *q, noise);
    }

    // A new start forgets the steps too.
    filter.reset(prior).unwrap();
    filter.update_with(&first, &[0]).unwrap();
    let seen = &orders.lock().unwrap().seen;
    assert!(seen.iter().all(|obs| obs.noise() == first.noise()));
}

#[test]
fn refused_steps_change_nothing() {
    let prior = Belief::<f64>::uniform(3, 5.0, 1.0).unwrap();
    let inner = DiagonalKalman::new(prior.clone());
    let mut filter = MemoryReplay::new(inner, ReplayConfig::default()).unwrap();
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        filter.diffuse(bad).unwrap_err();
        assert_eq!(filter.belief(), &prior);
    }
    filter.diffuse(f64::MAX).unwrap();
    let wide = filter.belief().clone();
    filter.diffuse(f64::MAX).unwrap_err();
    assert_eq!(filter.belief(), &wide);
}

/// Readings whose noise has grown too far leave the buffer when they are drawn, and only they.
#[test]
fn faded_readings_leave_the_buffer() {
    let mut filter = MemoryReplay::new(
        DiagonalKalman::new(Belief::<f64>::uniform(4, 5.0, 1.0).unwrap()),
        ReplayConfig::default(),
    )
    .unwrap();
    let observation = |point: u32| {
        let mut obs = Observation::new(Noise::uniform(1, 0.1).unwrap());
        obs.rebuild(4, &[point], &[5.0], |_, w| w[0] = 1.0).unwrap();
        obs
    };
    // q / R = 0, 2.9, then 3.1 for the first and 0.2 for the later two.
    filter.update_with(&observation(0), &[]).unwrap();
    filter.diffuse(0.029).unwrap();
    filter.update_with(&observation(1), &[0]).unwrap();
    filter.update_with(&observation(2), &[]).unwrap();
    assert_eq!(filter.buffered(), 3);
    filter.diffuse(0.002).unwrap();
    filter.update_with(&observation(3), &[]).unwrap();
    assert_eq!(filter.buffered(), 4, "nothing was drawn");
    let before = filter.belief().clone();
    filter
        .update_with(&observation(3), &[1, 0, 0, 9])
        .unwrap_err();
    assert_eq!(
        (filter.belief(), filter.buffered()),
        (&before, 4),
        "a failed update"
    );
    // Nor is there one where nothing was ever buffered.
    let mut fresh = MemoryReplay::new(
        DiagonalKalman::new(Belief::<f64>::uniform(4, 0.0, 10.0).unwrap()),
        ReplayConfig::default(),
    )
    .unwrap();
    let free = Observation::new(Noise::uniform(1, 0.1).unwrap());
    fresh.update_with(&free, &[0]).unwrap_err();
    fresh.update_with(&observation(0), &[0, 0]).unwrap();
    filter.update_with(&observation(3), &[0, 2, 0]).unwrap();
    assert_eq!(filter.buffered(), 4, "one came, one left");
    assert_eq!(
        filter.belief().mean()[0],
        before.mean()[0],
        "a faded reading taught"
    );
    filter.diffuse(1.0).unwrap();
    let empty = Observation::new(Noise::uniform(1, 0.1).unwrap());
    filter.update_with(&empty, &[2, 0, 3, 1]).unwrap();
    assert_eq!(filter.buffered(), 0);
}

/// A field that drifts by `q` per update, followed by replay that is told of `told`: error (rms, N/m)
/// and NIS ratio of the second half.
fn follow(q: f64, told: f64, replays: usize) -> (f64, f64) {
    let (n, steps) = (200, 400);
    let (mut squares, mut count, mut health) = (0.0, 0.0, FilterHealth::default());
    for seed in 0..3 {
        let mut world = LinearWorld::new(n, 50.0, 3.0, seed);
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let inner = DiagonalKalman::new(Belief::<f64>::uniform(n, 50.0, 3.0).unwrap());
        let config = ReplayConfig {
            replays,
            ..ReplayConfig::default()
        };
        let mut filter = MemoryReplay::new(inner, config).unwrap();
        for t in 0..steps {
            for k in &mut world.stiffness {
                *k += q.sqrt() * normal(&mut rng);
            }
            filter.diffuse(told).unwrap();
            let reading = world.reading(n, 30, 3, 0.3, 0.3);
            let report = filter.update(&reading.observation(n).unwrap()).unwrap();
            if t >= steps / 2 {
                health.record(&report);
                let pairs = filter.belief().mean().iter().zip(&world.stiffness);
                squares += pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                count += n as f64;
            }
        }
    }
    (f64::sqrt(squares / count), health.nis_ratio().unwrap())
}

/// Told of the drift, replay is better than without the past and better than untold, for slow and
/// quick drift, and keeps the NIS near that of a constant field.
#[test]
fn a_field_that_drifts_is_followed() {
    for (q, without_past, untold_error, untold_ratio) in
        [(1e-3, 0.6, 1.0, 1.5), (1e-2, 0.95, 0.85, 4.0)]
    {
        let (told, told_nis) = follow(q, q, 20);
        let (untold, untold_nis) = follow(q, 0.0, 20);
        let (bare, bare_nis) = follow(q, q, 0);
        eprintln!(
            "q {q}: error and NIS ratio {told:.3} {told_nis:.2}, untold {untold:.3} \
             {untold_nis:.2}, without replay {bare:.3} {bare_nis:.2}"
        );
        assert!(told < without_past * bare && told_nis < bare_nis);
        assert!(told < untold_error * untold && told_nis * untold_ratio < untold_nis);
    }
}

/// The exact filter beside the Kalman filter with full matrices, with steps between the readings and
/// points that are touched late.
#[test]
fn the_covariance_filter_follows_a_changing_field() {
    let (n, d, q) = (70, 3, 0.2);
    let prior = Belief::<f64>::uniform(n, 5.0, 2.0).unwrap();
    let mut filter =
        CovarianceFilter::with_projection(prior.clone(), Projection::OutputOnly).unwrap();
    let mut mean = DVector::from_element(n, 5.0);
    let mut covariance = DMatrix::identity(n, n) * 4.0;
    let mut world = LinearWorld::new(n, 5.0, 2.0, 4);
    for step in 0..40 {
        filter.diffuse(q).unwrap();
        covariance += DMatrix::identity(n, n) * q;
        let obs = world.reading(n, 6, d, 0.5, 0.1).observation(n).unwrap();
        let mut w = DMatrix::zeros(d, n);
        for (i, (k, &p)) in
            (0..d).flat_map(|i| obs.points().iter().enumerate().map(move |k| (i, k)))
        {
            w[(i, p as usize)] = obs.row(i)[k];
        }
        let r = DMatrix::from_row_slice(d, d, obs.noise().covariance());
        let s = &w * &covariance * w.transpose() + r;
        let gain = &covariance * w.transpose() * s.try_inverse().unwrap();
        mean += &gain * (DVector::from_row_slice(obs.reading()) - &w * &mean);
        covariance -= &gain * &w * &covariance;
        filter.update(&obs).unwrap();
        for i in 0..n {
            let (m, v) = (filter.belief().mean()[i], filter.belief().variance()[i]);
            assert!((m - mean[i].max(0.0)).abs() < 1e-9, "{step}: mean {i}");
            assert!(
                (v - covariance[(i, i)]).abs() < 1e-9,
                "{step}: variance {i}"
            );
        }
    }
    assert!(filter.points().len() > 64, "two blocks of the matrix");
    let before = filter.belief().clone();
    assert!(filter.diffuse(f64::NAN).is_err() && filter.diffuse(-1.0).is_err());
    assert_eq!(filter.belief(), &before);

    let level = FieldPrior::from(prior.clone()).with_level(1.0).unwrap();
    for mut refused in [
        CovarianceFilter::<f64>::new(prior).unwrap(),
        CovarianceFilter::with_projection(level, Projection::OutputOnly).unwrap(),
    ] {
        let error = refused.diffuse(q).unwrap_err();
        assert!(matches!(error, CoreError::Unsupported { .. }), "{error}");
    }
}
