//! `vsf diagnose`, and corrected models in the other commands, end to end on small recordings.

use crate::common;
use common::Bench;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// What the sensors read beyond the touch in [`biased`] [N].
const BIAS: [f64; 3] = [0.05, 0.0, -0.1];
const MODEL: &str = r#"{"schema": 1, "effects": [{"effect": "torque_bias", "parameters": [
    {"name": "b_1", "value": 0.05, "std": 0.001, "unit": "N"},
    {"name": "b_2", "value": 0, "std": 0.001, "unit": "N"},
    {"name": "b_3", "value": -0.1, "std": 0.001, "unit": "N"}]}]}"#;

/// The numbers of a file written by the command: a header, then f64.
fn numbers(path: &Path) -> Vec<f64> {
    let bytes = fs::read(path).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let number = |b: &[u8]| f64::from_le_bytes(b.try_into().unwrap());
    bytes[start..].chunks_exact(8).map(number).collect()
}

/// Samples of a sequence.
const ROWS: usize = 160;

/// A block that is approached, pressed and left, and whose sensors have a bias; `touch/` has it,
/// `data/` and `truth/` have not.
fn biased() -> Bench {
    let bench = Bench::new();
    for (id, shift) in [("a", 0.0), ("b", 0.002), ("c", 0.001)] {
        let angles: Vec<f64> = (0..ROWS)
            .flat_map(|k| {
                let t = k as f64 / ROWS as f64;
                let depth = 0.014 * (std::f64::consts::PI * t).sin().powi(2);
                [0.018 + shift + 0.002 * t, 0.016, 0.007 - depth]
            })
            .collect();
        let folder = bench.root.join("data").join(format!("seq_{id}"));
        common::npy(&folder.join("angles.npy"), &[ROWS, 3], &angles);
        common::npy(&folder.join("torques.npy"), &[ROWS, 3], &[0.0; 3 * ROWS]);
    }
    bench.ok("simulate data --field truth --out touch --noise-sd 0.002 --seed 3");
    for id in ["a", "b", "c"] {
        let path = bench.root.join(format!("touch/seq_{id}/torques.npy"));
        let mut torques = numbers(&path);
        for row in torques.chunks_exact_mut(3) {
            row.iter_mut().zip(BIAS).for_each(|(t, b)| *t += b);
        }
        common::npy(&path, &[ROWS, 3], &torques);
    }
    fs::write(bench.root.join("model.json"), MODEL).unwrap();
    bench
}

fn json(bench: &Bench, line: &str) -> Value {
    serde_json::from_str(&bench.ok(line)).unwrap()
}

const FEW: &str = "--effects torque_bias,torque_gain,joint_coulomb_friction,payload";

