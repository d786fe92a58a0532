//! Estimations saved and restored: the continued one is the uninterrupted one, bit for bit, and
//! states that cannot be are refused.

use proptest::prelude::*;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Value, json};
use vsf_core::nalgebra::Point3;
use vsf_core::{
    Belief, CoreError, Estimator, FilterHealth, Noise, Observation, RestPoints, Scalar,
    UpdateReport,
};
use vsf_filter::{
    CovarianceFilter, DiagonalForm, DiagonalKalman, DualConfig, DualReplay, FieldPrior,
    JointEstimator, Matern, MemoryReplay, Projection, ReplayConfig, ReplayVariance, RobustLoss,
    RobustNoise,
};
use vsf_testkit::LinearWorld;

const N: usize = 25;
const STEPS: usize = 24;

/// A run with all that an estimator meets: time that passes, sequences, refused observations.
fn step<E: Estimator>(estimator: &mut E, stream: &[Observation<E::Scalar>], t: usize) -> Vec<u64> {
    if t % 5 == 3 {
        let _ = estimator.diffuse(E::Scalar::from_f64(0.05));
    }
    if t % 11 == 7 {
        estimator.begin_sequence();
    }
    let mut beyond = Observation::new(Noise::uniform(1, 1.0).unwrap());
    beyond
        .rebuild(N + 1, &[N as u32], &[1.0], |_, w| w[0] = 1.0)
        .unwrap();
    estimator.update(&beyond).unwrap_err();
    let report = estimator.update(&stream[t]).unwrap();
    [report.nis, report.log_likelihood, report.postfit]
        .iter()
        .chain(estimator.whitened_residual())
        .map(|x| x.to_bits())
        .collect()
}

trait Format {
    fn copy<E: Serialize + DeserializeOwned>(estimator: &E) -> E;
}
struct Postcard;
impl Format for Postcard {
    fn copy<E: Serialize + DeserializeOwned>(estimator: &E) -> E {
        postcard::from_bytes(&postcard::to_allocvec(estimator).unwrap()).unwrap()
    }
}
struct Json;
impl Format for Json {
    fn copy<E: Serialize + DeserializeOwned>(estimator: &E) -> E {
        serde_json::from_str(&serde_json::to_string(estimator).unwrap()).unwrap()
    }
}

/// Runs to the end with and without an interruption before step `cut`.
fn interrupted<F, E>(make: impl Fn(Belief<E::Scalar>) -> E, seed: u64, cut: usize)
where
    F: Format,
    E: Estimator + Serialize + DeserializeOwned,
{
    let mut world = LinearWorld::new(N, 3.0, 1.0, seed);
    let stream: Vec<_> = (0..STEPS)
        .map(|t| {
            let contacts = (t * 7 + seed as usize) % 13;
            let mut reading = world.reading(N, contacts, 3, 0.2, 0.1);
            if t % 6 == 1 {
                reading.tau[t % 3] += 5.0;
            }
            reading.observation(N).unwrap()
        })
        .collect();
    let mut whole = make(Belief::uniform(N, 1.0, 2.0).unwrap());
    (0..cut).for_each(|t| drop(step(&mut whole, &stream, t)));
    let mut restored = F::copy(&whole);
    for t in cut..STEPS {
        assert_eq!(
            step(&mut whole, &stream, t),
            step(&mut restored, &stream, t),
            "step {t} after an interruption at {cut}"
        );
    }
    // The whole state, not only what shows.
    let bytes = |e: &E| postcard::to_allocvec(e).unwrap();
    assert_eq!(bytes(&whole), bytes(&restored));
    assert_eq!(whole.belief(), restored.belief());
}

