//! The commands end to end on a small recording.

use crate::common;
use common::{Bench, METADATA, ROWS, npy, vsf};
use std::fs;
use std::path::Path;
use std::process::Command;

fn has_keys(json: &str, keys: &[&str]) {
    for key in keys {
        assert!(
            json.contains(&format!("\"{key}\":")),
            "{key} is missing in {json}"
        );
    }
}

/// The number behind the first `"key": `, the first of a list.
fn value(json: &str, key: &str) -> f64 {
    let start = json.find(&format!("\"{key}\": ")).expect(key) + key.len() + 4;
    let text = json[start..].trim_start_matches(['[', ' ', '\n']);
    let end = text.find([',', '\n']).expect(key);
    text[..end].trim().parse().expect(key)
}

#[test]
fn round_trip() {
    let bench = Bench::touched();
    let json = bench.ok("estimate touch --out field.npz --out field.ply --out folder --json");
    has_keys(
        &json,
        &[
            "prior_sd",
            "noise_sd",
            "chosen_by",
            "touched_points",
            "nis_ratio",
            "out",
        ],
    );

    let json =
        bench.ok("evaluate touch --field field.npz --baseline zero,knn,mlp,gp --hidden 4 --json");
    has_keys(
        &json,
        &[
            "mean_error",
            "sd_error",
            "per_sequence",
            "per_joint",
            "samples",
            "unit",
            "baselines",
            "knn",
            "mlp",
            "gp",
        ],
    );
    let (error, zero) = (value(&json, "mean_error"), value(&json, "zero_error"));
    assert!(error < 0.3 * zero, "{error} N against {zero} N");
    // What it has not learned from is a part of what is touched.
    let new = value(&json, "new_places");
    assert!((0.0..1.0).contains(&new), "{new}");
    let text = bench.ok("evaluate touch --field field.npz");
    assert!(text.contains("at new places"), "{text}");
    assert_eq!(value(&json, "samples"), ROWS as f64);
    let folder = bench.ok("evaluate touch --field folder --json");
    assert_eq!(value(&folder, "mean_error"), error);

    // A field without deviations will do, and says so.
    bench.ok("evaluate touch --field truth");
    let error = bench.warned("predict touch --field truth --out certain");
    assert!(error.contains("K_std"), "{error}");
    bench.ok("export touch --field truth --torques certain_plots");

    // Predictions are a recording whose torques the field explains exactly.
    bench.ok("predict touch --field field.npz --out predicted");
    assert!(bench.root.join("predicted/seq_c/torques_sd.npy").is_file());
    let warned = bench.warned("info predicted");
    assert!(!warned.contains("torques_sd"), "{warned}");
    let json = bench.ok("evaluate predicted --field field.npz --json");
    assert!(value(&json, "mean_error") < 1e-9, "{json}");

    bench.ok("export field.npz --out f.png --out f.svg --out f.ply");
    bench.ok("export touch --field field.npz --torques plots --out g.png --deviation");
    bench.ok("export field.npz --out sd.svg --deviation");
    for (file, quantity) in [("f.svg", "stiffness"), ("sd.svg", "standard deviation")] {
        let svg = fs::read_to_string(bench.root.join(file)).unwrap();
        let legend = format!("largest {quantity} along each line of sight");
        assert!(svg.contains(&legend), "{file}");
    }
    for file in [
        "f.png",
        "f.svg",
        "f.ply",
        "g.png",
        "plots/torques_c.svg",
        "field.ply",
    ] {
        assert!(
            fs::metadata(bench.root.join(file)).unwrap().len() > 500,
            "{file}"
        );
    }
}

/// What is made from a recording is one of its own: it can be moved, and says where it comes from.
#[test]
fn made_recordings_travel() {
    let bench = Bench::new();
    let root = &bench.root;
    for folder in ["robots", "lab", "data/camera"] {
        fs::create_dir(root.join(folder)).unwrap();
    }
    let axes: String = [("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")]
        .iter()
        .zip(
            ["frame", "beam", "cart"]
                .iter()
                .zip(["beam", "cart", "tip"]),
        )
        .map(|((name, axis), (parent, child))| {
            format!(
                "<joint name='{name}' type='prismatic'><parent link='{parent}'/>\
                 <child link='{child}'/><axis xyz='{axis}'/></joint>"
            )
        })
        .collect();
    let urdf = format!(
        "<robot name='stage'><link name='frame'/><link name='beam'/><link name='cart'/>\
         <link name='tip'><collision><origin xyz='0 0 0.01'/><geometry>\
         <mesh filename='package://lab/tip.obj'/></geometry></collision></link>{axes}</robot>"
    );
    fs::write(root.join("robots/stage.urdf"), urdf).unwrap();
    fs::write(root.join("lab/tip.obj"), common::BOX).unwrap();
    let view = concat!(env!("CARGO_MANIFEST_DIR"), "/data/orange_tree/camera");
    for name in ["camera.json", "color.png", "depth.png"] {
        let to = root.join("data/camera").join(name);
        fs::copy(format!("{view}/{name}"), to).unwrap();
    }
    bench.metadata(&METADATA.replace("cartesian_stage", "../robots/stage.urdf"));

    bench.ok("simulate data --field truth --package lab=lab --out touch");
    bench.ok("predict touch --field truth --out predicted");
    fs::create_dir(root.join("away")).unwrap();
    for made in ["touch", "predicted"] {
        fs::rename(root.join(made), root.join("away").join(made)).unwrap();
    }
    for gone in ["robots", "lab", "data"] {
        fs::remove_dir_all(root.join(gone)).unwrap();
    }
    for (made, name, how) in [
        (
            "away/touch",
            "data, simulated",
            "\\\"data\\\": torques simulated",
        ),
        (
            "away/predicted",
            "data, simulated, predicted",
            "torques predicted by the stiffness field truth.",
        ),
    ] {
        let json = bench.ok(&format!("info {made} --json"));
        // The camera is of another scene.
        let elsewhere = "of the surface that is seen";
        let camera = "\"camera\": true";
        for part in [&format!("\"name\": \"{name}\""), how, camera, elsewhere] {
            assert!(json.contains(part), "{part} is not in {json}");
        }
        let json = bench.ok(&format!(
            "evaluate {made} --field truth --sequences c --json"
        ));
        assert!(value(&json, "mean_error") < 1e-9, "{json}");
        assert!(value(&json, "zero_error") > 1e-3, "{json}");
    }
}