#[test]
fn a_bias_is_named_and_corrected() {
    let bench = biased();
    let line = format!("diagnose touch {FEW} --json=d.json --html d.html --model m.json");
    let text = bench.ok(&line);
    assert!(text.contains("torque_bias explains the gap"), "{text}");
    assert!(!text.contains("not a known cause"), "{text}");
    assert!(text.contains("next experiment"), "{text}");
    assert!(text.contains("wrote d.html") && text.contains("wrote m.json"));

    // A sequence in neither split is no cause.
    let text = bench.ok(&format!("diagnose touch {FEW} --train a --test b"));
    assert!(!text.contains("Read the warning"), "{text}");

    // Of one sequence alone nothing is tested.
    let text = bench.ok(&format!("diagnose touch {FEW} --train a --html one.html"));
    assert!(text.contains("Error of the fit 0."), "{text}");
    let page = fs::read_to_string(bench.root.join("one.html")).unwrap();
    assert!(page.contains("Error of the fit, corrected"));
    for told in [text, page] {
        assert!(!told.to_lowercase().contains("test error"), "{told}");
        assert!(!told.contains("test score"), "{told}");
    }

    // What was computed is told where it cannot be written.
    #[cfg(unix)]
    {
        let output = bench.run(&format!("diagnose touch {FEW} --json=/dev/full"));
        assert_eq!(output.status.code(), Some(3));
        let told = String::from_utf8(output.stdout).unwrap();
        assert!(told.contains("torque_bias explains the gap"), "{told}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("/dev/full"));
    }

    let d = fs::read_to_string(bench.root.join("d.json")).unwrap();
    let d: Value = serde_json::from_str(&d).unwrap();
    assert_eq!(d["schema"], 1);
    assert_eq!(d["verdict"]["effects"], serde_json::json!(["torque_bias"]));
    assert_eq!(d["verdict"]["kind"], "effects");
    let found = d["effects"][0]["parameters"].as_array().unwrap();
    for (p, truth) in found.iter().zip(BIAS) {
        let (value, std) = (p["value"].as_f64().unwrap(), p["std"].as_f64().unwrap());
        assert!((value - truth).abs() < 0.02, "{value} ± {std}, not {truth}");
        assert_eq!(p["unit"], "N");
    }
    let number = |v: &Value| v.as_f64().unwrap();
    let gap = &d["gap"];
    assert!(number(&gap["test_error_corrected"]) < 0.5 * number(&gap["test_error_nominal"]));
    assert!(number(&gap["closed_fraction"]) > 0.8);
    assert_eq!(gap["closed_interval"].as_array().unwrap().len(), 2);
    for (kind, key) in [
        ("joint", "joint"),
        ("phase", "phase"),
        ("link", "link"),
        ("sequence", "sequence"),
        ("frequency", "frequency"),
    ] {
        let first = &d["where"][kind][0];
        for key in [key, "share", "interval", "excess"] {
            assert!(!first[key].is_null(), "{kind} {key}: {first}");
        }
    }
    let joint = &d["where"]["joint"][0];
    assert_eq!(joint["joint"], "stage_z", "{joint}");
    let untestable = d["effects"]
        .as_array()
        .unwrap()
        .iter()
        .find(|e| e["effect"] == "payload");
    let untestable = untestable.unwrap();
    assert_eq!(untestable["testable"], false);
    assert!(untestable["reason"].is_string());
    assert!(d["next_experiment"]["action"].is_string() && d["warnings"].is_array());

    let page = fs::read_to_string(bench.root.join("d.html")).unwrap();
    for part in [
        "torque_bias explains the gap",
        "<svg",
        "Where",
        "Not testable",
        "Next experiment",
    ] {
        assert!(page.contains(part), "{part}");
    }
    for foreign in ["<script", "src=", "href=", "@import", "url("] {
        assert!(!page.contains(foreign), "{foreign}");
    }

    // It is no model.
    let line = "estimate touch --model d.json --out f.npz";
    bench.fails(line, 1, &["d.json", "report of a diagnosis", "--model"]);

    // The report alone gives the page but for the torques.
    bench.ok("view d.json --out again.html");
    let again = fs::read_to_string(bench.root.join("again.html")).unwrap();
    let after = |page: &str| page.split_once("<h2>Where</h2>").unwrap().1.to_owned();
    let places = |page: &str| after(page).split_once("<details").unwrap().0.to_owned();
    assert_eq!(places(&again), places(&page));
    assert!(again.contains("torque_bias explains the gap") && !again.contains("class=\"plot\""));
    bench.fails("view d.json --field truth --out x.html", 2, &["--field"]);
    bench.fails("view m.json --out x.html", 1, &["m.json", "no diagnosis"]);

    // The file that was written serves the commands that read one.
    bench.ok("estimate touch --out plain.npz");
    bench.ok("estimate touch --out field.npz --model m.json");
    let nominal = json(&bench, "evaluate touch --field plain.npz --json");
    let corrected = json(
        &bench,
        "evaluate touch --field field.npz --model m.json --json",
    );
    let (nominal, corrected) = (
        number(&nominal["mean_error"]),
        number(&corrected["mean_error"]),
    );
    assert!(
        corrected < 0.5 * nominal,
        "{corrected} N, {nominal} N before"
    );
}

/// A drift goes on from sequence to sequence, also where only the last one is asked for.
#[test]
fn a_part_of_a_simulation_is_that_of_the_whole() {
    let bench = biased();
    let rate =
        |j: usize| format!(r#"{{"name": "r_{j}", "value": 0.01, "std": 0.001, "unit": "N/s"}}"#);
    let rates: Vec<String> = (1..=3).map(rate).collect();
    let drift = format!(
        r#"{{"schema": 1, "effects": [{{"effect": "torque_drift", "parameters": [{},
        {{"name": "T", "value": 3, "std": 0.1, "unit": "s"}}]}}]}}"#,
        rates.join(", ")
    );
    fs::write(bench.root.join("drift.json"), drift).unwrap();
    let of = |sequences: &str, out: &str| {
        bench.ok(&format!(
            "simulate data --field truth --model drift.json {sequences} --out {out}"
        ));
        numbers(&bench.root.join(out).join("seq_c/torques.npy"))
    };
    let whole = of("", "whole");
    assert_eq!(of("--sequences c", "part"), whole);
    assert_eq!(of("--sequences c,a", "turned"), whole);
}

