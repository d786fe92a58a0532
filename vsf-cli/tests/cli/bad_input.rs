//! Every bad input that the data set format lists: an exit code and one line that names the place.

use crate::common::{Bench, METADATA, ROWS, npy, raw_npy};
use std::fs;
use std::io::Write;
use std::process::Command;

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
fn torques_beyond_any_sensor() {
    let bench = Bench::new();
    torques(&bench, ROWS, |t| t[3 * 7 + 1] = -1e300);
    let parts = ["sequence b row 7 joint 2", "-1e300 N", "units"];
    bench.fails(INFO, 1, &parts);
    bench.fails("estimate data", 1, &parts);
    torques(&bench, ROWS, |t| t[3 * 7 + 1] = 1e11);
    bench.ok("estimate data");
}

#[test]
fn positions_beyond_numbers() {
    let bench = Bench::new();
    let path = bench.root.join("data/seq_b/angles.npy");
    let mut angles = vec![0.0; 3 * ROWS];
    angles[3 * 5] = 1.5e308;
    angles[3 * 6] = f64::MAX;
    npy(&path, &[ROWS, 3], &angles);
    let output = bench.run(INFO);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("1.5e308") && error.len() < 2000, "{error}");
}

#[test]
fn clouds_beyond_reach() {
    let bench = Bench::new();
    let points: Vec<f64> = (0..480).map(|k| 1e6 + k as f64).collect();
    npy(&bench.root.join("data/points.npy"), &[160, 3], &points);
    bench.fails(INFO, 1, &["points.npy row 0 y", "beyond 1e6 m", "units"]);
    let points: Vec<f64> = (0..480).map(|k| 1e5 + k as f64).collect();
    npy(&bench.root.join("data/points.npy"), &[160, 3], &points);
    let given = "estimate data --prior-sd 1 --noise-sd 1";
    bench.fails(given, 1, &["touches none of the 160", "units"]);
    assert!(!bench.root.join("field.npz").exists());
    assert!(bench.warned(INFO).contains("touches none of the 160"));
}

#[test]
fn tare_samples() {
    let bench = Bench::new();
    bench.metadata(&METADATA.replace("\"rate_hz\"", "\"tare_samples\": 24, \"rate_hz\""));
    bench.fails(
        INFO,
        1,
        &["dataset.json", "tare_samples = 24", "\"a\" has 24"],
    );
    bench.fails(
        "info data --tare-samples 99",
        2,
        &["--tare-samples", "99", "\"a\" has 24"],
    );
}

#[test]
fn flags_are_blamed_for_what_they_set() {
    let bench = Bench::new();
    bench.fails(
        "info data --joints a,b,a",
        2,
        &["--joints", "\"a\"", "twice"],
    );
    bench.fails("info data --train a,a", 2, &["--train", "twice"]);
    bench.fails("info data --test x", 2, &["--test", "\"x\""]);
    bench.fails("info data --links nope", 2, &["--links", "nope", "link_3"]);
    let types = r#""joint_types": ["prismatic", "prismatic", "prismatic"], "rate_hz""#;
    bench.metadata(&METADATA.replace("\"rate_hz\"", types));
    bench.fails(
        "info data --joints a",
        2,
        &["--joints", "3 types for 1 joints"],
    );
    bench.metadata(METADATA);
    for (flags, part) in [
        (
            "--joints a,b",
            "lists 2 columns, data/seq_a/angles.npy has 3",
        ),
        ("--joints a,b,c", "column 1 of the recording is joint \"a\""),
        ("--joint-types prismatic", "lists 1 columns"),
        ("--joint-types prismatic,revolute,prismatic", "column 2"),
        ("--rate-hz 1e-50", "1e-50 Hz must be from 1e-6 to 1e9 Hz"),
    ] {
        let flag = flags.split(' ').next().unwrap();
        bench.fails(&format!("info data {flags}"), 2, &[flag, part]);
    }
    let arm = r#"<robot name="r"><link name="base"/><link name="tip"/><joint name="j" type="prismatic"><parent link="base"/>
        <child link="tip"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#;
    fs::write(bench.root.join("r.urdf"), arm).unwrap();
    bench.fails(
        "info data --robot r.urdf --joints a,b,c",
        2,
        &["--joints: ./r.urdf: no moving joint 'a'"],
    );
}

