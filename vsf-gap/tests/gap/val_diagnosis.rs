//! A diagnosis against recordings whose cause is known, made by a world that shares no code with it.

use crate::common;

use common::campaign::{RATE, Rows, free_arm};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use std::cell::RefCell;
use std::f64::consts::TAU;
use std::sync::{Arc, LazyLock};
use tempfile::TempDir;
use vsf_data::{Dataset, Overrides, RobotRef, Sequence, Table, TorqueKind};
use vsf_gap::{Acts, Campaign, Effect, GapError, Outcome, VerdictKind, diagnose, effects};
use vsf_pipeline::SceneOptions;
use vsf_world::{CaseSpec, Kind as World, Level, Protocol, generate};

/// With its folder, where the robot is read from when it is opened.
fn recorded(truth: &[&str], seed: u64) -> (TempDir, Dataset) {
    let spec = CaseSpec {
        kind: World::Springs,
        protocol: Protocol::Rich,
        effects: truth.iter().map(|e| (*e).to_owned()).collect(),
        level: Level::Clear,
        seed,
    };
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    generate(&spec, folder.path()).unwrap();
    let (dataset, _) = Dataset::open(folder.path(), &Overrides::default()).unwrap();
    (folder, dataset)
}

/// The springs world without effect, whose readings tests change. Its folder stays with the build.
fn quiet() -> Dataset {
    static QUIET: LazyLock<(TempDir, Dataset)> = LazyLock::new(|| recorded(&[], 42));
    QUIET.1.clone()
}

/// What was recorded with effects.
fn made(truth: &[&str], seed: u64) -> Campaign {
    let (_folder, dataset) = recorded(truth, seed);
    opened(&dataset)
}

fn opened(dataset: &Dataset) -> Campaign {
    Campaign::open(dataset, &SceneOptions::default()).unwrap()
}

/// Some effects of each kind, few enough for a test.
fn some() -> Vec<Arc<dyn Effect>> {
    let names = [
        "torque_bias",
        "joint_coulomb_friction",
        "joint_viscous_friction",
        "payload",
        "gravity_tilt",
        "viscoelastic",
    ];
    effects::named(&names.map(str::to_owned)).unwrap()
}

fn diagnosed(truth: &[&str], seed: u64) -> Outcome {
    let campaign = made(truth, seed);
    diagnose(&campaign, &some(), 0, |_| {}).unwrap()
}

#[test]
fn a_payload_is_named_and_the_gap_closes() {
    let outcome = diagnosed(&["payload"], 41);
    let d = &outcome.diagnosis;
    assert_eq!(d.verdict.kind, VerdictKind::Effects);
    assert_eq!(d.verdict.effects, ["payload"]);
    assert!(d.verdict.probability > 0.9, "{}", d.verdict.probability);
    assert!(d.gap.test_error_corrected < d.gap.test_error_nominal);
    assert!(d.gap.closed_interval[0] <= d.gap.closed_fraction);
    assert!(d.gap.closed_fraction <= d.gap.closed_interval[1]);
    assert_eq!(outcome.model.parts.len(), 1);

    // Its file says what it was found in.
    let (file, campaign) = (outcome.model_file().unwrap(), &outcome.campaign);
    assert_eq!(
        file.model(campaign.site(), &some()).unwrap().theta(),
        outcome.model.theta()
    );
    assert_eq!(file.recording.as_ref(), Some(&d.dataset));
    assert!(!d.dataset.is_empty() && d.dataset == campaign.name());
    let train: Vec<&str> = campaign.train().iter().map(|m| m.id.as_str()).collect();
    assert_eq!(file.learned_from, train);
    assert_eq!(file.contact, Some(campaign.scene().contact_parameters()));
    assert_eq!(file.made_by, None);
}

/// Whether the test sequences are told to contradict the others.
fn contradicts(d: &vsf_gap::Diagnosis) -> bool {
    d.notes.iter().any(|n| n.contains("contradict"))
}

#[test]
fn nothing_is_named_where_nothing_acts() {
    let outcome = diagnose(&opened(&quiet()), &some(), 0, |_| {}).unwrap();
    let d = &outcome.diagnosis;
    assert_eq!(d.verdict.kind, VerdictKind::NoGap);
    assert!(d.verdict.effects.is_empty() && outcome.model.parts.is_empty());
    assert!(!contradicts(d), "{:?}", d.notes);
    assert_eq!(d.gap.test_error_nominal, d.gap.test_error_corrected);
    assert_eq!(d.gap.closed_fraction, 0.0);
}

