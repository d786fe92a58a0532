//! Baselines on torques that are a known function of the posture.

use nalgebra::{Point3, Vector3};
use vsf_core::CoreError;
use vsf_data::{Dataset, RobotRef, Sequence, Table};
use vsf_pipeline::{
    Baseline, MlpConfig, PipelineError, Scene, SceneOptions, SequencePrediction, Trace, score,
};
use vsf_robots::kinova_gen3;

const ROWS: usize = 40;

/// A push of a Gen3 beside the others, by `at`: the hand is held by a force that grows with its way
/// forward, and a steady one downward.
fn push(at: f64) -> Sequence {
    let robot = kinova_gen3().unwrap();
    let hand = robot.link_index("EndEffector_Link").unwrap();
    let mut posture = robot.posture();
    let (mut angles, mut torques) = (Vec::new(), Vec::new());
    for k in 0..ROWS {
        let s = (k as f64 / ROWS as f64 * std::f64::consts::PI).sin();
        let q = [
            -0.17 + 0.05 * at,
            0.77 + 0.2 * s,
            3.39 + 0.13 * s,
            -2.1 + 0.57 * s,
            -0.54 + 0.02 * at,
            -0.33 - 0.4 * s,
            0.52 - 0.16 * s,
        ];
        robot.update_posture(&q, &mut posture).unwrap();
        let p_W = Point3::from(posture.link_poses()[hand].translation.vector);
        let f_W = Vector3::new(-15.0 * s, 0.0, -3.0);
        let mut tau = [0.0; 7];
        posture.joint_torques(hand, &p_W, &f_W, &mut tau);
        angles.extend(q);
        torques.extend(tau);
    }
    let time = (0..ROWS).map(|k| k as f64).collect();
    let table = |data: Vec<f64>| Table::new(7, data).unwrap();
    Sequence::new(at.to_string(), time, table(angles), table(torques))
}

/// Pushes 0 to 6 train, others between them test; the points are out of reach.
fn recording() -> (Scene, Vec<Sequence>, Vec<Sequence>) {
    let train: Vec<Sequence> = (0..7).map(|k| push(f64::from(k))).collect();
    let test = vec![push(2.5), push(4.3)];
    let robot = RobotRef::resolve("kinova_gen3", ".".as_ref()).unwrap();
    let dataset = Dataset {
        rest_points: Some(vec![Point3::new(9.0, 0.0, 0.0)]),
        ..Dataset::new(robot, train.clone())
    };
    let scene = Scene::open(&dataset, &SceneOptions::default()).unwrap();
    (scene, train, test)
}

fn learned() -> [Baseline; 3] {
    [
        Baseline::Knn { k: 10 },
        Baseline::Gp { max_samples: 150 },
        Baseline::Mlp(MlpConfig {
            hidden: Some(vec![16, 16]),
            seed: 3,
        }),
    ]
}

/// The bounds leave the neighbors a fifth of the load, and the smooth regressions a twentieth.
#[test]
fn learn_a_function_of_the_posture() {
    let (scene, train, test) = recording();
    let (train, test): (Vec<_>, Vec<_>) = (train.iter().collect(), test.iter().collect());
    let traces: Vec<Trace> = scene.traces(&test, || {}).unwrap();
    let error = |baseline: &Baseline| {
        let found = baseline.predict(&scene, &train, &test).unwrap();
        assert_eq!(found[1].id, "4.3");
        score(&scene, &traces, &found).unwrap().mean_error
    };
    let zero = error(&Baseline::Zero);
    for (baseline, share) in learned().iter().zip([0.2, 0.05, 0.05]) {
        let error = error(baseline);
        assert!(error < share * zero, "{baseline:?}: {error} of {zero}");
    }
}

#[test]
fn networks_of_no_or_endless_size_are_refused() {
    let (scene, train, test) = recording();
    let (train, test): (Vec<_>, Vec<_>) = (train.iter().collect(), test.iter().collect());
    for hidden in [vec![], vec![16, 0], vec![usize::MAX], vec![1; 17]] {
        let hidden = Some(hidden);
        let mlp = Baseline::Mlp(MlpConfig { hidden, seed: 0 });
        let error = mlp.predict(&scene, &train, &test).unwrap_err().to_string();
        assert!(error.contains("hidden layer"), "{error}");
    }
}

#[test]
fn a_network_needs_more_than_what_is_held_out() {
    let (scene, train, test) = recording();
    let first = |table: &Table| Table::new(7, table[0].to_vec()).unwrap();
    let one = Sequence::new(
        "0",
        vec![0.0],
        first(&train[0].angles),
        first(&train[0].torques),
    );
    let test: Vec<_> = test.iter().collect();
    let mlp = Baseline::Mlp(MlpConfig::default());
    let error = mlp.predict(&scene, &[&one], &test).unwrap_err().to_string();
    assert!(error.contains("held out"), "{error}");
}

#[test]
fn same_bits_on_any_number_of_threads() {
    let (scene, train, test) = recording();
    let (train, test): (Vec<_>, Vec<_>) = (train.iter().collect(), test.iter().collect());
    let on = |threads: usize, baseline: &Baseline| -> Vec<SequencePrediction> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let run = || baseline.predict(&scene, &train, &test).unwrap();
        pool.build().unwrap().install(run)
    };
    for baseline in learned() {
        assert_eq!(on(1, &baseline), on(3, &baseline), "{baseline:?}");
    }
}

#[test]
fn deviations_grow_away_from_the_train_samples() {
    let (scene, train, _) = recording();
    let train: Vec<_> = train.iter().collect();
    for baseline in &learned()[..2] {
        let (near, far) = (push(3.0), push(40.0));
        let found = baseline.predict(&scene, &train, &[&near, &far]).unwrap();
        let total = |p: &SequencePrediction| p.sd.iter().flatten().sum::<f64>();
        assert!(total(&found[0]) > 0.0);
        assert!(total(&found[1]) > 3.0 * total(&found[0]), "{baseline:?}");
    }
}

/// Of one touch, parts are held out.
#[test]
fn one_touch_will_do() {
    let (scene, train, test) = recording();
    for baseline in learned() {
        let found = baseline.predict(&scene, &[&train[2]], &[&test[0]]).unwrap();
        assert_eq!(found[0].mean.len(), ROWS);
        assert!(found[0].mean.iter().flatten().all(|tau| tau.is_finite()));
    }
}

#[test]
fn refuse() {
    let (scene, train, test) = recording();
    let no_train = |baseline: &Baseline| baseline.predict(&scene, &[], &[&test[0]]);
    assert!(no_train(&Baseline::Zero).is_ok());
    for baseline in learned() {
        let error = no_train(&baseline).unwrap_err();
        assert!(
            matches!(error, PipelineError::NoSequences { .. }),
            "{error}"
        );
    }
    let mlp = |hidden| {
        let hidden = Some(hidden);
        Baseline::Mlp(MlpConfig { hidden, seed: 0 })
    };
    for baseline in [
        Baseline::Knn { k: 0 },
        Baseline::Gp { max_samples: 1 },
        Baseline::Gp {
            max_samples: 20_001,
        },
        mlp(vec![]),
        mlp(vec![8, 0]),
    ] {
        let error = baseline.predict(&scene, &[&train[0]], &[&test[0]]);
        let error = error.unwrap_err();
        let parameter = |e: &CoreError| matches!(e, CoreError::Parameter { .. });
        let refused = match &error {
            PipelineError::Core(e) => parameter(e),
            PipelineError::Vision(vsf_vision::VisionError::Core(e)) => parameter(e),
            _ => false,
        };
        assert!(refused, "{baseline:?}: {error}");
    }
}
