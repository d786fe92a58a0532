//! The batch optimum against an independent solver, brute-force Gaussian conditioning and refits.

use clarabel::algebra::{CscMatrix, MatrixMathMut};
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus,
};
use nalgebra::{DMatrix, DVector, Point3};
use proptest::prelude::*;
use rayon::prelude::*;
use vsf_core::{Belief, CoreError, Noise, Observation, RestPoints};
use vsf_filter::{BatchFit, BatchMap, FieldPrior, Matern, Smoothness};
use vsf_testkit::LinearWorld;

/// A field of which only the first `touched` points are touched.
struct World {
    field: usize,
    sequences: Vec<Vec<Observation<f64>>>,
}

/// Observations per sequence, channels, contacts of each.
fn world(field: usize, touched: usize, sizes: &[usize], d: usize, contacts: usize) -> World {
    let mut world = LinearWorld::new(field, 1.0, 4.0, 7);
    let mut sequence = |size: usize| {
        let mut observation = |k: usize| {
            let reading = world.reading(touched, contacts, d, 0.5, 0.3);
            let mut obs = reading.observation::<f64>(field).unwrap();
            // Correlated noise that differs between observations.
            let noise = DMatrix::from_fn(d, d, |i, j| {
                if i == j {
                    0.4
                } else {
                    0.05 * ((k + i + 2 * j) % 5) as f64
                }
            });
            let noise = &noise * noise.transpose();
            obs.set_noise(&Noise::full(d, noise.as_slice().to_vec()).unwrap())
                .unwrap();
            obs
        };
        let mut all: Vec<_> = (0..size).map(&mut observation).collect();
        // One without contact.
        let mut free = Observation::new(Noise::uniform(d, 0.2).unwrap());
        free.rebuild(field, &[], &vec![0.1; d], |_, _| {}).unwrap();
        all.insert(size / 2, free);
        all
    };
    let sequences = sizes.iter().map(|&s| sequence(s)).collect();
    World { field, sequences }
}

impl World {
    fn batch(&self) -> BatchMap<'_> {
        BatchMap::new(self.field, self.sequences.iter().map(Vec::as_slice)).unwrap()
    }

    fn stacked(&self, sequences: &[usize]) -> Stacked {
        let all: Vec<_> = sequences.iter().flat_map(|&s| &self.sequences[s]).collect();
        Stacked::new(self.field, &all)
    }
}

/// All readings as one: `tau = W K + N(0, R)`.
struct Stacked {
    w: DMatrix<f64>,
    r: DMatrix<f64>,
    tau: DVector<f64>,
}

impl Stacked {
    fn new(field: usize, observations: &[&Observation<f64>]) -> Self {
        let rows = observations.iter().map(|o| o.dim()).sum();
        let mut all = Self {
            w: DMatrix::zeros(rows, field),
            r: DMatrix::zeros(rows, rows),
            tau: DVector::zeros(rows),
        };
        let mut start = 0;
        for obs in observations {
            let d = obs.dim();
            for i in 0..d {
                all.tau[start + i] = obs.reading()[i];
                for (&p, &w) in obs.points().iter().zip(obs.row(i)) {
                    all.w[(start + i, p as usize)] = w;
                }
                for j in 0..d {
                    all.r[(start + i, start + j)] = obs.noise().covariance()[i * d + j];
                }
            }
            start += d;
        }
        all
    }
}

/// A Gaussian over the whole field.
#[derive(Clone)]
struct Gaussian {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Gaussian {
    fn new(prior: &FieldPrior) -> Self {
        let n = prior.len();
        Self {
            mean: DVector::from_column_slice(prior.mean()),
            covariance: DMatrix::from_fn(n, n, |i, j| prior.covariance(i, j)),
        }
    }