/// No spring pushes the other way; zeros were not read.
#[test]
fn torques_of_the_wrong_sign_are_a_gap_and_zeros_tell_nothing() {
    let dataset = quiet();
    let scaled = |by: f64| {
        let mut dataset = dataset.clone();
        let torques = dataset.sequences.iter_mut().map(|s| &mut s.torques);
        torques.for_each(|t| t.data_mut().iter_mut().for_each(|t| *t *= by));
        let campaign = opened(&dataset);
        let bias = effects::named(&["torque_bias".to_owned()]).unwrap();
        diagnose(&campaign, &bias, 0, |_| {})
    };
    let wrong = scaled(-1.0).unwrap().diagnosis;
    assert_eq!(wrong.verdict.kind, VerdictKind::Unknown);
    assert!(wrong.notes.iter().any(|n| n.contains("sign")));
    let zeros = scaled(0.0).map(drop).unwrap_err();
    assert!(matches!(zeros, GapError::TooLittle { .. }), "{zeros}");
}

/// The springs world without effect, its readings changed: `felt` gets the time (s) and the torques of a sample.
fn of_springs(felt: impl Fn(f64, &mut [f64])) -> Campaign {
    of_springs_in(|_, t, row| felt(t, row))
}

/// The same; `felt` is told, too, whether it is of a test sequence.
fn of_springs_in(felt: impl Fn(bool, f64, &mut [f64])) -> Campaign {
    let mut dataset = quiet();
    for s in &mut dataset.sequences {
        let joints = s.torques.cols();
        let rows = s.torques.data_mut().chunks_exact_mut(joints);
        let is_test = dataset.splits.test.contains(&s.id);
        rows.zip(&s.time)
            .for_each(|(row, t)| felt(is_test, *t, row));
    }
    opened(&dataset)
}

/// Screening promises little of a step at so slow a motion, and much of the form that extends it: which has to outdo it even
/// so.
#[test]
fn dry_friction_is_not_named_by_its_general_form() {
    let mut dataset = quiet();
    for s in &mut dataset.sequences {
        let joints = s.torques.cols();
        let velocities = s.velocities.clone().unwrap();
        let rows = s.torques.data_mut().chunks_exact_mut(joints);
        for (row, qd) in rows.zip(velocities.data().chunks_exact(joints)) {
            row[1] -= 20.0 * (qd[1] / 0.01).tanh();
        }
    }
    let campaign = opened(&dataset);
    let names = ["joint_stribeck_friction", "joint_coulomb_friction"];
    let both = effects::named(&names.map(str::to_owned)).unwrap();
    let d = diagnose(&campaign, &both, 0, |_| {}).unwrap().diagnosis;
    assert_eq!(d.verdict.effects, ["joint_coulomb_friction"]);
    let of = |name: &str| d.effects.iter().find(|e| e.effect == name).unwrap();
    assert!(names.iter().all(|name| of(name).null_score.is_some()));
    let c = &of("joint_coulomb_friction").parameters;
    assert!(
        c.iter()
            .any(|p| p.name == "c_2" && (p.value - 20.0).abs() < 0.5),
        "{c:?}"
    );
}

/// Train sequences that show nothing are no proof for test sequences that read otherwise.
#[test]
fn test_sequences_that_contradict_the_others_are_no_absence_of_a_gap() {
    let bias = effects::named(&["torque_bias".to_owned()]).unwrap();
    let of = |felt: fn(&mut [f64])| {
        let campaign = of_springs_in(|is_test, _, row| {
            if is_test {
                felt(row)
            }
        });
        diagnose(&campaign, &bias, 0, |_| {}).unwrap().diagnosis
    };
    let opposite = |row: &mut [f64]| row.iter_mut().for_each(|t| *t = -*t);
    for felt in [opposite, |row: &mut [f64]| row.swap(1, 3)] {
        let d = of(felt);
        assert_eq!(d.verdict.kind, VerdictKind::Unknown, "{:?}", d.verdict);
        assert!(contradicts(&d), "{:?}", d.notes);
    }
}

