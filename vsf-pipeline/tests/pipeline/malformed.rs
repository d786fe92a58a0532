//! Sequences, data sets, traces and predictions that were put together wrongly in memory are refused by name.

use nalgebra::{Point3, Vector3};
use serde::de::DeserializeOwned;
use std::ops::Range;
use vsf_core::{Belief, Noise, Observation};
use vsf_data::{DataError, Dataset, RobotRef, Sequence, Table, TorqueKind};
use vsf_pipeline::{
    EstimatorSpec, Evaluation, Experiment, Hyper, HyperChoice, HyperMethod, PipelineError,
    PipelineWarning, PriorShape, Scene, SceneOptions, SequencePrediction, Trace, choose_hyper,
    derivatives_of, estimate, evaluate, external_torques, motion_warnings, predict,
    reading_warnings, score, simulate,
};
use vsf_robots::planar_arm;

const ROWS: usize = 80;
const JOINTS: usize = 3;
const POINTS: usize = 4;

fn table(rows: usize, cols: usize) -> Table {
    let data = (0..rows * cols).map(|k| 1e-3 * k as f64);
    Table::new(cols, data.collect()).unwrap()
}

fn sequence(id: &str) -> Sequence {
    let time = (0..ROWS).map(|k| 0.01 * k as f64).collect();
    Sequence {
        velocities: Some(table(ROWS, JOINTS)),
        touch_starts: vec![0, 40],
        ..Sequence::new(id, time, table(ROWS, JOINTS), table(ROWS, JOINTS))
    }
}

fn dataset(torque_kind: TorqueKind) -> Dataset {
    let robot = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
    let far = |k: usize| Point3::new(9.0, 0.0, 0.01 * k as f64);
    let mut dataset = Dataset {
        torque_kind,
        rest_points: Some((0..POINTS).map(far).collect()),
        ..Dataset::new(robot, vec![sequence("a"), sequence("b")])
    };
    dataset.splits.test = dataset.splits.train.split_off(1);
    dataset
}

fn open(dataset: &Dataset) -> Result<Scene, PipelineError> {
    Scene::open(dataset, &SceneOptions::default())
}

fn scene(torque_kind: TorqueKind) -> Scene {
    open(&dataset(torque_kind)).unwrap()
}

/// Sequences with one thing wrong each, and what tells it.
fn wrong_sequences() -> Vec<(Sequence, &'static str)> {
    let good = || sequence("a");
    let mut nan = table(ROWS, JOINTS);
    nan.data_mut()[7] = f64::NAN;
    let reversed = good().time.into_iter().rev().collect();
    let starts = |touch_starts: &[usize]| Sequence {
        touch_starts: touch_starts.to_vec(),
        ..good()
    };
    let torques = |torques: Table| Sequence { torques, ..good() };
    let velocities = |table: Table| Sequence {
        velocities: Some(table),
        ..good()
    };
    let time = |time: Vec<f64>| Sequence { time, ..good() };
    let angles = |angles: Table| Sequence { angles, ..good() };
    vec![
        (torques(table(10, JOINTS)), "torques.npy: 10 rows"),
        (torques(table(ROWS, 1)), "torques.npy: shape [80, 1]"),
        (torques(nan.clone()), "torques.npy row 2 joint 2: NaN"),
        (angles(nan), "angles.npy row 2 joint 2: NaN"),
        (velocities(table(10, JOINTS)), "velocities.npy: 10 rows"),
        (velocities(table(ROWS, 1)), "velocities.npy: shape [80, 1]"),
        (time(Vec::new()), "time.npy: 0 rows"),
        (time(reversed), "time.npy row 1"),
        (starts(&[0, 500]), "entry 1 is row 500"),
        (starts(&[50, 10]), "entry 1 is row 10"),
        (
            Sequence::new("a", good().time, table(ROWS, 2), table(ROWS, 2)),
            "joint angles has length 2, expected 3",
        ),
    ]
}

