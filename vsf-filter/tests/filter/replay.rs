//! Memory replay: determinism, the buffer, errors, consistency.

use crate::common::{Orders, Probe};
use std::sync::{Arc, Mutex};
use vsf_core::{Belief, CoreError, Estimator, FilterHealth, Noise, Observation};
use vsf_filter::{DiagonalKalman, MemoryReplay, ReplayConfig, ReplayVariance, Revisit};
use vsf_testkit::LinearWorld;

const N: usize = 30;

fn sequence(steps: usize, seed: u64) -> Vec<Observation<f64>> {
    let mut world = LinearWorld::new(N, 3.0, 0.5, seed);
    (0..steps)
        .map(|t| {
            world
                .reading(N, 1 + t % 12, 3, 0.05, 0.1)
                .observation(N)
                .unwrap()
        })
        .collect()
}

fn prior() -> Belief<f64> {
    Belief::uniform(N, 1.0, 1.0).unwrap()
}

fn replay(config: ReplayConfig) -> MemoryReplay<DiagonalKalman<f64>> {
    MemoryReplay::new(DiagonalKalman::new(prior()), config).unwrap()
}

fn run(config: ReplayConfig) -> Belief<f64> {
    let mut filter = replay(config);
    for obs in &sequence(20, 1) {
        filter.update(obs).unwrap();
    }
    filter.belief().clone()
}

fn probe(config: ReplayConfig) -> (MemoryReplay<Probe>, Arc<Mutex<Orders>>) {
    let (probe, orders) = Probe::new(prior());
    (MemoryReplay::new(probe, config).unwrap(), orders)
}

/// The first value of each reading that was taken in.
fn seen(orders: &Mutex<Orders>) -> Vec<f64> {
    let seen = std::mem::take(&mut orders.lock().unwrap().seen);
    seen.iter().map(|obs| obs.reading()[0]).collect()
}

/// What is replayed may be chosen at run time.
#[test]
fn a_boxed_one_replays_alike() {
    let own: Box<dyn Revisit<Scalar = f64>> = Box::new(DiagonalKalman::new(prior()));
    assert_eq!(
        format!("{own:?}"),
        "Revisit { scalar: \"float64\", points: 30, .. }"
    );
    let mut boxed = MemoryReplay::new(own, ReplayConfig::default()).unwrap();
    for obs in &sequence(20, 1) {
        boxed.update(obs).unwrap();
    }
    assert_eq!(
        boxed.clone().into_inner().belief(),
        &run(ReplayConfig::default())
    );
}

#[test]
fn same_seed_same_bits() {
    let config = |seed| ReplayConfig {
        seed,
        ..ReplayConfig::default()
    };
    assert_eq!(run(config(7)), run(config(7)));
    assert_ne!(run(config(7)), run(config(8)));
}

#[test]
fn without_replays_it_is_the_filter_inside() {
    let config = ReplayConfig {
        replays: 0,
        byte_budget: 0,
        ..ReplayConfig::default()
    };
    let (mut outer, mut inner) = (replay(config), DiagonalKalman::new(prior()));
    for obs in &sequence(20, 1) {
        assert_eq!(outer.update(obs).unwrap(), inner.update(obs).unwrap());
        assert_eq!(outer.belief(), inner.belief());
        assert_eq!(outer.whitened_residual(), inner.whitened_residual());
    }
    assert_eq!(outer.buffered(), 0);
}

#[test]
fn replays_need_a_budget() {
    let config = ReplayConfig {
        byte_budget: 0,
        ..ReplayConfig::default()
    };
    assert!(MemoryReplay::new(DiagonalKalman::new(prior()), config).is_err());
}

#[test]
fn an_update_corrects_once_and_replays_the_past() {
    let (mut filter, orders) = probe(ReplayConfig {
        replays: 5,
        ..ReplayConfig::default()
    });
    for (t, obs) in sequence(8, 1).iter().enumerate() {
        filter.update(obs).unwrap();
        let seen = seen(&orders);
        assert_eq!(seen.len(), 6, "step {t}");
        assert_eq!(seen[0], obs.reading()[0]);
        assert_eq!(filter.buffered(), t + 1);
    }
}