/// Twice the torques are twice the stiffness: what tells a gain is by how much joints differ.
#[test]
fn gains_are_relative_to_the_joints_that_agree() {
    let gain = effects::named(&["torque_gain".to_owned()]).unwrap();
    let of = |gains: [f64; 7]| {
        let campaign = of_springs(|_, row| row.iter_mut().zip(gains).for_each(|(t, g)| *t *= g));
        let d = diagnose(&campaign, &gain, 0, |_| {}).unwrap().diagnosis;
        let joint = |j: usize| campaign.site().robot.joints()[j].name().to_owned();
        (d, joint(2))
    };
    let (all, _) = of([2.0; 7]);
    assert_eq!(all.verdict.kind, VerdictKind::NoGap);
    let (one, third) = of([2.0, 2.0, 3.0, 2.0, 2.0, 2.0, 2.0]);
    assert_eq!(one.verdict.effects, ["torque_gain"]);
    assert_eq!(
        one.effects[0].joints,
        [third],
        "{:?}",
        one.effects[0].parameters
    );
    let parameters = &one.effects[0].parameters;
    assert!((parameters[2].value - 0.5).abs() < 0.05, "{parameters:?}");
    let others = parameters.iter().filter(|p| p.name != "g_3");
    // The last joint feels next to nothing.
    let close = |p: &vsf_gap::ParameterEstimate| p.value.abs() < (3.0 * p.sd).max(0.05);
    assert!(others.clone().all(close), "{parameters:?}");
    assert_eq!(others.filter(|p| p.value == 0.0 && p.sd == 0.0).count(), 1);
    assert!(one.notes.iter().any(|n| n.contains("relative to")));
}

/// Means over a fifth of a second leave little of it, and differences of samples take some of it for noise.
#[test]
fn a_hum_in_free_motion_is_a_gap() {
    let hum = |t: f64| 0.8 * (9.0 * TAU * t).sin();
    let campaign = of_springs(|t, row| row.iter_mut().for_each(|tau| *tau += hum(t)));
    let d = diagnose(&campaign, &some(), 0, |_| {}).unwrap().diagnosis;
    assert_eq!(d.verdict.kind, VerdictKind::Unknown, "{:?}", d.verdict);
    let free = d.gap.free.unwrap();
    // Seven joints feel it.
    let felt = 0.8 * (7.0_f64 / 2.0).sqrt();
    assert!((free.nominal / felt - 1.0).abs() < 0.2, "{free:?}");
}

/// Three samples in a row have one difference of second order: noise cannot be told from a gap.
#[test]
fn handfuls_of_samples_and_arms_that_rest_tell_nothing() {
    let sequence = |rows: usize, way: f64| -> Rows {
        (0..rows)
            .map(|k| {
                (
                    vec![way * k as f64, 0.0, 0.0],
                    vec![0.1 * (k % 2) as f64, 0.0, 0.2],
                )
            })
            .collect()
    };
    let refused = |rows: usize, way: f64| {
        let campaign = free_arm(&vec![sequence(rows, way); 3]);
        let outcome = diagnose(&campaign, &some(), 0, |_| {});
        outcome.map(|_| ()).map_err(|e| e.to_string())
    };
    let short = refused(3, 0.1).unwrap_err();
    assert!(short.contains("samples in a row"), "{short}");
    let still = refused(50, 0.0).unwrap_err();
    assert!(still.contains("no joint moves"), "{still}");
    assert_eq!(refused(50, 0.01), Ok(()));
}

/// A planar arm of three joints that swings in free air; `felt` makes the readings of the actuators (N m) of what it
/// takes to move it and of the velocities (rad/s). Noise of 0.02 N m.
fn swinging(felt: impl Fn([f64; 3], [f64; 3]) -> [f64; 3]) -> Campaign {
    swinging_with_noise(7, felt)
}

/// The same with other noise.
fn swinging_with_noise(seed: u64, felt: impl Fn([f64; 3], [f64; 3]) -> [f64; 3]) -> Campaign {
    swinging_in_sequences(seed, |_, tau, qd| felt(tau, qd))
}

/// The same with readings that differ from sequence to sequence.
fn swinging_in_sequences(
    seed: u64,
    felt: impl Fn(u32, [f64; 3], [f64; 3]) -> [f64; 3],
) -> Campaign {
    let robot = vsf_robots::planar_arm(3, 0.3, 0.03).unwrap();
    let mut workspace = robot.dynamics_workspace();
    let gravity = nalgebra::Vector3::new(0.0, 0.0, -common::GRAVITY);
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut sequence = |s: u32| -> Rows {
        let mut row = |k: u32| {
            let t = f64::from(k) / RATE;
            let phase = |j: usize| (0.15 + 0.07 * j as f64) * TAU * t + f64::from(s) + j as f64;
            let pace = |j: usize| (0.15 + 0.07 * j as f64) * TAU;
            let q = [0, 1, 2].map(|j| 0.2 + 0.6 * phase(j).sin());
            let qd = [0, 1, 2].map(|j| 0.6 * pace(j) * phase(j).cos());
            let qdd = [0, 1, 2].map(|j| -0.6 * pace(j).powi(2) * phase(j).sin());
            let rigid = robot
                .inverse_dynamics(&q, &qd, &qdd, &gravity, &mut workspace)
                .unwrap();
            let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
            let tau = felt(s, [rigid[0], rigid[1], rigid[2]], qd);
            (q.to_vec(), tau.map(|t| t + 0.02 * noise()).to_vec())
        };
        (0..800).map(&mut row).collect()
    };
    free_arm(&[0, 1, 2, 3].map(&mut sequence))
}