fn all<F: Format, T: Scalar + Serialize + DeserializeOwned>(
    seed: u64,
    cut: usize,
    form: DiagonalForm,
    config: ReplayConfig,
) {
    let diagonal = |prior: Belief<T>| DiagonalKalman::with_form(prior, form);
    let robust = |prior| RobustNoise::new(diagonal(prior), RobustLoss::STUDENT_T).unwrap();
    interrupted::<F, _>(diagonal, seed, cut);
    interrupted::<F, _>(robust, seed, cut);
    let replay = |prior| MemoryReplay::new(diagonal(prior), config).unwrap();
    interrupted::<F, _>(replay, seed, cut);
    let replayed = |prior| MemoryReplay::new(robust(prior), config).unwrap();
    interrupted::<F, _>(replayed, seed, cut);
    let outside = |prior| RobustNoise::new(replay(prior), RobustLoss::HUBER).unwrap();
    interrupted::<F, _>(outside, seed, cut);
    let config = DualConfig {
        replays: config.replays,
        seed: config.seed,
        byte_budget: config.byte_budget,
    };
    let dual = |prior: Belief<T>| DualReplay::new(prior, config).unwrap();
    interrupted::<F, _>(dual, seed, cut);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn an_interruption_changes_nothing(
        (seed, cut) in (0u64..1000, 0..STEPS),
        form in prop::sample::select(vec![
            DiagonalForm::Innovation, DiagonalForm::InnovationUpdated,
        ]),
        shrink in prop::bool::ANY,
        (replays, byte_budget) in (0usize..6, 1usize..8000),
        clear_on_sequence in prop::bool::ANY,
    ) {
        let variance = if shrink { ReplayVariance::Shrink } else { ReplayVariance::Keep };
        let config = ReplayConfig { replays, variance, seed, byte_budget, clear_on_sequence };
        all::<Postcard, f32>(seed, cut, form, config);
        all::<Postcard, f64>(seed, cut, form, config);
        all::<Json, f32>(seed, cut, form, config);
        all::<Json, f64>(seed, cut, form, config);
    }
}

/// More points than a block, more ranks than wait at once, and priors that link points.
fn dense<F: Format, T: Scalar + Serialize + DeserializeOwned>(cut: usize) {
    let n = 80;
    let at = |i: usize| Point3::new(0.01 * (i % 9) as f64, 0.01 * (i / 9) as f64, 0.0);
    let rest = RestPoints::new((0..n).map(at).collect()).unwrap();
    let smooth = Matern {
        sd: 1.0,
        length: 0.02,
        smoothness: Default::default(),
    };
    let local = || FieldPrior::from(Belief::<f64>::uniform(n, 0.1, 2.0).unwrap());
    for prior in [
        local(),
        local().with_level(1.0).unwrap(),
        local().with_smooth(smooth, &rest).unwrap(),
    ] {
        for projection in [
            Projection::Constrained,
            Projection::OutputOnly,
            Projection::FedBack,
        ] {
            let mut world = LinearWorld::new(n, 0.0, 2.0, 4);
            let mut stream = (0..40).map(|t| {
                let reading = world.reading(10 + 2 * t, 2 + t, 3, 0.2, 0.1);
                reading.observation::<T>(n).unwrap()
            });
            let mut whole =
                CovarianceFilter::<T>::with_projection(prior.clone(), projection).unwrap();
            for obs in stream.by_ref().take(cut) {
                whole.update(&obs).unwrap();
            }
            let mut restored = F::copy(&whole);
            assert_eq!(whole.kkt_residual(), restored.kkt_residual());
            for obs in stream {
                assert_eq!(whole.update(&obs).unwrap(), restored.update(&obs).unwrap());
                assert_eq!(whole.kkt_residual(), restored.kkt_residual());
                assert_eq!(whole.whitened_residual(), restored.whitened_residual());
                assert_eq!(whole.belief(), restored.belief());
            }
            let bytes = |e: &CovarianceFilter<T>| postcard::to_allocvec(e).unwrap();
            assert_eq!(bytes(&whole), bytes(&restored));
            let all: Vec<u32> = (0..n as u32).collect();
            assert_eq!(
                whole.extrapolate(&all).unwrap(),
                restored.extrapolate(&all).unwrap()
            );
        }
    }
}

#[test]
fn an_interruption_of_a_dense_filter_changes_nothing() {
    for cut in [0, 1, 25, 39] {
        dense::<Postcard, f32>(cut);
        dense::<Postcard, f64>(cut);
        dense::<Json, f64>(cut);
    }
}

fn saved_dense() -> CovarianceFilter<f64> {
    let prior = FieldPrior::from(Belief::<f64>::uniform(4, 0.0, 2.0).unwrap());
    let mut filter = CovarianceFilter::new(prior.with_level(1.0).unwrap()).unwrap();
    let mut obs = Observation::new(Noise::uniform(2, 0.5).unwrap());
    obs.rebuild(4, &[0, 2], &[3.0, 1.0], |k, w| {
        w.copy_from_slice(&[1.0, k as f64]);
    })
    .unwrap();
    filter.update(&obs).unwrap();
    filter
}

/// Without touched points nothing else tells how large the ring is; the first touch would reserve it.
#[test]
fn a_ring_larger_than_any_noise_is_refused() {
    let prior = Belief::<f64>::uniform(2, 1.0, 1.0).unwrap();
    let filter = CovarianceFilter::<f64>::new(prior);
    let mut state = serde_json::to_value(filter.unwrap()).unwrap();
    let pushed = 1u64 << 50;
    (state["ring"], state["pushed"]) = (json!(pushed), json!(pushed));
    let refused = serde_json::from_value::<CovarianceFilter<f64>>(state);
    assert!(refused.unwrap_err().to_string().contains("lacks"));
}

