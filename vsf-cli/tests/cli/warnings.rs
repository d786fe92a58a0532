//! What can be worked with and should be known: on standard error, and in the results for machines.

use crate::common;
use common::{Bench, METADATA, npy};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg32;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use vsf::data::{Dataset, Overrides, Sequence, TorqueKind};
use vsf::pipeline::{Scene, SceneOptions, reading_warnings, robot_of};

/// An arm of one joint with limits, and a ball at its end.
const ARM: &str = r#"<robot name="arm"><link name="base"/><link name="rod"><collision>
    <origin xyz="0.3 0 0"/><geometry><sphere radius="0.02"/></geometry></collision></link>
    <joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/>
    <limit lower="-1.5" upper="1.5" effort="20" velocity="5"/></joint></robot>"#;

/// A recording of the arm with these angles and torques, in `arm/`.
fn arm(bench: &Bench, angles: &[f64], torques: &[f64]) {
    let folder = bench.root.join("arm/seq_0");
    fs::create_dir_all(&folder).unwrap();
    npy(&folder.join("angles.npy"), &[angles.len(), 1], angles);
    npy(&folder.join("torques.npy"), &[torques.len(), 1], torques);
    let metadata = r#"{"robot": "arm.urdf", "rate_hz": 10}"#;
    fs::write(bench.root.join("arm/dataset.json"), metadata).unwrap();
    fs::write(bench.root.join("arm/arm.urdf"), ARM).unwrap();
}

fn points(bench: &Bench) {
    npy(
        &bench.root.join("arm/points.npy"),
        &[2, 3],
        &[0.3, 0.0, 0.0, 0.3, 0.005, 0.0],
    );
}

fn warns(bench: &Bench, line: &str, parts: &[&str]) {
    let error = bench.warned(line);
    for part in parts {
        assert!(error.contains(part), "{part:?} is not in: {error}");
    }
}

#[test]
fn angles_in_degrees() {
    let bench = Bench::new();
    arm(&bench, &[0.1, 0.2, -45.0, 60.0], &[1.0; 4]);
    let parts = [
        "degrees",
        "joint hinge: 2 of 4",
        "sequence 0 row 2",
        "-45.0",
    ];
    warns(&bench, "info arm", &parts);
    points(&bench);
    warns(&bench, "info arm", &parts);
    // Small ones are far outside the limits; they may wrap around, too.
    arm(&bench, &[0.1, 5.0], &[1.0; 2]);
    warns(&bench, "info arm", &["degrees", "wrap", "row 1 with 5.0"]);
}

/// A joint without limits may go on turning, as fast as joints do; degrees go faster.
#[test]
fn turns_of_continuous_joints_are_no_degrees() {
    let bench = Bench::new();
    for (step, degrees) in [(0.5, false), (3.0, true)] {
        let angles: Vec<f64> = (0..80).map(|k| step * f64::from(k)).collect();
        arm(&bench, &angles, &[1.0; 80]);
        let urdf = bench.root.join("arm/arm.urdf");
        fs::write(urdf, ARM.replace("revolute", "continuous")).unwrap();
        let error = bench.warned("info arm");
        assert_eq!(error.contains("degrees"), degrees, "{error}");
    }
}

#[test]
fn angles_outside_the_limits() {
    let bench = Bench::new();
    arm(&bench, &[1.5005, 1.6, 1.7, 0.0], &[1.0; 4]);
    let parts = ["-1.5 .. 1.5 rad", "hinge: 2 of 4", "row 1 with 1.6"];
    warns(&bench, "info arm", &parts);
    for close in [1.5005, -1.5005] {
        arm(&bench, &[close; 2], &[1.0; 2]);
        assert_eq!(bench.warned("info arm"), "");
    }
}