#[test]
fn a_simulation_that_touches_nothing_is_warned_of() {
    let bench = Bench::new();
    let far = bench.warned("simulate data --field truth --base-pose 5,0,0,0,0,0 --out far");
    assert!(far.contains("touches none of the"), "{far}");
    let near = bench.warned("simulate data --field truth --out near");
    assert!(!near.contains("touches none"), "{near}");
}

/// More neighbors than there are samples are all of them.
#[test]
fn neighbors_without_end() {
    let bench = Bench::touched();
    let errors = ["1000000", "18446744073709551615"].map(|n| {
        let json = bench.ok(&format!(
            "evaluate touch --baseline knn --neighbors {n} --json"
        ));
        value(&json, "mean_error")
    });
    assert_eq!(errors[0], errors[1]);
}

#[test]
fn simulation_repeats_with_its_seed() {
    let bench = Bench::touched();
    let read = |folder: &str| fs::read(bench.root.join(folder).join("seq_a/torques.npy")).unwrap();
    bench.ok("simulate data --field truth --out again --noise-sd 0.002 --seed 3");
    bench.ok("simulate data --field truth --out other --noise-sd 0.002 --seed 4");
    assert_eq!(read("touch"), read("again"));
    assert_ne!(read("touch"), read("other"));
}

/// The report says what was given and what was chosen.
#[test]
fn given_or_chosen() {
    let bench = Bench::touched();
    let prior = "prior       N(0, 50.00²) N/m, as given";
    let noise = "N, as given";
    let chosen = "chosen on held-out readings";
    let likelihood = "chosen by marginal likelihood";
    for (flags, prior, noise, given, chosen_by) in [
        ("", chosen, chosen, "\"given\": [],", "held-out"),
        (
            "--hyper likelihood",
            likelihood,
            likelihood,
            "\"given\": [],",
            "likelihood",
        ),
        (
            "--prior-sd 50",
            prior,
            "N, its ratio to prior_sd chosen on",
            "\"prior_sd\"",
            "held-out",
        ),
        (
            "--noise-sd 0.01",
            "N/m, its ratio to noise_sd chosen on",
            noise,
            "\"noise_sd\"",
            "held-out",
        ),
        (
            "--prior-sd 50 --noise-sd 0.01",
            prior,
            noise,
            "\"noise_sd\"",
            "given",
        ),
    ] {
        let text = bench.ok(&format!("estimate touch {flags} --json=a.json"));
        let line = |start: &str| text.lines().find(|l| l.trim().starts_with(start)).unwrap();
        assert!(line("prior ").contains(prior), "{flags}: {text}");
        assert!(line("noise sd").contains(noise), "{flags}: {text}");
        let json = fs::read_to_string(bench.root.join("a.json")).unwrap();
        let (_, list) = json.split_once("\"given\": ").unwrap();
        let list = format!("\"given\": {}", &list[..=list.find(']').unwrap() + 1]);
        assert!(list.contains(given), "{list}");
        assert!(json.contains(&format!("\"chosen_by\": \"{chosen_by}\"")));
    }
}

#[test]
fn flag_before_file_before_preset() {
    let bench = Bench::touched();
    fs::write(bench.root.join("vsf.toml"), "prior-sd = 7\nreplay = 3\n").unwrap();
    let with = |flags: &str| bench.ok(&format!("estimate touch --preset paper {flags} --json"));
    // Another estimator keeps its own replays, or none.
    for estimator in ["batch", "exact", "dual", "replay", "diagonal", "updated"] {
        with(&format!("--estimator {estimator}"));
    }
    let json = with("");
    assert_eq!(with("--estimator printed"), json);
    assert_eq!(
        (value(&json, "prior_sd"), value(&json, "noise_sd")),
        (0.1, 1.0)
    );
    assert!(json.contains("\"printed\""), "{json}");
    let json = with("--config vsf.toml --estimator replay");
    assert_eq!(
        (value(&json, "prior_sd"), value(&json, "noise_sd")),
        (7.0, 1.0)
    );
    let json = with("--config vsf.toml --estimator replay --prior-sd 9");
    assert_eq!(value(&json, "prior_sd"), 9.0);
}

