//! Replay in dual form: it comes down to the constrained optimum, however often readings are drawn, within
//! bounded memory.

use crate::common::golden_observations;
use proptest::prelude::*;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use vsf_core::{Belief, Estimator, Noise, Observation};
use vsf_filter::{BatchMap, DiagonalKalman, DualConfig, DualReplay, MemoryReplay, ReplayConfig};
use vsf_testkit::{LinearWorld, normal};

fn optimum(prior: &Belief<f64>, stream: &[Observation<f64>]) -> Vec<f64> {
    let batch = BatchMap::new(prior.len(), [stream]).unwrap();
    let fit = batch.solve(&prior.clone().into(), 1.0).unwrap();
    assert!(fit.kkt_residual() < 1e-8);
    fit.mean().to_vec()
}

fn farthest(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .fold(0.0, |far, (a, b)| (a - b).abs().max(far))
}

fn rms(a: &[f64], b: &[f64]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (squares / a.len() as f64).sqrt()
}

/// Takes in a stream, then only replays it.
fn settle(filter: &mut DualReplay<f64>, stream: &[Observation<f64>], rounds: usize) {
    for obs in stream {
        filter.update(obs).unwrap();
    }
    let empty = Observation::new(Noise::uniform(1, 1.0).unwrap());
    for _ in 0..rounds {
        filter.update(&empty).unwrap();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// The truth is the active-set optimum of the primal problem, a different method. Noise
    /// is correlated between channels, and many points end at zero.
    #[test]
    fn val_replays_come_down_to_the_constrained_optimum(
        seed in 0u64..10_000,
        (points, contacts, steps) in (5usize..40, 1usize..20, 1usize..40),
        (mean, sd) in (0.0f64..2.0, 0.5f64..1.5),
        correlation in -0.6f64..0.6,
    ) {
        let mut world = LinearWorld::new(points, 0.5, 2.0, seed);
        let r = 0.25 * correlation;
        let noise = Noise::full(2, vec![0.25, r, r, 0.25]).unwrap();
        let stream: Vec<_> = (0..steps)
            .map(|_| {
                let reading = world.reading(points, contacts, 2, 1.0, 0.5);
                let mut obs: Observation<f64> = reading.observation(points).unwrap();
                obs.set_noise(&noise).unwrap();
                obs
            })
            .collect();
        let prior = Belief::uniform(points, mean, sd).unwrap();
        let config = DualConfig { replays: 100, seed, ..DualConfig::default() };
        let mut filter = DualReplay::new(prior.clone(), config).unwrap();
        settle(&mut filter, &stream, 1000);
        let far = farthest(filter.belief().mean(), &optimum(&prior, &stream));
        prop_assert!(far < 1e-6, "{far:e} N/m away");
    }
}

/// Beside numbers from outside: the case of `golden/quadprog.npz`, whose optimum `BatchMap` has too.
#[test]
fn val_golden_case_comes_down_to_its_optimum() {
    let (stream, truth) = golden_observations();
    let prior = Belief::uniform(truth.len(), 0.0, 0.1).unwrap();
    let expected: ndarray::Array1<f64> = crate::common::archive("quadprog.npz")
        .by_name("x_exact_nnls")
        .unwrap();
    let mut filter = DualReplay::new(prior, DualConfig::default()).unwrap();
    settle(&mut filter, &stream, 4000);
    let far = farthest(filter.belief().mean(), expected.as_slice().unwrap());
    assert!(far < 1e-8, "{far:e} N/m away");
}

/// Readings of a link that presses to and fro into a row of points: neighbors are felt together, and all by
/// nearly the same lever, which changes slowly.
fn press(t: usize, truth: &[f64], rng: &mut Pcg64Mcg) -> Observation<f64> {
    let (n, phase) = (truth.len(), 0.01 * t as f64);
    let first = ((0.5 + 0.5 * (0.37 * phase).sin()) * (n - 60) as f64) as usize;
    let depth = 0.5 - 0.5 * phase.cos();
    let points: Vec<u32> = (first..first + 10 + (50.0 * depth) as usize)
        .map(|p| p as u32)
        .collect();
    let column = |k: usize, i: usize| {
        let lever = 0.3 + 0.1 * (i as f64 + 0.2 * phase).cos();
        lever * depth * (1.0 + 0.02 * (k * (i + 1)) as f64)
    };
    let reading: Vec<f64> = (0..3)
        .map(|i| {
            let felt = points.iter().enumerate();
            let sum: f64 = felt.map(|(k, &p)| column(k, i) * truth[p as usize]).sum();
            sum + 0.1 * normal(rng)
        })
        .collect();
    let mut obs = Observation::new(Noise::uniform(3, 0.1).unwrap());
    obs.rebuild(n, &points, &reading, |k, w| {
        (0..3).for_each(|i| w[i] = column(k, i));
    })
    .unwrap();
    obs
}

/// Errors (rms, N/m) of the field after so many readings, of which 200 are remembered.
fn errors<E: Estimator<Scalar = f64>>(
    make: impl Fn(Belief<f64>, usize) -> E,
    after: [usize; 2],
) -> [f64; 2] {
    let n = 200;
    let truth: Vec<f64> = (0..n)
        .map(|i| 20.0 + 10.0 * (0.1 * i as f64).sin())
        .collect();
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    let size = press(315, &truth, &mut rng).bytes();
    let mut filter = make(Belief::uniform(n, 0.0, 30.0).unwrap(), 200 * size);
    let mut t = 0;
    after.map(|end| {
        while t < end {
            filter.update(&press(t, &truth, &mut rng)).unwrap();
            t += 1;
        }
        rms(filter.belief().mean(), &truth)
    })
}

/// Readings that have left the memory still count, and none counts as often as it is drawn: the field
/// becomes better with every reading, and better than that of Alg. 1.
#[test]
fn more_readings_than_memory_make_the_field_better() {
    let dual = |prior, byte_budget| {
        let config = DualConfig {
            byte_budget,
            ..DualConfig::default()
        };
        DualReplay::new(prior, config).unwrap()
    };
    let replay = |prior, byte_budget| {
        let config = ReplayConfig {
            byte_budget,
            ..ReplayConfig::default()
        };
        MemoryReplay::new(DiagonalKalman::new(prior), config).unwrap()
    };
    let after = [1000, 10_000];
    let [early, late] = errors(dual, after);
    let paper = errors(replay, after);
    eprintln!(
        "field error after {after:?} readings: {early:.2}, {late:.2} N/m; Alg. 1 {paper:.2?}"
    );
    assert!(late < 0.9 * early && late < 0.5 * paper[1]);
}

#[test]
fn memory_stays_within_its_budget() {
    let mut world = LinearWorld::new(50, 5.0, 1.0, 3);
    let config = DualConfig {
        byte_budget: 20_000,
        ..DualConfig::default()
    };
    let prior = Belief::<f64>::uniform(50, 5.0, 1.0).unwrap();
    let mut filter = DualReplay::new(prior, config).unwrap();
    for t in 0..300 {
        let reading = world.reading(50, 1 + t % 30, 3, 0.3, 0.1);
        filter.update(&reading.observation(50).unwrap()).unwrap();
        assert!(filter.buffered_bytes() <= config.byte_budget);
    }
    assert!(filter.buffered() > 5);
}

#[test]
fn sizes_that_cannot_be_are_refused() {
    let prior = || Belief::<f64>::uniform(2, 1.0, 1.0).unwrap();
    for (replays, byte_budget) in [(1, 0), (1_000_001, 1000)] {
        let config = DualConfig {
            replays,
            byte_budget,
            ..DualConfig::default()
        };
        DualReplay::new(prior(), config).unwrap_err();
    }
}

/// A case that needs many replays: three times as many readings as unknowns, precise beside the prior.
#[test]
fn val_precise_readings_come_down_late() {
    let points = 6;
    let mut world = LinearWorld::new(points, 0.5, 2.0, 336);
    let observe = |_| world.reading(points, 6, 2, 1.0, 0.3).observation(points);
    let stream: Vec<_> = (0..21).map(observe).map(Result::unwrap).collect();
    let prior = Belief::uniform(points, 0.0, 2.5).unwrap();
    let config = DualConfig {
        replays: 100,
        ..DualConfig::default()
    };
    let mut filter = DualReplay::new(prior.clone(), config).unwrap();
    settle(&mut filter, &stream, 3000);
    let far = farthest(filter.belief().mean(), &optimum(&prior, &stream));
    assert!(far < 1e-9, "{far:e} N/m away");
}

/// What users get: one pass with 20 replays, of readings whose noise is what the prior leaves open of them.
#[test]
fn one_pass_comes_near_the_optimum() {
    let points = 60;
    let mut world = LinearWorld::new(points, 10.0, 3.0, 2);
    let observe = |_| world.reading(points, 15, 3, 0.3, 2.0).observation(points);
    let stream: Vec<_> = (0..300).map(observe).map(Result::unwrap).collect();
    let prior = Belief::uniform(points, 10.0, 3.0).unwrap();
    let mut filter = DualReplay::new(prior.clone(), DualConfig::default()).unwrap();
    settle(&mut filter, &stream, 0);
    let best = optimum(&prior, &stream);
    let (far, at_first) = (rms(filter.belief().mean(), &best), rms(prior.mean(), &best));
    assert!(far < 0.1 * at_first, "{far} of {at_first} N/m away");
}

/// A refused update leaves no trace: what follows is what it is without it.
#[test]
fn a_failed_update_changes_nothing() {
    let prior = || Belief::<f32>::uniform(3, 1.0, 1.0).unwrap();
    let config = DualConfig::default();
    let (mut with, mut without) = (
        DualReplay::new(prior(), config).unwrap(),
        DualReplay::new(prior(), config).unwrap(),
    );
    let observe = |reading: f64, weight: f64| {
        let mut obs = Observation::<f32>::new(Noise::uniform(1, 1e-3).unwrap());
        obs.rebuild(3, &[0, 2], &[reading], |_, w| w[0] = weight)
            .unwrap();
        obs
    };
    for t in 0..5 {
        let good = observe(2.0, 0.5);
        with.update(&observe(3e38, 1e-3)).unwrap_err();
        assert_eq!(with.buffered(), t);
        assert_eq!(with.update(&good), without.update(&good));
        assert_eq!(with.belief(), without.belief());
    }
}