    /// Conditioning in covariance form, and the log-density of what was seen.
    fn condition(&self, w: &DMatrix<f64>, r: &DMatrix<f64>, tau: &DVector<f64>) -> (Self, f64) {
        let s = w * &self.covariance * w.transpose() + r;
        let factor = s.clone().cholesky().unwrap();
        let e = tau - w * &self.mean;
        let gain = &self.covariance * w.transpose() * factor.inverse();
        let log_det: f64 = factor.l().diagonal().iter().map(|l| 2.0 * l.ln()).sum();
        let quad = e.dot(&factor.solve(&e));
        let dof = tau.len() as f64;
        let log_density = -0.5 * (dof * std::f64::consts::TAU.ln() + log_det + quad);
        let posterior = Self {
            mean: &self.mean + &gain * e,
            covariance: &self.covariance - &gain * w * &self.covariance,
        };
        (posterior, log_density)
    }

    /// Some points known to be zero.
    fn with_zeros(&self, points: &[usize]) -> Self {
        if points.is_empty() {
            return self.clone();
        }
        let (n, k) = (self.mean.len(), points.len());
        let w = DMatrix::from_fn(k, n, |i, j| f64::from(points[i] == j));
        self.condition(&w, &DMatrix::zeros(k, k), &DVector::zeros(k))
            .0
    }
}

fn held_at_zero(batch: &BatchMap<'_>, fit: &BatchFit<'_>) -> Vec<usize> {
    let free: Vec<u32> = fit.free_points().collect();
    let held = batch.points().iter().filter(|p| !free.contains(p));
    held.map(|&p| p as usize).collect()
}

fn priors(field: usize) -> Vec<(&'static str, FieldPrior)> {
    let rest: Vec<Point3<f64>> = (0..field)
        .map(|i| {
            Point3::new(
                0.01 * (i % 5) as f64,
                0.01 * (i / 5) as f64,
                0.003 * (i % 3) as f64,
            )
        })
        .collect();
    let rest = RestPoints::new(rest).unwrap();
    let local = || {
        let mean = (0..field).map(|i| 0.3 * (i % 4) as f64).collect();
        let variance = (0..field).map(|i| 1.0 + 0.2 * (i % 7) as f64).collect();
        FieldPrior::from(Belief::new(mean, variance).unwrap())
    };
    let smooth = Matern {
        sd: 2.0,
        length: 0.02,
        smoothness: Smoothness::ThreeHalves,
    };
    vec![
        ("independent", local()),
        ("level", local().with_level(1.5).unwrap()),
        ("smooth", local().with_smooth(smooth, &rest).unwrap()),
        (
            "level and smooth",
            local()
                .with_level(0.7)
                .unwrap()
                .with_smooth(smooth, &rest)
                .unwrap(),
        ),
    ]
}

fn close(what: &str, got: f64, want: f64, tolerance: f64) {
    assert!(
        (got - want).abs() <= tolerance * (1.0 + want.abs()),
        "{what}: {got}, expected {want}"
    );
}

/// Rows by far fewer than points, fewer, more.
fn worlds() -> Vec<World> {
    vec![
        world(50, 40, &[2, 1, 1], 3, 25),
        world(40, 30, &[3, 1, 5], 3, 15),
        world(40, 30, &[30, 2, 9, 20], 3, 8),
    ]
}

/// Means, variances, predictions and the evidence, against conditioning of the whole field.
#[test]
fn posterior_is_that_of_brute_force() {
    for (k, world) in worlds().iter().enumerate() {
        let batch = world.batch();
        let every: Vec<usize> = (0..world.sequences.len()).collect();
        let all = world.stacked(&every);
        for (name, prior) in priors(world.field) {
            for scale in [1.0, 0.4] {
                let what = |s: &str| format!("world {k}, {name}, scale {scale}: {s}");
                let fit = batch.solve(&prior, scale).unwrap();
                assert!(fit.kkt_residual() < 1e-10, "{}", fit.kkt_residual());
                let zeros = held_at_zero(&batch, &fit);
                assert!(!zeros.is_empty() && fit.free_points().count() > 3);
                let r = &all.r * (scale * scale);
                let gaussian = Gaussian::new(&prior);
                let (exact, _) = gaussian.with_zeros(&zeros).condition(&all.w, &r, &all.tau);
                let belief = fit.belief().unwrap();
                for (i, mean) in fit.mean().into_iter().enumerate() {
                    close(&what("mean"), mean, belief.mean()[i], 1e-13);
                    let mean = exact.mean[i].max(0.0);
                    close(&what("mean"), belief.mean()[i], mean, 1e-8);
                    if !zeros.contains(&i) {
                        let variance = exact.covariance[(i, i)];
                        close(&what("variance"), belief.variance()[i], variance, 1e-8);
                    }
                }
                // A reading of touched and untouched points.
                let mut obs = LinearWorld::new(world.field, 1.0, 1.0, 3)
                    .reading(world.field, 20, 4, 0.5, 0.2)
                    .observation::<f64>(world.field)
                    .unwrap();
                obs.set_noise(&Noise::uniform(4, 0.7).unwrap()).unwrap();
                let one = Stacked::new(world.field, &[&obs]);
                let covariance =
                    &one.w * &exact.covariance * one.w.transpose() + one.r * (scale * scale);
                // The Gaussian's own means: those of untouched points are not cut at zero.
                let mean = &one.w * &exact.mean;
                let (got_mean, got) = fit.predict_joint(&obs).unwrap();
                let marginal = fit.predict(&obs).unwrap();
                for i in 0..4 {
                    close(&what("predicted"), got_mean[i], mean[i], 1e-8);
                    close(&what("sd"), marginal.sd[i], covariance[(i, i)].sqrt(), 1e-8);
                    for j in 0..4 {
                        close(
                            &what("covariance"),
                            got[4 * i + j],
                            covariance[(i, j)],
                            1e-8,
                        );
                    }
                }
                assert_eq!(marginal.mean, got_mean);
                let (_, evidence) = gaussian.condition(&all.w, &r, &all.tau);
                let got = batch.log_evidence(&prior, scale).unwrap();
                close(&what("evidence"), got, evidence, 1e-9);
            }
        }
    }
}

/// The closed form beside the evidence with every deviation multiplied by a factor.
#[test]
fn best_scale_has_the_greatest_evidence() {
    let mut sequence = Vec::new();
    for (w, force) in [([1.0, 0.4], 3.0), ([0.2, -1.0], 5.0), ([0.5, 0.5], -1.0)] {
        let mut obs = Observation::new(Noise::uniform(1, 0.7).unwrap());
        obs.rebuild(2, &[0, 1], &[force], |k, column| column[0] = w[k])
            .unwrap();
        sequence.push(obs);
    }
    let batch = BatchMap::new(2, [&sequence[..]]).unwrap();
    let prior = |sd| {
        FieldPrior::from(Belief::<f64>::uniform(2, 0.3, sd).unwrap())
            .with_level(2.0 * sd)
            .unwrap()
    };
    let (scale, greatest) = batch.best_scale(&prior(0.5), 1.3).unwrap();
    let scaled = |s: f64| batch.log_evidence(&prior(0.5 * s), 1.3 * s).unwrap();
    close("evidence", greatest, scaled(scale), 1e-12);
    for factor in [0.5, 0.99, 1.01, 3.0] {
        assert!(scaled(scale * factor) < greatest, "{factor}");
    }
}

#[test]
fn without_readings_no_scale_is_best() {
    let prior = FieldPrior::from(Belief::<f64>::uniform(2, 0.3, 1.0).unwrap());
    let batch = BatchMap::new(2, [&[][..]]).unwrap();
    let error = batch.best_scale(&prior, 1.0).unwrap_err();
    assert!(error.to_string().contains("without readings"), "{error}");
    assert!(matches!(
        BatchMap::new(usize::MAX, [&[][..]]),
        Err(CoreError::TooMany { .. })
    ));
}

/// A point held at zero, alone: its posterior without the bound, cut off there.
#[test]
fn points_at_zero_have_the_moment_of_a_cut_off_gaussian() {
    let mut obs = Observation::new(Noise::uniform(1, 0.5).unwrap());
    obs.rebuild(1, &[0], &[-0.8], |_, w| w[0] = 1.0).unwrap();
    let sequence = [obs];
    let batch = BatchMap::new(1, [&sequence[..]]).unwrap();
    let prior = FieldPrior::from(Belief::<f64>::uniform(1, 0.0, 2.0).unwrap());
    for scale in [1.0, 3.0] {
        let belief = batch.solve(&prior, scale).unwrap().belief().unwrap();
        let variance = 1.0 / (0.25 + 1.0 / (0.25 * scale * scale));
        let mean = variance * -0.8 / (0.25 * scale * scale);
        let (mut moment, mut mass) = (0.0, 0.0);
        for k in 0..400_000 {
            let x = (f64::from(k) + 0.5) * 1e-4;
            let p = (-0.5 * (x - mean).powi(2) / variance).exp();
            moment += x * x * p;
            mass += p;
        }
        assert_eq!(belief.mean()[0], 0.0);
        close("moment", belief.variance()[0], moment / mass, 1e-6);
    }
}

/// Each sequence against conditioning on all others with the same points at zero.
#[test]
fn leaving_a_sequence_out_is_a_fit_without_it() {
    for (k, world) in worlds().iter().enumerate() {
        let batch = world.batch();
        for (name, prior) in priors(world.field) {
            let scale = 0.6;
            let fit = batch.solve(&prior, scale).unwrap();
            let zeros = held_at_zero(&batch, &fit);
            let held_out = fit.leave_one_out().unwrap();
            assert_eq!(held_out.len(), world.sequences.len());
            for (s, got) in held_out.iter().enumerate() {
                let what = |q: &str| format!("world {k}, {name}, sequence {s}: {q}");
                let others: Vec<usize> = (0..held_out.len()).filter(|&o| o != s).collect();
                let (rest, own) = (world.stacked(&others), world.stacked(&[s]));
                let r = rest.r * (scale * scale);
                let prior = Gaussian::new(&prior).with_zeros(&zeros);
                let (without, _) = prior.condition(&rest.w, &r, &rest.tau);
                let r = &own.r * (scale * scale);
                let (_, log_density) = without.condition(&own.w, &r, &own.tau);
                close(&what("density"), got.log_density, log_density, 1e-8);
                let prediction = &own.w * &without.mean;
                assert_eq!(got.prediction.len(), prediction.len());
                for (a, b) in got.prediction.iter().zip(&prediction) {
                    close(&what("prediction"), *a, *b, 1e-8);
                }
                let error = own.tau - prediction;
                let d = 3;
                let norms = error
                    .as_slice()
                    .chunks(d)
                    .map(|e| DVector::from_column_slice(e).norm());
                let mean = norms.sum::<f64>() / (error.len() / d) as f64;
                close(&what("error"), got.mean_error, mean, 1e-8);
            }
        }
    }
}

/// Noise that is given beside the observations is what copies of them with that noise have, to the bit; by points and
/// by rows.
#[test]
fn noise_beside_the_observations_is_theirs() {
    let covariance = vec![0.3, 0.1, 0.0, 0.1, 0.5, -0.2, 0.0, -0.2, 0.4];
    let noise = Noise::full(3, covariance).unwrap();
    for world in [world(40, 30, &[6, 4], 3, 12), world(60, 60, &[1, 2], 3, 20)] {
        let mut copies = world.sequences.clone();
        for obs in copies.iter_mut().flatten() {
            obs.set_noise(&noise).unwrap();
        }
        let sequences = || world.sequences.iter().map(Vec::as_slice);
        let beside = BatchMap::with_noise(world.field, sequences(), &noise).unwrap();
        let copied = BatchMap::new(world.field, copies.iter().map(Vec::as_slice)).unwrap();
        for (name, prior) in priors(world.field) {
            let [a, b] = [&beside, &copied].map(|batch| batch.solve(&prior, 1.5).unwrap());
            assert_eq!(a.belief().unwrap(), b.belief().unwrap(), "{name}");
            assert_eq!(
                a.leave_one_out().unwrap(),
                b.leave_one_out().unwrap(),
                "{name}"
            );
            let [own, copy] = [&world.sequences, &copies].map(|s| &s[0][0]);
            let [own, copy] = [a.predict_joint(own), b.predict_joint(copy)];
            assert_eq!(own.unwrap(), copy.unwrap(), "{name}");
            let [a, b] = [&beside, &copied].map(|batch| batch.best_scale(&prior, 1.5).unwrap());
            assert_eq!(a, b, "{name}");
        }
        for noise in [Noise::uniform(2, 1.0), Noise::uniform(3, 1e-160)] {
            assert!(BatchMap::with_noise(world.field, sequences(), &noise.unwrap()).is_err());
        }
    }
}

/// A scale of the noise is what the same factor on every observation's noise does.
#[test]
fn noise_scale_is_noise() {
    let world = world(40, 30, &[6, 4], 3, 12);
    let mut louder = world.sequences.clone();
    for obs in louder.iter_mut().flatten() {
        let covariance = obs.noise().covariance().iter().map(|r| 6.25 * r).collect();
        obs.set_noise(&Noise::full(3, covariance).unwrap()).unwrap();
    }
    let other = BatchMap::new(40, louder.iter().map(Vec::as_slice)).unwrap();
    let batch = world.batch();
    for (name, prior) in priors(40) {
        let (a, b) = (
            batch.solve(&prior, 2.5).unwrap(),
            other.solve(&prior, 1.0).unwrap(),
        );
        let (a, b) = (a.belief().unwrap(), b.belief().unwrap());
        for i in 0..40 {
            close(name, a.mean()[i], b.mean()[i], 1e-10);
            close(name, a.variance()[i], b.variance()[i], 1e-10);
        }
        let evidence = other.log_evidence(&prior, 1.0).unwrap();
        close(
            name,
            batch.log_evidence(&prior, 2.5).unwrap(),
            evidence,
            1e-12,
        );
    }
}

/// Bit for bit.
#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let world = world(700, 640, &[60, 50], 7, 120);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let batch = world.batch();
            let prior = FieldPrior::from(Belief::<f64>::uniform(700, 0.5, 3.0).unwrap());
            let fit = batch.solve(&prior, 1.0).unwrap();
            assert!(fit.kkt_residual() < 1e-12 && fit.free_points().count() > 300);
            (fit.belief().unwrap(), fit.leave_one_out().unwrap())
        })
    };
    assert!(run(1) == run(3), "they do");
}