#[test]
fn files_set_what_flags_set() {
    let bench = Bench::new();
    let file = "threshold = 0.003\nprior-sd = 5\nnoise-sd = 2\n\
        [simulate]\nout = \"by file\"\nnoise-sd = 0.05\nseed = 7\n\
        [evaluate]\nbaseline = [\"zero\"]\nneighbors = 3\n\
        [export]\ndeviation = true\nout = [\"a.ply\", \"b.ply\"]\n\
        [estimate]\nprior-sd = 6\n";
    fs::write(bench.root.join("vsf.toml"), file).unwrap();
    // The noise of a simulation is its own, not the one that an estimate assumes.
    let json = bench.ok("simulate data --field truth --config vsf.toml --json");
    assert_eq!(
        (value(&json, "noise_sd"), value(&json, "seed")),
        (0.05, 7.0)
    );
    assert!(bench.root.join("by file/seq_a/torques.npy").is_file());
    let json =
        bench.ok("simulate data --field truth --config vsf.toml --noise-sd 0 --out x --json");
    assert_eq!((value(&json, "noise_sd"), value(&json, "seed")), (0.0, 7.0));
    // The table of a command goes before the top.
    let json = bench.ok("estimate x --config vsf.toml --preset paper --json");
    assert_eq!(
        (value(&json, "prior_sd"), value(&json, "noise_sd")),
        (6.0, 2.0)
    );
    let json = bench.ok("evaluate x --config vsf.toml --json");
    assert!(json.contains("\"predictor\": \"zero\""), "{json}");
    let warned = bench.warned("export truth --config vsf.toml");
    assert!(warned.contains("--deviation is of pictures"), "{warned}");
    assert!(bench.root.join("b.ply").is_file());

    for (text, parts) in [
        ("\nneighbors = 3", ["line 2", "neighbors"]),
        ("[evaluate]\nneighbours = 3", ["line 2", "neighbors"]),
        (
            "[evaluate]\nneighbors = 0",
            ["line 2", "must be a whole number >= 1"],
        ),
        (
            "[bench]\npoints = 3",
            ["[bench]", "info, estimate, live, predict"],
        ),
        ("threshold = nan", ["line 1", "length > 0"]),
        ("links = []", ["links", "not empty"]),
        // What only the command can tell.
        ("\ngravity = [0, 0]", ["line 2", "--gravity takes 3"]),
        ("links = \"nope\"", ["line 1", "--links: no link 'nope'"]),
        ("threshold = [1, 2]", ["line 1", "--threshold"]),
        ("[export]\ndeviation = 3", ["line 2", "--deviation"]),
        ("threshold = 1\nthreshold = 2", ["line 2", "duplicate"]),
        ("json = \"a.json\"", ["unknown key", "json"]),
    ] {
        fs::write(bench.root.join("vsf.toml"), text).unwrap();
        let parts = ["vsf.toml", parts[0], parts[1]];
        bench.fails("info data --config vsf.toml", 2, &parts);
    }
}

#[test]
fn numbers_out_of_range_name_their_flag() {
    let bench = Bench::new();
    for (line, flag) in [
        ("info data --rate-hz=nan", "--rate-hz"),
        ("info data --rate-hz=-1", "--rate-hz"),
        ("info data --gravity=0,0,inf", "--gravity"),
        ("info data --gravity=0,0,-9810", "--gravity"),
        ("info data --base-pose=0,0,0,180,0,0", "--base-pose"),
        ("info data --base-pose=0,0,0,0,0,nan", "--base-pose"),
        ("info data --friction=-0.1", "--friction"),
        ("info data --slip-step=0", "--slip-step"),
        ("info data --padding=1e300", "--padding"),
        ("info data --padding=-1", "padding"),
        ("info data --subdivision=9", "--subdivision"),
        ("info data --grid-resolution=0", "--grid-resolution"),
        ("info data --grid-resolution=1e90", "--grid-resolution"),
        ("info data --threshold=1e-300", "from 1e-9 to 1 m"),
        (
            "evaluate data --baseline=mlp --hidden=18446744073709551615",
            "--hidden",
        ),
        ("experiment blind --cases=18446744073709551615", "--cases"),
        ("estimate data --prior-sd=1e200", "--prior-sd"),
        ("evaluate data --neighbors=0", "--neighbors"),
        ("evaluate data --gp-samples=20001", "--gp-samples"),
        ("estimate data --replay=99999999999", "--replay"),
        ("bench --replay=99999999999", "--replay"),
        ("export truth --out a.ply --full-scale=0", "--full-scale"),
        (
            "simulate data --field truth --out x --noise-sd=-1",
            "--noise-sd",
        ),
    ] {
        bench.fails(line, 2, &[flag]);
    }
}

