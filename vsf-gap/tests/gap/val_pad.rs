//! A pad that is poked from above: the force is a stiffness that grows along x times the depth, along the normal alone.
//! No sensor, joint or contact of the catalogue has a part in it, and no springs of points give it exactly.

use nalgebra::Point3;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use vsf_data::{Dataset, RobotRef, Sequence, Splits, Table};
use vsf_gap::{Campaign, Diagnosis, VerdictKind, diagnose, effects};
use vsf_pipeline::{SceneOptions, reading_warnings};

/// Spacing of the points, the depth that pokes go to, and the noise (m, N).
const SPACING: f64 = 0.004;
const DEPTH: f64 = 0.004;
const NOISE: f64 = 0.01;

/// From 5 mm above down to the depth, a while there, and back.
fn heights() -> Vec<f64> {
    const ABOVE: f64 = 0.005;
    const STEPS: usize = 60;
    let down = (0..STEPS).map(|k| ABOVE - (ABOVE + DEPTH) * k as f64 / (STEPS - 1) as f64);
    let down: Vec<f64> = down.collect();
    let still = vec![-DEPTH; 12];
    let up: Vec<f64> = down.iter().rev().copied().collect();
    [vec![ABOVE; 16], down, still, up].concat()
}

/// Pokes at places (m); the last one tests.
fn pad(places: &[[f64; 2]]) -> Dataset {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let mut noise = || {
        let sample: f64 = StandardNormal.sample(&mut random);
        NOISE * sample
    };
    let poke = |(id, [x, y]): (usize, &[f64; 2])| {
        let heights = heights();
        let stiffness = 300.0 * (1.0 + 40.0 * (x + 0.012));
        let (mut angles, mut forces) = (Vec::new(), Vec::new());
        for z in &heights {
            angles.extend([*x, *y, *z]);
            let force = stiffness * (-z).max(0.0);
            forces.extend([noise(), noise(), force + noise()]);
        }
        let time = (0..heights.len()).map(|k| 0.025 * k as f64).collect();
        let table = |data| Table::new(3, data).unwrap();
        Sequence::new(id.to_string(), time, table(angles), table(forces))
    };
    let sequences: Vec<Sequence> = places.iter().enumerate().map(poke).collect();
    let across = (0..11).map(|i| -0.02 + SPACING * f64::from(i));
    let layers = || (0..4).map(|i| -SPACING * f64::from(i));
    let column = |(x, y): (f64, f64)| layers().map(move |z| Point3::new(x, y, z));
    let points = across
        .clone()
        .flat_map(|x| across.clone().map(move |y| (x, y)))
        .flat_map(column);
    let ids: Vec<String> = sequences.iter().map(|s| s.id.clone()).collect();
    let (test, train) = ids.split_last().unwrap();
    let robot = RobotRef::resolve("cartesian_stage", ".".as_ref()).unwrap();
    Dataset {
        rest_points: Some(points.collect()),
        splits: Splits {
            train: train.to_vec(),
            test: vec![test.clone()],
        },
        ..Dataset::new(robot, sequences)
    }
}

const PLACES: [[f64; 2]; 6] = [
    [-0.012, -0.012],
    [-0.012, 0.012],
    [0.0, 0.0],
    [0.012, -0.012],
    [0.012, 0.012],
    [0.006, 0.0],
];

/// Readings that press one way only have their columns in order.
#[test]
fn no_other_order_of_columns_is_told() {
    let dataset = pad(&PLACES);
    let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
    let scene = campaign.scene();
    let traces: Vec<_> = (dataset.sequences.iter())
        .map(|s| scene.trace(s).unwrap())
        .collect();
    let sequences: Vec<&Sequence> = dataset.sequences.iter().collect();
    let warnings = reading_warnings(scene, &sequences, &traces);
    assert!(warnings.is_empty(), "{warnings:?}");
}

/// An effect of contact that another contact threshold explains as well is no cause.
#[test]
fn from_where_on_points_are_touched_is_no_cause() {
    let few = ["contact_friction", "encoder_offset", "latency"].map(str::to_owned);
    let few = effects::named(&few).unwrap();
    let of = |campaign: Campaign| diagnose(&campaign, &few, 0, |_| {}).unwrap();
    let campaign = Campaign::open(&pad(&PLACES), &SceneOptions::default()).unwrap();
    let own = of(campaign.clone()).diagnosis;
    assert_eq!(own.verdict.kind, VerdictKind::Effects, "{:?}", own.verdict);
    let outcome = of(campaign.with_suited_fields());
    let suited = outcome.campaign.scene().contact().threshold;
    assert!((suited - 0.8 * SPACING).abs() < 1e-12, "{suited}");
    let found = outcome.diagnosis;
    assert!(found.verdict.effects.is_empty(), "{:?}", found.verdict);
    assert!(found.gap.threshold == Some(suited) && found.gap.threshold_nominal == Some(suited));
    let told = &found.notes[0];
    assert!(
        told.contains("without any effect, contact_friction") && told.contains("3.200 mm"),
        "{told}"
    );
    assert_eq!(found.verdict.or_threshold, own.verdict.effects);
    for report in &found.effects {
        let open = found.verdict.or_threshold.contains(&report.effect);
        assert!(!open || report.shows_from.is_empty(), "{}", report.effect);
    }
}