/// Those who ask first each invert a matrix, on threads that ask as well: all get the same.
#[test]
fn deviations_on_all_threads_at_once() {
    let world = world(700, 640, &[60, 50], 7, 120);
    let prior = FieldPrior::from(Belief::<f64>::uniform(700, 0.5, 3.0).unwrap());
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3);
    let pool = pool.build().unwrap();
    for _ in 0..5 {
        let batch = world.batch();
        let fit = batch.solve(&prior, 1.0).unwrap();
        let ask = |_| fit.belief().unwrap();
        let at_once: Vec<_> = pool.install(|| (0..20).into_par_iter().map(ask).collect());
        let expected = fit.belief().unwrap();
        assert!(at_once.iter().all(|belief| *belief == expected));
    }
}

#[test]
fn bad_input_is_refused() {
    let world = world(20, 10, &[3], 2, 5);
    let batch = world.batch();
    let prior = |n| FieldPrior::from(Belief::<f64>::uniform(n, 0.0, 1.0).unwrap());
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-200, 1e200] {
        let error = batch.solve(&prior(20), scale).unwrap_err();
        assert!(matches!(error, CoreError::Parameter { .. }), "{error}");
        assert!(batch.log_evidence(&prior(20), scale).is_err());
    }
    assert!(matches!(
        batch.solve(&prior(19), 1.0),
        Err(CoreError::Length { .. })
    ));
    let short = BatchMap::new(9, world.sequences.iter().map(Vec::as_slice));
    assert!(matches!(short, Err(CoreError::OutOfRange { .. })));
    let fit = batch.solve(&prior(20), 1.0).unwrap();
    assert!(fit.marginals(&[20]).is_err());
    let mut far = Observation::new(Noise::uniform(1, 1.0).unwrap());
    far.rebuild(50, &[30], &[1.0], |_, w| w[0] = 1.0).unwrap();
    assert!(fit.predict(&far).is_err());
    // Weights whose squares overflow.
    let mut huge = Observation::new(Noise::uniform(1, 1.0).unwrap());
    huge.rebuild(1, &[0], &[1.0], |_, w| w[0] = 1e200).unwrap();
    let huge = [huge];
    let batch = BatchMap::new(1, [&huge[..]]).unwrap();
    assert!(matches!(
        batch.solve(&prior(1), 1.0),
        Err(CoreError::Overflow { .. })
    ));
}

