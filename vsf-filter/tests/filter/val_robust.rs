//! Outliers: what they do to a filter, and what is left of it under robust noise. Closed forms of
//! one reading.

use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use vsf_core::{Belief, CoreError, Estimator, FilterHealth, Noise, Observation, Prediction};
use vsf_filter::{DiagonalKalman, MemoryReplay, ReplayConfig, RobustLoss, RobustNoise};
use vsf_testkit::{LinearWorld, normal};

type Boxed = Box<dyn Estimator<Scalar = f64>>;

const LOSSES: [RobustLoss; 2] = [RobustLoss::HUBER, RobustLoss::STUDENT_T];

fn robust<E: Estimator>(inner: E, loss: RobustLoss) -> RobustNoise<E> {
    RobustNoise::new(inner, loss).unwrap()
}

fn replay<E: vsf_filter::Revisit>(inner: E) -> MemoryReplay<E> {
    MemoryReplay::new(inner, ReplayConfig::default()).unwrap()
}

#[test]
fn weights_are_those_of_the_losses() {
    let (huber, t) = (RobustLoss::HUBER, RobustLoss::STUDENT_T);
    for z in [0.0, 0.5, 1.0, 1.345] {
        assert_eq!(huber.weight(z), 1.0);
        assert_eq!(huber.weight(-z), 1.0);
    }
    assert_eq!(huber.weight(2.69), 0.5);
    assert_eq!(huber.weight(-13.45), 0.1);
    assert_eq!((t.weight(0.0), t.weight(1.0)), (1.0, 1.0));
    assert_eq!(t.weight(4.0), 0.25);
    for loss in LOSSES {
        for z in [1e10, 1e200, f64::INFINITY] {
            assert!(loss.weight(z) > 0.0 && loss.weight(z) < 1e-9, "{loss:?}");
        }
    }
    for loss in [
        RobustLoss::Huber { k: 0.0 },
        RobustLoss::Huber { k: f64::NAN },
        RobustLoss::StudentT { nu: -1.0 },
        RobustLoss::StudentT { nu: f64::INFINITY },
    ] {
        let filter = DiagonalKalman::new(Belief::<f64>::uniform(1, 0.0, 1.0).unwrap());
        let error = RobustNoise::new(filter, loss).unwrap_err();
        assert!(matches!(error, CoreError::Parameter { .. }), "{loss:?}");
    }
}

/// The posterior mean of one observation is that of noise `R_ij / sqrt(w_i w_j)` plus
/// `(s_i² - R_ii) (1 / w_i - 1)` on the diagonal, by the formula written out.
#[test]
fn one_observation_gives_the_posterior_of_the_inflated_noise() {
    let (n, d) = (9, 4);
    let mut world = LinearWorld::new(n, 8.0, 1.0, 9);
    let mut reading = world.reading(n, n, d, 0.5, 0.2);
    reading.tau[1] += 20.0;
    reading.tau[3] -= 4.0;
    let a = DMatrix::from_fn(d, d, |i, j| {
        if i == j {
            0.3
        } else {
            0.05 * (i + 2 * j) as f64
        }
    });
    let r = &a * a.transpose();
    let mut obs = Observation::<f64>::new(Noise::full(d, r.as_slice().to_vec()).unwrap());
    obs.rebuild(n, &reading.points, &reading.tau, |k, w| {
        w.copy_from_slice(&reading.columns[k])
    })
    .unwrap();
    let prior = Belief::uniform(n, 8.0, 1.0).unwrap();
    let (w, tau) = (
        DMatrix::from_fn(d, n, |i, k| reading.columns[k][i]),
        &reading.tau,
    );
    let s = &w * w.transpose() + &r;
    for loss in LOSSES {
        let mut filter = robust(DiagonalKalman::new(prior.clone()), loss);
        let report = filter.update(&obs).unwrap();

        let residual = DVector::from_column_slice(tau) - &w * DVector::repeat(n, 8.0);
        let weight = |i: usize| loss.weight(residual[i] / s[(i, i)].sqrt());
        let inflated = DMatrix::from_fn(d, d, |i, j| {
            let field = s[(i, i)] - r[(i, i)];
            let more = if i == j {
                field * (1.0 / weight(i) - 1.0)
            } else {
                0.0
            };
            r[(i, j)] / (weight(i) * weight(j)).sqrt() + more
        });
        let innovation = (&w * w.transpose() + inflated).try_inverse().unwrap();
        let shift = w.transpose() * &innovation * &residual;
        for i in 0..n {
            let expected = (8.0 + shift[i]).max(0.0);
            assert!(
                (filter.belief().mean()[i] - expected).abs() < 1e-11,
                "{loss:?}"
            );
        }
        let nis = residual.dot(&(innovation * &residual));
        assert!((report.nis - nis).abs() < 1e-10 * nis);
        let downweighted = (0..d).filter(|&i| weight(i) < 1.0).count();
        assert!(downweighted >= 2 && filter.weights()[1] < 0.3);
        let share = downweighted as f64 / d as f64;
        assert_eq!(filter.downweighted_share(), Some(share));
    }
}