#[test]
fn commands_with_a_model_agree() {
    let bench = biased();
    // Torques are added back: readings of field and model together.
    bench.ok("simulate data --field truth --model model.json --out exact");
    bench.ok("simulate data --field truth --out plain");
    let of = |folder: &str| numbers(&bench.root.join(folder).join("seq_c/torques.npy"));
    for (row, plain) in of("exact").chunks_exact(3).zip(of("plain").chunks_exact(3)) {
        for ((a, b), bias) in row.iter().zip(plain).zip(BIAS) {
            assert!((a - b - bias).abs() < 1e-12);
        }
    }
    bench.ok("predict exact --field truth --model model.json --out predicted");
    for (a, b) in of("predicted").iter().zip(of("exact")) {
        assert!((a - b).abs() < 1e-12);
    }
    let line = "evaluate exact --field truth --model model.json --baseline zero --json";
    let exact = json(&bench, line);
    assert!(exact["mean_error"].as_f64().unwrap() < 1e-12, "{exact}");
    // Readings are those of the recording, not what the model leaves of them.
    assert_eq!(
        exact["zero_error"],
        exact["baselines"]["zero"]["mean_error"]
    );
    assert_eq!(exact["samples"], ROWS);

    // The noise of a simulation is the same with a model as without.
    bench.ok("simulate data --field truth --model model.json --noise-sd 0.01 --out noisy");
    bench.ok("simulate data --field truth --noise-sd 0.01 --out plain_noisy");
    for (k, (a, b)) in of("noisy").iter().zip(of("plain_noisy")).enumerate() {
        assert!((a - b - BIAS[k % 3]).abs() < 1e-12);
    }

    // Offsets are not tared away before anything is written.
    bench.ok("simulate data --field truth --model model.json --tare-samples 9 --out tared");
    assert_eq!(of("tared"), of("exact"));

    // Predictions of tared readings are as these are.
    bench.ok("predict touch --field truth --model model.json --tare-samples 9 --out like");
    let line = "evaluate like --field truth --model model.json --json";
    assert!(json(&bench, line)["mean_error"].as_f64().unwrap() < 1e-12);

    // Baselines alone need no field.
    let baseline = json(
        &bench,
        "evaluate touch --model model.json --baseline zero --json",
    );
    assert_eq!(baseline["predictor"], "zero");

    // Sequences in no split, in any order.
    bench.ok("predict exact --field truth --model model.json --out other --sequences c,a --train b --test a");
    assert!(bench.root.join("other/seq_c/torques_sd.npy").is_file());
}

/// Where the object lay in a sequence says nothing of other recordings.
#[test]
fn parameters_of_sequences_are_of_their_recording() {
    let bench = biased();
    let parameters: Vec<Value> = (["", "_a", "_b", "_c"].iter())
        .flat_map(|id| ["dx", "dy", "dz"].map(|axis| format!("{axis}{id}")))
        .map(|name| serde_json::json!({"name": name, "value": 0.001, "std": 0.0, "unit": "m"}))
        .collect();
    let model = |recording: &str| {
        let effect = serde_json::json!({"effect": "registration_offset", "parameters": parameters});
        let text = serde_json::json!({
            "schema": 1, "recording_name": recording, "effects": [effect],
        });
        fs::write(bench.root.join("r.json"), text.to_string()).unwrap();
        bench.warned("estimate touch --model r.json --out r.npz")
    };
    let name = json(&bench, "info touch --json")["name"]
        .as_str()
        .unwrap()
        .to_owned();
    assert!(!model(&name).contains("parameters of their own for the sequences of"));
    let warning = model("another");
    assert!(
        warning.contains("for the sequences of \"another\""),
        "{warning}"
    );
}