/// With inertias in doubt, a gain of one joint of a planar arm is as well another mass.
fn named_in_air(campaign: &Campaign) -> vsf_gap::Diagnosis {
    let free: Vec<_> = (effects::catalogue().into_iter())
        .filter(|e| e.acts() == Acts::Torques && e.name() != "inertial_error")
        .collect();
    let outcome = diagnose(campaign, &free, 0, |_| {}).unwrap();
    outcome.diagnosis
}

/// Before friction is known, roughness of joints has its place; weights that allow for that see reversals alone, and a fit by
/// them was many deviations off.
#[test]
fn val_parameters_in_air_are_as_certain_as_they_are_said_to_be() {
    let size = [1.5, 2.0, 0.4];
    let dry = effects::named(&["joint_coulomb_friction".to_owned()]).unwrap();
    let mut squares = Vec::new();
    for seed in 1..=8 {
        let campaign = swinging_with_noise(seed, |tau, qd| {
            [0, 1, 2].map(|j| tau[j] + size[j] * (qd[j] / 0.05).tanh())
        });
        let d = diagnose(&campaign, &dry, 0, |_| {}).unwrap().diagnosis;
        for p in &d.effects[0].parameters {
            let truth = match p.name.split_once('_') {
                Some(("c", joint)) => size[joint.parse::<usize>().unwrap() - 1],
                Some(_) => 0.0,
                None => 0.05,
            };
            let off = (p.value - truth) / p.sd;
            assert!(off.abs() < 4.0, "{} {} ± {}", p.name, p.value, p.sd);
            if p.name.starts_with("c_") {
                squares.push(off * off);
            }
        }
    }
    // Nor less certain: of 24, one in a hundred would be beyond.
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!((0.4..1.8).contains(&mean), "{mean}");
}

/// Alone, the bias takes the mean of what the gain adds: with the gain beside it, it has to give that back.
#[test]
fn a_gain_beside_a_bias_is_named() {
    let d = named_in_air(&swinging(|tau, _| [1.1 * tau[0], tau[1] + 0.3, tau[2]]));
    let mut named = d.verdict.effects.clone();
    named.sort();
    assert_eq!(named, ["torque_bias", "torque_gain"], "{:?}", d.verdict);
    assert_eq!(d.verdict.kind, VerdictKind::Effects);
    let of = |effect: &str, name: &str| {
        let own = d.effects.iter().find(|e| e.effect == effect).unwrap();
        own.parameters
            .iter()
            .find(|p| p.name == name)
            .unwrap()
            .value
    };
    let (g, b) = (of("torque_gain", "g_1"), of("torque_bias", "b_2"));
    assert!((g - 0.1).abs() < 0.02 && (b - 0.3).abs() < 0.03, "{g} {b}");
}

/// However clear a constant is in the train sequences, the test sequence has one of the other sign.
#[test]
fn what_all_sequences_together_do_not_bear_out_is_not_named() {
    let campaign = swinging_in_sequences(7, |s, tau, _| {
        let bias = if s < 3 { 0.05 } else { -0.075 };
        [tau[0], tau[1] + bias, tau[2]]
    });
    assert_eq!((campaign.train().len(), campaign.test().len()), (3, 1));
    let bias = effects::named(&["torque_bias"]).unwrap();
    let outcome = diagnose(&campaign, &bias, 0, |_| {}).unwrap();
    let d = &outcome.diagnosis;
    assert!(d.verdict.effects.is_empty(), "{:?}", d.verdict);
    assert_eq!(d.verdict.effect_set_95, ["torque_bias"]);
    let bias = &d.effects[0];
    assert!(
        bias.score > 100.0 && bias.test_score < Some(-100.0),
        "{bias:?}"
    );
    let aside = "left aside, since the test sequences do not bear them out";
    assert!(
        d.notes.iter().any(|n| n.starts_with(aside)),
        "{:?}",
        d.notes
    );
}

