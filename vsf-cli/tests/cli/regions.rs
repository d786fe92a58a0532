//! `vsf regions` on small fields.

use crate::common::{Bench, npy};
use serde_json::Value;
use std::fs;

fn json(bench: &Bench, line: &str) -> Value {
    serde_json::from_str(&bench.ok(&format!("{line} --json"))).unwrap()
}

/// An end of the block that is three times as stiff, 48 of 160 points.
#[test]
fn val_the_stiff_side_is_one_region() {
    let bench = Bench::new();
    let stiffness: Vec<f64> = (0..160)
        .map(|i| if i < 112 { 30.0 } else { 90.0 })
        .collect();
    npy(&bench.root.join("truth/K.npy"), &[160], &stiffness);
    let found = json(&bench, "regions truth");
    let of = |key: &str| found[key].as_f64().unwrap();
    assert_eq!((of("background"), of("stiff_from")), (30.0, 60.0));
    assert_eq!((of("points"), of("scattered")), (160.0, 0.0));
    let regions = found["regions"].as_array().unwrap();
    assert_eq!(regions.len(), 1);
    assert_eq!(regions[0]["points"].as_array().unwrap().len(), 48);
    let numbers = |value: &Value| -> Vec<f64> {
        value
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap())
            .collect()
    };
    for (found, expected) in numbers(&regions[0]["center"])
        .into_iter()
        .zip([0.032, 0.014, -0.002])
    {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    assert_eq!(numbers(&regions[0]["bounds"][0]), [0.028, 0.0, -0.004]);
    assert!((regions[0]["times_background"].as_f64().unwrap() - 3.0).abs() < 1e-12);
    let warning = bench.warned("regions truth");
    assert!(warning.contains("without K_std"), "{warning}");
    let text = bench.ok("regions truth --contrast 3");
    assert!(text.contains("no region is that stiff"), "{text}");
}

/// Of an estimate, touched points alone count, with their deviations.
#[test]
fn an_estimate_says_what_was_touched_and_how_sure_it_is() {
    let bench = Bench::touched();
    bench.ok("estimate touch --out field.npz");
    let text = bench.ok("regions field.npz --contrast 1.3 --confidence 0.6");
    let found = json(&bench, "regions field.npz --contrast 1.3 --confidence 0.6");
    let touched = found["points"].as_u64().unwrap();
    assert!((1..160).contains(&touched));
    assert!(
        text.contains(&format!("{touched} touched points")),
        "{text}"
    );
    let center = found["regions"][0]["center"][0].as_f64().unwrap();
    assert!(center > 0.018, "{text}");
    // No point of it is that certain, which is no finding that there is none.
    let line = "regions field.npz --contrast 1.3 --confidence 0.999999999";
    let sure = json(&bench, line);
    assert_eq!(sure["regions"].as_array().unwrap().len(), 0);
    let unsure = sure["unsure"].as_array().unwrap().len();
    let text = bench.ok(line);
    assert!(
        unsure > 0 && text.contains(&format!("but less surely: {unsure} (")),
        "{text}"
    );
}

#[test]
fn what_cannot_be_is_refused() {
    let bench = Bench::new();
    bench.fails("regions data", 1, &["data is a recording", "vsf estimate"]);
    bench.fails("regions nothing.npz", 1, &["nothing.npz"]);
    for (flag, value) in [
        ("--contrast", "0"),
        ("--contrast", "nan"),
        ("--confidence", "1"),
        ("--confidence", "0.4"),
        ("--reach", "-1"),
        ("--fewest", "0"),
    ] {
        bench.fails(&format!("regions truth {flag} {value}"), 2, &[flag]);
    }
    // Points that all lie in one place.
    let folder = bench.root.join("heap");
    fs::create_dir(&folder).unwrap();
    npy(&folder.join("points.npy"), &[5, 3], &[0.1; 15]);
    npy(&folder.join("K.npy"), &[5], &[2.0; 5]);
    let text = bench.ok("regions heap --contrast 0.5");
    assert!(text.contains("0.100"), "{text}");
    npy(&folder.join("K.npy"), &[5], &[0.0; 5]);
    let warning = bench.warned("regions heap");
    assert!(warning.contains("no background"), "{warning}");
}