#[test]
fn sequences() {
    for kind in [TorqueKind::External, TorqueKind::Measured] {
        let scene = scene(kind);
        let good = sequence("a");
        let traces = [scene.trace(&good).unwrap()];
        let stiffness = [1.0; POINTS];
        assert_eq!(motion_warnings(scene.robot(), &[&good]).len(), 1);
        for (wrong, tells) in wrong_sequences() {
            let refused = |what: &str, error: Option<PipelineError>| {
                let text = error.map(|e| e.to_string()).unwrap_or_default();
                assert!(text.contains(tells), "{what}, {tells}: {text:?}");
            };
            refused("trace", scene.trace(&wrong).err());
            refused("follow", scene.follow(&wrong, |_, _, _| Ok(())).err());
            refused("torques", external_torques(&scene, &wrong).err());
            refused("motion", derivatives_of(scene.robot(), &wrong).err());
            let simulated = simulate(&scene, &stiffness, &[&wrong], &traces);
            refused("simulate", simulated.err());
            for warnings in [
                motion_warnings(scene.robot(), &[&good, &wrong]),
                reading_warnings(&scene, &[&wrong], &traces),
            ] {
                let [PipelineWarning::Malformed { sequence, problem }] = &warnings[..] else {
                    panic!("{tells}: {warnings:?}");
                };
                assert!(sequence == "a" && problem.contains(tells), "{problem}");
            }
        }
    }
}

/// Traces of other sequences, or fewer.
#[test]
fn sequences_and_traces_in_pairs() {
    let scene = scene(TorqueKind::External);
    let mut cut = sequence("a");
    cut.torques.data_mut()[JOINTS * 70] = 100.0;
    let whole = scene.trace(&cut).unwrap();
    let short = Trace {
        time: whole.time[..20].to_vec(),
        observations: whole.observations[..20].to_vec(),
        touches: std::iter::once(0..20).collect(),
        ..whole
    };
    for traces in [&[short][..], &[]] {
        let warnings = reading_warnings(&scene, &[&cut], traces);
        let [PipelineWarning::Malformed { problem, .. }] = &warnings[..] else {
            panic!("{warnings:?}");
        };
        assert!(problem.contains("trace has length"), "{problem}");
    }
}

#[test]
fn data_sets() {
    let robot = || planar_arm(JOINTS, 0.3, 0.03).unwrap();
    let good = dataset(TorqueKind::External);
    let scene = open(&good).unwrap();
    let traces = scene
        .traces(&[&good.sequences[0], &good.sequences[1]], || {})
        .unwrap();
    let experiment = Experiment::new(&good, &scene, &traces).unwrap();
    assert!(format!("{experiment:?} {scene:?}").contains("planar"));
    let check = |change: fn(&mut Dataset), is: fn(&DataError) -> bool| {
        let mut wrong = good.clone();
        change(&mut wrong);
        for error in [
            open(&wrong).unwrap_err(),
            Scene::in_air(&wrong, robot()).unwrap_err(),
            Experiment::new(&wrong, &scene, &traces).unwrap_err(),
        ] {
            assert!(
                matches!(&error, PipelineError::Data(e) if is(e)),
                "{error:?}"
            );
        }
    };
    check(
        |d| d.splits.test = vec!["a".to_owned()],
        |e| matches!(e, DataError::DuplicateSequence { .. }),
    );
    check(
        |d| d.splits.test = vec!["c".to_owned()],
        |e| matches!(e, DataError::UnknownSequence { .. }),
    );
    check(
        |d| d.gravity = Vector3::new(0.0, 0.0, f64::NAN),
        |e| matches!(e, DataError::Metadata { key: "gravity", .. }),
    );
    check(
        |d| d.sequences[1].touch_starts = vec![500],
        |e| matches!(e, DataError::TouchStarts { .. }),
    );
}

/// Every sample touches the same two points, which lie in a field of `field_len`.
fn trace(field_len: usize, joints: usize) -> Trace {
    let points = [field_len as u32 - 2, field_len as u32 - 1];
    let reading = |row: usize| {
        let mut obs = Observation::new(Noise::uniform(joints, 1.0).unwrap());
        let tau = vec![1.0 + 0.1 * (row % 3) as f64; joints];
        obs.rebuild(field_len, &points, &tau, |_, w| w.fill(0.1))
            .unwrap();
        obs
    };
    Trace {
        id: "a".to_owned(),
        time: (0..ROWS).map(|k| k as f64).collect(),
        observations: (0..ROWS).map(reading).collect(),
        touches: vec![0..40, 40..ROWS],
    }
}