#[test]
fn links_named_twice() {
    let bench = Bench::new();
    bench.fails(
        "estimate data --links tip,tip --out a.npz",
        2,
        &["--links", "\"tip\" twice"],
    );
}

#[test]
fn files_of_another_kind() {
    let bench = Bench::new();
    for name in ["a.csv", "a.npy", "a.npz", "a.ply"] {
        fs::write(bench.root.join(name), "a").unwrap();
        for line in [format!("info {name}"), format!("view {name} --out a.html")] {
            bench.fails(&line, 1, &[name]);
        }
    }
}

#[test]
fn packages_without_a_folder() {
    let bench = Bench::new();
    let urdf = r#"<robot name="r"><link name="a"><collision><geometry>
        <mesh filename="package://arm/m/a.stl"/></geometry></collision></link></robot>"#;
    fs::write(bench.root.join("r.urdf"), urdf).unwrap();
    bench.fails(
        "info data --robot r.urdf",
        1,
        &["r.urdf", "package://arm/m/a.stl", "--package arm=PATH"],
    );
    bench.fails(
        "info data --robot r.urdf --package arm=.",
        1,
        &["m/a.stl", "cannot read"],
    );
    bench.fails("info data --package arm", 2, &["--package", "NAME=PATH"]);
}

#[test]
fn meshes_without_area_are_named() {
    let bench = Bench::new();
    let mut urdf = r#"<robot name="r"><link name="l0"/>"#.to_owned();
    let flat = r#"<collision><geometry><mesh filename="flat.obj"/></geometry></collision>"#;
    for (joint, collision) in [(1, ""), (2, ""), (3, flat)] {
        let parent = joint - 1;
        urdf += &format!(
            r#"<link name="l{joint}">{collision}</link><joint name="j{joint}" type="continuous">
            <parent link="l{parent}"/><child link="l{joint}"/><axis xyz="0 0 1"/></joint>"#
        );
    }
    fs::write(bench.root.join("r.urdf"), urdf + "</robot>").unwrap();
    fs::write(
        bench.root.join("flat.obj"),
        "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
    )
    .unwrap();
    let words = ["flat.obj of link \"l3\"", "no area", "check its units"];
    bench.fails("info data --robot r.urdf", 1, &words);
}

#[test]
fn robots_that_cannot_move() {
    let bench = Bench::new();
    let urdf = r#"<robot name="rock"><link name="a"/></robot>"#;
    fs::write(bench.root.join("r.urdf"), urdf).unwrap();
    bench.fails("info data --robot r.urdf", 1, &["rock", "no moving joints"]);
    let urdf = r#"<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="floating">
        <parent link="a"/><child link="b"/></joint></robot>"#;
    fs::write(bench.root.join("r.urdf"), urdf).unwrap();
    bench.fails(
        "info data --robot r.urdf",
        1,
        &["r.urdf", "'j'", "floating"],
    );
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
    bench.fails(
        "estimate data --sequences a,zz",
        2,
        &["--sequences", "\"zz\"", "a, b, c"],
    );
    bench.metadata("{ nonsense");
    bench.fails(INFO, 1, &["dataset.json line 1"]);
    bench.metadata(&format!("\u{feff}{METADATA}"));
    bench.fails(INFO, 1, &["dataset.json line 1", "byte order mark"]);
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

#[test]
fn fields_that_are_no_estimate() {
    let bench = Bench::new();
    let refused = |name: &str, shape: &[usize], data: &[f64], parts: &[&str]| {
        let path = bench.root.join("truth").join(name);
        npy(&path, shape, data);
        for line in ["evaluate data --field truth", "export truth --out a.ply"] {
            bench.fails(line, 1, parts);
        }
        fs::remove_file(path).unwrap();
    };
    let all = |value: f64| vec![value; 160];
    let mut odd = all(2.0);
    odd[7] = 3.0;
    refused("noise_sd.npy", &[160], &all(0.0), &["noise_sd", "0.0"]);
    refused("prior_sd.npy", &[160], &all(-1.0), &["prior_sd", "-1.0"]);
    refused(
        "prior_sd.npy",
        &[160],
        &odd,
        &["prior_sd row 7", "3.0", "2.0"],
    );
    refused("noise_sd.npy", &[160], &all(1e200), &["noise_sd", "1e200"]);
    refused("touched.npy", &[160], &odd, &["touched row 0", "2.0"]);
    refused(
        "touched.npy",
        &[160, 2],
        &vec![0.0; 320],
        &["touched", "2 columns"],
    );
    refused(
        "touched.npy",
        &[3],
        &[0.0; 3],
        &["touched", "3 rows", "160"],
    );
    odd[7] = -3.0;
    refused("K.npy", &[160], &odd, &["truth", "K row 7", "-3.0"]);
    odd[7] = 1e200;
    refused("K.npy", &[160], &odd, &["K row 7", "1e200"]);
    // As a stored field of the recording, too.
    odd[7] = -3.0;
    fs::create_dir(bench.root.join("data/field")).unwrap();
    npy(&bench.root.join("data/field/K.npy"), &[160], &odd);
    fs::copy(
        bench.root.join("data/points.npy"),
        bench.root.join("data/field/points.npy"),
    )
    .unwrap();
    bench.fails("evaluate data", 1, &["K row 7", "-3.0"]);
    // One of other points is told before any other command needs it.
    npy(&bench.root.join("data/field/K.npy"), &[2], &[1.0; 2]);
    npy(
        &bench.root.join("data/field/points.npy"),
        &[2, 3],
        &[0.0; 6],
    );
    let json = bench.ok("info data --json");
    assert!(
        json.contains("the stored field: data: the field has 2 points"),
        "{json}"
    );
}

#[test]
fn huge_coordinates_are_short_in_messages() {
    let bench = Bench::new();
    npy(
        &bench.root.join("truth/points.npy"),
        &[160, 3],
        &[1e300; 480],
    );
    let output = bench.run("evaluate data --field truth");
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("1e300") && error.len() < 500, "{error}");
}

