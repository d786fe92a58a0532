//! Choice of prior and noise on readings made from a known field with known noise.

use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use vsf_core::{Noise, Observation, RestPoints};
use vsf_pipeline::{HyperMethod, PipelineError, PriorShape, Trace, choose_contact, choose_hyper};

const POINTS: usize = 60;
const CHANNELS: usize = 3;
const PRIOR_SD: f64 = 20.0;
const NOISE_SD: f64 = 0.5;

fn rest() -> RestPoints {
    let at = |i: usize| Point3::new(i as f64, (i % 7) as f64, (i % 5) as f64) * 0.01;
    RestPoints::new((0..POINTS).map(at).collect()).unwrap()
}

/// `touches` of 40 readings each; every reading is a new combination of eight points.
fn traces(touches: &[usize], seed: u64) -> Vec<Trace> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let normal = |sd: f64| Normal::new(0.0, sd).unwrap();
    let field: Vec<f64> = (0..POINTS)
        .map(|_| normal(PRIOR_SD).sample(&mut rng))
        .collect();
    let noise = Noise::uniform(CHANNELS, 1.0).unwrap();
    let mut sequence = |(id, touches): (usize, &usize)| {
        let mut observations = Vec::new();
        for _ in 0..40 * touches {
            let mut points: Vec<u32> = (0..POINTS as u32).collect();
            (0..8).for_each(|k| points.swap(k, rng.random_range(k..POINTS)));
            points.truncate(8);
            points.sort_unstable();
            let mut rows = [[0.0; CHANNELS]; 8];
            let mut reading = [0.0; CHANNELS];
            for (row, &p) in rows.iter_mut().zip(&points) {
                for (w, tau) in row.iter_mut().zip(&mut reading) {
                    *w = normal(0.01).sample(&mut rng);
                    *tau += *w * field[p as usize];
                }
            }
            reading
                .iter_mut()
                .for_each(|tau| *tau += normal(NOISE_SD).sample(&mut rng));
            let mut obs = Observation::new(noise.clone());
            obs.rebuild(POINTS, &points, &reading, |k, w| {
                w.copy_from_slice(&rows[k]);
            })
            .unwrap();
            observations.push(obs);
        }
        Trace {
            id: id.to_string(),
            time: (0..observations.len()).map(|i| i as f64).collect(),
            touches: (0..*touches).map(|t| 40 * t..40 * (t + 1)).collect(),
            observations,
        }
    };
    touches.iter().enumerate().map(&mut sequence).collect()
}

#[test]
fn likelihood_finds_noise_and_prior() {
    let traces = traces(&[2, 2, 2], 1);
    let shapes = [PriorShape::independent()];
    let choice = choose_hyper(&rest(), &traces, &shapes, HyperMethod::Likelihood).unwrap();
    for sd in &choice.hyper.noise_sd {
        assert!((sd / NOISE_SD - 1.0).abs() < 0.15, "{sd}");
    }
    // Ratios are tried at powers of two.
    let factor = choice.hyper.prior_sd / PRIOR_SD;
    assert!((0.4..2.5).contains(&factor), "{factor}");
    let greatest = |c: &vsf_pipeline::Candidate| c.log_evidence.unwrap();
    let best = choice
        .candidates
        .iter()
        .map(greatest)
        .fold(f64::MIN, f64::max);
    assert!(best.is_finite() && choice.candidates.iter().all(|c| c.error.is_none()));
}

#[test]
fn held_out_noise_is_the_error_of_the_prediction() {
    let traces = traces(&[2, 2, 2], 2);
    let shapes = [PriorShape::independent()];
    let choice = choose_hyper(&rest(), &traces, &shapes, HyperMethod::HeldOut).unwrap();
    // Noise and what five sixths of the readings leave unknown of the field.
    for sd in &choice.hyper.noise_sd {
        assert!((1.0..1.6).contains(&(sd / NOISE_SD)), "{sd}");
    }
    let error = |c: &vsf_pipeline::Candidate| c.error.unwrap();
    let least = choice.candidates.iter().map(error).fold(f64::MAX, f64::min);
    assert!(least < 1.6 * NOISE_SD * (CHANNELS as f64).sqrt(), "{least}");
}

/// It is touches that are held out, however they are cut into sequences.
#[test]
fn sequences_do_not_matter() {
    let choice = |touches: &[usize]| {
        let shapes = [PriorShape::independent()];
        choose_hyper(&rest(), &traces(touches, 3), &shapes, HyperMethod::HeldOut).unwrap()
    };
    let one = choice(&[6]);
    for other in [choice(&[1; 6]), choice(&[4, 2])] {
        assert_eq!(one, other);
    }
}