/// Any two of them leave much, and bend to explain it.
#[test]
fn three_effects_beside_contact_are_named() {
    let truth = [
        "joint_coulomb_friction",
        "joint_viscous_friction",
        "payload",
    ];
    let d = diagnosed(&truth, 100).diagnosis;
    let mut named = d.verdict.effects.clone();
    named.sort();
    assert_eq!(named, truth, "{:?}", d.verdict);
    assert!(d.gap.closed_fraction > 0.95, "{:?}", d.gap);
}

/// Friction that is larger one way takes some of a constant, which is small beside it.
#[test]
fn a_bias_beside_friction_is_named() {
    let friction = |v: f64| (v / 0.01).tanh();
    let d = named_in_air(&swinging(|tau, v| {
        [
            tau[0] + friction(v[0]),
            tau[1] + 0.5 * friction(v[1]),
            tau[2] + 0.2 * friction(v[2]) + 0.3,
        ]
    }));
    assert!(
        d.verdict.effects.iter().any(|e| e == "torque_bias"),
        "{:?}",
        d.verdict
    );
    assert!(
        d.gap.test_error_corrected < 1.5 * d.gap.noise_floor,
        "{:?}",
        d.gap
    );
}

/// Joints that move slowly, mostly one way: dry coupling of one pair out of 42 imitates a bias.
#[test]
fn a_bias_of_one_joint_of_many_is_no_coupling() {
    let robot = vsf_robots::kinova_gen3().unwrap();
    let mut workspace = robot.dynamics_workspace();
    let gravity = nalgebra::Vector3::new(0.0, 0.0, -common::GRAVITY);
    let mut right = 0;
    for seed in 0..4 {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let mut sequence = |s: u32| {
            let pace = |j: usize| 0.02 + 0.08 * f64::from((7 * s + 3 * j as u32) % 11) / 11.0;
            let time: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k)).collect();
            let (mut angles, mut torques) = (Vec::new(), Vec::new());
            for t in &time {
                let phase = |j: usize| pace(j) * t + f64::from(s) + 2.0 * j as f64;
                let q: Vec<f64> = (0..7).map(|j| 0.5 * phase(j).sin()).collect();
                let hold = robot.gravity_torques(&q, &gravity, &mut workspace).unwrap();
                let bias = |j: usize| if j == 0 { 0.5 } else { 0.0 };
                let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
                let read = hold
                    .iter()
                    .enumerate()
                    .map(|(j, h)| h + bias(j) + 0.05 * noise());
                torques.extend(read);
                angles.extend(q);
            }
            let [angles, torques] = [angles, torques].map(|rows| Table::new(7, rows).unwrap());
            Sequence::new(s.to_string(), time, angles, torques)
        };
        let robot = RobotRef::resolve("kinova_gen3", ".".as_ref()).unwrap();
        let mut dataset = Dataset {
            torque_kind: TorqueKind::Measured,
            ..Dataset::new(robot, (0..4).map(&mut sequence).collect())
        };
        dataset.splits.test = dataset.splits.train.split_off(3);
        let d = named_in_air(&Campaign::open(&dataset, &SceneOptions::default()).unwrap());
        right += usize::from(d.verdict.effects == ["torque_bias"]);
        let bias = d
            .effects
            .iter()
            .find(|e| e.effect == "torque_bias")
            .unwrap();
        assert!(bias.probability > 0.3, "{:?}", d.verdict);
    }
    assert!(right >= 3, "{right} of 4");
}

/// Any two or three of them leave much.
#[test]
fn four_effects_in_free_air_are_named() {
    let d = named_in_air(&swinging(|tau, v| {
        [
            1.15 * tau[0] + (v[0] / 0.01).tanh() + 1.5 * v[0],
            tau[1] + 0.5 * (v[1] / 0.01).tanh() + v[1],
            tau[2] + 0.2 * (v[2] / 0.01).tanh() + 0.4 * v[2] + 0.5,
        ]
    }));
    let mut named = d.verdict.effects.clone();
    named.sort();
    let truth = [
        "joint_coulomb_friction",
        "joint_viscous_friction",
        "torque_bias",
        "torque_gain",
    ];
    assert_eq!(named, truth, "{:?}", d.verdict);
    let (error, floor) = (d.gap.test_error_corrected, d.gap.noise_floor);
    assert!(error < 1.1 * floor, "{error} {floor}");
}