#[test]
fn outputs_never_mix_with_other_files() {
    let bench = Bench::touched();
    let estimate = "estimate touch --prior-sd 10 --noise-sd 1 --out";
    fs::create_dir(bench.root.join("notes")).unwrap();
    fs::write(bench.root.join("notes/a.txt"), "mine").unwrap();
    bench.fails(&format!("{estimate} notes"), 2, &["notes", "a.txt"]);
    bench.fails(&format!("{estimate} touch"), 2, &["touch", "dataset.json"]);
    bench.fails(
        &format!("{estimate} touch/seq_a"),
        2,
        &["seq_a", "other files"],
    );
    assert!(!bench.root.join("touch/K.npy").exists());
    assert_eq!(fs::read_dir(bench.root.join("notes")).unwrap().count(), 1);
    // Arrays of any kind are no field to replace.
    fs::remove_file(bench.root.join("notes/a.txt")).unwrap();
    fs::copy(
        bench.root.join("data/points.npy"),
        bench.root.join("notes/points.npy"),
    )
    .unwrap();
    bench.fails(&format!("{estimate} notes"), 2, &["notes", "points.npy"]);
    bench.ok(&format!("{estimate} folder"));
    bench.ok(&format!("{estimate} folder"));
    // What makes a recording another one, or none.
    for out in ["seq_zz", "camera", "field.npz"] {
        bench.fails(
            &format!("{estimate} touch/{out}"),
            2,
            &["--out", "would change touch"],
        );
    }
    bench.ok("info touch");
    for command in ["simulate", "predict"] {
        let line = format!("{command} touch --field truth --out");
        bench.fails(&format!("{line} notes"), 2, &["notes", "other files"]);
        bench.fails(&format!("{line} touch"), 2, &["touch", "would change"]);
    }
    let before = fs::read(bench.root.join("touch/seq_c/torques.npy")).unwrap();
    bench.fails(
        "predict touch --sequences a,b,c --field truth --out touch",
        2,
        &["would change touch"],
    );
    assert_eq!(
        before,
        fs::read(bench.root.join("touch/seq_c/torques.npy")).unwrap()
    );
}

