//! Every bad input that the data set format lists: an exit code and one line that names the place.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;
use common::{Bench, METADATA, ROWS, npy, raw_npy};
use std::fs;

const INFO: &str = "info data";

/// Writes 3-column `torques` of sequence b with `change` applied.
fn torques(bench: &Bench, rows: usize, change: impl Fn(&mut Vec<f64>)) {
    let mut data = vec![0.0; 3 * rows];
    change(&mut data);
    npy(
        &bench.root.join("data/seq_b/torques.npy"),
        &[rows, 3],
        &data,
    );
}

#[test]
fn missing_file_or_folder() {
    let bench = Bench::new();
    fs::remove_file(bench.root.join("data/seq_b/torques.npy")).unwrap();
    bench.fails(INFO, 1, &["seq_b", "torques.npy", "no such"]);
    bench.fails("info nowhere", 1, &["nowhere", "no such"]);
    bench.fails("evaluate data --field none.npz", 1, &["seq_b"]);
}

#[test]
fn wrong_rank_and_width() {
    let bench = Bench::new();
    let path = bench.root.join("data/seq_b/torques.npy");
    npy(&path, &[ROWS * 3], &[0.0; 3 * ROWS]);
    bench.fails(INFO, 1, &["seq_b", "torques.npy", "shape"]);
    npy(&path, &[ROWS, 2], &[0.0; 2 * ROWS]);
    bench.fails(INFO, 1, &["seq_b", "torques.npy", "3 columns"]);
}

#[test]
fn lengths_that_differ() {
    let bench = Bench::new();
    torques(&bench, ROWS - 1, |_| {});
    bench.fails(INFO, 1, &["seq_b", "torques.npy", "23 rows", "24"]);
}

#[test]
fn numbers_that_are_not_finite() {
    let bench = Bench::new();
    for value in [f64::NAN, f64::INFINITY] {
        torques(&bench, ROWS, |t| t[3 * 7 + 1] = value);
        bench.fails(INFO, 1, &["seq_b", "torques.npy row 7 joint 2"]);
    }
}

#[test]
fn time_that_does_not_increase() {
    let bench = Bench::new();
    let mut time: Vec<f64> = (0..ROWS).map(|k| k as f64).collect();
    time[5] = time[4];
    npy(&bench.root.join("data/seq_b/time.npy"), &[ROWS], &time);
    bench.fails(INFO, 1, &["seq_b", "time.npy row 5"]);
}

#[test]
fn unknown_robot() {
    let bench = Bench::new();
    bench.fails(
        "info data --robot kinova_gen9",
        1,
        &["kinova_gen9", "kinova_gen3"],
    );
    bench.fails("info data --robot none.urdf", 1, &["none.urdf"]);
    bench.fails(
        "info data --robot kinova_gen3",
        1,
        &["3 joint columns", "7 joints"],
    );
    bench.metadata(r#"{"rate_hz": 50}"#);
    bench.fails(INFO, 1, &["dataset.json", "robot is required"]);
}

#[test]
fn damaged_npy_npz_and_png() {
    let bench = Bench::new();
    let path = bench.root.join("data/seq_b/torques.npy");
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() - 9]).unwrap();
    bench.fails(INFO, 1, &["seq_b", "torques.npy"]);
    fs::write(&path, b"not numpy").unwrap();
    bench.fails(INFO, 1, &["seq_b", "torques.npy"]);
    fs::write(&path, &whole).unwrap();

    fs::write(bench.root.join("bad.npz"), b"PK\x03\x04 cut").unwrap();
    bench.fails("evaluate data --field bad.npz", 1, &["bad.npz"]);

    let camera = bench.root.join("data/camera");
    fs::create_dir(&camera).unwrap();
    let json = r#"{"width": 2, "height": 2, "fx": 1, "fy": 1, "cx": 0, "cy": 0, "depth_scale": 0.001,
        "world_from_camera": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}"#;
    fs::write(camera.join("camera.json"), json).unwrap();
    fs::write(camera.join("color.png"), b"\x89PNG\r\n\x1a\n cut").unwrap();
    bench.fails(INFO, 1, &["color.png"]);
}

#[test]
fn pickled_objects() {
    let bench = Bench::new();
    raw_npy(
        &bench.root.join("data/seq_b/torques.npy"),
        "|O",
        "24, 3",
        b"\x80\x04.",
    );
    bench.fails(INFO, 1, &["seq_b", "torques.npy", "pickle"]);
}

#[test]
fn points_outside_the_box_are_a_warning() {
    let bench = Bench::new();
    bench.metadata(&METADATA.replace(
        "\"rate_hz\"",
        "\"object_bbox\": [[0.001, -1, -1], [1, 1, 1]], \"rate_hz\"",
    ));
    let output = bench.run(INFO);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    assert!(
        error.contains("warning: ") && error.contains("16 of 160 points"),
        "{error}"
    );
}

#[test]
fn splits_and_ids() {
    let bench = Bench::new();
    bench.metadata(&METADATA.replace("[\"c\"]", "[]"));
    bench.fails(INFO, 1, &["dataset.json", "test is empty"]);
    bench.metadata(&METADATA.replace("\"c\"", "\"x\""));
    bench.fails(INFO, 1, &["dataset.json", "\"x\"", "seq_x"]);
    bench.metadata(r#"{"robot": "cartesian_stage", "rate_hz": 50}"#);
    bench.fails("evaluate data --field truth", 1, &["test split is empty"]);
    bench.fails("estimate data --sequences a,zz", 1, &["\"zz\"", "a, b, c"]);
    bench.metadata("{ nonsense");
    bench.fails(INFO, 1, &["dataset.json line 1"]);
}

#[test]
fn rate_is_required_without_time() {
    let bench = Bench::new();
    bench.metadata(r#"{"robot": "cartesian_stage"}"#);
    bench.fails(INFO, 1, &["seq_a", "rate_hz"]);
    bench.ok("info data --rate-hz 50");
}

#[test]
fn fields_of_other_points() {
    let bench = Bench::new();
    npy(&bench.root.join("truth/points.npy"), &[1, 3], &[0.0; 3]);
    npy(&bench.root.join("truth/K.npy"), &[1], &[1.0]);
    bench.fails("evaluate data --field truth", 1, &["1 points", "160"]);
    npy(&bench.root.join("truth/points.npy"), &[160, 3], &[0.5; 480]);
    npy(&bench.root.join("truth/K.npy"), &[160], &[1.0; 160]);
    bench.fails("evaluate data --field truth", 1, &["row 0", "points.npy"]);
}