/// A tendon of the third joint that passes the first: of all pairs of joints, that one alone is in the model.
#[test]
fn a_joint_that_drags_a_distant_one_is_named_with_it() {
    let d = named_in_air(&swinging(|tau, v| [tau[0] + 0.4 * v[2], tau[1], tau[2]]));
    assert_eq!(d.verdict.effects, ["joint_coupling"], "{:?}", d.verdict);
    let coupling = d.effects.iter().find(|e| e.effect == "joint_coupling");
    let parameters = &coupling.unwrap().parameters;
    let names: Vec<_> = parameters.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(names, ["c_1_3", "d_1_3", "i_1_3", "eps"]);
    let viscous = &parameters[1];
    assert!((viscous.value - 0.4).abs() < 0.02, "{viscous:?}");
}

/// The size from which on a parameter shows.
fn shows_from(d: &vsf_gap::Diagnosis, effect: &str, name: &str) -> f64 {
    let of = d.effects.iter().find(|e| e.effect == effect).unwrap();
    let limit = of.shows_from.iter().find(|l| l.name == name).unwrap();
    limit.value.unwrap()
}

/// Well below it nothing is named, well above it is.
#[test]
fn effects_show_from_the_stated_size_on() {
    let few = [
        "torque_bias",
        "torque_gain",
        "joint_coulomb_friction",
        "joint_viscous_friction",
        "latency",
    ];
    let few = effects::named(&few).unwrap();
    let diagnosed = |felt: &dyn Fn([f64; 3], [f64; 3]) -> [f64; 3]| {
        let outcome = diagnose(&swinging(felt), &few, 0, |_| {}).unwrap();
        outcome.diagnosis
    };
    let quiet = diagnosed(&|tau, _| tau);
    assert_eq!(
        quiet.verdict.kind,
        VerdictKind::NoGap,
        "{:?}",
        quiet.verdict
    );
    let bias = shows_from(&quiet, "torque_bias", "b_2");
    let viscous = shows_from(&quiet, "joint_viscous_friction", "d_1");
    let gain = shows_from(&quiet, "torque_gain", "g_3");
    for (effect, size) in [
        ("torque_bias", [0.0, bias, 0.0]),
        ("joint_viscous_friction", [viscous, 0.0, 0.0]),
        ("torque_gain", [0.0, 0.0, gain]),
    ] {
        for times in [0.6, 1.4] {
            let [v, b, g] = size.map(|size| times * size);
            let felt =
                |tau: [f64; 3], qd: [f64; 3]| [tau[0] + v * qd[0], tau[1] + b, (1.0 + g) * tau[2]];
            let d = diagnosed(&felt);
            let expected: &[&str] = if times > 1.0 { &[effect] } else { &[] };
            assert_eq!(d.verdict.effects, expected, "{times} {size:?}");
        }
    }
}

/// At that size, 4 times of 5.
#[test]
fn effects_of_the_stated_size_are_named_most_of_the_time() {
    let bias = effects::named(&["torque_bias"]).unwrap();
    let diagnosed = |seed: u64, by: f64| {
        let campaign = swinging_with_noise(seed, |tau, _| [tau[0], tau[1] + by, tau[2]]);
        let outcome = diagnose(&campaign, &bias, 0, |_| {}).unwrap();
        outcome.diagnosis
    };
    let named: Vec<bool> = (100..112)
        .map(|seed| {
            let size = shows_from(&diagnosed(seed, 0.0), "torque_bias", "b_2");
            !diagnosed(seed, size).verdict.effects.is_empty()
        })
        .collect();
    let count = named.iter().filter(|n| **n).count();
    assert!((8..=12).contains(&count), "{named:?}");
}

/// Beside a field, too.
#[test]
fn effects_in_contact_show_from_the_stated_size_on() {
    let dataset = quiet();
    let few = effects::named(&["torque_bias", "viscoelastic"]).unwrap();
    let biased = |by: f64| {
        let mut dataset = dataset.clone();
        for sequence in &mut dataset.sequences {
            let joints = sequence.torques.cols();
            let torques = sequence.torques.data_mut().iter_mut();
            torques.skip(2).step_by(joints).for_each(|t| *t += by);
        }
        let campaign = opened(&dataset);
        let outcome = diagnose(&campaign, &few, 0, |_| {}).unwrap();
        outcome.diagnosis
    };
    let size = shows_from(&biased(0.0), "torque_bias", "b_3");
    assert!(biased(0.6 * size).verdict.effects.is_empty());
    assert_eq!(biased(1.4 * size).verdict.effects, ["torque_bias"]);
}