#[test]
fn dense_states_that_cannot_be_are_refused() {
    let good = serde_json::to_value(saved_dense()).unwrap();
    assert!(serde_json::from_value::<CovarianceFilter<f64>>(good.clone()).is_ok());
    for (at, value, says) in [
        ("/prior/local/1", json!(0.0), "> 0 N²/m²"),
        ("/prior/level_variance", json!(-1.0), "level variance"),
        ("/belief/mean/1", json!(-1.0), ">= 0 N/m"),
        ("/points", json!([0, 0]), "twice"),
        ("/points/1", json!(4), "out of range"),
        ("/link", json!([]), "link"),
        ("/link/0", json!(-1.0), "common level"),
        ("/mean", json!([1.0]), "means"),
        ("/variance/0", json!(-1.0), "positive definite"),
        ("/mode/0/1", json!(-1.0), "multiplier"),
        ("/ring", json!(0), "lacks"),
        ("/ring", json!(1u64 << 40), "lacks"),
        ("/ring", json!(513), "lacks"),
        ("/pushed", json!(u64::MAX), "lacks"),
        ("/applied/0", json!(0), "lacks"),
        ("/ranks", json!([1.0]), "ranks"),
        ("/panels/0", json!([1.0]), "entries"),
        ("/projection", json!("Magic"), "unknown variant"),
    ] {
        let mut state = good.clone();
        *state.pointer_mut(at).unwrap() = value;
        match serde_json::from_value::<CovarianceFilter<f64>>(state) {
            Ok(_) => panic!("{at} was taken"),
            Err(error) => assert!(error.to_string().contains(says), "{at}: {error}"),
        }
    }
}

/// A covariance that is none has no constrained mean to find: the filter says so or keeps a field.
#[test]
fn indefinite_states_leave_a_belief() {
    let mut filter = saved_dense();
    let mut obs = Observation::new(Noise::uniform(1, 0.5).unwrap());
    obs.rebuild(4, &[0, 1, 2, 3], &[-1.0], |k, w| w[0] = 1.0 + k as f64)
        .unwrap();
    filter.update(&obs).unwrap();
    let good = serde_json::to_value(filter).unwrap();
    // What two points have in common, in a rank that others have no part in.
    for (k, value) in (0..8 * 8).flat_map(|k| [(k, 3.0), (k, 1e3)]) {
        let (one, other) = (k / 8, k % 8);
        let mut state = good.clone();
        *state.pointer_mut(&format!("/ranks/{one}")).unwrap() = json!(value);
        *state.pointer_mut(&format!("/ranks/{other}")).unwrap() = json!(-value);
        let mut filter: CovarianceFilter<f64> = serde_json::from_value(state).unwrap();
        for (point, reading) in [(0, -9.0), (3, 3.0), (1, -9.0)] {
            obs.rebuild(4, &[point], &[reading], |_, w| w[0] = 1.0)
                .unwrap();
            let before = filter.belief().clone();
            if filter.update(&obs).is_err() {
                assert_eq!(*filter.belief(), before, "{one} {other} {value}");
            }
            let belief = filter.belief();
            Belief::new(belief.mean().to_vec(), belief.variance().to_vec())
                .unwrap_or_else(|e| panic!("{one} {other} {value}: {e}"));
        }
    }
}

type Replay<T> = RobustNoise<MemoryReplay<DiagonalKalman<T>>>;

/// An estimator that remembers readings of a field that has moved.
fn saved() -> Replay<f64> {
    let prior = Belief::uniform(4, 1.0, 2.0).unwrap();
    let config = ReplayConfig {
        byte_budget: 2000,
        ..ReplayConfig::default()
    };
    let inner = MemoryReplay::new(DiagonalKalman::new(prior), config).unwrap();
    let mut filter = RobustNoise::new(inner, RobustLoss::HUBER).unwrap();
    let mut obs = Observation::new(Noise::full(2, vec![1.0, 0.5, 0.5, 1.0]).unwrap());
    for (points, reading) in [(&[0u32, 2][..], [3.0, 1.0]), (&[1, 3], [2.0, 40.0])] {
        obs.rebuild(4, points, &reading, |k, w| {
            w.copy_from_slice(&[1.0, k as f64]);
        })
        .unwrap();
        filter.update(&obs).unwrap();
        filter.diffuse(0.25).unwrap();
    }
    filter
}