#[test]
fn names_do_not_command_the_terminal() {
    let bench = Bench::new();
    let name = r#"{"name": "a\u001b[2J\u009b31mb\r", "#;
    bench.metadata(&METADATA.replacen('{', name, 1));
    let shown = bench.ok(INFO);
    assert!(
        shown.contains("a\u{fffd}[2J\u{fffd}31mb\u{fffd}"),
        "{shown:?}"
    );
    assert!(bench.ok("info data --json").contains(r"a\u001b[2J"));
    let output = bench.run("info data --sequences \u{1b}[2J");
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(!error.contains('\u{1b}'), "{error:?}");
    bench.metadata(&METADATA.replace("\"c\"", r#""\u001b[2J""#));
    let output = bench.run(INFO);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(
        !output.status.success() && !error.contains('\u{1b}'),
        "{error:?}"
    );
}

#[test]
fn pictures_of_what_is_not_there() {
    let bench = Bench::new();
    bench.fails(
        "export truth --out a.png --deviation",
        1,
        &["truth: ", "K_std"],
    );
    let array = |name: &str, value| npy(&bench.root.join(name), &[160], &[value; 160]);
    array("truth/K.npy", 1e99);
    bench.fails("export truth --out a.png", 1, &["truth: K row 0 is 1e99"]);
    bench.fails("export truth --out a.mcap", 1, &["row 0 of K ", "1e99"]);
    let plot = "export data --field truth --torques plots";
    let part = "sequence c: row 1 joint stage_x: a predicted torque of ";
    bench.fails(plot, 1, &[part, "check the recording and the field"]);
    array("truth/K.npy", 1.0);
    array("truth/K_std.npy", 1e99);
    let mark = |json: &str| fs::write(bench.root.join("truth/format.json"), json).unwrap();
    mark(r#"{"K_std_unit": "standard_deviation"}"#);
    let deviation = "export truth --deviation --out a.svg";
    bench.fails(deviation, 1, &["truth: K_std row 0 is 1e99"]);
    bench.fails("export truth --out a.mcap", 1, &["row 0 of K_std ", "1e99"]);
    bench.fails(plot, 1, &["joint stage_x: a deviation of the predicted"]);
    let line = "predict data --field truth --out p";
    bench.fails(line, 1, &["K_std of the field", "joint 1: a torque of"]);
    let far = "[[1, 0, 0, 0], [0, 1, 0, 1e200], [0, 0, 1, 0], [0, 0, 0, 1]]";
    mark(&format!("{{\"base_pose\": {far}}}"));
    bench.fails(line, 1, &["truth", "base_pose", "1e200 m, beyond 1e6"]);
    let line = "info data --base-pose 0,0,1e50,0,0,0";
    bench.fails(line, 2, &["--base-pose: ", "1e50 m, beyond 1e6"]);
    bench.fails(
        "export truth --out truth/points.npy/x.png",
        3,
        &["points.npy"],
    );
}

#[cfg(unix)]
#[test]
fn links_and_pipes() {
    use std::os::unix::fs::symlink;
    use std::process::Command;
    let bench = Bench::new();
    let at = |name: &str| bench.root.join("data").join(name);
    // A link that leads nowhere is a file that is lost, not one that was never there.
    for (name, target) in [
        ("seq_gone", "x"),
        ("points.npy", "points.npy"),
        ("camera", "x"),
    ] {
        let kept = fs::read(at(name));
        let _ = fs::remove_file(at(name));
        symlink(target, at(name)).unwrap();
        let output = bench.run(INFO);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && error.contains(name), "{error}");
        fs::remove_file(at(name)).unwrap();
        if let Ok(bytes) = kept {
            fs::write(at(name), bytes).unwrap();
        }
    }
    symlink("x", at("seq_a/time.npy")).unwrap();
    bench.fails(INFO, 3, &["seq_a/time.npy"]);
    fs::remove_file(at("seq_a/time.npy")).unwrap();
    symlink(".", at("seq_self")).unwrap();
    bench.fails(INFO, 1, &["seq_self/angles.npy"]);
    fs::remove_file(at("seq_self")).unwrap();
    // A pipe would wait for ever.
    fs::remove_file(at("seq_a/torques.npy")).unwrap();
    let made = Command::new("mkfifo").arg(at("seq_a/torques.npy")).status();
    assert!(made.unwrap().success());
    bench.fails(INFO, 3, &["seq_a/torques.npy", "pipe"]);
    for flags in ["--config /dev/zero", "--model /dev/zero"] {
        bench.fails(
            &format!("estimate data {flags}"),
            3,
            &["/dev/zero", "device"],
        );
    }
    bench.metadata(&METADATA.replace("cartesian_stage", "/dev/zero"));
    bench.fails(INFO, 3, &["/dev/zero", "device"]);
}

#[cfg(unix)]
#[test]
fn paths_of_any_kind() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let bench = Bench::new();
    for name in ["\u{fc} \u{65e5}".as_bytes(), b"not \xff unicode"] {
        let folder = bench.root.join(OsStr::from_bytes(name));
        fs::rename(bench.root.join("data"), &folder).unwrap();
        let out = bench
            .root
            .join(OsStr::from_bytes(&[name, b" b.npz"].concat()));
        let output = Command::new(env!("CARGO_BIN_EXE_vsf"))
            .args([
                "estimate",
                "--prior-sd=1",
                "--noise-sd=1",
                "--json=out.json",
            ])
            .arg(&folder)
            .arg("--out")
            .arg(&out)
            .current_dir(&bench.root)
            .output()
            .unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{error}");
        assert!(out.is_file());
        let json = fs::read_to_string(bench.root.join("out.json")).unwrap();
        assert!(json.contains(" b.npz"), "{json}");
        fs::rename(&folder, bench.root.join("data")).unwrap();
    }
}

#[test]
fn outputs_that_cannot_be_written() {
    let bench = Bench::touched();
    let estimate = "estimate touch --prior-sd 10 --noise-sd 1";
    fs::create_dir(bench.root.join("a.npz")).unwrap();
    bench.fails(&format!("{estimate} --out a.npz"), 2, &["a.npz", "folder"]);
    bench.fails(
        &format!("{estimate} --out b.npz/"),
        2,
        &["b.npz/", "folder"],
    );
    let long = "a".repeat(300);
    for out in [format!("--out {long}.npz"), format!("--json={long}")] {
        bench.fails(&format!("{estimate} {out}"), 3, &["cannot write", &long]);
    }
    if cfg!(target_os = "linux") {
        bench.fails(
            &format!("{estimate} --out /proc/a.npz"),
            3,
            &["/proc/a.npz"],
        );
        let full = format!("{estimate} --json=/dev/full");
        bench.fails(&full, 3, &["/dev/full"]);
        // What was computed is told all the same.
        let told = bench.run(&full).stdout;
        assert!(String::from_utf8_lossy(&told).contains("touched"));
        for line in ["--help", "--version", "help estimate"] {
            let full = fs::File::options().write(true).open("/dev/full").unwrap();
            let output = Command::new(env!("CARGO_BIN_EXE_vsf"))
                .args(line.split(' '))
                .stdout(full)
                .output()
                .unwrap();
            let error = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(3), "{line}: {error}");
            assert!(error.contains("standard output"), "{line}: {error}");
        }
    }
    if cfg!(target_os = "linux") {
        // A wrong flag is one, whether or not the message about it can be read.
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let mut vsf = Command::new(env!("CARGO_BIN_EXE_vsf"));
        let status = vsf.arg("--nonsense").stderr(full).status().unwrap();
        assert_eq!(status.code(), Some(2));
    }
    let mut locked = fs::metadata(bench.root.join("touch/points.npy"))
        .unwrap()
        .permissions();
    locked.set_readonly(true);
    fs::write(bench.root.join("kept.npz"), "mine").unwrap();
    fs::set_permissions(bench.root.join("kept.npz"), locked).unwrap();
    bench.fails(
        &format!("{estimate} --out kept.npz"),
        3,
        &["kept.npz", "read-only"],
    );
    assert_eq!(fs::read(bench.root.join("kept.npz")).unwrap(), b"mine");
}