/// One reading of many points is little for independent ones; a prior that correlates them is a matrix.
#[test]
fn too_many_points_for_a_matrix_are_refused() {
    let n = 40_000;
    let points: Vec<u32> = (0..n as u32).collect();
    let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
    obs.rebuild(n, &points, &[1.0], |_, w| w[0] = 1.0).unwrap();
    let sequence = [obs];
    let batch = BatchMap::new(n, [&sequence[..]]).unwrap();
    let independent = FieldPrior::from(Belief::<f64>::uniform(n, 0.0, 1.0).unwrap());
    assert!(batch.solve(&independent, 1.0).is_ok());
    let common = independent.with_level(1.0).unwrap();
    assert!(matches!(
        batch.solve(&common, 1.0),
        Err(CoreError::TooMany {
            got: 40_000,
            max: 32_768,
            ..
        })
    ));
}

/// Without observations, or without contacts, the prior stays.
#[test]
fn nothing_seen_is_the_prior() {
    let prior = FieldPrior::from(Belief::<f64>::uniform(4, 2.0, 3.0).unwrap());
    let free = [Observation::new(Noise::uniform(2, 1.0).unwrap())];
    for sequences in [vec![], vec![&free[..]], vec![&[][..], &free[..]]] {
        let batch = BatchMap::new(4, sequences.clone()).unwrap();
        let fit = batch.solve(&prior, 1.0).unwrap();
        assert_eq!(fit.belief().unwrap(), prior.marginals().unwrap());
        assert_eq!(fit.leave_one_out().unwrap().len(), sequences.len());
        let channels = sequences.iter().map(|s| 2.0 * s.len() as f64).sum::<f64>();
        let evidence = batch.log_evidence(&prior, 1.0).unwrap();
        close(
            "evidence",
            evidence,
            -0.5 * channels * std::f64::consts::TAU.ln(),
            1e-12,
        );
    }
}