#[test]
fn torques_of_another_unit() {
    let bench = Bench::new();
    arm(&bench, &[0.0; 3], &[150.0, 199.0, -3000.0]);
    points(&bench);
    warns(
        &bench,
        "info arm",
        &["20.0 N m", "hinge: 1 of 3", "-3000.0"],
    );
}

#[test]
fn silent_torques() {
    let bench = Bench::new();
    warns(&bench, "info data", &["all zero", "a, b, c"]);
    let json = bench.ok("info data --json");
    let (_, warnings) = json.split_once("\"warnings\": [").unwrap();
    assert!(warnings.contains("all zero"), "{json}");
    // Every result has the list.
    for line in [
        "bench --points 1000 --steps 2 --json",
        "export truth --out a.ply --json",
    ] {
        assert!(bench.ok(line).contains("\"warnings\": []"), "{line}");
    }
}

#[test]
fn tare_samples_that_are_no_rest() {
    let bench = Bench::new();
    // Away from the points, then on them.
    let angles =
        |away: usize| -> Vec<f64> { (0..20).map(|k| if k < away { 0.5 } else { 0.0 }).collect() };
    let torques = |noise: f64| -> Vec<f64> {
        let wave = |k: usize| if k.is_multiple_of(2) { noise } else { -noise };
        (0..20)
            .map(|k| if k < 8 { wave(k) } else { -4.0 })
            .collect()
    };
    arm(&bench, &angles(8), &torques(0.1));
    points(&bench);
    assert_eq!(bench.warned("info arm --tare-samples 8"), "");
    warns(
        &bench,
        "info arm --tare-samples 10",
        &[
            "sequence 0: 2 of its 10 tare samples are in contact",
            "row 8",
        ],
    );
    arm(&bench, &angles(8), &torques(2.0));
    warns(
        &bench,
        "info arm --tare-samples 8",
        &["sequence 0", "spread by 2.000 N m", "4.000 N m"],
    );
}

#[test]
fn fields_of_another_recording() {
    let bench = Bench::touched();
    bench.ok("estimate touch --out f.npz --out folder");
    for field in ["f.npz", "folder"] {
        assert_eq!(bench.warned(&format!("evaluate touch --field {field}")), "");
    }
    let named = METADATA.replace("\"rate_hz\"", "\"name\": \"peach\", \"rate_hz\"");
    fs::write(bench.root.join("touch/dataset.json"), named).unwrap();
    for field in ["f.npz", "folder"] {
        let line = format!("evaluate touch --field {field}");
        warns(
            &bench,
            &line,
            &["recording \"data, simulated\"", "\"peach\"", field],
        );
    }
}