/// What a diagnosis says of fields is what one gets who estimates them, with the model and without.
#[test]
fn estimated_errors_are_those_of_estimates() {
    let bench = biased();
    let line = format!("diagnose touch {FEW} --model m.json --json");
    let diagnosis = json(&bench, &line);
    assert!(diagnosis["notes"].to_string().contains("--effects"));
    let found = &diagnosis["gap"];
    assert_eq!(found["estimated"], true);
    let number = |key: &str| found[key].as_f64().unwrap();
    let plain = json(&bench, "estimate touch --out plain.npz --json");
    assert_eq!(number("threshold"), plain["threshold"].as_f64().unwrap());
    bench.ok("estimate touch --out field.npz --model m.json");
    for (key, line) in [
        (
            "test_error_nominal",
            "evaluate touch --field plain.npz --json",
        ),
        (
            "test_error_corrected",
            "evaluate touch --field field.npz --model m.json --json",
        ),
    ] {
        let error = json(&bench, line)["mean_error"].as_f64().unwrap();
        assert!((number(key) / error - 1.0).abs() < 1e-6, "{key} {error}");
    }
    assert!(number("test_error_corrected") < 0.5 * number("test_error_nominal"));
}

/// The parameters of effects are relative to the contact that they were found in; torques of the joints do not depend on
/// from where on points are touched.
#[test]
fn a_corrected_model_brings_its_contact() {
    let bench = biased();
    bench.ok(&format!(
        "diagnose touch {FEW} --threshold 0.003 --friction 0.3 --model m.json"
    ));
    let model = fs::read_to_string(bench.root.join("m.json")).unwrap();
    let parsed: Value = serde_json::from_str(&model).unwrap();
    assert_eq!(parsed["contact_parameters"]["threshold"], 0.003);
    let plain = json(&bench, "estimate touch --out plain.npz --json");
    let estimated = json(
        &bench,
        "estimate touch --out field.npz --model m.json --json",
    );
    assert_eq!(estimated["threshold"], plain["threshold"]);
    let warning = bench.warned("evaluate touch --field field.npz --model m.json");
    assert!(
        !warning.contains("the corrected model was found"),
        "{warning}"
    );
    let warning = bench.warned("evaluate touch --field plain.npz --model m.json");
    let says = "the corrected model was found with --friction 0.3, the field estimated with 0.15";
    assert!(warning.contains(says), "{warning}");

    // Padding does.
    let mut padding = parsed.clone();
    padding["effects"] = serde_json::json!([{
        "effect": "geometry_padding",
        "parameters": [{"name": "padding", "value": 0.001, "std": 0.0, "unit": "m"}],
    }]);
    fs::write(bench.root.join("p.json"), padding.to_string()).unwrap();
    let padded = json(&bench, "estimate touch --out p.npz --model p.json --json");
    assert_eq!(padded["threshold"], 0.003);
    let warning = bench.warned("evaluate touch --field plain.npz --model p.json");
    assert!(
        warning.contains("found with --threshold 0.003"),
        "{warning}"
    );

    let elsewhere = model.replace(
        "\"subdivision\": 2",
        "\"subdivision\": 2, \"links\": [\"tail\"]",
    );
    assert_ne!(elsewhere, model);
    fs::write(bench.root.join("m.json"), elsewhere).unwrap();
    let line = "estimate touch --out field.npz --model m.json";
    bench.fails(
        line,
        1,
        &["remembers which links touched", "no link 'tail'"],
    );

    // What cannot be is told with the file, before anything is computed.
    for (from, to, part) in [
        (
            "\"friction\": 0.3",
            "\"friction\": -1",
            "m.json: contact_parameters: friction -1.0 must be",
        ),
        (
            "\"friction\": 0.3",
            "\"friction\": []",
            "m.json: corrected model: line 10 column 16: contact_parameters.friction: invalid type: sequence, expected a number",
        ),
    ] {
        let text = model.replace(from, to);
        assert_ne!(text, model);
        fs::write(bench.root.join("m.json"), text).unwrap();
        bench.fails(line, 1, &[part]);
    }
}