fn wrong_traces() -> Vec<(Trace, &'static str)> {
    let good = || trace(POINTS, JOINTS);
    let touches = |touches: &[Range<usize>]| Trace {
        touches: touches.to_vec(),
        ..good()
    };
    let mut late = good();
    late.time[5] = f64::NAN;
    let mut back = good();
    back.time[7] = 5.5;
    let mut mixed = good();
    mixed.observations[6] = trace(POINTS, 2).observations.remove(0);
    let backward = Range { start: 60, end: 50 };
    vec![
        (trace(POINTS + 5, JOINTS), "row 0: observed point 8"),
        (mixed, "row 6: observation has length 2, expected 3"),
        (
            Trace {
                time: vec![0.0; 10],
                ..good()
            },
            "row 10: time has length 10, expected 80",
        ),
        (late, "row 5: time[0] is NaN"),
        (back, "row 7: time = 5.5 is out of range: later than"),
        (touches(&[0..40, 40..500]), "touch 1 is samples 40 to 500"),
        (touches(&[0..40, 30..ROWS]), "touch 1 is samples 30 to 80"),
        (touches(&[0..40, backward]), "touch 1 is samples 60 to 50"),
        (touches(&[0..40, 41..ROWS]), "touch 1 is samples 41 to 80"),
        (touches(&[0..40, 40..70]), "touch 2 is samples 70 to 70"),
        (touches(&[]), "touch 0 is samples 0 to 0"),
    ]
}

#[test]
fn traces() {
    let scene = scene(TorqueKind::External);
    let (rest, shape) = (scene.rest(), PriorShape::default());
    let belief = Belief::uniform(POINTS, 1.0, 1.0).unwrap();
    let hyper = Hyper {
        prior_sd: 10.0,
        shape,
        noise_sd: vec![0.1; JOINTS],
    };
    let noise_sd = &hyper.noise_sd;
    let good = trace(POINTS, JOINTS);
    let prediction = predict(&scene, &belief, noise_sd, &good).unwrap();
    score(&scene, std::slice::from_ref(&good), &[prediction]).unwrap();
    let data = dataset(TorqueKind::External);
    for (wrong, tells) in wrong_traces() {
        let refused = |what: &str, error: Option<PipelineError>| {
            let text = error.map(|e| e.to_string()).unwrap_or_default();
            assert!(text.contains(tells), "{what}, {tells}: {text:?}");
        };
        let both = [good.clone(), wrong.clone()];
        refused("check", wrong.check(POINTS, JOINTS).err());
        refused("evaluate", evaluate(&scene, &belief, &both).err());
        refused("predict", predict(&scene, &belief, noise_sd, &wrong).err());
        refused("score", {
            let zero = |t: &Trace| SequencePrediction {
                id: t.id.clone(),
                mean: vec![vec![0.0; JOINTS]; t.observations.len()],
                sd: Vec::new(),
            };
            score(&scene, &both, &both.each_ref().map(zero)).err()
        });
        for spec in [EstimatorSpec::Batch, EstimatorSpec::replay()] {
            let found = estimate(rest, &both, &spec, &hyper, |_| {});
            refused("estimate", found.err());
        }
        for method in [HyperMethod::HeldOut, HyperMethod::Likelihood] {
            refused("hyper", choose_hyper(rest, &both, &[shape], method).err());
        }
        refused("experiment", Experiment::new(&data, &scene, &both).err());
        let simulated = simulate(&scene, &[1.0; POINTS], &[&data.sequences[0]], &both[1..]);
        refused("simulate", simulated.err());
        let warnings = reading_warnings(&scene, &[], &both);
        assert!(
            matches!(&warnings[..], [PipelineWarning::Malformed { problem, .. }] if problem.contains(tells)),
            "{warnings:?}"
        );
    }
    for (sd, tells) in [
        (f64::NAN, "noise sd[1] is NaN"),
        (-1.0, "noise sd = -1.0 is out of range"),
        (1e200, "noise sd = 1e200 is out of range"),
    ] {
        let error = predict(&scene, &belief, &[0.1, sd, 0.1], &good).unwrap_err();
        assert!(error.to_string().contains(tells), "{error}");
    }
}