/// A single channel innovates by `z² w(z)`: of good readings its mean is a known integral, for
/// Huber's loss `2 Phi(k) - 1`.
#[test]
fn nis_of_good_readings_is_the_mean_of_the_weighted_square() {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    for loss in LOSSES {
        let (step, mut expected, mut square) = (1e-3, 0.0, 0.0);
        for i in -10_000..10_000 {
            let z = (f64::from(i) + 0.5) * step;
            let nis = z * z * loss.weight(z);
            let density = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
            expected += nis * density * step;
            square += nis * nis * density * step;
        }
        let named = if loss == RobustLoss::HUBER {
            0.821
        } else {
            0.767
        };
        assert!((expected - named).abs() < 1e-3, "{loss:?}: {expected}");
        let (trials, mut sum) = (20_000, 0.0);
        let prior = Belief::uniform(1, 50.0, 2.0).unwrap();
        let mut filter = robust(DiagonalKalman::new(prior.clone()), loss);
        let mut obs = Observation::<f64>::new(Noise::uniform(1, 0.5).unwrap());
        for _ in 0..trials {
            let k = 50.0 + 2.0 * normal(&mut rng);
            let tau = 0.3 * k + 0.5 * normal(&mut rng);
            obs.rebuild(1, &[0], &[tau], |_, w| w[0] = 0.3).unwrap();
            filter.reset(prior.clone()).unwrap();
            sum += filter.update(&obs).unwrap().nis;
        }
        let mean = sum / f64::from(trials);
        let sd = ((square - expected * expected) / f64::from(trials)).sqrt();
        assert!(
            (mean - expected).abs() < 5.0 * sd,
            "{loss:?}: {mean}, {expected}"
        );
    }
}

/// One channel never shifts its own prediction by more than `k` of its predicted deviations under
/// Huber's loss, however far off and however little is known of the field; under Student's t a gross
/// error hardly shifts it at all.
#[test]
fn the_pull_of_one_reading_is_bounded() {
    let mut obs = Observation::<f64>::new(Noise::uniform(1, 0.1).unwrap());
    for sd in [0.1, 10.0, 1e4] {
        for error in [3.0, 30.0, 1e3, 1e9] {
            let mut pull = |loss| {
                let prior = Belief::uniform(1, 1e6, sd).unwrap();
                let mut filter = robust(DiagonalKalman::new(prior), loss);
                let s = (sd * sd + 0.01f64).sqrt();
                obs.rebuild(1, &[0], &[1e6 + error * s], |_, w| w[0] = 1.0)
                    .unwrap();
                filter.update(&obs).unwrap();
                (filter.belief().mean()[0] - 1e6) / s
            };
            let (huber, t) = (pull(RobustLoss::HUBER), pull(RobustLoss::STUDENT_T));
            assert!(
                huber > 0.0 && huber <= 1.345 + 1e-6,
                "sd {sd}, {error}: {huber}"
            );
            assert!(t > 0.0 && t <= 5.0 / error + 1e-6, "sd {sd}, {error}: {t}");
        }
    }
}

#[derive(Debug, Clone, Copy)]
enum Fault {
    None,
    /// Every 20th channel reading is off by 60 noise deviations.
    Spikes,
    /// Channel 2 always reads the same.
    Stuck(f64),
}

/// Error of the field (rms, N/m) after 150 readings of 8 of 40 points by 7 channels.
fn error(fault: Fault, noise: f64, make: &dyn Fn(Belief<f64>) -> Boxed) -> f64 {
    let n = 40;
    let (mut squares, mut count) = (0.0, 0.0);
    for seed in 0..10 {
        let mut world = LinearWorld::new(n, 10.0, 3.0, seed);
        let mut filter = make(Belief::uniform(n, 10.0, 3.0).unwrap());
        for t in 0..150 {
            let mut reading = world.reading(n, 8, 7, 0.3, noise);
            match fault {
                Fault::None => {}
                Fault::Spikes => {
                    for (c, tau) in reading.tau.iter_mut().enumerate() {
                        if (t * 7 + c) * 7919 % 20 == 3 {
                            *tau += if (t + c) % 3 == 0 { -60.0 } else { 60.0 } * noise;
                        }
                    }
                }
                Fault::Stuck(value) => reading.tau[2] = value,
            }
            filter.update(&reading.observation(n).unwrap()).unwrap();
        }
        let pairs = filter.belief().mean().iter().zip(&world.stiffness);
        squares += pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        count += n as f64;
    }
    f64::sqrt(squares / count)
}

fn plain(prior: Belief<f64>) -> Boxed {
    Box::new(replay(DiagonalKalman::new(prior)))
}

/// Errors with the robust noise inside and outside of the replay.
fn robust_errors(fault: Fault, noise: f64, loss: RobustLoss) -> (f64, f64) {
    let inside = |b| Box::new(replay(robust(DiagonalKalman::new(b), loss))) as Boxed;
    let outside = |b| Box::new(robust(plain(b), loss)) as Boxed;
    (error(fault, noise, &inside), error(fault, noise, &outside))
}