#[test]
fn without_contact_nothing_can_be_chosen() {
    for method in [HyperMethod::HeldOut, HyperMethod::Likelihood] {
        let error = choose_hyper(&rest(), &[], &[PriorShape::default()], method).unwrap_err();
        assert!(error.to_string().contains("touch"), "{error}");
    }
}

/// Strokes that never touch a point twice: nothing held out touches a known point, and the level of
/// the noise is the scale of the readings, not zero.
#[test]
fn strokes_over_new_points_leave_a_finite_noise() {
    let noise = Noise::uniform(1, 1.0).unwrap();
    let stroke = |first: u32| {
        let mut observations = Vec::new();
        for p in first..first + 8 {
            let mut obs = Observation::new(noise.clone());
            obs.rebuild(POINTS, &[p], &[2.0], |_, w| w[0] = 0.01)
                .unwrap();
            observations.push(obs);
        }
        Trace {
            id: first.to_string(),
            time: (0..8).map(f64::from).collect(),
            touches: std::iter::once(0..8).collect(),
            observations,
        }
    };
    let traces = [stroke(0), stroke(8), stroke(16)];
    let shapes = [PriorShape::independent()];
    let choice = choose_hyper(&rest(), &traces, &shapes, HyperMethod::HeldOut).unwrap();
    let sd = choice.hyper.noise_sd[0];
    assert!((0.1..10.0).contains(&sd), "{sd}");
}

/// The same readings, and columns as another model of contact has them: of `lever` times the size.
fn with_columns(traces: &[Trace], lever: impl Fn(usize) -> f64) -> Vec<Trace> {
    let mut other = traces.to_vec();
    for (row, obs) in other
        .iter_mut()
        .flat_map(|t| &mut t.observations)
        .enumerate()
    {
        let own = obs.clone();
        obs.rebuild(POINTS, own.points(), own.reading(), |k, w| {
            (0..CHANNELS).for_each(|c| w[c] = lever(row + k) * own.row(c)[k]);
        })
        .unwrap();
    }
    other
}

/// Readings are made of columns, and others of the same points are worse, on touches that share points and within the only
/// one. Between equals the first is taken.
#[test]
fn the_contact_that_made_the_readings_is_chosen() {
    let shapes = [PriorShape::independent()];
    let mut one = traces(&[4], 4);
    one[0].touches = std::iter::once(0..one[0].time.len()).collect();
    for own in [traces(&[2, 2, 2], 4), one] {
        let noisy = with_columns(&own, |at| if at.is_multiple_of(2) { 0.5 } else { 1.5 });
        for (contacts, chosen) in [([&noisy[..], &own], 1), ([&own, &noisy], 0)] {
            let found = choose_contact(&rest(), &contacts, &shapes).unwrap();
            assert_eq!(found.contact, chosen, "{:?}", found.errors);
            let [right, wrong] = [chosen, 1 - chosen].map(|k| found.errors[k]);
            assert!(right < wrong, "{right} against {wrong}");
            let alone = choose_hyper(&rest(), &own, &shapes, HyperMethod::HeldOut).unwrap();
            assert_eq!(found.choice, alone);
        }
        // Springs of half the stiffness move twice as far.
        let longer = with_columns(&own, |_| 2.0);
        let found = choose_contact(&rest(), &[&longer, &own], &shapes).unwrap();
        assert_eq!(found.contact, 0);
        let [a, b] = found.errors[..] else { panic!() };
        assert!((a / b - 1.0).abs() < 1e-6, "{a} and {b}");
    }
}

/// Contact that begins earlier adds samples; the same are held out in both.
#[test]
fn contacts_are_compared_on_the_same_samples() {
    let own = traces(&[1], 5);
    let mut late = own.clone();
    for obs in &mut late[0].observations[..20] {
        let reading = obs.reading().to_vec();
        obs.rebuild(POINTS, &[], &reading, |_, _| {}).unwrap();
    }
    let shapes = [PriorShape::independent()];
    for (contacts, chosen) in [([&own[..], &late], 0), ([&late, &own], 1)] {
        let found = choose_contact(&rest(), &contacts, &shapes).unwrap();
        assert_eq!(found.contact, chosen, "{:?}", found.errors);
    }
}

#[test]
fn contacts_of_other_samples_are_refused() {
    let shapes = [PriorShape::independent()];
    let own = traces(&[2, 2], 6);
    let other = traces(&[2, 2], 7);
    let error = choose_contact(&rest(), &[&own, &other], &shapes).unwrap_err();
    assert!(
        matches!(&error, PipelineError::OtherSamples { id, index: 1 } if id == "0"),
        "{error}"
    );
    for contacts in [&[][..], &[&own[..], &own[..1]]] {
        let error = choose_contact(&rest(), contacts, &shapes).unwrap_err();
        assert!(matches!(error, PipelineError::Core(_)), "{error}");
    }
    assert!(choose_contact(&rest(), &[&own], &[]).is_err());
}