#[test]
fn usage_errors() {
    let bench = Bench::new();
    fs::write(bench.root.join("bad.toml"), "threshhold = 0.1\n").unwrap();
    bench.fails(
        "estimate data --config bad.toml",
        2,
        &["bad.toml", "threshhold"],
    );
    fs::write(bench.root.join("bad.toml"), "\nthreshold = \"wide\"\n").unwrap();
    bench.fails("estimate data --config bad.toml", 2, &["bad.toml line 2"]);
    bench.fails(
        "estimate data --config none.toml",
        1,
        &["none.toml", "no such"],
    );
    bench.fails(
        "estimate data --model none.json",
        1,
        &["none.json", "no such"],
    );
    bench.fails("estimate data --threshold -1", 2, &["threshold"]);
    bench.ok("estimate data --estimator dual --replay 5 --seed 3");
    for flag in ["--replay-variance keep", "--clear-replay"] {
        for estimator in ["dual", "exact", "batch", "diagonal"] {
            let name = flag.split(' ').next().unwrap();
            let line = format!("estimate data --estimator {estimator} {flag}");
            bench.fails(&line, 2, &[name, estimator, "choose `replay`"]);
        }
    }
    bench.ok("estimate data --estimator replay --robust huber");
    bench.ok("estimate data --estimator exact --robust student-t --replay 0");
    bench.fails(
        "estimate data --robust huber",
        2,
        &["--robust", "`batch`", "choose `exact`"],
    );
    for line in [
        "estimate data --replay 5",
        "estimate data --estimator exact --replay 5",
    ] {
        bench.fails(line, 2, &["--replay", "choose `dual`"]);
    }
    bench.fails("estimate data --prior-sd 0 --noise-sd 1", 2, &["prior-sd"]);
    let all = [".npz", ".ply", "folder", "`vsf export`", ".png", ".svg"];
    for line in ["estimate data --out a.jpg", "export truth --out a.jpg"] {
        bench.fails(line, 2, &all);
    }
    bench.fails("estimate data --out a.png", 2, &["export", ".npz", ".ply"]);
    bench.fails("estimate data --gravity 1,2", 2, &["gravity", "3 numbers"]);
    bench.fails("evaluate data", 2, &["--field"]);
    bench.fails("nonsense", 2, &["nonsense"]);
    bench.fails(
        "simulate data --field truth --out truth/K.npy/x",
        3,
        &["K.npy"],
    );
    for points in ["0", "1000000000000"] {
        bench.fails(&format!("bench --points {points}"), 2, &["--points"]);
    }
    bench.fails(
        "estimate data --out a.npz --json=a.npz",
        2,
        &["--json", "--out"],
    );
    bench.fails(
        "estimate data --preset paper --estimator batch --replay 5",
        2,
        &["--replay", "`batch` has no replay"],
    );
    bench.fails(
        "estimate data --estimator exact --seed 3",
        2,
        &["--seed", "`exact` has no random draws"],
    );
    bench.fails(
        "estimate data --preset paper --smooth-length 0.1",
        2,
        &["--smooth-length", "no smooth part without a share above 0"],
    );
    bench.fails(
        "evaluate data --field truth --baseline gp --gp-samples 1",
        2,
        &["--gp-samples"],
    );
    for flag in ["--sequences a", "--field truth", "--torques x"] {
        let line = format!("export truth --out a.ply {flag}");
        bench.fails(&line, 2, &["needs a recording", "truth"]);
    }
    bench.fails(
        "export data --out a.mcap --sequences a",
        2,
        &["--sequences", "--torques"],
    );
    bench.fails("simulate data --out data", 2, &["would change data"]);
    bench.fails("simulate data --out data/seq_1", 2, &["data/seq_1"]);
    bench.fails("estimate data --noise-sd=-1", 2, &["--noise-sd"]);
    bench.fails(
        "info data --json=none/a.json",
        3,
        &["none/a.json", "folder"],
    );
    bench.fails("info data --json=data", 3, &["data", "file"]);
    bench.fails(
        "export truth --out a.ply --json=a.ply",
        2,
        &["--json", "--out"],
    );
}

#[test]
fn json_to_a_file_and_quiet() {
    let bench = Bench::new();
    let text = bench.ok("info data --json=info.json");
    assert!(text.contains("cartesian_stage"));
    let json = fs::read_to_string(bench.root.join("info.json")).unwrap();
    has_keys(
        &json,
        &[
            "name",
            "joints",
            "points",
            "sequences",
            "contact_samples",
            "warnings",
        ],
    );
    assert_eq!(bench.ok("info data --quiet"), "");
    assert_eq!(bench.ok("info data --json=-"), json);
    assert!(!bench.root.join("-").exists());
    let json = bench.ok("bench --points 1000 --replay 1 --soak 0.002 --json");
    has_keys(
        &json,
        &[
            "rate_hz",
            "steps",
            "late",
            "resident_start_mb",
            "resident_end_mb",
            "tenths",
            "p99_ms",
            "max_ms",
            "resident_mb",
        ],
    );
    bench.fails("bench --soak 1 --steps 4", 2, &["--soak", "--steps"]);
    bench.fails(
        "bench --points 1 --steps 4",
        2,
        &["--points 1", "without contact"],
    );
    bench.ok("bench --points 1000 --steps 4 --estimator dual");
    bench.ok("bench --points 1000 --soak 0.001 --estimator dual");
    let json = bench.ok("bench --points 1000 --steps 4 --json");
    has_keys(
        &json,
        &[
            "steps_per_second",
            "p99_ms",
            "contacts",
            "kinematics",
            "update",
            "median_ms",
        ],
    );
}

/// A file name may follow `--json`; what was meant as input or command is told, and not written to.
#[test]
fn json_before_the_input() {
    let bench = Bench::new();
    for line in [
        "info --json data",
        "--json info data",
        "--json info",
        "experiment priors --json data",
        "export --json truth --out a.ply",
    ] {
        bench.fails(line, 2, &["--json", "--json=FILE"]);
    }
    assert!(!bench.root.join("info").exists());
    for line in [
        "info data --json a.json",
        "info --json=b.json data",
        "--json c.json info data",
    ] {
        bench.ok(line);
    }
    for file in ["a.json", "b.json", "c.json"] {
        assert!(bench.root.join(file).is_file(), "{file}");
    }
    // Another flag that is missing is no fault of --json.
    bench.fails("simulate data --json d.json", 2, &["--out"]);
}

#[test]
fn quick_start() {
    let folder = tempfile::tempdir().unwrap();
    let output = vsf(folder.path(), "--json=result.json");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.contains("stiffness field") && text.contains("zero torque"),
        "{text}"
    );
    for file in [
        "field.npz",
        "field.ply",
        "field.png",
        "torques.svg",
        "recording/dataset.json",
    ] {
        let path = folder.path().join("vsf-quickstart").join(file);
        assert!(fs::metadata(path).unwrap().len() > 500, "{file}");
    }
    let json = fs::read_to_string(folder.path().join("result.json")).unwrap();
    let field = value(&json, "mean_error");
    assert!(field < 0.5 * value(&json, "zero_error"), "{json}");
}