/// Interior point solution of `min x^T H x / 2 - b^T x`, `x >= 0`; none where it gets stuck, as it seldom does.
fn clarabel(h: &DMatrix<f64>, b: &DVector<f64>) -> Option<Vec<f64>> {
    let n = b.len();
    let upper: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            (0..n)
                .map(|j| if j >= i { h[(i, j)] } else { 0.0 })
                .collect()
        })
        .collect();
    let p = CscMatrix::from(&upper);
    let mut a = CscMatrix::<f64>::identity(n);
    a.negate();
    let q: Vec<f64> = b.iter().map(|v| -v).collect();
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(1e-10)
        .tol_gap_rel(1e-10)
        .tol_feas(1e-10)
        .build()
        .unwrap();
    let zeros = vec![0.0; n];
    let mut solver =
        DefaultSolver::new(&p, &q, &a, &zeros, &[NonnegativeConeT(n)], settings).unwrap();
    solver.solve();
    let status = solver.solution.status;
    assert!(
        matches!(status, SolverStatus::Solved | SolverStatus::MaxIterations),
        "{status:?}"
    );
    (status == SolverStatus::Solved).then(|| solver.solution.x.clone())
}

#[derive(Debug, Clone)]
struct Case {
    field: usize,
    d: usize,
    rows: Vec<Vec<f64>>,
    tau: Vec<f64>,
    noise: f64,
    mean: Vec<f64>,
    sd: Vec<f64>,
    level: f64,
}