/// The gain that would turn them round is none that a sensor has.
#[test]
fn actuators_of_the_wrong_sign_are_unknown() {
    let d = named_in_air(&swinging(|tau, _| tau.map(|t| -t)));
    assert_eq!(d.verdict.kind, VerdictKind::Unknown, "{:?}", d.verdict);
    assert!(d.notes.iter().any(|n| n.contains("bound")), "{:?}", d.notes);
    let of_named = |e: &&vsf_gap::EffectReport| d.verdict.effects.contains(&e.effect);
    assert!((d.effects.iter().filter(of_named)).any(|e| !e.at_bound.is_empty()));
}

/// Noise in place of torques: gains that take them to next to nothing close all of the gap.
#[test]
fn readings_of_no_torques_are_unknown() {
    let rng = RefCell::new(Pcg64Mcg::seed_from_u64(11));
    let noise = || -> f64 { StandardNormal.sample(&mut *rng.borrow_mut()) };
    let d = named_in_air(&swinging(|_, _| [0, 1, 2].map(|_| noise())));
    assert_eq!(d.verdict.kind, VerdictKind::Unknown, "{:?}", d.verdict);
    assert!(d.gap.closed_fraction > 0.9, "{}", d.gap.closed_fraction);
    let said = d.notes.iter().any(|n| n.contains("predicting zero torque"));
    assert!(said, "{:?}", d.notes);
}

/// Gains that drift with the warmth of the arm are none of one size: what those leave lasts.
#[test]
fn what_a_named_effect_leaves_is_white_or_something_else_acts() {
    let few = effects::named(&["torque_gain", "viscoelastic"]).unwrap();
    for (cause, kind) in [
        ("torque_gain", VerdictKind::Effects),
        ("thermal_gain", VerdictKind::Unknown),
    ] {
        let campaign = made(&[cause], 41034);
        let outcome = diagnose(&campaign, &few, 0, |_| {}).unwrap();
        let d = outcome.diagnosis;
        assert_eq!(d.verdict.effects, ["torque_gain"], "{cause}");
        assert_eq!(d.verdict.kind, kind, "{cause}");
        let said = (d.notes.iter()).any(|n| n.contains("something else acts"));
        assert_eq!(said, kind == VerdictKind::Unknown, "{:?}", d.notes);
    }
}

/// A sensor that is knocked off before the test sequences: nothing that was fitted can know. What the tare
/// of noisy sensors is off by is no such thing.
#[test]
fn what_is_left_in_free_motion_is_unknown() {
    let mut dataset = quiet();
    let few = effects::named(&["torque_bias", "viscoelastic"]).unwrap();
    let verdict = |dataset: &Dataset| {
        let campaign = opened(dataset);
        let outcome = diagnose(&campaign, &few, 0, |_| {}).unwrap();
        (outcome.diagnosis.verdict.kind, outcome.diagnosis.notes)
    };
    dataset.tare_samples = 10;
    assert_eq!(verdict(&dataset).0, VerdictKind::NoGap);

    dataset.tare_samples = 0;
    let test = dataset.splits.test.clone();
    for sequence in &mut dataset.sequences {
        if test.contains(&sequence.id) {
            let joints = sequence.torques.cols();
            let torques = sequence.torques.data_mut().iter_mut();
            torques.skip(1).step_by(joints).for_each(|t| *t += 0.4);
        }
    }
    let (kind, notes) = verdict(&dataset);
    assert_eq!(kind, VerdictKind::Unknown);
    let said = "in free motion of the test sequences an error of ";
    let left = notes[0].strip_prefix(said).unwrap().split(' ').next();
    let left: f64 = left.unwrap().parse().unwrap();
    assert!((left - 0.4).abs() < 0.01, "{left}");
}

/// The mean of a few noisy samples is no exact zero: taking it for one looked like a drift.
#[test]
fn what_a_tare_leaves_is_no_drift() {
    let mut dataset = quiet();
    dataset.tare_samples = 4;
    let campaign = opened(&dataset);
    let drifts = effects::named(&["torque_drift", "torque_bias"].map(str::to_owned)).unwrap();
    let d = diagnose(&campaign, &drifts, 0, |_| {}).unwrap().diagnosis;
    assert_eq!(d.verdict.kind, VerdictKind::NoGap);
    for effect in &d.effects {
        assert!(
            effect.score < 5.0,
            "{}: {} nats",
            effect.effect,
            effect.score
        );
    }
}