/// A field knows the corrected model that it was estimated with.
#[test]
fn fields_remember_their_model() {
    let bench = biased();
    bench.ok("estimate touch --out plain.npz");
    bench.ok("estimate touch --out field.npz --out folder --model model.json");
    let other = fs::read_to_string(bench.root.join("model.json")).unwrap();
    fs::write(bench.root.join("other.json"), other.replace("-0.1", "-0.2")).unwrap();
    // One without effects is the nominal one.
    fs::write(
        bench.root.join("none.json"),
        r#"{"schema": 1, "effects": []}"#,
    )
    .unwrap();
    bench.ok("estimate touch --out none.npz --model none.json");
    for line in [
        "evaluate touch --field none.npz",
        "evaluate touch --field plain.npz --model none.json",
    ] {
        let warning = bench.warned(line);
        assert!(!warning.contains("corrected"), "{line}: {warning}");
    }
    let model = "corrected model (torque_bias)";
    for (line, part) in [
        ("evaluate touch --field field.npz", "lacks its effects"),
        ("predict touch --field folder --out a", "lacks its effects"),
        (
            "simulate touch --field field.npz --out b",
            "lacks its effects",
        ),
        (
            "export touch --field field.npz --torques plots",
            "lacks its effects",
        ),
        (
            "evaluate touch --field field.npz --model other.json",
            "another corrected",
        ),
        (
            "predict touch --field plain.npz --model model.json --out c",
            "estimated without",
        ),
    ] {
        let warning = bench.warned(line);
        assert!(
            warning.contains(model) && warning.contains(part),
            "{line}: {warning}"
        );
    }
    for line in [
        "evaluate touch --field field.npz --model model.json",
        "predict touch --field folder --model model.json --out d",
        "evaluate touch --field plain.npz",
        "evaluate touch --field truth --model model.json",
        "export touch --field field.npz --model model.json --torques plots --out touch.mcap",
    ] {
        let warning = bench.warned(line);
        assert!(!warning.contains("corrected"), "{line}: {warning}");
    }
}

#[test]
fn an_arm_in_free_air() {
    let bench = Bench::touched();
    let folder = bench.root.join("air");
    fs::create_dir(&folder).unwrap();
    let metadata = r#"{"name": "<script>alert(1)</script>", "robot": "planar_arm", "rate_hz": 50,
        "torque_kind": "measured", "gravity": [0, 0, 0],
        "splits": {"train": ["1", "2"], "test": ["3"]}}"#;
    fs::write(folder.join("dataset.json"), metadata).unwrap();
    const ROWS: usize = 120;
    for id in 1..=3 {
        let (mut angles, mut torques) = (Vec::new(), Vec::new());
        for k in 0..ROWS {
            let t = k as f64 / 50.0;
            for j in 0..3 {
                let w = 1.0 + 0.4 * f64::from(j) + 0.2 * f64::from(id);
                angles.push((w * t).sin());
                // An arm without weight that drags: readings are mostly viscous friction.
                torques.push(20.0 * w * (w * t).cos());
            }
        }
        let folder = folder.join(format!("seq_{id}"));
        fs::create_dir(&folder).unwrap();
        common::npy(&folder.join("angles.npy"), &[ROWS, 3], &angles);
        common::npy(&folder.join("torques.npy"), &[ROWS, 3], &torques);
    }
    let line = "diagnose air --effects joint_viscous_friction,contact_friction --html air.html --model air.json --json";
    let d = json(&bench, line);
    let effects = d["effects"].as_array().unwrap();
    let contact = effects
        .iter()
        .find(|e| e["effect"] == "contact_friction")
        .unwrap();
    assert_eq!(contact["testable"], false);
    assert_eq!(d["gap"]["unit"], "N m");
    assert_eq!(d["dataset"], "<script>alert(1)</script>");
    // A hostile name stays text.
    let page = fs::read_to_string(bench.root.join("air.html")).unwrap();
    assert!(page.contains("&lt;script&gt;") && !page.contains("<script"));

    // The model predicts what the diagnosis says, without a field.
    let after = d["gap"]["test_error_corrected"].as_f64().unwrap();
    assert!(after < d["gap"]["test_error_nominal"].as_f64().unwrap());
    let model = "--model air.json";
    let evaluated = json(
        &bench,
        &format!("evaluate air {model} --baseline zero --json"),
    );
    assert_eq!(evaluated["predictor"], "model");
    assert!((evaluated["mean_error"].as_f64().unwrap() - after).abs() < 1e-9);
    assert!(
        evaluated["baselines"]["zero"]["mean_error"]
            .as_f64()
            .unwrap()
            > after
    );
    // What it was found in is no test.
    let [trained, tested] =
        ["1", "3"].map(|id| bench.warned(&format!("evaluate air {model} --sequences {id}")));
    let said = "air.json: the model was fitted to sequences that are predicted (1)";
    assert!(
        trained.contains(said) && !tested.contains("was fitted"),
        "{trained}{tested}"
    );
    json(&bench, "evaluate air --baseline knn --neighbors 5 --json");
    let own = bench.warned("evaluate air --baseline knn --sequences 1,3");
    assert!(
        own.contains("baselines learn from the train split, and 1 is of it"),
        "{own}"
    );
    let other = r#"{"schema": 1, "effects": [{"effect": "torque_bias", "parameters":
        [{"name": "b_1", "value": 99, "std": 1, "unit": "N m"}, {"name": "b_2", "value": 0, "std": 1, "unit": "N m"},
        {"name": "b_3", "value": 0, "std": 1, "unit": "N m"}]}]}"#;
    fs::write(bench.root.join("other.json"), other).unwrap();
    let worse = bench.warned("evaluate air --model other.json");
    assert!(
        worse.contains("is above that of the nominal model"),
        "{worse}"
    );
    let simulated = bench.ok(&format!("simulate air {model} --out simulated"));
    assert!(simulated.contains("in free air"), "{simulated}");
    let again = json(&bench, &format!("evaluate simulated {model} --json"));
    assert!(again["mean_error"].as_f64().unwrap() < 1e-9, "{again}");
    bench.ok(&format!("predict air {model} --out predicted"));
    assert!(bench.root.join("predicted/seq_3/torques.npy").is_file());
    // Nothing says how sure it is.
    assert!(!bench.root.join("predicted/seq_3/torques_sd.npy").exists());
    bench.ok(&format!(
        "export air {model} --torques plots --out air.mcap"
    ));
    assert!(bench.root.join("plots/torques_3.svg").is_file());
    let drawn = format!("export air {model} --out air.png");
    bench.fails(&drawn, 2, &["air.png: a recording without points"]);
    bench.fails("evaluate air", 2, &["one without takes --model"]);

    // More friction than there can be is no cause that is known; its model is called what it is.
    assert!(!d["notes"].to_string().contains("not a known cause"));
    for id in 1..=3 {
        let path = folder.join(format!("seq_{id}/torques.npy"));
        let torques: Vec<f64> = numbers(&path).iter().map(|t| 15.0 * t).collect();
        common::npy(&path, &[ROWS, 3], &torques);
    }
    let line = "diagnose air --effects joint_viscous_friction --model closest.json --json=d.json";
    let warning = bench.warned(line);
    let said = "closest.json holds what comes closest, not a known cause";
    assert!(warning.contains(said), "{warning}");
    let d = fs::read_to_string(bench.root.join("d.json")).unwrap();
    let d: Value = serde_json::from_str(&d).unwrap();
    assert_eq!(d["verdict"]["kind"], "unknown", "{d}");
    assert!(d["notes"].to_string().contains("not a known cause"), "{d}");
}