/// Random problems with repeated and zero columns and repeated rows; readings of any sign.
fn case() -> impl Strategy<Value = Case> {
    (1usize..24, 1usize..4, 0usize..9).prop_flat_map(|(n, d, observations)| {
        let entry = prop_oneof![2 => Just(0.0), 5 => -1.0..1.0f64, 1 => Just(0.5)];
        let m = d * observations;
        (
            prop::collection::vec(prop::collection::vec(entry, n), m),
            prop::collection::vec(-3.0..3.0f64, m),
            0.05..1.0f64,
            prop::collection::vec(prop_oneof![Just(0.0), 0.0..2.0f64], n),
            prop::collection::vec(prop_oneof![Just(2.0), 0.1..10.0f64], n),
            prop_oneof![Just(0.0), 0.1..5.0f64],
            0..n,
            0..n,
        )
            .prop_map(move |(mut rows, tau, noise, mean, sd, level, from, to)| {
                for row in &mut rows {
                    row[to] = row[from];
                }
                if m >= 2 * d {
                    for i in 0..d {
                        rows[d + i] = rows[i].clone();
                    }
                }
                Case {
                    field: n,
                    d,
                    rows,
                    tau,
                    noise,
                    mean,
                    sd,
                    level,
                }
            })
    })
}

impl Case {
    fn observations(&self, weight: f64, tau: f64) -> Vec<Observation<f64>> {
        let observation = |t: usize| {
            let mut obs = Observation::new(Noise::uniform(self.d, tau * self.noise).unwrap());
            let rows = &self.rows[t * self.d..(t + 1) * self.d];
            // Zero columns are kept for every other observation.
            let points: Vec<u32> = (0..self.field as u32)
                .filter(|&p| t.is_multiple_of(2) || rows.iter().any(|r| r[p as usize] != 0.0))
                .collect();
            let reading: Vec<f64> = (0..self.d)
                .map(|i| tau * self.tau[t * self.d + i])
                .collect();
            obs.rebuild(self.field, &points, &reading, |k, w| {
                for (i, w) in w.iter_mut().enumerate() {
                    *w = weight * rows[i][points[k] as usize];
                }
            })
            .unwrap();
            obs
        };
        (0..self.rows.len() / self.d).map(observation).collect()
    }