#[test]
fn priors_and_noise_that_no_numbers_hold_name_their_flags() {
    let bench = Bench::new();
    let recording = concat!(env!("CARGO_MANIFEST_DIR"), "/data/orange_tree");
    let line = |estimator: &str| {
        format!(
            "estimate {recording} --train 000 --test 007 --subdivision 1 --estimator {estimator} \
             --prior-sd 1e12 --noise-sd 1e-12"
        )
    };
    for estimator in ["exact", "dual", "diagonal"] {
        let flags = ["--prior-sd and --noise-sd", "further apart"];
        bench.fails(&line(estimator), 2, &flags);
    }
    bench.ok(&line("batch"));
}

#[test]
fn the_camera_forms_the_prior() {
    let bench = Bench::touched();
    bench.fails("estimate touch --vision level", 1, &["camera/"]);

    let recording = concat!(env!("CARGO_MANIFEST_DIR"), "/data/orange_tree");
    let both = "--train 000,004 --test 007 --subdivision 1";
    let check = |vision: &str| {
        let out = format!("{vision}.npz");
        let json = bench.ok(&format!(
            "estimate {recording} {both} --vision {vision} --prior-sd 5 --noise-sd 0.5 --out {out} --json"
        ));
        has_keys(&json, &["vision", "vision_share", "vision_candidates"]);
        let tried = json.matches("\"share\":").count();
        assert_eq!(tried, if vision == "none" { 0 } else { 3 }, "{json}");
        let json = bench.ok(&format!("evaluate {recording} {both} --field {out} --json"));
        let (error, zero) = (value(&json, "mean_error"), value(&json, "zero_error"));
        assert!(
            error < 0.7 * zero,
            "{vision}: {error} N m against {zero} N m"
        );
    };
    for vision in ["none", "level", "knn", "ridge"] {
        check(vision);
    }
}

/// Fields of other objects say how stiff a new one is by how it looks.
#[test]
fn other_objects_form_the_prior() {
    let bench = Bench::touched();
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    let known = "--prior-sd 5 --noise-sd 0.5 --subdivision 1";
    for object in ["orange_tree", "orange_tree_partial"] {
        let few = if object == "orange_tree" {
            "000"
        } else {
            "000,001"
        };
        bench.ok(&format!(
            "estimate {data}/{object} {known} --sequences {few} --out {object}.npz"
        ));
    }
    let objects = ["orange_tree", "orange_tree_partial"].map(|o| format!("{data}/{o}={o}.npz"));
    let objects = objects.join(" ");
    let new = format!("{data}/orange_tree_no");
    let error = |vision: &str| {
        let json = bench.ok(&format!(
            "estimate {new} {known} --vision {vision} --out new.npz --json"
        ));
        assert!(
            json.contains(&format!("\"vision\": \"{vision}\"")),
            "{json}"
        );
        let tried = json.matches("\"share\":").count();
        assert_eq!(tried, if vision == "none" { 0 } else { 3 }, "{json}");
        let json = bench.ok(&format!(
            "evaluate {new} --subdivision 1 --field new.npz --json"
        ));
        value(&json, "mean_error")
    };
    let blind = error("none");
    for regressor in ["knn", "gp"] {
        let json = bench.ok(&format!(
            "learn {objects} --regressor {regressor} --out looks.json --json"
        ));
        assert_eq!(value(&json, "objects"), 2.0);
        assert!(value(&json, "points") > 50.0, "{json}");
        let seen = error("looks.json");
        assert!(
            seen < 0.9 * blind,
            "{regressor}: {seen} N m, {blind} N m by touch"
        );
    }
    // Of the objects that it was learned from.
    for (of, told) in [("orange_tree_no", false), ("orange_tree", true)] {
        let line = format!("estimate {data}/{of} --vision looks.json --out told.npz");
        let warning = bench.warned(&line);
        assert_eq!(warning.contains("of this name"), told, "{of}: {warning}");
    }
    // The file is an input.
    let line = format!("estimate {data}/orange_tree_no --vision looks.json --json=./looks.json");
    bench.fails(&line, 2, &["--json", "looks.json"]);
    bench.fails(
        "estimate touch --vision none.json",
        2,
        &["--vision", "level"],
    );
    fs::write(bench.root.join("cut.json"), "{").unwrap();
    bench.fails("estimate touch --vision cut.json", 1, &["cut.json"]);
    bench.fails("learn touch=truth --out a.json", 1, &["touch", "camera/"]);
    fs::write(bench.root.join("mine.json"), "{}").unwrap();
    bench.fails(
        "learn touch=truth --out mine.json",
        2,
        &["--out mine.json", "something else"],
    );
    let line = format!("learn {data}/orange_tree=truth --out a.json");
    bench.fails(&line, 1, &["orange_tree", "the recording"]);
    let (own, other) = (
        format!("{data}/orange_tree/points.npy"),
        bench.root.join("other"),
    );
    fs::create_dir(&other).unwrap();
    let mut points = fs::read(own).unwrap();
    let n = (points.len() - 128) / 12;
    let last = points.len() - 4;
    points[last..].copy_from_slice(&9.0_f32.to_le_bytes());
    fs::write(other.join("points.npy"), points).unwrap();
    npy(&other.join("K.npy"), &[n], &vec![1.0; n]);
    let line = format!("learn {data}/orange_tree=other --out a.json");
    bench.fails(&line, 1, &["other", "belongs to other points"]);
    bench.fails(
        "learn touch=truth touch=field --out a.json",
        2,
        &["touch is given twice"],
    );
    bench.fails("learn data=truth --out a.npy", 2, &["--out", ".json"]);
    bench.fails(
        &format!("learn {data}/orange_tree --out a.json"),
        2,
        &["orange_tree=FIELD is required"],
    );
    bench.fails(
        "learn touch=field --out touch/a.json",
        2,
        &["--out", "touch"],
    );
    let nowhere = "error: nowhere: no such data set folder";
    bench.fails("learn nowhere=truth --out a.json", 1, &[nowhere]);
    bench.fails("learn --out a.json", 2, &["RECORDING"]);
    assert!(!bench.root.join("a.json").exists());
}

