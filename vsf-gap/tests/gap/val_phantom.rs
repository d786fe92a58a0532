//! A real silicone cylinder under a plate, pressed one way (Dawood et al., CC BY 4.0; see its SOURCE.md).
//! From outside: silicone stiffens; in place of one linear spring, a quintic one closes 0.91 to 0.96 of the
//! gap of four such phantoms, and free layers of springs imitate it.

use std::path::Path;
use vsf_data::{Dataset, Overrides};
use vsf_gap::{Campaign, Diagnosis, STIFFNESS_FIELD, VerdictKind, diagnose, effects};
use vsf_pipeline::SceneOptions;

fn diagnosis() -> Diagnosis {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/phantom_ef10_0t");
    let (dataset, _) = Dataset::open(&folder, &Overrides::default()).unwrap();
    let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
    // A plate of another thickness gains much on the layers, and explains next to nothing.
    let few = [
        "strain_stiffening",
        "geometry_padding",
        "torque_bias",
        "torque_drift",
    ];
    let few = effects::named(&few).unwrap();
    diagnose(&campaign, &few, 0, |_| {}).unwrap().diagnosis
}

#[test]
fn stiffening_is_not_told_from_a_field_that_grows_stiff_with_depth() {
    let d = diagnosis();
    assert_eq!(d.verdict.kind, VerdictKind::NotDiagnosable);
    assert_eq!(d.verdict.effects, ["strain_stiffening"]);
    assert!(
        d.verdict
            .effect_set_95
            .contains(&"strain_stiffening".to_owned())
    );
    assert!(d.gap.corrected_by.is_empty());
    let report = |name: &str| d.effects.iter().find(|e| e.effect == name).unwrap();
    let stiffening = report("strain_stiffening");
    assert_eq!(stiffening.ambiguous_with, [STIFFNESS_FIELD]);
    assert_eq!(stiffening.probability, 0.5);
    let note = (d.notes.iter())
        .find(|n| n.contains("strain_stiffening"))
        .unwrap();
    let words: Vec<&str> = note.split(' ').collect();
    let share: f64 = words[words.iter().position(|w| *w == "%").unwrap() - 1]
        .parse()
        .unwrap();
    assert!((91.0..=96.0).contains(&share), "{share}");
    // The press has one joint: from another side it comes to an object that is turned.
    assert!(d.next_experiment.action.contains("turn the object"));

    // The layers fit it to 3 % of what is measured, as well as a plain batch field does.
    assert!(
        d.gap.test_error_nominal < 0.035 * 90.13,
        "{}",
        d.gap.test_error_nominal
    );

    // A plate that touches from the first sample on never shows what its gauge reads free.
    for name in ["torque_bias", "torque_drift"] {
        assert!(!report(name).testable && report(name).reason.is_some());
    }
}