#[test]
fn what_is_refused() {
    let bench = biased();
    bench.fails(
        "diagnose touch --effects torque_boas",
        2,
        &["--effects", "torque_boas", "torque_bias"],
    );
    bench.fails(
        "diagnose touch --effects latency,latency",
        2,
        &["--effects", "twice"],
    );
    bench.fails("diagnose nowhere", 1, &["nowhere"]);
    let untestable = ["none of those", "payload", "look for others"];
    bench.fails("diagnose touch --effects payload", 1, &untestable);
    bench.fails("diagnose touch --html report.txt", 2, &["--html", ".html"]);
    bench.fails("diagnose touch --model model.npz", 2, &["--model", ".json"]);
    bench.fails(
        "diagnose touch --html none/report.html",
        3,
        &["none/report.html", "folder"],
    );
    bench.fails(
        "diagnose touch --model touch/dataset.json",
        2,
        &["--model", "touch"],
    );
    bench.fails(
        "diagnose touch --html touch/a.html",
        2,
        &["--html", "touch"],
    );
    bench.fails(
        "diagnose touch --json=touch/a.json",
        2,
        &["--json", "touch"],
    );
    bench.fails(
        "diagnose touch --model a.json --json=./a.json",
        2,
        &["--json", "--model", "same file"],
    );
    fs::write(bench.root.join("mine.json"), "{}").unwrap();
    bench.fails(
        "diagnose touch --model mine.json",
        2,
        &["--model mine.json", "something else"],
    );
    bench.fails("diagnose touch --seed x", 2, &["--seed"]);
    bench.fails("diagnose touch --train a,b,c --test x", 2, &["--test"]);

    let model = |text: &str| fs::write(bench.root.join("model.json"), text).unwrap();
    for (text, parts) in [
        (
            MODEL.replace("torque_bias", "torque_boas"),
            ["model.json", "torque_boas"],
        ),
        (MODEL.replace("\"N\"", "\"N m\""), ["model.json", "\"N m\""]),
        (MODEL.replace("b_2", "b_4"), ["model.json", "b_4"]),
        (MODEL.replace("-0.1", "NaN"), ["model.json", "line 4"]),
        (MODEL.replace("-0.1", "-1e9"), ["model.json", "must be in"]),
        (
            MODEL.replace("\"schema\": 1", "\"schema\": 9"),
            ["model.json", "schema 9"],
        ),
        (
            MODEL.replace("\"schema\": 1", "\"schema\": 1, \"joints\": [\"a\"]"),
            ["model.json", "with the joints a; here they are"],
        ),
        ("{}".to_owned(), ["model.json", "schema"]),
    ] {
        model(&text);
        for command in [
            "estimate touch --model model.json",
            "evaluate touch --field truth --model model.json",
            "predict touch --field truth --model model.json --out out",
            "simulate touch --field truth --model model.json --out out",
        ] {
            bench.fails(command, 1, &parts);
        }
    }
    assert!(!bench.root.join("out").exists() && !bench.root.join("field.npz").exists());
    bench.fails(
        "estimate touch --model none.json",
        1,
        &["none.json", "no such"],
    );
    let json = "estimate touch --model model.json --json=./model.json";
    bench.fails(json, 2, &["--json", "model.json"]);
}