/// Sensors that are zeroed before every sequence, drift anew and wander.
#[test]
fn a_drift_that_begins_anew_and_wanders_is_a_drift() {
    const RATES: [f64; 7] = [0.05, -0.15, 0.13, 0.1, -0.03, 0.03, 0.01];
    const WANDERS: f64 = 0.25;
    let mut dataset = quiet();
    let mut rng = Pcg64Mcg::seed_from_u64(3);
    for sequence in &mut dataset.sequences {
        let time = sequence.time.clone();
        let length = time[time.len() - 1] - time[0];
        let mut walk = [0.0; RATES.len()];
        for (row, t) in time.iter().enumerate() {
            let dt = if row > 0 { t - time[row - 1] } else { 0.0 };
            for (j, rate) in RATES.iter().enumerate() {
                let step: f64 = StandardNormal.sample(&mut rng);
                walk[j] += WANDERS * rate * (length * dt).sqrt() * step;
                sequence.torques.data_mut()[row * RATES.len() + j] +=
                    rate * (t - time[0]) + walk[j];
            }
        }
    }
    let campaign = opened(&dataset);
    let few = effects::named(&["torque_drift", "torque_bias", "viscoelastic"]).unwrap();
    let outcome = diagnose(&campaign, &few, 0, |_| {}).unwrap();
    let d = &outcome.diagnosis;
    assert_eq!(d.verdict.kind, VerdictKind::Effects, "{:?}", d.notes);
    assert_eq!(d.verdict.effects, ["torque_drift"]);
    for (j, rate) in RATES.iter().enumerate() {
        let name = format!("s_{}", j + 1);
        let found = (d.effects[0].parameters.iter()).find(|p| p.name == name);
        let found = found.unwrap();
        // The walks of four sequences shift their mean by 0.13 of the rate.
        let off = (found.value - rate).abs();
        assert!(off < 0.4 * rate.abs(), "{name}: {} of {rate}", found.value);
        assert!(off < 3.0 * found.sd, "{name}: {} of {rate}", found.value);
    }
}

/// An object that lies elsewhere in every sequence shows where sequences touch the same places, the test
/// sequences among them.
#[test]
fn an_object_that_is_put_back_elsewhere_shows_on_halves_of_the_test_sequences() {
    let (_folder, dataset) = recorded(&["registration_offset"], 48);
    // Points alone are quicker, and are as far off.
    let options = SceneOptions {
        subdivision: 1,
        ..SceneOptions::default()
    };
    let campaign = Campaign::open(&dataset, &options).unwrap();
    let registration = effects::named(&["registration_offset"]).unwrap();
    let outcome = diagnose(&campaign, &registration, 0, |_| {}).unwrap();
    let d = &outcome.diagnosis;
    assert_eq!(d.verdict.kind, VerdictKind::Effects);
    assert_eq!(d.verdict.effects, ["registration_offset"]);
    assert!(d.gap.closed_fraction > 0.5 && d.gap.closed_interval[0] > 0.0);
    assert!(d.notes.iter().any(|n| n.contains("second halves")));
    let of_checked = outcome.checked.iter().zip(&outcome.nominal.rows);
    for (motion, residuals) in of_checked {
        assert!(motion.len() < 700 && residuals.len() == 7 * motion.len());
    }
    assert_eq!(d.location.sequence.len(), 6);
}

#[test]
fn shares_are_shares_and_the_same_seed_gives_the_same_diagnosis() {
    let campaign = made(&["joint_viscous_friction"], 43);
    let bias: Vec<Arc<dyn Effect>> = effects::named(&[
        "joint_viscous_friction".to_owned(),
        "torque_bias".to_owned(),
    ])
    .unwrap();
    let run = || diagnose(&campaign, &bias, 7, |_| {}).unwrap().diagnosis;
    let d = run();
    assert_eq!(d.verdict.effects, ["joint_viscous_friction"]);
    for parts in [&d.location.joint, &d.location.phase, &d.location.sequence] {
        let sum: f64 = parts.iter().map(|p| p.share).sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
        let inside = |p: &vsf_gap::LocatedShare| p.interval[0] <= p.interval[1] && p.excess >= 0.0;
        assert!(parts.iter().all(inside));
    }
    let json = serde_json::to_string(&d).unwrap();
    let one = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    assert_eq!(json, serde_json::to_string(&one.install(run)).unwrap());
}