#[test]
fn grids_too_coarse_for_contact() {
    let bench = Bench::new();
    arm(&bench, &[0.0, 0.1], &[1.0; 2]);
    points(&bench);
    let corners = ["0 0 0", "0.1 0 0", "0 0.1 0", "0 0 0.1"];
    let face = |[a, b, c]: [usize; 3]| {
        let corner = |k: usize| format!("vertex {}\n", corners[k]);
        let [a, b, c] = [a, b, c].map(corner);
        format!("facet normal 0 0 0\nouter loop\n{a}{b}{c}endloop\nendfacet\n")
    };
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(face);
    let stl = format!("solid t\n{}endsolid t\n", faces.concat());
    fs::write(bench.root.join("arm/rod.stl"), stl).unwrap();
    let ball = r#"<sphere radius="0.02"/>"#;
    let urdf = ARM.replace(ball, r#"<mesh filename="rod.stl"/>"#);
    fs::write(bench.root.join("arm/arm.urdf"), urdf).unwrap();
    warns(
        &bench,
        "info arm --grid-resolution 0.03",
        &[
            "link \"rod\"",
            "contact threshold of 0.004",
            "a finer --grid-resolution",
        ],
    );
    bench.fails(
        "info arm --grid-resolution 1e-5",
        2,
        &["--grid-resolution", "\"rod\"", "a coarser one"],
    );
    assert_eq!(bench.warned("info arm"), "");
}

/// A mesh whose faces are turned over has no inside, and one without a lid or two hardly any.
#[test]
fn meshes_that_are_no_bodies() {
    let bench = Bench::new();
    let arm = ARM.replace("<sphere radius=\"0.02\"/>", "<mesh filename=\"tip.obj\"/>");
    let tip = |faces: &dyn Fn(&str) -> Option<String>| {
        self::arm(&bench, &[0.0; 3], &[1.0; 3]);
        points(&bench);
        let line = |l: &str| match l.strip_prefix("f ") {
            None => Some(l.to_owned()),
            Some(face) => faces(face),
        };
        let mesh: Vec<String> = common::BOX.lines().filter_map(line).collect();
        fs::write(bench.root.join("arm/arm.urdf"), &arm).unwrap();
        fs::write(bench.root.join("arm/tip.obj"), mesh.join("\n")).unwrap();
    };
    let turn = |face: &str| face.split(' ').rev().collect::<Vec<_>>().join(" ");
    tip(&|face| Some(format!("f {face}")));
    let whole = bench.warned("info arm");
    assert!(!whole.contains("tip.obj"), "{whole}");
    tip(&|face| Some(format!("f {}", turn(face))));
    warns(
        &bench,
        "info arm",
        &["tip.obj", "inside out", "normals outward"],
    );
    tip(&|face| face.starts_with('1').then(|| format!("f {face}")));
    warns(&bench, "info arm", &["tip.obj", "edges", "a guess"]);
}

/// Where the object lay in a test sequence is learned from its readings alone.
#[test]
fn models_that_have_seen_test_sequences() {
    let bench = Bench::touched();
    let model = |of: &str| {
        let names = ["dx", "dy", "dz"].into_iter();
        let all = ["", "_a", "_b", "_c"].map(|id| names.clone().map(move |n| format!("{n}{id}")));
        let parameter = |name: String| {
            let value = if name == of { 0.001 } else { 0.0 };
            format!(r#"{{"name": "{name}", "value": {value}, "std": 0.0, "unit": "m"}}"#)
        };
        let parameters: Vec<String> = all.into_iter().flatten().map(parameter).collect();
        let effect = format!(
            r#"{{"schema": 1, "effects": [{{"effect": "registration_offset", "parameters": [{}]}}]}}"#,
            parameters.join(", ")
        );
        fs::write(bench.root.join("model.json"), effect).unwrap();
    };
    let line = "evaluate touch --field truth --model model.json";
    model("dz_c");
    warns(
        &bench,
        line,
        &["model.json", "test sequences c;", "than on new"],
    );
    let quiet = |line: &str| {
        let text = bench.warned(line);
        assert!(!text.contains("than on new"), "{text}");
    };
    // Where they are not looked at.
    quiet(&format!("{line} --sequences b"));
    quiet("estimate touch --model model.json --out field.npz");
    // Of train sequences nobody expects otherwise.
    for of in ["dz_b", "dz"] {
        model(of);
        quiet(line);
    }
}

#[test]
fn positions_that_jump() {
    let bench = Bench::new();
    arm(&bench, &[-0.9, -0.8, 0.9, 0.95], &[1.0; 4]);
    let parts = ["from -0.8 to 0.9 rad", "limit of 5.0 rad/s", "row 2"];
    warns(&bench, "info arm", &parts);
    // Between two touches the arm may have gone anywhere.
    let metadata = r#"{"robot": "arm.urdf", "rate_hz": 10, "touch_starts": {"0": [0, 2]}}"#;
    fs::write(bench.root.join("arm/dataset.json"), metadata).unwrap();
    assert!(!bench.warned("info arm").contains("as fast as"));
}

#[test]
fn one_velocity_that_cannot_be() {
    let bench = Bench::new();
    let q: Vec<f64> = (0..40).map(|k| 0.3 * (0.2 * f64::from(k)).sin()).collect();
    arm(&bench, &q, &[1.0; 40]);
    let mut v: Vec<f64> = (0..40).map(|k| 0.6 * (0.2 * f64::from(k)).cos()).collect();
    let velocities = bench.root.join("arm/seq_0/velocities.npy");
    npy(&velocities, &[40, 1], &v);
    assert!(!bench.warned("info arm").contains("velocity"));
    v[17] = -16.0;
    npy(&velocities, &[40, 1], &v);
    let parts = [
        "velocity of -16.0 rad/s in sequence 0 row 17",
        "limit of 5.0 rad/s",
    ];
    warns(&bench, "info arm", &parts);
}

#[test]
fn fields_worse_than_none() {
    let bench = Bench::touched();
    let stiff = bench.root.join("stiff");
    fs::create_dir(&stiff).unwrap();
    let points = bench.root.join("truth/points.npy");
    fs::copy(&points, stiff.join("points.npy")).unwrap();
    let n = fs::metadata(bench.root.join("truth/K.npy")).unwrap().len();
    let n = (n as usize - 128) / 8;
    npy(&stiff.join("K.npy"), &[n], &vec![500.0; n]);
    let parts = ["not below that of zero torque", "units"];
    warns(&bench, "evaluate touch --field stiff", &parts);
    let good = bench.warned("evaluate touch --field truth");
    assert!(!good.contains("zero torque"), "{good}");
    // A sequence whose readings are not of its touches, among others.
    let read = |id: &str| fs::read(bench.root.join(format!("touch/seq_{id}/torques.npy"))).unwrap();
    let turned: Vec<u8> = {
        let bytes = read("a");
        let (header, data) = bytes.split_at(128);
        let turned = data
            .chunks_exact(8)
            .map(|b| (-f64::from_le_bytes(b.try_into().unwrap())).to_le_bytes());
        header.iter().copied().chain(turned.flatten()).collect()
    };
    fs::write(bench.root.join("touch/seq_a/torques.npy"), turned).unwrap();
    let parts = ["in 1 of 3 sequences, most of all in a", "their readings"];
    warns(
        &bench,
        "evaluate touch --field truth --sequences a,b,c",
        &parts,
    );
}

#[test]
fn points_in_one_place() {
    let bench = Bench::new();
    arm(&bench, &[0.0; 3], &[1.0; 3]);
    let far = [
        0.3, 0.005, 0.0, 0.3, -0.0, 0.0, 0.3, 0.01, 0.0, 0.3, 0.0, 0.0, 0.3, 0.01, 0.0,
    ];
    npy(&bench.root.join("arm/points.npy"), &[5, 3], &far);
    let parts = [
        "points.npy: 2 of 5 points repeat others",
        "row 3 that of row 1",
    ];
    warns(&bench, "info arm", &parts);
    points(&bench);
    let text = bench.warned("info arm");
    assert!(!text.contains("repeat"), "{text}");
}

/// As of two scans of one object, off by a tenth of a millimeter.
#[test]
fn points_in_pairs() {
    let bench = Bench::touched();
    let path = bench.root.join("touch/points.npy");
    let (dataset, _) = Dataset::open(bench.root.join("touch"), &Overrides::default()).unwrap();
    let places = dataset.rest_points.unwrap();
    let twice = places
        .iter()
        .flat_map(|p| [0.0, 1e-4].map(|by| [p.x + by, p.y, p.z]));
    let twice: Vec<f64> = twice.flatten().collect();
    npy(&path, &[2 * places.len(), 3], &twice);
    warns(
        &bench,
        "info touch",
        &["points come in clusters", "40 times", "1.00e-4 m"],
    );
}

/// A joint that is elsewhere, since a word is misspelled.
#[test]
fn words_of_a_urdf_that_are_not_understood() {
    let bench = Bench::new();
    arm(&bench, &[0.0; 3], &[1.0; 3]);
    points(&bench);
    let urdf = bench.root.join("arm/arm.urdf");
    fs::write(
        &urdf,
        ARM.replace("<origin", "<orign").replace("<axis", "<Axis"),
    )
    .unwrap();
    let parts = ["<orign> in <collision> (line 2)", "1 more place"];
    warns(&bench, "info arm", &parts);
}

/// As where a flag of the estimate is left out of the evaluation.
#[test]
fn fields_of_a_robot_that_stood_elsewhere() {
    let bench = Bench::touched();
    let pose = "--base-pose 0,0,0.0004,0,0,0.001";
    bench.ok(&format!("estimate touch --out f.npz {pose}"));
    let line = "evaluate touch --field f.npz";
    let parts = [
        "f.npz",
        "base elsewhere, 0.0004000 m and 0.001000 rad",
        "--base-pose",
    ];
    warns(&bench, line, &parts);
    let same = bench.warned(&format!("{line} {pose}"));
    assert!(!same.contains("elsewhere"), "{same}");
    // Another recording says nothing of where the robot stood.
    let other = [&parts[..], &["\"data, simulated\", this one is \"data\""]].concat();
    warns(&bench, "export data --field f.npz --out a.mcap", &other);
}

/// What was computed from a recording is no other one to its field.
#[test]
fn fields_and_what_was_computed_from_their_recording() {
    let bench = Bench::touched();
    bench.ok("estimate touch --prior-sd 10 --noise-sd 1 --out f.npz");
    bench.ok("simulate touch --field f.npz --out again");
    bench.ok("predict again --field f.npz --out there");
    for recording in ["touch", "again", "there"] {
        let told = bench.warned(&format!("predict {recording} --field f.npz --out p"));
        assert!(!told.contains("estimated from"), "{told}");
    }
}

/// What is said of the readings of a recording whose rows are changed.
fn warnings_of(recording: &str, change: impl FnMut(&mut [f64])) -> Vec<String> {
    warnings_with(&Overrides::default(), recording, change)
}

/// The same with other metadata.
fn warnings_with(
    given: &Overrides,
    recording: &str,
    mut change: impl FnMut(&mut [f64]),
) -> Vec<String> {
    warnings_of_all(given, recording, |[.., torques]| change(torques))
}

/// The same of one whose rows of angles, velocities and torques are changed.
fn warnings_of_all(
    given: &Overrides,
    recording: &str,
    mut change: impl FnMut([&mut [f64]; 3]),
) -> Vec<String> {
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join(recording);
    let (dataset, _) = Dataset::open(&recording, given).unwrap();
    let scene = match dataset.rest_points {
        Some(_) => Scene::open(&dataset, &SceneOptions::default()),
        None => robot_of(&dataset, &BTreeMap::new()).and_then(|r| Scene::in_air(&dataset, r)),
    };
    let scene = scene.unwrap();
    let mut sequences = dataset.sequences.clone();
    for sequence in &mut sequences {
        let joints = scene.robot().joint_count();
        // Of those without velocities nothing is changed.
        let mut none = sequence.angles.clone();
        let velocities = sequence.velocities.as_mut().unwrap_or(&mut none);
        let angles = sequence.angles.data_mut().chunks_exact_mut(joints);
        let velocities = velocities.data_mut().chunks_exact_mut(joints);
        let torques = sequence.torques.data_mut().chunks_exact_mut(joints);
        let rows = angles.zip(velocities).zip(torques);
        rows.for_each(|((q, qd), tau)| change([q, qd, tau]));
    }
    let sequences: Vec<&Sequence> = sequences.iter().collect();
    let traces = scene.traces(&sequences, || {}).unwrap();
    let warnings = reading_warnings(&scene, &sequences, &traces);
    warnings.iter().map(ToString::to_string).collect()
}

fn says_once(warnings: &[String], part: &str) {
    let once = warnings.len() == 1 && warnings[0].contains(part);
    assert!(once, "{part}: {warnings:?}");
}

/// Of a real arm, whose joint states were sorted by name; another arm, and one whose joint stands elsewhere.
#[test]
fn joint_states_of_another_order() {
    let own = "../vsf-gap/tests/data/unisa_ur10";
    let of = |change: &dyn Fn([&mut [f64]; 3])| warnings_of_all(&Overrides::default(), own, change);
    assert_eq!(of(&|_| {}), [""; 0]);
    let sorted = of(&|rows| rows.into_iter().for_each(|row| row.swap(0, 2)));
    let names = "shoulder_pan_joint and elbow_joint exchanged";
    says_once(
        &sorted,
        &format!("columns of positions and torques of {names}"),
    );
    let positions = of(&|[q, qd, _]| [q, qd].into_iter().for_each(|row| row.swap(0, 2)));
    says_once(&positions, &format!("columns of positions of {names}"));
    let elsewhere = of(&|[q, ..]| q[1] += std::f64::consts::FRAC_PI_2);
    says_once(
        &elsewhere,
        "explain only 0 % of the squared readings of its actuators",
    );
}

/// One joint in another unit, and one that hardly feels anything.
#[test]
fn a_joint_of_another_unit_in_contact() {
    let changed =
        |joint: usize, factor: f64| warnings_of("data/orange_tree", |row| row[joint] *= factor);
    for (joint, factor, says) in [
        (1, 0.1, "torques of Actuator2 are some 0.10 times"),
        (3, 10.0, "torques of Actuator4 are some 10.00 times"),
        (3, 0.01, "torques of Actuator4 are some 0.01 times"),
    ] {
        says_once(&changed(joint, factor), says);
    }
    // A gain, and what is next to nothing.
    for (joint, factor) in [(3, 1.5), (1, 0.6), (6, 10.0)] {
        assert_eq!(changed(joint, factor), [""; 0], "{joint} {factor}");
    }
}

/// In readings of a plant, whose stiffness differs from place to place. The last joint feels next to nothing.
#[test]
fn joints_of_the_other_sign_in_a_plant() {
    let changed = |change: &dyn Fn(&mut [f64])| warnings_of("data/orange_tree", change);
    assert_eq!(changed(&|_| {}), [""; 0]);
    for turned in [
        &[0][..],
        &[1],
        &[2],
        &[3],
        &[4],
        &[5],
        &[1, 3],
        &[0, 2, 4],
        &[0, 1, 2],
    ] {
        let warnings = changed(&|row| turned.iter().for_each(|&j| row[j] = -row[j]));
        let names: Vec<String> = turned
            .iter()
            .map(|j| format!("Actuator{}", j + 1))
            .collect();
        let says = format!("the other sign of {} (", names.join(", "));
        says_once(&warnings, &says);
    }
    let warnings = changed(&|row| row.swap(4, 6));
    says_once(&warnings, "columns of Actuator5 and Actuator7 exchanged");
    // One wrong reading says nothing of columns.
    let mut rows = 0;
    let spike = warnings_of("data/orange_tree", |row| {
        rows += 1;
        row[6] += if rows == 250 { 50.0 } else { 0.0 };
    });
    says_once(&spike, "joint Actuator7 reads 49.9");
    // With the noise of real sensors.
    for (turned, says) in [(false, None), (true, Some("the other sign of Actuator4 ("))] {
        let mut random = Pcg32::new(7, 0);
        let noise = Normal::new(0.0, 0.3).unwrap();
        let warnings = warnings_of("data/orange_tree", |row| {
            row.iter_mut().for_each(|t| *t += noise.sample(&mut random));
            if turned {
                row[3] = -row[3];
            }
        });
        match says {
            None => assert_eq!(warnings, [""; 0]),
            Some(says) => says_once(&warnings, says),
        }
    }
}

/// Of a real arm. The first joint turns about the vertical, the last one bears nothing: friction is all that they read.
#[test]
fn joints_of_the_other_sign_in_the_air() {
    let changed =
        |change: &dyn Fn(&mut [f64])| warnings_of("../vsf-gap/tests/data/unisa_panda", change);
    assert_eq!(changed(&|_| {}), [""; 0]);
    for turned in [&[1][..], &[2], &[3], &[4], &[5], &[1, 3]] {
        let warnings = changed(&|row| turned.iter().for_each(|&j| row[j] = -row[j]));
        let names: Vec<String> = turned
            .iter()
            .map(|j| format!("panda_joint{}", j + 1))
            .collect();
        let says = format!(
            "readings of {} are opposite to the weight",
            names.join(", ")
        );
        says_once(&warnings, &says);
    }
    for (a, b) in [(0, 1), (1, 3), (2, 4), (5, 6)] {
        let warnings = changed(&|row| row.swap(a, b));
        let (a, b) = (a + 1, b + 1);
        let says = format!("columns of panda_joint{a} and panda_joint{b} exchanged");
        says_once(&warnings, &says);
    }
    let warnings = changed(&|row| row.reverse());
    says_once(&warnings, "with their columns in reverse order");
    let warnings = changed(&|row| row.rotate_right(1));
    says_once(&warnings, "with their columns turned on");
    // Offsets of more than the weight are none of these.
    let offset = changed(&|row| (row[5], row[6]) = (row[5] - 4.0, row[6] - 0.3));
    assert_eq!(offset, [""; 0]);
}

const ARMS: [&str; 2] = [
    "../vsf-gap/tests/data/unisa_panda",
    "../vsf-gap/tests/data/unisa_ur10",
];

/// Friction is most of what the first joint of the second arm reads: it fits any column without it better.
#[test]
fn real_arms_are_read_as_they_are() {
    for arm in ARMS {
        assert_eq!(warnings_of(arm, |_| {}), [""; 0], "{arm}");
    }
}

/// Gains of sensors are a matter of the diagnosis; other units are not.
#[test]
fn joints_of_another_scale_in_the_air() {
    let changed = |joints: &[usize], factor: f64| {
        warnings_of(ARMS[0], |row| joints.iter().for_each(|&j| row[j] *= factor))
    };
    assert_eq!(changed(&[1, 2, 3], 1.5), [""; 0]);
    for (joint, factor) in [(1, 100.0), (3, 10.0), (3, 0.2)] {
        let says = format!("the readings of panda_joint{} are", joint + 1);
        let warnings = changed(&[joint], factor);
        let warning = warnings.iter().find(|w| w.contains(&says));
        let told = warning.unwrap_or_else(|| panic!("{joint} {factor}: {warnings:?}"));
        let times = told.split(" times").next().unwrap().rsplit(' ').next();
        let times: f64 = times.unwrap().parse().unwrap();
        assert!((times / factor - 1.0).abs() < 0.1, "{told}");
        assert!(told.contains("torque constant"), "{told}");
    }
    let all = changed(&[0, 1, 2, 3, 4, 5, 6], 1e3);
    assert!(
        all.iter()
            .any(|w| w.contains("torque constant") && w.contains("more joint")),
        "{all:?}"
    );
}

/// Readings of actuators that are said to be of touch alone, of whatever friction.
#[test]
fn readings_of_the_other_kind_in_the_air() {
    let given = Overrides {
        torque_kind: Some(TorqueKind::External),
        ..Overrides::default()
    };
    for arm in ARMS {
        let warnings = warnings_with(&given, arm, |_| {});
        says_once(&warnings, "taken as torque_kind external");
        // Motors that are off give no torques of either kind.
        let off = warnings_of(arm, |row| row.fill(0.0));
        assert!(!off.iter().any(|w| w.contains("torque_kind")), "{off:?}");
    }
}

/// An arm that hangs from a wall, or whose gravity was never written down. Along its own axis the second arm's
/// first joint reads friction alone.
#[test]
fn gravity_that_points_elsewhere() {
    for arm in ARMS {
        for given in [
            [0.0, 9.81, 0.0],
            [-6.0, 0.0, -7.8],
            [0.0, 0.0, 9.81],
            [0.0; 3],
        ] {
            let given = Overrides {
                gravity: Some(given.into()),
                ..Overrides::default()
            };
            let warnings = warnings_with(&given, arm, |_| {});
            says_once(&warnings, "where nothing is touched gravity of (");
            let vector = warnings[0].split(['(', ')']).nth(1).unwrap();
            let vector: Vec<f64> = vector.split(", ").map(|v| v.parse().unwrap()).collect();
            let off = (vector[0].hypot(vector[1])).hypot(vector[2] + 9.81);
            assert!(off < 1.5, "{arm}: {vector:?}");
        }
        // Actuators that push where they should hold look much like it.
        let pushing = warnings_of(arm, |row| row.iter_mut().for_each(|t| *t = -*t));
        says_once(&pushing, "sign");
        // Askew by ten degrees is a matter of the diagnosis.
        let askew = Overrides {
            gravity: Some([1.7, 0.0, -9.66].into()),
            ..Overrides::default()
        };
        assert_eq!(warnings_with(&askew, arm, |_| {}), [""; 0], "{arm}");
    }
}

/// One reading that is no touch, and accuses nobody of another sign.
#[test]
fn spikes_are_named() {
    for (recording, size) in [("data/orange_tree", 60.0), (ARMS[0], -400.0)] {
        let mut row = 0;
        let warnings = warnings_of(recording, |torques| {
            torques[3] += if row == 200 { size } else { 0.0 };
            row += 1;
        });
        says_once(&warnings, "in row 200 of sequence");
        says_once(&warnings, "looks like a fault of the sensor");
        assert!(!warnings[0].contains("more reading"), "{warnings:?}");
        // A few rows, which without that are called columns of other joints.
        let mut row = 0;
        let warnings = warnings_of(recording, |torques| {
            torques[1] += if (250..253).contains(&row) { size } else { 0.0 };
            row += 1;
        });
        says_once(&warnings, "so it is in 2 more readings");
    }
}

/// Whatever friction an arm has in the poses in which it rests.
#[test]
fn arms_at_rest_are_not_accused() {
    for arm in ARMS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(arm);
        let (mut dataset, _) = Dataset::open(folder, &Overrides::default()).unwrap();
        let mut rng = Pcg32::new(1, 2);
        let noise = Normal::new(0.0, 0.05).unwrap();
        for sequence in &mut dataset.sequences {
            let joints = sequence.width();
            let still = |data: &mut [f64]| {
                let first = data[..joints].to_vec();
                data.chunks_exact_mut(joints)
                    .for_each(|row| row.copy_from_slice(&first));
            };
            still(sequence.angles.data_mut());
            still(sequence.torques.data_mut());
            let torques = sequence.torques.data_mut().iter_mut();
            torques.for_each(|t| *t += noise.sample(&mut rng));
            if let Some(velocities) = &mut sequence.velocities {
                velocities.data_mut().fill(0.0);
            }
        }
        let robot = robot_of(&dataset, &BTreeMap::new()).unwrap();
        let scene = Scene::in_air(&dataset, robot).unwrap();
        let sequences: Vec<&Sequence> = dataset.sequences.iter().collect();
        let traces = scene.traces(&sequences, || {}).unwrap();
        let warnings = reading_warnings(&scene, &sequences, &traces);
        let accused = |w: &str| {
            ["exchanged", "opposite", "gravity of"]
                .iter()
                .any(|a| w.contains(a))
        };
        assert!(
            !warnings.iter().any(|w| accused(&w.to_string())),
            "{warnings:?}"
        );
    }
}