/// Outputs are written together: where one cannot be, none is.
#[test]
#[cfg(unix)]
fn outputs_are_all_or_none() {
    let bench = biased();
    let page = bench.root.join("d.html");
    fs::write(&page, "kept").unwrap();
    let mut rights = fs::metadata(&page).unwrap().permissions();
    rights.set_readonly(true);
    fs::set_permissions(&page, rights).unwrap();
    let line = "diagnose touch --effects torque_bias --html d.html --model m.json --json=d.json";
    bench.fails(line, 3, &["d.html"]);
    assert!(!bench.root.join("m.json").exists() && !bench.root.join("d.json").exists());
    assert_eq!(fs::read_to_string(&page).unwrap(), "kept");
}

/// Recordings that hold next to nothing give an answer or a reason, never a panic.
#[test]
fn recordings_of_next_to_nothing() {
    let bench = Bench::touched();
    for rows in [1, 2, 5] {
        for id in ["a", "b", "c"] {
            let folder = bench.root.join(format!("touch/seq_{id}"));
            let angles: Vec<f64> = (0..rows)
                .flat_map(|k| [0.02, 0.016, -0.001 * k as f64])
                .collect();
            common::npy(&folder.join("angles.npy"), &[rows, 3], &angles);
            common::npy(
                &folder.join("torques.npy"),
                &[rows, 3],
                &vec![0.1; 3 * rows],
            );
            let _ = fs::remove_file(folder.join("time.npy"));
        }
        let output = bench.run("diagnose touch --rate-hz 50 --html d.html --json");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(!error.contains("panicked"), "{rows} rows: {error}");
        match output.status.code() {
            Some(0) => assert!(serde_json::from_slice::<Value>(&output.stdout).is_ok()),
            _ => assert!(error.contains("error: "), "{rows} rows: {error}"),
        }
    }
    // Silence is no absence of a gap.
    for id in ["a", "b", "c"] {
        let torques = bench.root.join(format!("touch/seq_{id}/torques.npy"));
        common::npy(&torques, &[5, 3], &[0.0; 15]);
    }
    let silent = "torques of the train sequences: all are zero";
    bench.fails("diagnose touch --rate-hz 50", 1, &[silent]);
    let points: Vec<f64> = (0..480).map(|k| 1e3 + k as f64).collect();
    common::npy(&bench.root.join("data/points.npy"), &[160, 3], &points);
    for id in ["a", "b", "c"] {
        let torques = bench.root.join(format!("data/seq_{id}/torques.npy"));
        let readings: Vec<f64> = (0..3 * common::ROWS)
            .map(|k| 0.01 * (k % 7) as f64)
            .collect();
        common::npy(&torques, &[common::ROWS, 3], &readings);
    }
    let warning = bench.warned("diagnose data --effects torque_bias,contact_friction");
    assert!(warning.contains("touches none of the 160"), "{warning}");
}
