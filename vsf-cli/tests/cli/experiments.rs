//! Experiments: what they write, and that a recording that fails takes nothing from the others.

use crate::common::{Bench, METADATA};
use std::fs;
use std::path::Path;
use vsf::data::{CameraView, Dataset, Overrides};
use vsf::pipeline::{
    EstimatorSpec, Experiment, HyperMethod, Method, Overlap, OverlapShares, PriorShape, Scene,
    SceneOptions, choose_hyper, estimate, evaluate, rgbd_view, view_warnings,
};

fn has(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
}

#[test]
fn the_paper_in_one_report() {
    let bench = Bench::touched();
    // Its name shall not become a path.
    let metadata = METADATA.replacen('{', r#"{"name": "../a b", "#, 1);
    fs::write(bench.root.join("touch/dataset.json"), metadata).unwrap();
    let line = "experiment paper touch nowhere --out report --json";
    let output = bench.run(line);
    let (json, error) = (output.stdout, String::from_utf8(output.stderr).unwrap());
    assert_eq!(output.status.code(), Some(1), "{error}");
    has(&error, &["error: ", "nowhere"]);
    let json = String::from_utf8(json).unwrap();
    let keys = [
        "\"table1\"",
        "\"update_speed\"",
        "\"errors\"",
        "\"update_times\"",
        "\"failed\"",
        "nowhere",
        "\"leave_one_out\": true",
        "\"overlap\": \"full\"",
        "\"method\": \"blind-online\"",
    ];
    has(&json, &keys);
    let file = |name: &str| fs::read_to_string(bench.root.join("report").join(name)).unwrap();
    let tables = [
        "Table I:",
        "Table II:",
        "Table III:",
        "each of 3 in turn",
        "../a b",
        "VSF blind",
    ];
    has(&file("report.md"), &tables);
    // No camera, so no such column.
    assert!(!file("report.md").contains("VSF with vision"));
    has(&file("report.json"), &["\"failed\""]);
    has(&file("update_time.svg"), &["dense"]);
    assert!(bench.root.join("report/01____a_b_blind.png").is_file());

    // An earlier report is replaced, other files are not, whatever their names.
    let mine = bench.root.join("mine");
    let refuses = |name: &str| {
        bench.fails(
            "experiment paper touch --out mine",
            2,
            &["--out", "mine", name],
        );
        assert_eq!(fs::read(mine.join(name)).unwrap(), b"mine");
    };
    fs::create_dir(&mine).unwrap();
    fs::write(mine.join("notes.txt"), "mine").unwrap();
    refuses("notes.txt");
    for name in [
        "report.md",
        "report.json",
        "update_time.svg",
        "01_a_blind.png",
    ] {
        fs::remove_dir_all(&mine).unwrap();
        fs::create_dir(&mine).unwrap();
        fs::copy(bench.root.join("report/report.md"), mine.join("report.md")).unwrap();
        fs::write(mine.join(name), "mine").unwrap();
        refuses(name);
    }
}

/// An earlier report outlives a run that comes to nothing.
#[test]
fn reports_are_kept_until_there_is_another() {
    let bench = Bench::new();
    fs::create_dir(bench.root.join("report")).unwrap();
    let earlier = b"# Experiments\n<!-- vsf 0.1.0 -->\nearlier";
    fs::write(bench.root.join("report/report.md"), earlier).unwrap();
    bench.fails("experiment paper nowhere --out report", 1, &["nowhere"]);
    let names = fs::read_dir(bench.root.join("report")).unwrap().count();
    let report = fs::read(bench.root.join("report/report.md")).unwrap();
    assert_eq!((names, &report[..]), (1, &earlier[..]));
}

#[test]
fn folders_of_blind_cases_are_checked() {
    let bench = Bench::new();
    let keep = |folder: &str| format!("experiment blind --cases 1 --keep {folder}");
    bench.fails(&keep("data"), 2, &["--keep data", "other files"]);
    bench.fails(&keep("data/points.npy"), 2, &["--keep", "no folder"]);
    bench.fails(&keep("data/points.npy/x"), 3, &["points.npy/x"]);
    // Recordings of others, whatever their names, and what was edited.
    let cases = bench.root.join("cases");
    fs::create_dir_all(cases.join("case_000")).unwrap();
    bench.fails(&keep("cases"), 2, &["other files", "case_000"]);
    let metadata = |text: &str| fs::write(cases.join("case_000/dataset.json"), text).unwrap();
    metadata("{}");
    bench.fails(&keep("cases"), 2, &["other files", "case_000"]);
    metadata(r#"{"made_by": "vsf import"}"#);
    bench.fails(&keep("cases"), 2, &["case_000", "vsf import"]);
    metadata(r#"{"made_by": "vsf-world"}"#);
    bench.fails(&keep("cases"), 2, &["case_000", "was edited"]);
}

#[test]
fn recordings_that_fail_are_named() {
    let bench = Bench::touched();
    fs::create_dir(bench.root.join("empty")).unwrap();
    for experiment in ["table1", "priors"] {
        let output = bench.run(&format!("experiment {experiment} nowhere touch empty"));
        let error = String::from_utf8(output.stderr).unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(!output.status.success());
        has(&error, &["nowhere", "empty"]);
        // The name says what recording it was simulated from.
        has(&text, &["data", "| --- |"]);
        bench.fails(&format!("experiment {experiment} nowhere"), 1, &["nowhere"]);
    }
}

#[test]
fn recordings_of_one_name_are_told_apart() {
    let bench = Bench::touched();
    fs::create_dir(bench.root.join("again")).unwrap();
    // Both are called by what they were simulated from.
    bench.ok("simulate data --field truth --out again/touch --noise-sd 0.002 --seed 4");
    let text = bench.ok("experiment priors touch again/touch");
    assert!(text.starts_with("touch\n"), "{text}");
    has(&text, &["\nagain/touch\n"]);
    bench.fails("experiment priors touch touch", 2, &["touch", "twice"]);
}

#[test]
fn recordings_are_warned_of() {
    let bench = Bench::touched();
    let metadata = METADATA.replacen('{', r#"{"tare_samples": 12, "#, 1);
    fs::write(bench.root.join("touch/dataset.json"), metadata).unwrap();
    has(
        &bench.warned("experiment table1 touch"),
        &["warning", "tare"],
    );
}

/// Told before contact is run: not even the robot is looked at.
#[test]
fn vision_without_a_camera() {
    let bench = Bench::touched();
    let metadata = METADATA.replacen("cartesian_stage", "nobody", 1);
    fs::write(bench.root.join("touch/dataset.json"), metadata).unwrap();
    bench.fails("estimate touch --vision level", 1, &["no camera/"]);
    bench.fails("estimate touch", 1, &["nobody"]);
}

/// Depths in another unit.
#[test]
fn a_surface_that_is_elsewhere() {
    let (dataset, scene) = sample("orange_tree_no");
    let mut camera = dataset.camera.clone().unwrap();
    let warned = |camera: &CameraView| {
        let view = rgbd_view(camera).unwrap();
        view_warnings(scene.rest(), &view)
    };
    assert_eq!(warned(&camera), []);
    for factor in [0.1, 10.0] {
        camera.depth_scale = factor * dataset.camera.as_ref().unwrap().depth_scale;
        assert!(warned(&camera)[0].to_string().contains("depth_scale"));
    }
}

/// A built-in recording and the scene of it.
fn sample(name: &str) -> (Dataset, Scene) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("data")
        .join(name);
    let (dataset, _) = Dataset::open(folder, &Overrides::default()).unwrap();
    let options = SceneOptions {
        subdivision: 1,
        ..SceneOptions::default()
    };
    let scene = Scene::open(&dataset, &options).unwrap();
    (dataset, scene)
}

#[test]
fn overlap_is_told_from_contacts() {
    for (name, overlap) in [
        ("orange_tree", Overlap::Full),
        ("orange_tree_partial", Overlap::Partial),
        ("orange_tree_no", Overlap::No),
    ] {
        let (dataset, scene) = sample(name);
        let sequences: Vec<_> = dataset.train().chain(dataset.test()).collect();
        let traces = scene.traces(&sequences, || {}).unwrap();
        let experiment = Experiment::new(&dataset, &scene, &traces).unwrap();
        assert_eq!(OverlapShares::of(&experiment).overlap(), overlap, "{name}");
    }
}

/// Each sequence is predicted from the others alone.
#[test]
fn errors_are_those_of_sequences_left_out() {
    let (dataset, scene) = sample("orange_tree_no");
    let sequences: Vec<_> = dataset.train().chain(dataset.test()).collect();
    let traces = scene.traces(&sequences, || {}).unwrap();
    let experiment = Experiment::new(&dataset, &scene, &traces).unwrap();
    assert!(experiment.leave_one_out());
    assert_eq!(
        (experiment.test_len(), experiment.curve_lens()),
        (4, vec![1, 2, 3])
    );
    let errors = experiment.errors_after(1, None).unwrap();
    let blind = errors.iter().find(|e| e.method == Method::Blind).unwrap();
    for (k, found) in blind.evaluation.per_sequence.iter().enumerate() {
        // The one that follows, the first after the last.
        let train = [traces[(k + 1) % traces.len()].clone()];
        let shape = PriorShape::default();
        let hyper = choose_hyper(
            scene.rest(),
            &train,
            &shape.or_independent(),
            HyperMethod::HeldOut,
        )
        .unwrap()
        .hyper;
        let field = estimate(scene.rest(), &train, &EstimatorSpec::Batch, &hyper, |_| {}).unwrap();
        let alone = evaluate(&scene, &field.belief, &traces[k..=k]).unwrap();
        assert_eq!(found.sequence, traces[k].id);
        assert_eq!(found.mean_error, alone.mean_error);
    }
}
