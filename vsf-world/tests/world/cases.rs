//! Recordings and labels of whole cases.

use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use vsf_data::{Dataset, Overrides};
use vsf_world::{
    CaseSpec, Class, EFFECTS, JOINTS, Kind, Label, Level, Phase, Protocol, SAMPLES, SEQUENCES,
    WorldError, draw_cases, generate,
};

fn spec(kind: Kind, effects: &[&str], seed: u64) -> CaseSpec {
    CaseSpec {
        kind,
        protocol: Protocol::Rich,
        effects: effects.iter().map(|e| (*e).to_owned()).collect(),
        level: Level::Clear,
        seed,
    }
}

fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.insert(
                path.to_string_lossy().into_owned(),
                std::fs::read(&path).unwrap(),
            );
        }
    }
    found
}

fn open(dir: &Path) -> Dataset {
    let (dataset, warnings) = Dataset::open(dir, &Overrides::default()).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    dataset
}

/// Noise of the torques: what remains when the noise-free ones are taken away.
fn noise(dataset: &Dataset, label: &Label) -> Vec<Vec<f64>> {
    let mut out = vec![Vec::new(); JOINTS];
    for (sequence, oracle) in dataset.sequences.iter().zip(&label.oracle) {
        for (row, truth) in sequence.torques.iter().zip(oracle) {
            for j in 0..JOINTS {
                out[j].push(row[j] - truth[j]);
            }
        }
    }
    out
}

#[test]
fn none_is_noise_alone_and_the_same_seed_gives_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path().join("r");
    let label = generate(&spec(Kind::Springs, &[], 11), &at).unwrap();
    let first = files(&at);
    assert_eq!(label, generate(&spec(Kind::Springs, &[], 11), &at).unwrap());
    assert!(first == files(&at), "same seed, other bytes");

    assert_eq!(label.class, Class::None);
    assert_eq!((label.ratio_test, label.diff_energy_train), (0.0, 0.0));
    let dataset = open(&at);
    assert_eq!(
        (dataset.sequences.len(), dataset.width()),
        (SEQUENCES, JOINTS)
    );
    assert!(dataset.sequences.iter().all(|s| s.len() == SAMPLES));
    assert_eq!(dataset.splits.test, ["004", "005"]);
    assert!(dataset.rest_points.as_ref().unwrap().len() > 3000);
    for column in noise(&dataset, &label) {
        let n = column.len() as f64;
        let var = column.iter().map(|x| x * x).sum::<f64>() / n;
        let lag = column.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n / var;
        // Five standard deviations: sd of a variance of 4200 samples is 2.2 % (more when
        // correlated), of a correlation 1.5 %.
        assert!((var.sqrt() / label.noise_nm - 1.0).abs() < 0.08, "{var}");
        assert!((lag - label.noise_ar1).abs() < 0.1, "{lag}");
    }
    // Nothing speaks of causes.
    for (path, bytes) in &first {
        let text = String::from_utf8_lossy(bytes);
        let hint = EFFECTS.iter().any(|e| path.contains(e) || text.contains(e));
        assert!(!hint && !text.contains("effect"), "{path}");
    }
}

#[test]
fn effects_change_the_torques_by_the_stated_share() {
    // One of the sensor, one of the arm, one of the angles, one of the matter, one of outside.
    let names = [
        "joint_load_friction",
        "joint_elasticity",
        "encoder_offset",
        "damage_softening",
        "cable_torque",
    ];
    names.par_iter().enumerate().for_each(|(i, name)| {
        let dir = tempfile::tempdir().unwrap();
        let label = generate(&spec(Kind::Springs, &[name], 20 + i as u64), dir.path()).unwrap();
        assert!(
            (0.2..=0.4).contains(&label.ratio_test),
            "{name}: {}",
            label.ratio_test
        );
        assert!((label.ratio_test / label.effects[0].ratio_alone - 1.0).abs() < 1e-9);
        assert_eq!(label.effects[0].effect.name(), *name);
        assert!(label.diff_energy_train > 0.0, "{name}");
        for sum in [
            label.truth_share.joint.iter().sum::<f64>(),
            label.truth_share.sequence.iter().sum(),
            label.truth_share.phase.values().sum(),
        ] {
            assert!((sum - 1.0).abs() < 1e-9, "{name}: {sum}");
        }
        // The difference is in the recording: its energy over train and test, noise on top.
        let (stated, samples) = (
            label.diff_energy_train + label.diff_energy_test,
            (SEQUENCES * SAMPLES * JOINTS) as f64,
        );
        let found: f64 = noise(&open(dir.path()), &label)
            .iter()
            .flatten()
            .map(|x| x * x)
            .sum();
        let expected = stated + samples * label.noise_nm.powi(2);
        assert!(
            (found / expected - 1.0).abs() < 0.05,
            "{name}: {found} {expected}"
        );
        let json = serde_json::to_string(&label).unwrap();
        assert_eq!(
            serde_json::from_str::<Label>(&json).unwrap().effects,
            label.effects
        );
    });
}

#[test]
fn plants_and_pairs_and_mere_pushes() {
    let dir = tempfile::tempdir().unwrap();
    let spec = CaseSpec {
        protocol: Protocol::PushOnly,
        level: Level::Subtle,
        ..spec(Kind::Plant, &["joint_load_friction", "payload"], 31)
    };
    let label = generate(&spec, dir.path()).unwrap();
    assert_eq!(label.class, Class::Pair);
    assert!(
        label
            .effects
            .iter()
            .all(|e| (0.1..=0.2).contains(&e.ratio_alone))
    );
    assert!(
        (0.1..0.4).contains(&label.ratio_test),
        "{}",
        label.ratio_test
    );
    assert_eq!(open(dir.path()).sequences.len(), SEQUENCES);
    let phases = |s: &Vec<(Phase, f64, f64)>| s.iter().map(|p| p.0).collect::<Vec<_>>();
    let pushed = [Phase::Approach, Phase::Load, Phase::Unload, Phase::Free];
    assert!(label.schedule.iter().all(|s| phases(s) == pushed));
}

#[test]
fn names_are_checked_before_anything_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path().join("r");
    let wrong = generate(&spec(Kind::Springs, &["gremlins"], 1), &at);
    assert!(matches!(wrong, Err(WorldError::UnknownEffect { .. })));
    let wrong = generate(&spec(Kind::Plant, &["spatial_coupling"], 1), &at);
    assert!(matches!(wrong, Err(WorldError::NotInThisWorld { .. })));
    assert!(!at.exists());
}

#[test]
fn draws_hold_the_stated_mix() {
    let cases = draw_cases(200, 3);
    let count = |class: Class| cases.iter().filter(|c| c.class() == class).count();
    assert_eq!(count(Class::None), 40);
    assert_eq!(count(Class::Single), 100);
    assert_eq!(count(Class::Pair), 30);
    assert_eq!(count(Class::Unknown), 30);
    for name in EFFECTS {
        let singles = cases.iter().filter(|c| c.effects == [name]).count();
        assert!((3..=4).contains(&singles), "{name}: {singles}");
    }
    let plants = cases.iter().filter(|c| c.kind == Kind::Plant).count();
    assert!((40..80).contains(&plants), "{plants}");
}