fn refused(at: &str, value: Value) -> String {
    let mut state = serde_json::to_value(saved()).unwrap();
    let entry = state.pointer_mut(at);
    *entry.unwrap_or_else(|| panic!("no {at} in {}", serde_json::to_value(saved()).unwrap())) =
        value;
    match serde_json::from_value::<Replay<f64>>(state) {
        Ok(_) => panic!("{at} was taken"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn states_that_cannot_be_are_refused() {
    let restored: Replay<f64> =
        serde_json::from_value(serde_json::to_value(saved()).unwrap()).unwrap();
    assert_eq!(restored.belief(), saved().belief());
    let buffer = "/inner/buffer";
    let past = "/inner/buffer/kept/0";
    for (at, value, says) in [
        ("/inner/inner/belief/mean/1".into(), json!(-1.0), ">= 0 N/m"),
        (
            "/inner/inner/belief/variance/1".into(),
            json!(0.0),
            "> 0 N²/m²",
        ),
        (
            "/inner/inner/belief/mean".into(),
            json!([1.0]),
            "length 4, expected 1",
        ),
        (
            "/inner/inner/form".into(),
            json!("Magic"),
            "unknown variant",
        ),
        ("/inner/rng".into(), json!([2, 3]), "odd"),
        ("/inner/diffused".into(), json!(-1.0), "total variance"),
        (
            "/inner/diffused".into(),
            json!(0.1),
            "at most that of all steps",
        ),
        (
            "/inner/config/byte_budget".into(),
            json!(0),
            "at least what the buffer holds",
        ),
        (
            "/inner/config/byte_budget".into(),
            json!(100),
            "at least what the buffer holds",
        ),
        (
            format!("{buffer}/spare"),
            json!([u64::MAX]),
            "bytes of a replay buffer",
        ),
        (format!("{buffer}/limit"), json!(0), "could not have kept"),
        (format!("{past}/held"), json!(1), "could not have kept"),
        (
            format!("{past}/diffused"),
            json!(-0.5),
            ">= 0 N²/m² and finite",
        ),
        (
            format!("{past}/obs/points/1"),
            json!(4),
            "observed point 4 is out of range",
        ),
        (
            format!("{past}/obs/points/1"),
            json!(0),
            "strictly increasing",
        ),
        (
            format!("{past}/obs/rows"),
            json!([1.0]),
            "observation matrix has length 1",
        ),
        (
            format!("{past}/obs/reading"),
            json!([1.0]),
            "reading has length 1",
        ),
        (
            format!("{past}/obs/noise/dim"),
            json!(u64::MAX),
            "more than the 4096",
        ),
        (
            format!("{past}/obs/noise/covariance/1"),
            json!(0.7),
            "symmetric",
        ),
        (
            format!("{past}/obs/noise/covariance/3"),
            json!(-1.0),
            "positive definite",
        ),
        ("/loss".into(), json!({"Huber": {"k": 0.0}}), "Huber's k"),
        (
            "/loss".into(),
            json!({"StudentT": {"nu": -1.0}}),
            "degrees of freedom",
        ),
        ("/weights/0".into(), json!(1.5), "in (0, 1]"),
        ("/downweighted".into(), json!(1000), "at most all readings"),
        ("/readings".into(), json!(u64::MAX), "at most 2^50"),
    ] {
        let error = refused(&at, value);
        assert!(error.contains(says), "{at}: {error}");
    }
    // Formats with infinities.
    let mut bytes = postcard::to_allocvec(&DiagonalKalman::new(
        Belief::<f64>::uniform(1, 7.0, 2.0).unwrap(),
    ))
    .unwrap();
    let mean = bytes
        .windows(8)
        .position(|b| b == 7f64.to_le_bytes())
        .unwrap();
    bytes[mean..mean + 8].copy_from_slice(&f64::INFINITY.to_le_bytes());
    let restored = postcard::from_bytes::<DiagonalKalman<f64>>(&bytes);
    assert!(restored.is_err(), "an infinite mean was taken");
}

/// A dual replay with two readings in memory.
fn saved_dual() -> DualReplay<f64> {
    let prior = Belief::uniform(4, 1.0, 2.0).unwrap();
    let mut filter = DualReplay::new(prior, DualConfig::default()).unwrap();
    let mut obs = Observation::new(Noise::uniform(2, 0.5).unwrap());
    for (points, reading) in [(&[0u32, 2][..], [3.0, -9.0]), (&[1, 3], [2.0, 40.0])] {
        obs.rebuild(4, points, &reading, |k, w| {
            w.copy_from_slice(&[1.0, k as f64]);
        })
        .unwrap();
        filter.update(&obs).unwrap();
    }
    filter
}

#[test]
fn dual_states_that_cannot_be_are_refused() {
    let good = serde_json::to_value(saved_dual()).unwrap();
    let restored: DualReplay<f64> = serde_json::from_value(good.clone()).unwrap();
    assert_eq!(restored.belief(), saved_dual().belief());
    let past = "/buffer/kept/0";
    for (at, value, says) in [
        ("/filter/belief/mean/1".into(), json!(-1.0), ">= 0 N/m"),
        ("/free/1".into(), json!(77.0), "free means"),
        ("/free".into(), json!([1.0]), "free means"),
        ("/prior/2".into(), json!(0.0), "prior variance"),
        ("/prior".into(), json!([1.0]), "prior variances"),
        ("/rng".into(), json!([2, 3]), "odd"),
        (
            "/config/byte_budget".into(),
            json!(100),
            "at least what the buffer holds",
        ),
        (format!("{past}/held"), json!(1), "could not have kept"),
        (
            format!("{past}/extra/multipliers"),
            json!([1.0]),
            "multipliers",
        ),
        (
            format!("{past}/extra/factor/dim"),
            json!(7),
            "Cholesky factor",
        ),
        (
            format!("{past}/extra/factor/lower/3"),
            json!(-1.0),
            "positive definite",
        ),
        (
            format!("{past}/extra/factor"),
            json!({"dim": 0, "lower": []}),
            "factor of an observation",
        ),
    ] {
        let mut state = good.clone();
        *state
            .pointer_mut(&at)
            .unwrap_or_else(|| panic!("no {at} in {good}")) = value;
        match serde_json::from_value::<DualReplay<f64>>(state) {
            Ok(_) => panic!("{at} was taken"),
            Err(error) => assert!(error.to_string().contains(says), "{at}: {error}"),
        }
    }
}

/// Steps that are too long, by a factor that no constructor made, end in finite numbers all the same.
#[test]
fn a_dual_state_with_wrong_factors_stays_finite() {
    let mut state = serde_json::to_value(saved_dual()).unwrap();
    for k in [0, 1] {
        let lower = json!([1e-9, 0.0, 0.0, 1e-9]);
        *state
            .pointer_mut(&format!("/buffer/kept/{k}/extra/factor/lower"))
            .unwrap() = lower;
    }
    let mut filter: DualReplay<f64> = serde_json::from_value(state).unwrap();
    let mut obs = Observation::new(Noise::uniform(2, 0.5).unwrap());
    obs.rebuild(4, &[0, 3], &[3.0, 1.0], |k, w| {
        w.copy_from_slice(&[1.0, k as f64]);
    })
    .unwrap();
    for _ in 0..50 {
        let _ = filter.update(&obs);
        let belief = filter.belief();
        Belief::new(belief.mean().to_vec(), belief.variance().to_vec()).unwrap();
    }
}

proptest! {
    /// Broken bytes give an error or an estimator that works, never a panic.
    #[test]
    fn broken_bytes_do_no_harm(at in 0usize..2000, with in any::<u8>(), cut in any::<bool>()) {
        let mut bytes = postcard::to_allocvec(&saved()).unwrap();
        let at = at % bytes.len();
        if cut {
            bytes.truncate(at);
        } else {
            bytes[at] = with;
        }
        let Ok(mut filter) = postcard::from_bytes::<Replay<f64>>(&bytes) else {
            return Ok(());
        };
        if filter.inner().config().replays > 1000 {
            return Ok(());
        }
        let before = filter.belief().clone();
        let mut obs = Observation::new(Noise::uniform(1, 0.5).unwrap());
        obs.rebuild(4, &[1], &[2.0], |_, w| w[0] = 1.0).unwrap();
        let result: Result<_, CoreError> = filter.update(&obs);
        let belief = filter.belief();
        if result.is_err() {
            prop_assert_eq!(belief, &before);
        }
        prop_assert!(Belief::new(belief.mean().to_vec(), belief.variance().to_vec()).is_ok());
    }
}

/// Statistics of the innovations go on over a restart; what cannot be is refused.
#[test]
fn filter_health_is_kept() {
    let mut health = FilterHealth::default();
    for nis in [6.0, 8.5] {
        health.record(&UpdateReport {
            dof: 7,
            nis,
            ..UpdateReport::default()
        });
    }
    assert_eq!(Json::copy(&health), health);
    assert_eq!(Postcard::copy(&health), health);
    for bad in ["-1.0", "1e999", "null"] {
        let text = format!(r#"{{"updates": 2, "dof": 14, "nis": {bad}}}"#);
        assert!(
            serde_json::from_str::<FilterHealth>(&text).is_err(),
            "{bad}"
        );
    }
}