    /// The prior in units of `unit`.
    fn prior(&self, unit: f64) -> FieldPrior {
        let mean = self.mean.iter().map(|m| unit * m).collect();
        let variance = self.sd.iter().map(|s| (unit * s).powi(2)).collect();
        FieldPrior::from(Belief::new(mean, variance).unwrap())
            .with_level(unit * self.level)
            .unwrap()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// The optimality conditions hold in the problem as stacked by hand, the solution is that of
    /// an interior point method, and any units give the same field.
    #[test]
    fn optimum_of_random_problems(case in case()) {
        let observations = case.observations(1.0, 1.0);
        let batch = BatchMap::new(case.field, [&observations[..]]).unwrap();
        let prior = case.prior(1.0);
        let fit = batch.solve(&prior, 1.0).unwrap();
        prop_assert!(fit.kkt_residual() < 1e-9, "KKT {:e}", fit.kkt_residual());
        let x = fit.mean();

        let all = Stacked::new(case.field, &observations.iter().collect::<Vec<_>>());
        let variance = case.noise * case.noise;
        let gaussian = Gaussian::new(&prior);
        let precision = gaussian.covariance.clone().try_inverse().unwrap();
        let touched: Vec<usize> = batch.points().iter().map(|&p| p as usize).collect();
        let h = all.w.transpose() * &all.w / variance + &precision;
        let b = all.w.transpose() * &all.tau / variance + &precision * &gaussian.mean;
        // Over the touched points, the others integrated out: a Schur complement, which keeps the digits that
        // the inverse of a part of the inverse loses.
        let others: Vec<usize> = (0..case.field).filter(|p| !touched.contains(p)).collect();
        let part = |rows: &[usize], cols: &[usize]| {
            DMatrix::from_fn(rows.len(), cols.len(), |i, j| h[(rows[i], cols[j])])
        };
        let t = touched.len();
        let of_others = part(&others, &others).try_inverse();
        let carried =
            part(&touched, &others) * of_others.unwrap_or_else(|| DMatrix::zeros(0, 0));
        let rest = DVector::from_fn(others.len(), |i, _| b[others[i]]);
        let b = DVector::from_fn(t, |i, _| b[touched[i]]) - &carried * rest;
        let h = part(&touched, &touched) - &carried * part(&others, &touched);
        let x_t = DVector::from_fn(t, |i, _| x[touched[i]]);
        let gradient = &h * &x_t - &b;
        let size = 1.0 + b.amax().max((&h * &x_t).amax());
        for i in 0..t {
            prop_assert!(x_t[i] >= 0.0);
            if x_t[i] > 0.0 {
                prop_assert!(gradient[i].abs() < 1e-7 * size, "gradient {}", gradient[i]);
            } else {
                prop_assert!(gradient[i] > -1e-7 * size, "gradient {}", gradient[i]);
            }
        }
        if t > 0 {
            // In units in which H has a unit diagonal and b is at most 1.
            let unit = h.diagonal().map(f64::sqrt);
            let size = b.component_div(&unit).amax().max(1e-3);
            let h = DMatrix::from_fn(t, t, |i, j| h[(i, j)] / (unit[i] * unit[j]));
            let b = b.component_div(&unit) / size;
            let x = x_t.component_mul(&unit) / size;
            // Another case in the place of one that only the optimality conditions answer for.
            let other = clarabel(&h, &b);
            prop_assume!(other.is_some());
            let other = DVector::from_vec(other.unwrap_or_default());
            let objective = |x: &DVector<f64>| 0.5 * x.dot(&(&h * x)) - b.dot(x);
            let (ours, theirs) = (objective(&x), objective(&other));
            prop_assert!((ours - theirs).abs() < 1e-7, "{ours}, {theirs}");
            let gap = x - other;
            prop_assert!(gap.dot(&(&h * &gap)) < 1e-7);
        }

        for (weight, tau) in [(1e-6, 1.0), (1e7, 1e-3), (1.0, 1e9)] {
            let observations = case.observations(weight, tau);
            let batch = BatchMap::new(case.field, [&observations[..]]).unwrap();
            let unit = tau / weight;
            let scaled = batch.solve(&case.prior(unit), 1.0).unwrap();
            prop_assert!(scaled.kkt_residual() < 1e-9);
            for (a, b) in scaled.mean().iter().zip(&x) {
                prop_assert!((a / unit - b).abs() < 1e-6 * (1.0 + b.abs()), "{a} in {unit}, {b}");
            }
        }
    }

    /// Readings against the direction of every column leave nothing.
    #[test]
    fn pulled_points_stay_at_zero(case in case()) {
        let mut case = case;
        case.mean.fill(0.0);
        case.level = 0.0;
        for (row, tau) in case.rows.iter_mut().zip(&mut case.tau) {
            row.iter_mut().for_each(|w| *w = w.abs());
            *tau = -tau.abs();
        }
        let observations = case.observations(1.0, 1.0);
        let batch = BatchMap::new(case.field, [&observations[..]]).unwrap();
        let fit = batch.solve(&case.prior(1.0), 1.0).unwrap();
        prop_assert!(fit.mean().iter().all(|k| *k == 0.0));
        prop_assert_eq!(fit.kkt_residual(), 0.0);
        prop_assert!(fit.belief().is_ok() && fit.leave_one_out().is_ok());
    }
}