#[test]
fn empty_observations_are_not_stored() {
    let mut filter = replay(ReplayConfig::default());
    let empty = Observation::new(Noise::uniform(3, 0.1).unwrap());
    filter.update(&empty).unwrap();
    assert_eq!((filter.buffered(), filter.belief()), (0, &prior()));
    filter.update(&sequence(1, 1)[0]).unwrap();
    filter.update(&empty).unwrap();
    assert_eq!(filter.buffered(), 1);
}

#[test]
fn the_buffer_outlives_a_sequence_unless_told_otherwise() {
    for clear in [false, true] {
        let mut filter = replay(ReplayConfig {
            clear_on_sequence: clear,
            ..ReplayConfig::default()
        });
        for obs in &sequence(6, 1) {
            filter.update(obs).unwrap();
        }
        let belief = filter.belief().clone();
        filter.begin_sequence();
        assert_eq!(filter.buffered(), if clear { 0 } else { 6 });
        assert_eq!(filter.belief(), &belief);
    }
}

#[test]
fn an_index_beyond_the_buffer_is_an_error() {
    let mut filter = replay(ReplayConfig::default());
    let data = sequence(3, 1);
    filter.update_with(&data[0], &[0, 0]).unwrap();
    let before = filter.belief().clone();
    let error = filter.update_with(&data[1], &[1, 0, 2]).unwrap_err();
    assert!(
        matches!(
            error,
            CoreError::OutOfRange {
                index: 2,
                len: 2,
                ..
            }
        ),
        "{error}"
    );
    assert_eq!((filter.belief(), filter.buffered()), (&before, 1));
}

/// An error in the correction or in any replay leaves belief, residual and buffer as they were.
#[test]
fn errors_roll_back_every_bit() {
    for variance in [ReplayVariance::Keep, ReplayVariance::Shrink] {
        let data = sequence(12, 3);
        for fail_at in 0..8 {
            let (mut filter, orders) = probe(ReplayConfig {
                replays: 7,
                variance,
                ..ReplayConfig::default()
            });
            for obs in &data[..11] {
                filter.update(obs).unwrap();
            }
            let before = filter.belief().clone();
            let residual = filter.whitened_residual().to_vec();
            orders.lock().unwrap().fail_in = Some(fail_at);
            let error = filter.update(&data[11]).unwrap_err();
            assert_eq!(error.to_string(), "on demand");
            let bits = |x: &[f64]| x.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            let (b, a) = (&before, filter.belief());
            assert_eq!(
                bits(b.mean()),
                bits(a.mean()),
                "{variance:?} failing at {fail_at}"
            );
            assert_eq!(
                bits(b.variance()),
                bits(a.variance()),
                "{variance:?}, {fail_at}"
            );
            assert_eq!(
                (filter.buffered(), filter.whitened_residual()),
                (11, &residual[..])
            );
            orders.lock().unwrap().fail_in = None;
            filter.update(&data[11]).unwrap();
            assert_eq!(filter.buffered(), 12);
        }
    }
}

/// An observation of `contacts` points whose reading is its number.
fn numbered(number: usize, contacts: usize) -> Observation<f64> {
    let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
    let points: Vec<u32> = (0..contacts as u32).collect();
    obs.rebuild(N, &points, &[number as f64], |_, w| w[0] = 1e-3)
        .unwrap();
    obs
}

/// What is in the buffer: every slot is replayed once.
fn contents(filter: &mut MemoryReplay<Probe>, orders: &Mutex<Orders>) -> Vec<usize> {
    orders.lock().unwrap().seen.clear();
    let all: Vec<usize> = (0..filter.buffered()).collect();
    let empty = Observation::new(Noise::uniform(1, 1.0).unwrap());
    filter.update_with(&empty, &all).unwrap();
    seen(orders)[1..].iter().map(|&x| x as usize).collect()
}