#[test]
fn outliers_ruin_the_plain_filter_and_not_the_robust_one() {
    for noise in [0.3, 0.05] {
        let clean = error(Fault::None, noise, &plain);
        for fault in [Fault::Spikes, Fault::Stuck(0.0), Fault::Stuck(20.0)] {
            let ruined = error(fault, noise, &plain);
            assert!(ruined > 8.0 * clean, "{fault:?}: {ruined}, clean {clean}");
            for loss in LOSSES {
                let (inside, outside) = robust_errors(fault, noise, loss);
                eprintln!(
                    "noise {noise}, {fault:?}, {loss:?}: plain {ruined:.3}, inside replay \
                     {inside:.3}, outside {outside:.3}, without outliers {clean:.3}"
                );
                assert!(inside < 2.0 * clean);
                // Early judgments that are kept are not always right.
                assert!(noise < 0.3 || outside < 2.0 * clean);
            }
        }
    }
}

#[test]
fn without_outliers_little_is_lost() {
    let clean = error(Fault::None, 0.3, &plain);
    for loss in LOSSES {
        let (inside, outside) = robust_errors(Fault::None, 0.3, loss);
        eprintln!("{loss:?}: inside replay {inside:.4}, outside {outside:.4}, plain {clean:.4}");
        assert!(inside < 1.05 * clean && outside < 1.05 * clean, "{loss:?}");
    }
    // Readings of full weight pass unchanged.
    let wide = robust_errors(Fault::None, 0.3, RobustLoss::Huber { k: 1e3 });
    assert_eq!(wide, (clean, clean));
}

/// The weights show which channel is wrong, the share how much of all is doubted.
#[test]
fn weights_and_share_tell_what_is_wrong() {
    let n = 40;
    for (stuck, expected) in [(false, 0.179), (true, 0.179 * 6.0 / 7.0 + 1.0 / 7.0)] {
        let mut world = LinearWorld::new(n, 50.0, 1.0, 1);
        let prior = Belief::<f64>::uniform(n, 50.0, 1.0).unwrap();
        let mut filter = robust(replay(DiagonalKalman::new(prior)), RobustLoss::HUBER);
        let (mut sums, mut health) = ([0.0; 7], FilterHealth::default());
        for t in 0..400 {
            let mut reading = world.reading(n, 8, 7, 0.3, 0.3);
            if stuck {
                reading.tau[2] = 40.0;
            }
            health.record(&filter.update(&reading.observation(n).unwrap()).unwrap());
            if t >= 100 {
                let weights = sums.iter_mut().zip(filter.weights());
                weights.for_each(|(sum, w)| *sum += w / 300.0);
            }
        }
        let share = filter.downweighted_share().unwrap();
        eprintln!("stuck {stuck}: share {share:.3}, weights {sums:.2?}");
        assert!(
            (share - expected).abs() < 0.03,
            "{share}, expected {expected}"
        );
        for (c, w) in sums.iter().enumerate() {
            assert_eq!(*w < 0.1, stuck && c == 2, "channel {c}: {w}");
        }
        filter
            .reset(Belief::uniform(n, 50.0, 1.0).unwrap())
            .unwrap();
        assert_eq!(
            (filter.downweighted_share(), filter.weights().len()),
            (None, 0)
        );
    }
}

proptest! {
    /// A failed update leaves everything, also the counts; predictions are those of the inside.
    #[test]
    fn it_is_transparent_to_errors_and_predictions(seed in 0u64..1000) {
        let n = 12;
        let mut world = LinearWorld::new(n, 10.0, 3.0, seed);
        let inner = DiagonalKalman::new(Belief::<f32>::uniform(n, 10.0, 3.0).unwrap());
        let mut filter = robust(inner, RobustLoss::STUDENT_T);
        for _ in 0..5 {
            filter.update(&world.reading(n, 6, 3, 0.3, 0.1).observation(n).unwrap()).unwrap();
        }
        let (belief, share) = (filter.belief().clone(), filter.downweighted_share());
        let weights = filter.weights().to_vec();
        let mut reading = world.reading(n, 6, 3, 0.3, 0.1);
        let (mut a, mut b) = (Prediction::default(), Prediction::default());
        let obs = reading.observation(n).unwrap();
        filter.predict(&obs, &mut a).unwrap();
        filter.inner().predict(&obs, &mut b).unwrap();
        prop_assert_eq!(a, b);
        for column in &mut reading.columns {
            column.fill(1e30);
        }
        prop_assert!(filter.update(&reading.observation(n).unwrap()).is_err());
        reading.points[5] = n as u32;
        prop_assert!(filter.update(&reading.observation(n + 1).unwrap()).is_err());
        prop_assert_eq!(filter.belief(), &belief);
        prop_assert_eq!(filter.downweighted_share(), share);
        prop_assert_eq!(filter.weights(), &weights[..]);
    }
}