/// Without a reader, it would be waited for for ever; with one, it gets all.
#[cfg(target_os = "linux")]
#[test]
fn outputs_to_pipes() {
    let bench = Bench::touched();
    let pipe = bench.root.join("pipe.npz");
    let made = Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let estimate = "estimate touch --prior-sd 40 --noise-sd 0.01";
    let to_pipe = format!("{estimate} --out pipe.npz");
    bench.fails(&to_pipe, 3, &["pipe.npz", "nothing reads"]);
    bench.ok(&format!("{estimate} --out file.npz"));
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || fs::read(pipe).unwrap()
    });
    // Until the reader has come.
    while !bench.run(&to_pipe).status.success() {}
    assert!(reader.join().unwrap() == fs::read(bench.root.join("file.npz")).unwrap());
    // Standard output that is a pipe has no path of its own.
    let told = bench.ok("info touch --json=/dev/stdout -q");
    assert!(told.contains("\"made_by\""), "{told}");
}

/// What is there but cannot be read is not said to be something else.
#[cfg(unix)]
#[test]
fn outputs_that_cannot_be_read() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::touched();
    let at = |name: &str| bench.root.join(name);
    bench.ok("simulate data --field truth --out out");
    fs::remove_file(at("out/dataset.json")).unwrap();
    fs::create_dir(at("out/dataset.json")).unwrap();
    let simulate = "simulate data --field truth --out out";
    bench.fails(simulate, 3, &["cannot read out/dataset.json: "]);

    let close = |name: &str, mode| fs::set_permissions(at(name), fs::Permissions::from_mode(mode));
    let estimate = "estimate touch --prior-sd 10 --noise-sd 1 --out";
    bench.ok(&format!("{estimate} f.npz"));
    fs::create_dir(at("shut")).unwrap();
    close("f.npz", 0o222).unwrap();
    close("shut", 0o333).unwrap();
    if fs::read(at("f.npz")).is_ok() {
        writeln!(
            std::io::stderr(),
            "skipped: permissions, which do not bind this user"
        )
        .unwrap();
        return;
    }
    bench.fails(
        &format!("{estimate} f.npz"),
        3,
        &["cannot read what --out f.npz holds: "],
    );
    for line in [
        &format!("{estimate} shut"),
        "simulate data --field truth --out shut",
    ] {
        bench.fails(line, 3, &["cannot list --out shut: "]);
    }
    close("shut", 0o755).unwrap();
}