/// So does an onset that a padding finds, with which nothing else is to be told from that padding.
#[test]
fn an_onset_that_a_padding_finds_is_no_cause() {
    let few = ["contact_friction", "geometry_padding"].map(str::to_owned);
    let few = effects::named(&few).unwrap();
    let campaign = Campaign::open(&pad(&PLACES), &SceneOptions::default()).unwrap();
    let given = diagnose(&campaign, &few, 0, |_| {}).unwrap();
    assert_eq!(given.campaign.scene().contact(), campaign.scene().contact());
    let free = campaign.clone().with_suited_fields();
    let outcome = diagnose(&free, &few, 0, |_| {}).unwrap();
    let found = outcome.diagnosis;
    assert!(found.verdict.effects.is_empty(), "{:?}", found.verdict);
    let [own, chosen] = [&campaign, &outcome.campaign].map(|c| c.scene().contact().threshold);
    assert!(own < chosen, "{own} {chosen}");
    assert_eq!(found.gap.threshold, Some(chosen));
    let told = |n: &String| n.contains("without any effect, contact_friction");
    assert!(found.notes.iter().any(told), "{:?}", found.notes);
    let set = &found.verdict.effect_set_95;
    assert!(set.iter().any(|e| e == "contact_friction"), "{set:?}");
}

/// What that onset is worth is asked beside the causes that are named beside the padding: without them, they hide most of it.
#[test]
fn an_onset_is_compared_beside_other_causes() {
    let mut dataset = pad(&PLACES);
    for sequence in &mut dataset.sequences {
        // Dry friction along z.
        let rows = sequence.angles.data().chunks_exact(3);
        let heights: Vec<f64> = rows.map(|row| row[2]).collect();
        let last = heights.len() - 1;
        for row in 0..=last {
            let rise = heights[(row + 1).min(last)] - heights[row.saturating_sub(1)];
            if rise.abs() > 1e-9 {
                sequence.torques.data_mut()[3 * row + 2] -= 0.6 * rise.signum();
            }
        }
    }
    let few = ["joint_coulomb_friction", "geometry_padding"].map(str::to_owned);
    let few = effects::named(&few).unwrap();
    let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
    let found = diagnose(&campaign.with_suited_fields(), &few, 0, |_| {}).unwrap();
    let Diagnosis { verdict, notes, .. } = found.diagnosis;
    assert_eq!(verdict.effects, ["joint_coulomb_friction"]);
    let told = notes
        .iter()
        .find(|n| n.contains("3.200 mm instead of 2.000"));
    let (of_threshold, of_padding) = told
        .unwrap()
        .split_once("nats beside joint_coulomb_friction,")
        .unwrap();
    let nats = |text: &str| -> f64 {
        let mut words = text.split([' ', '.']).skip_while(|w| *w != "by").skip(1);
        words.next().unwrap().parse().unwrap()
    };
    let (of_threshold, of_padding) = (nats(of_threshold), nats(of_padding));
    assert!(of_threshold > of_padding, "{of_threshold} {of_padding}");
}

/// No spring pulls, so that nothing is left for effects of the object's place to change: the cause is unknown, and not that
/// there is too little to tell.
#[test]
fn springs_that_pull_are_unknown() {
    let mut dataset = pad(&PLACES);
    for sequence in &mut dataset.sequences {
        let torques = sequence.torques.data_mut().iter_mut();
        torques.for_each(|t| *t = -*t);
    }
    let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
    let few = ["torque_bias", "registration_offset"].map(str::to_owned);
    let few = effects::named(&few).unwrap();
    let Diagnosis { verdict, notes, .. } = diagnose(&campaign, &few, 0, |_| {}).unwrap().diagnosis;
    assert_eq!(verdict.kind, VerdictKind::Unknown, "{verdict:?}");
    assert!(verdict.effects.is_empty(), "{verdict:?}");
    let told = |n: &String| n.contains("opposite to what springs give") && n.contains("sign");
    assert!(notes.iter().any(told), "{notes:?}");

    // What acts beside, and shows in the air, is named all the same, and is not all.
    for sequence in &mut dataset.sequences {
        let rows = sequence.torques.data_mut().chunks_exact_mut(3);
        rows.for_each(|row| row[2] += 1.0);
    }
    let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
    let Diagnosis { verdict, notes, .. } =
        diagnose(&campaign, &few[..1], 0, |_| {}).unwrap().diagnosis;
    assert_eq!(verdict.kind, VerdictKind::Unknown, "{verdict:?}");
    assert_eq!(verdict.effects, ["torque_bias"]);
    let told = |n: &String| n.contains("remains with torque_bias is opposite");
    assert!(notes.iter().any(told), "{notes:?}");
}

/// Where a wrong pose leaves nothing touched, what takes some of the forces is no known cause.
#[test]
fn what_is_felt_out_of_reach_of_the_points_is_unknown() {
    let mut dataset = pad(&PLACES);
    dataset.base_pose.translation.z += 0.1;
    let few = ["joint_elasticity", "torque_bias", "joint_coulomb_friction"].map(str::to_owned);
    let few = effects::named(&few).unwrap();
    let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
    let Diagnosis { verdict, notes, .. } = diagnose(&campaign, &few, 0, |_| {}).unwrap().diagnosis;
    assert_eq!(verdict.kind, VerdictKind::Unknown, "{verdict:?}");
    let told = |n: &String| n.contains("touch no point") && n.contains("base_pose");
    assert!(notes.iter().any(told), "{notes:?}");
}