#[test]
fn priors() {
    let scene = scene(TorqueKind::External);
    let traces = [trace(POINTS, JOINTS)];
    for shape in [PriorShape::default(), PriorShape::independent()] {
        for prior_sd in [-10.0, 0.0, f64::NAN, 1e200] {
            let hyper = Hyper {
                prior_sd,
                shape,
                noise_sd: vec![0.1; JOINTS],
            };
            let error = estimate(scene.rest(), &traces, &EstimatorSpec::Batch, &hyper, |_| {});
            let text = error.unwrap_err().to_string();
            let tells = format!("prior sd = {prior_sd:?} is out of range");
            assert!(text.contains(&tells), "{text}");
        }
        for mean in [vec![1.0; POINTS + 1], vec![-1.0; POINTS]] {
            assert!(shape.prior_about(scene.rest(), 1.0, mean).is_err());
        }
    }
}

/// A scene says what readings mean; one of another recording would read them as what they are not.
#[test]
fn scenes_of_other_recordings() {
    let data = dataset(TorqueKind::Measured);
    let scene = open(&data).unwrap();
    scene.check_recording(&data).unwrap();
    scene.clone().without_tare().check_recording(&data).unwrap();
    let other = |what: &str, data: Dataset| {
        let error = scene.check_recording(&data).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
        let traces: Vec<Trace> = (data.sequences.iter())
            .map(|s| scene.trace(s).unwrap())
            .collect();
        assert!(Experiment::new(&data, &scene, &traces).is_err());
    };
    other("torque_kind", dataset(TorqueKind::External));
    other(
        "gravity",
        Dataset {
            gravity: Vector3::new(0.0, 0.0, -1.62),
            ..data.clone()
        },
    );
    other(
        "base_pose",
        Dataset {
            base_pose: nalgebra::Isometry3::translation(0.0, 0.0, 5.0),
            ..data.clone()
        },
    );
    let mut names: Vec<String> = (scene.robot().joints().iter())
        .map(|j| j.name().to_owned())
        .collect();
    names.reverse();
    other(
        "joint_3",
        Dataset {
            joints: Some(names),
            ..data
        },
    );
}

#[test]
fn predictions() {
    let scene = scene(TorqueKind::External);
    let trace = [trace(POINTS, JOINTS)];
    let rows = |len: usize, value: f64| vec![vec![value; len]; ROWS];
    let refused = |mean: Vec<Vec<f64>>, sd: Vec<Vec<f64>>, tells: &str| {
        let id = "a".to_owned();
        let found = score(&scene, &trace, &[SequencePrediction { id, mean, sd }]);
        let text = found.unwrap_err().to_string();
        assert!(text.contains(tells), "{text}");
    };
    let good = || rows(JOINTS, 1.0);
    let mut nan = good();
    nan[4][1] = f64::NAN;
    for (wrong, tells) in [
        (rows(1, 1.0), "row 0: predicted {} has length 1, expected 3"),
        (rows(9, 1.0), "row 0: predicted {} has length 9, expected 3"),
        (nan, "sequence a row 4: predicted {}[1] is NaN"),
        (rows(JOINTS, f64::INFINITY), "predicted {}[0] is inf"),
    ] {
        refused(wrong.clone(), Vec::new(), &tells.replace("{}", "reading"));
        refused(good(), wrong, &tells.replace("{}", "sd"));
    }
    refused(
        good()[1..].to_vec(),
        Vec::new(),
        "sequence a row 79: predicted rows",
    );
    refused(good(), good()[1..].to_vec(), "row 79: rows of predicted sd");
    refused(good(), rows(JOINTS, -1.0), "row 0: predicted sd = -1.0");
    // Finite, but not its square.
    refused(rows(JOINTS, 1e200), Vec::new(), "squared errors");
}

/// What is written as JSON can be read again.
#[test]
fn results_can_be_read() {
    fn read<T: DeserializeOwned>() {}
    read::<Hyper>();
    read::<HyperChoice>();
    read::<Evaluation>();
}