/// Positions and velocities that no robot has, though their torques may still be numbers.
#[test]
fn motions_beyond_all_robots() {
    let bench = Bench::new();
    let metadata = METADATA.replacen('{', "{\"torque_kind\": \"measured\", ", 1);
    bench.metadata(&metadata);
    for value in [1e10, -1e100, 1e200, 1e308] {
        let mut velocities = vec![0.0; 3 * ROWS];
        velocities[3 * 7 + 1] = value;
        let path = bench.root.join("data/seq_b/velocities.npy");
        npy(&path, &[ROWS, 3], &velocities);
        let place = "sequence b row 7 joint 2: a velocity of";
        for line in [
            INFO,
            "estimate data --prior-sd 1 --noise-sd 1",
            "diagnose data",
        ] {
            bench.fails(line, 1, &[place, &format!("{value:?} m/s"), "at most 1e9"]);
        }
        fs::remove_file(path).unwrap();
    }
    let mut angles = vec![0.0; 3 * ROWS];
    angles[3 * 9 + 2] = 1e200;
    npy(
        &bench.root.join("data/seq_b/angles.npy"),
        &[ROWS, 3],
        &angles,
    );
    bench.fails(
        INFO,
        1,
        &["sequence b row 9 joint 3: a position of 1e200 m"],
    );
}

/// What is written can be read: of the largest prior and noise that are taken, given alone or together.
#[test]
fn fields_of_the_largest_prior_and_noise() {
    let bench = Bench::touched();
    for flags in [
        "--prior-sd 1e12 --noise-sd 1e12 --smooth-share 1e6 --level-share 1e6",
        "--prior-sd 1e-12 --noise-sd 1e-12",
        "--prior-sd 1e12",
        "--prior-sd 1e-12",
        "--noise-sd 1e12",
        "--noise-sd 1e-12",
    ] {
        bench.ok(&format!("estimate touch {flags} --out f.npz"));
        bench.ok("evaluate touch --field f.npz");
    }
    for (flag, range) in [
        ("--prior-sd 1e100", "1e-12 to 1e12"),
        ("--prior-sd 1e-100", "1e-12 to 1e12"),
        ("--noise-sd 1,1e13,1", "1e-12 to 1e12"),
        ("--smooth-share 1e100", "at most 1e6"),
        ("--level-share 1e7", "at most 1e6"),
    ] {
        let line = format!("estimate touch {flag} --out g.npz");
        bench.fails(&line, 2, &[flag.split(' ').next().unwrap(), range]);
    }
    let line = "simulate data --field truth --out s --noise-sd";
    bench.fails(&format!("{line} 1e10"), 2, &["--noise-sd", "at most 1e9"]);
    bench.ok(&format!("{line} 1e9"));
    bench.ok("info s");
}