/// What is read is not written over, however the path is spelled.
#[test]
fn json_never_replaces_an_input() {
    let bench = Bench::touched();
    bench.ok("estimate touch --out field.npz");
    let before = fs::read(bench.root.join("field.npz")).unwrap();
    for command in [
        "estimate touch --out other.npz --json=./other.npz",
        "evaluate touch --field field.npz --json=./field.npz",
        "info touch --json=touch/dataset.json",
    ] {
        let out = bench.run(command);
        assert_eq!(out.status.code(), Some(2), "{command}");
    }
    assert!(fs::read(bench.root.join("field.npz")).unwrap() == before);
    bench.ok("info touch");

    fs::write(bench.root.join("c.toml"), "threshold = 0.002\n").unwrap();
    let urdf = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/orange_tree/robot.urdf");
    fs::copy(urdf, bench.root.join("r.urdf")).unwrap();
    for (line, kept) in [
        ("info touch --config c.toml --json=c.toml", "c.toml"),
        (
            "view touch --config c.toml --out v.html --json=c.toml",
            "c.toml",
        ),
        ("info touch --robot r.urdf --json=./r.urdf", "r.urdf"),
        ("export field.npz --out f.ply --json=field.npz", "field.npz"),
        (
            "experiment table1 nowhere touch --json=touch/dataset.json",
            "touch",
        ),
    ] {
        bench.fails(line, 2, &["--json", "holds something else", kept]);
    }
    // New files, and results of before, in the place of what is read or in it.
    bench.ok("diagnose touch --json=report.json");
    for (line, kept) in [
        ("info touch --json=touch/new.json", "touch"),
        (
            "experiment table1 nowhere touch --json=touch/new.json",
            "touch",
        ),
        (
            "view report.json --out v.html --json=report.json",
            "report.json",
        ),
    ] {
        bench.fails(line, 2, &["--json", "would change", kept]);
    }
    // Nor what is written beside it, which is told before the work.
    for command in ["predict", "simulate"] {
        let line = format!("{command} touch --field field.npz --out p9 --json=p9");
        bench.fails(&line, 2, &["--json", "--out", "same file"]);
        assert!(!bench.root.join("p9").exists());
    }
}

/// Stamps may be those of a clock.
#[test]
fn torques_of_any_time_are_drawn() {
    let bench = Bench::touched();
    let time: Vec<f64> = (0..ROWS).map(|k| 1.7e9 + 0.02 * k as f64).collect();
    npy(&bench.root.join("touch/seq_c/time.npy"), &[ROWS], &time);
    bench.ok("export touch --field truth --torques plots");
    let svg = fs::read_to_string(bench.root.join("plots/torques_c.svg")).unwrap();
    assert!(svg.contains("0.4") && !svg.contains("1700000000"));
}

/// A field predicts through the contact that it was estimated with, and says where flags tell otherwise.
#[test]
fn a_field_brings_its_contact() {
    let bench = Bench::touched();
    let text = bench.ok("estimate touch --out field.npz --threshold 0.003 --subdivision 1");
    assert!(text.contains("threshold 3.000 mm"), "{text}");
    bench.ok("export field.npz --out folder");
    let error = |field: &str, flags: &str| {
        let line = format!("evaluate touch --field {field} {flags} --json");
        let run = bench.run(&line);
        assert!(run.status.success(), "{line}");
        let warned = String::from_utf8_lossy(&run.stderr).into_owned();
        let json = String::from_utf8_lossy(&run.stdout);
        (value(&json, "mean_error"), warned)
    };
    let (own, quiet) = error("field.npz", "");
    let (same, still) = error("field.npz", "--threshold 0.003 --subdivision 1");
    let (other, told) = error("field.npz", "--threshold 0.001");
    assert_eq!(own, same);
    assert!(other > own, "{other} against {own}");
    for silent in [&quiet, &still] {
        assert!(!silent.contains("was estimated with"), "{silent}");
    }
    let says = "field.npz: the field was estimated with --threshold 0.003, not 0.001;";
    assert!(told.contains(says), "{told}");
    assert!(told.matches("was estimated with").count() == 1, "{told}");
    assert_eq!(error("folder", "").0, own);

    // Fields that say nothing, as those of other programs, are taken through the default contact.
    let (plain, quiet) = error("truth", "");
    assert_eq!(plain, error("truth", "--threshold 0.002").0);
    assert!(!quiet.contains("was estimated with"), "{quiet}");

    // A finer slip step may slip as far.
    bench.ok("estimate touch --out fine.npz --slip-step 0.00001");
    let (_, told) = error("fine.npz", "--slip-step 0.0001");
    let says = "--slip-step 0.00001 --max-slip-iterations 2000, not 0.0001 and 200;";
    assert!(told.contains(says), "{told}");

    // The only link that can touch is all of them.
    bench.ok("estimate touch --out tip.npz --links link_3");
    for (field, flags) in [("tip.npz", ""), ("field.npz", "--links link_3")] {
        let (_, quiet) = error(field, flags);
        assert!(!quiet.contains("was estimated with"), "{quiet}");
    }
}