/// Every part of the history has the same chance to be in a full buffer, also when observations
/// differ in size.
#[test]
fn a_full_buffer_is_a_uniform_sample_of_the_history() {
    for sizes in [&[4][..], &[1, 20, 6, 2, 15]] {
        const HISTORY: usize = 100;
        let budget = numbered(0, 8).bytes() * 12;
        let mut counts = [0usize; 10];
        for seed in 0..300 {
            let (mut filter, orders) = probe(ReplayConfig {
                replays: 1,
                byte_budget: budget,
                seed,
                ..ReplayConfig::default()
            });
            for t in 0..HISTORY {
                filter.update(&numbered(t, sizes[t % sizes.len()])).unwrap();
                assert!(filter.buffered_bytes() <= budget);
                assert!(filter.buffered() > 0);
            }
            let mut kept = contents(&mut filter, &orders);
            kept.iter().for_each(|t| counts[t / 10] += 1);
            let len = kept.len();
            kept.sort_unstable();
            kept.dedup();
            assert_eq!(kept.len(), len, "an observation is twice in the buffer");
        }
        let total: usize = counts.iter().sum();
        let expected = total as f64 / counts.len() as f64;
        let chi_squared: f64 = counts
            .iter()
            .map(|&c| (c as f64 - expected).powi(2) / expected)
            .sum();
        eprintln!("sizes {sizes:?}: {counts:?}, chi-squared {chi_squared:.1} of 9");
        // 0.1 % of uniform samples exceed 27.9.
        assert!(chi_squared < 27.9, "{counts:?}: chi-squared {chi_squared}");
    }
}

#[test]
fn one_observation_is_kept_however_large() {
    let mut filter = replay(ReplayConfig {
        byte_budget: 1,
        ..ReplayConfig::default()
    });
    for t in 0..20 {
        filter.update(&numbered(t, 1 + t % 7)).unwrap();
        assert_eq!(filter.buffered(), 1);
        // What the buffer notes beside it is small.
        assert!(filter.buffered_bytes() <= numbered(0, 7).bytes() + 100);
    }
}

/// Readings of fields drawn from the prior, one long sequence each: NIS per degree of freedom.
fn nis_ratio(variance: ReplayVariance, replays: usize) -> f64 {
    let mut health = FilterHealth::default();
    for seed in 0..20 {
        let mut world = LinearWorld::new(N, 10.0, 1.0, 100 + seed);
        let inner = DiagonalKalman::new(Belief::<f64>::uniform(N, 10.0, 1.0).unwrap());
        let config = ReplayConfig {
            replays,
            variance,
            seed,
            ..ReplayConfig::default()
        };
        let mut filter = MemoryReplay::new(inner, config).unwrap();
        for _ in 0..60 {
            let reading = world.reading(N, 8, 3, 0.3, 0.1);
            health.record(&filter.update(&reading.observation(N).unwrap()).unwrap());
        }
    }
    health.nis_ratio().unwrap()
}

/// Replaying must not make the filter more certain than its data. Shrinking variances on every
/// replay does.
#[test]
fn replay_with_shrinking_variances_is_overconfident() {
    let bare = nis_ratio(ReplayVariance::Keep, 0);
    let keep = nis_ratio(ReplayVariance::Keep, 20);
    let shrink = nis_ratio(ReplayVariance::Shrink, 20);
    eprintln!("NIS ratio: without replay {bare:.2}, Keep {keep:.2}, Shrink {shrink:.2}");
    // Correlations that the filter does not keep make it too sure already without replays.
    assert!(
        keep < bare && bare < 2.6 && keep < 1.6,
        "Keep {keep}, without replay {bare}"
    );
    assert!(shrink > 4.0, "Shrink {shrink}");
}