/// A path that leads back through a folder to come names what is there.
#[test]
fn outputs_behind_folders_that_do_not_exist() {
    let bench = Bench::touched();
    let before = fs::read(bench.root.join("touch/seq_a/torques.npy")).unwrap();
    let refused = ["--out", "does not exist"];
    for line in [
        "simulate touch --field truth --out nosuch/../touch",
        "predict touch --field truth --out nosuch/../touch",
        "experiment paper touch --out nosuch/../touch",
        "estimate touch --out nosuch/../truth",
        "estimate touch --out nosuch/../f.npz",
    ] {
        bench.fails(line, 3, &refused);
    }
    assert!(!bench.root.join("nosuch").exists());
    let after = fs::read(bench.root.join("touch/seq_a/torques.npy")).unwrap();
    assert_eq!(before, after);
}

/// No recording holds such torques, and none is written that could not be read.
#[test]
fn torques_beyond_any_sensor_are_not_written() {
    let bench = Bench::new();
    npy(&bench.root.join("truth/K.npy"), &[160], &[1e20; 160]);
    for line in ["simulate data", "predict data"] {
        bench.fails(
            &format!("{line} --field truth --out out"),
            1,
            &["field truth", "joint 3: a torque of", "at most 1e12"],
        );
    }
    assert!(!bench.root.join("out").exists());
}

/// Two outputs of one place, or one in the other.
#[test]
fn outputs_of_one_place() {
    let bench = Bench::touched();
    let estimate = "estimate touch --out f.npz --out";
    bench.fails(&format!("{estimate} ./f.npz"), 2, &["--out", "same file"]);
    bench.fails(
        "estimate touch --out folder --out folder/f.npz",
        2,
        &["--out folder", "one lies in the other"],
    );
}

/// Standard output holds no folder.
#[test]
fn outputs_that_are_a_dash() {
    let bench = Bench::touched();
    for line in [
        "estimate touch --out -",
        "simulate data --field truth --out -",
    ] {
        bench.fails(line, 2, &["--out", "standard output"]);
    }
    assert!(!bench.root.join("-").exists());
}

/// Folders of plots and the quick start's, too.
#[test]
fn outputs_of_every_command() {
    let bench = Bench::touched();
    bench.ok("estimate touch --out f.npz");
    let line = "export touch --field f.npz --torques touch/seq_zz";
    bench.fails(line, 2, &["--torques", "would change touch"]);
    bench.ok("info touch");
    fs::create_dir(bench.root.join("vsf-quickstart")).unwrap();
    let line = "--json=vsf-quickstart/field.npz";
    bench.fails(
        line,
        2,
        &["--json vsf-quickstart/field.npz", "one lies in the other"],
    );
}

/// What cannot be written is told before the work.
#[cfg(target_os = "linux")]
#[test]
fn outputs_where_nothing_can_be_written() {
    let bench = Bench::touched();
    let long = "x".repeat(300);
    std::os::unix::fs::symlink("nowhere", bench.root.join("link.npz")).unwrap();
    for (line, part) in [
        ("estimate touch --out /proc/f.npz", "/proc/f.npz"),
        ("diagnose touch --html /proc/a.html", "/proc/a.html"),
        ("experiment paper touch --out /proc/report", "/proc/report"),
        (&format!("view touch --out {long}.html"), "too long"),
        ("estimate touch --out link.npz", "leads nowhere"),
    ] {
        bench.fails(line, 3, &["cannot write", part]);
    }
}

#[cfg(unix)]
#[test]
fn outputs_below_what_is_no_folder() {
    let bench = Bench::touched();
    let file = ["touch/dataset.json", "is no folder"];
    for out in ["f.npz", "folder", "new/f.ply"] {
        let line = format!("estimate touch --out touch/dataset.json/{out}");
        bench.fails(&line, 3, &file);
    }
    bench.fails(
        "simulate data --field truth --out touch/dataset.json/x",
        3,
        &file,
    );
    let line = "estimate touch --out /dev/null/f.npz";
    bench.fails(
        line,
        3,
        &["--out /dev/null/f.npz", "/dev/null is no folder"],
    );
}