/// The recording was simulated with a contact threshold of 2 mm.
#[test]
fn the_threshold_is_chosen_on_held_out_touches() {
    let bench = Bench::touched();
    let text = bench.ok("estimate touch --thresholds 0.006,0.002 --json=a.json");
    assert!(text.contains("threshold 2.000 mm"), "{text}");
    assert!(
        text.contains("chosen on held-out readings: 6.000 mm"),
        "{text}"
    );
    let json = fs::read_to_string(bench.root.join("a.json")).unwrap();
    assert_eq!(value(&json, "threshold"), 0.002);
    let (_, tried) = json.split_once("\"thresholds\": ").unwrap();
    let (first, second) = tried[2..].split_once('}').unwrap();
    assert!(value(first, "error") > value(second, "error"), "{tried}");
    // As with that threshold alone.
    let alone = bench.ok("estimate touch --threshold 0.002 --json");
    for key in ["prior_sd", "noise_sd", "mean_stiffness"] {
        assert_eq!(value(&json, key), value(&alone, key), "{key}");
    }
    // Those to compare go before one of a preset or a file.
    fs::write(bench.root.join("one.toml"), "threshold = 0.003\n").unwrap();
    for further in ["--preset paper", "--config one.toml"] {
        let text = bench.ok(&format!(
            "estimate touch --thresholds 0.006,0.002 {further}"
        ));
        assert!(text.contains("readings: 6.000 mm"), "{further}: {text}");
    }
    for (flags, says) in [
        ("--threshold 0.002", "--threshold"),
        ("--hyper likelihood", "held-out"),
    ] {
        let line = format!("estimate touch --thresholds 0.002,0.006 {flags}");
        bench.fails(&line, 2, &["--thresholds", says]);
    }
    bench.fails("estimate touch --thresholds 0.002,-1", 2, &["--thresholds"]);
}

/// Where nothing says which threshold, the one that suits the points' spacing is compared with closer ones, by four touches.
#[test]
fn closer_thresholds_are_compared() {
    let bench = Bench::new();
    bench.ok("simulate data --field truth --out touch --threshold 0.0008 --noise-sd 0.002");
    let path = bench.root.join("touch/dataset.json");
    let known = fs::read_to_string(&path).unwrap();
    let with_touches = |starts: &[usize]| {
        let mut metadata: serde_json::Value = serde_json::from_str(&known).unwrap();
        let object = metadata.as_object_mut().unwrap();
        object.remove("contact_parameters");
        let starts = serde_json::json!({ "a": starts, "b": starts });
        object.insert("touch_starts".to_owned(), starts);
        fs::write(&path, metadata.to_string()).unwrap();
    };
    let estimate = |flags: &str| {
        let json = bench.ok(&format!("estimate touch --out field.npz --json{flags}"));
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let compared = json["thresholds"].as_array().unwrap().iter();
        let compared: Vec<f64> = compared.map(|t| t["threshold"].as_f64().unwrap()).collect();
        (json["threshold"].as_f64().unwrap(), compared)
    };
    with_touches(&[0]);
    assert_eq!(estimate(""), (0.0032, vec![]));
    with_touches(&[0, 12]);
    let compared = vec![0.0032, 0.0008, 0.0002];
    assert_eq!(estimate(""), (0.0008, compared));
    for (flags, threshold) in [
        (" --threshold 0.002", 0.002),
        (" --hyper likelihood", 0.0032),
        (" --prior-sd 50 --noise-sd 0.1", 0.0032),
        (" --estimator replay", 0.0032),
    ] {
        assert_eq!(estimate(flags), (threshold, vec![]), "{flags}");
    }
    // Surfaces that are drawn in are touched from no closer.
    assert!(estimate(" --padding=-0.0015").1.is_empty());
    // Prior and noise are those of the threshold alone.
    let prior_sd = |flags: &str| {
        value(
            &bench.ok(&format!("estimate touch --json{flags}")),
            "prior_sd",
        )
    };
    assert_eq!(prior_sd(""), prior_sd(" --threshold 0.0008"));
}

/// Touches so light that closer thresholds feel nothing of them are learned from all the same.
#[test]
fn light_touches_are_compared_with_no_closer_threshold() {
    let bench = Bench::new();
    for id in ["a", "b"] {
        let angles: Vec<f64> = (0..ROWS)
            .flat_map(|k| [0.018, 0.016, 0.0045 - 0.0001 * k.min(ROWS - k) as f64])
            .collect();
        npy(
            &bench.root.join(format!("data/seq_{id}/angles.npy")),
            &[ROWS, 3],
            &angles,
        );
    }
    bench.ok("simulate data --field truth --out touch --threshold 0.0032 --noise-sd 0.0001");
    let path = bench.root.join("touch/dataset.json");
    let mut metadata: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    let object = metadata.as_object_mut().unwrap();
    object.remove("contact_parameters");
    object.insert(
        "touch_starts".to_owned(),
        serde_json::json!({ "a": [0, 12], "b": [0, 12] }),
    );
    fs::write(&path, metadata.to_string()).unwrap();
    let json = bench.ok("estimate touch --json");
    assert_eq!(value(&json, "threshold"), 0.0032);
    assert!(value(&json, "contact_samples") > 0.0, "{json}");
    bench.fails(
        "estimate touch --thresholds 0.0032,0.0002",
        1,
        &["0.0002 m", "touches none"],
    );
}

/// A field without parameters of contact is simulated in some contact: whoever estimates from the recording, or predicts it
/// with such a field, does so in the same.
#[test]
fn a_simulation_brings_its_contact() {
    let bench = Bench::new();
    bench.ok("simulate data --field truth --out simulated --threshold 0.003");
    for (flag, threshold) in [("", 0.003), (" --threshold 0.002", 0.002)] {
        let line = format!("estimate simulated --out field.npz --json{flag}");
        assert_eq!(value(&bench.ok(&line), "threshold"), threshold);
    }
    let told = bench.warned("estimate simulated --out field.npz --threshold 0.002 --friction 0.3");
    let says = "simulated: the torques were computed with --threshold 0.003 --friction 0.15 (contact_parameters of \
        dataset.json), not 0.002 and 0.3";
    assert!(told.contains(says), "{told}");
    let quiet = bench.warned("evaluate simulated --field truth");
    assert!(
        !quiet.contains("computed") && !quiet.contains("in which contact"),
        "{quiet}"
    );
    let json = bench.ok("evaluate simulated --field truth --json");
    assert!(value(&json, "mean_error") < 1e-9, "{json}");
    // Measured torques are of contact that nobody knows: one that suits the points.
    let metadata = bench.root.join("simulated/dataset.json");
    let known = fs::read_to_string(&metadata).unwrap();
    let mut known: serde_json::Value = serde_json::from_str(&known).unwrap();
    known.as_object_mut().unwrap().remove("contact_parameters");
    fs::write(&metadata, known.to_string()).unwrap();
    let json = bench.ok("estimate simulated --out field.npz --json");
    assert_eq!(value(&json, "threshold"), 0.0032);
    // Nor does this field say in which contact it holds.
    for (flag, taken) in [
        (
            "",
            Some("--threshold 0.002 and --subdivision 2 are taken (0.003200 m suits the points)"),
        ),
        (" --threshold 0.003", Some("--subdivision 2 is taken")),
        (" --threshold 0.003 --subdivision 2", None),
    ] {
        let told = bench.warned(&format!("evaluate simulated --field truth{flag}"));
        let about = "truth: does not say in which contact it was estimated: ";
        match taken {
            Some(taken) => assert!(told.contains(&format!("{about}{taken};")), "{told}"),
            None => assert!(!told.contains(about), "{told}"),
        }
    }
}

/// What is in no split may be predicted, too.
#[test]
fn sequences_of_no_split_are_predicted() {
    let bench = Bench::new();
    bench.metadata(r#"{"robot": "cartesian_stage", "rate_hz": 50, "splits": {"train": ["a"]}}"#);
    for command in ["predict", "simulate"] {
        bench.ok(&format!(
            "{command} data --field truth --sequences b --out {command}ed"
        ));
        let json = bench.ok(&format!("info {command}ed --json"));
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(json["train"], serde_json::json!(["b"]), "{command}");
    }
}

/// Errors on touches that a field has learned from are no predictions.
#[test]
fn fields_that_know_what_they_predict() {
    let bench = Bench::touched();
    bench.ok("estimate touch --sequences c,a --out all.npz");
    bench.ok("estimate touch --out folder");
    let warning = bench.warned("evaluate touch --field all.npz");
    assert!(warning.contains("that it predicts (c)"), "{warning}");
    for line in [
        "evaluate touch --field folder",
        "evaluate touch --field all.npz --sequences b",
        "evaluate touch --field truth",
    ] {
        let warning = bench.warned(line);
        assert!(!warning.contains("has learned from"), "{line}: {warning}");
    }
}

#[test]
fn help_fits_the_terminal() {
    let commands = "import info points estimate learn predict evaluate regions diagnose simulate export view bench";
    let experiments =
        "experiment,experiment paper,experiment table1,experiment priors,experiment blind";
    let all = commands.split(' ').chain(experiments.split(','));
    for command in all.chain([""]) {
        let words = ["help"].into_iter().chain(command.split_whitespace());
        for width in [72, 100] {
            let output = Command::new(env!("CARGO_BIN_EXE_vsf"))
                .args(words.clone())
                .env("COLUMNS", width.to_string())
                .output()
                .unwrap();
            let help = String::from_utf8(output.stdout).unwrap();
            assert!(help.contains("Usage: vsf"), "{command}");
            let wide = help.lines().find(|l| l.chars().count() > width);
            assert_eq!(wide, None, "{command} at {width}");
        }
    }
}

/// What a field says of itself, and what one of another program leaves open.
#[test]
fn fields_are_described() {
    let bench = Bench::touched();
    let estimated: serde_json::Value =
        serde_json::from_str(&bench.ok("estimate touch --out field.npz --json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&bench.ok("info field.npz --json")).unwrap();
    for key in ["points", "touched_points", "noise_sd"] {
        assert_eq!(json[key], estimated[key], "{key}");
    }
    assert_eq!(json["learned_from"], estimated["sequences"]);
    assert_eq!(
        json["contact_parameters"]["threshold"],
        estimated["threshold"]
    );
    assert!(json["mean_stiffness"].as_f64().unwrap() > 0.0);
    let text = bench.ok("info field.npz");
    for part in ["touched points: mean", "--threshold", "model     none"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let json: serde_json::Value = serde_json::from_str(&bench.ok("info truth --json")).unwrap();
    for key in [
        "touched_points",
        "learned_from",
        "prior_sd",
        "contact_parameters",
    ] {
        assert!(json[key].is_null(), "{key}: {json}");
    }
    assert!(bench.ok("info truth").contains("of all points: mean"));
    bench.fails("info data/points.npy", 1, &["points.npy"]);
}
