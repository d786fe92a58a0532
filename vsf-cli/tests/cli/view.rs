//! `vsf view`: what the page holds, and what is refused.

use crate::common::{Bench, METADATA, ROWS, npy};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;
use std::fs;

/// What the script of a page reads.
fn data(page: &str) -> Value {
    let (_, rest) = page.split_once("id=\"data\">").expect("no data");
    let (json, _) = rest.split_once("</script>").expect("no end of the data");
    serde_json::from_str(json).expect("no JSON")
}

fn bytes(numbers: &Value) -> Vec<u8> {
    STANDARD.decode(numbers.as_str().unwrap()).unwrap()
}

fn floats(numbers: &Value) -> Vec<f64> {
    let number = |b: &[u8]| f64::from(f32::from_le_bytes(b.try_into().unwrap()));
    bytes(numbers).chunks_exact(4).map(number).collect()
}

fn counts(numbers: &Value) -> Vec<usize> {
    let number = |b: &[u8]| u32::from_le_bytes(b.try_into().unwrap()) as usize;
    bytes(numbers).chunks_exact(4).map(number).collect()
}

fn view(bench: &Bench, line: &str) -> (String, Value) {
    bench.ok(&format!("view {line} --out page.html"));
    let page = fs::read_to_string(bench.root.join("page.html")).unwrap();
    for foreign in ["src=", "href=", "@import", "url(", "fetch(", "import "] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    // The data and the program; and nothing but these scripts.
    assert_eq!(page.matches("<script").count(), 2);
    assert_eq!(page.matches("</script>").count(), 2);
    let data = data(&page);
    (page, data)
}

#[test]
fn a_field_comes_back() {
    let bench = Bench::touched();
    bench.ok("estimate touch --out field.npz");
    let (page, data) = view(&bench, "field.npz --full-scale 120");
    assert!(page.contains("<title>field</title>"));
    let cloud = &data["cloud"];
    assert_eq!(cloud["total"], 160);
    assert!((cloud["spacing"].as_f64().unwrap() - 0.004).abs() < 1e-9);
    let origin: Vec<f64> = (data["origin"].as_array().unwrap().iter())
        .map(|v| v.as_f64().unwrap())
        .collect();
    let points = floats(&cloud["points"]);
    assert_eq!(points.len(), 3 * 160);
    // The last point of the block, at (0.036, 0.028, -0.004).
    for (k, truth) in [0.036, 0.028, -0.004].into_iter().enumerate() {
        assert!((points[3 * 159 + k] + origin[k] - truth).abs() < 1e-8);
    }
    let touched = bytes(&cloud["touched"]);
    assert!(touched.contains(&0) && touched.contains(&1));
    let layers = cloud["layers"].as_array().unwrap();
    let names: Vec<_> = layers.iter().map(|l| l["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["stiffness", "standard deviation"]);
    assert_eq!(layers[0]["limit"], 120.0);
    assert!(data["motion"].is_null());

    let (_, truth) = view(&bench, "truth");
    let stiffness = floats(&truth["cloud"]["layers"][0]["values"]);
    assert_eq!((stiffness[0], stiffness[159]), (30.0, 90.0));
    assert_eq!(truth["cloud"]["layers"].as_array().unwrap().len(), 1);
    assert!(truth["cloud"]["touched"].is_null());
}

#[test]
fn a_recording_shows_robot_and_touches() {
    let bench = Bench::touched();
    let (_, data) = view(&bench, "touch --field truth");
    let motion = &data["motion"];
    assert_eq!(motion["robot"]["parents"], serde_json::json!([-1, 0, 1, 2]));
    assert_eq!(
        (&motion["every"], &motion["unit"]),
        (&Value::from(1), &Value::from("N"))
    );
    let tip = &motion["robot"]["surfaces"][0];
    assert_eq!(tip["link"], 3);
    let vertices = floats(&tip["vertices"]);
    // A ball of 4 mm about (0, 0, 4 mm).
    for p in vertices.chunks_exact(3) {
        let distance = (p[0].powi(2) + p[1].powi(2) + (p[2] - 0.004).powi(2)).sqrt();
        assert!((distance - 0.004).abs() < 1e-8);
    }
    let most = counts(&tip["faces"]).into_iter().max().unwrap();
    assert!(most < vertices.len() / 3);

    let sequences = motion["sequences"].as_array().unwrap();
    assert_eq!(sequences.len(), 3);
    let a = &sequences[0];
    assert_eq!(a["id"], "a");
    let time = floats(&a["time"]);
    assert!(time.len() == ROWS && time[0] == 0.0 && (time[5] - 0.1).abs() < 1e-6);
    let poses = floats(&a["poses"]);
    assert_eq!(poses.len(), 7 * 4 * ROWS);
    // The tip at the deepest sample.
    let origin = &data["origin"];
    let at = &poses[7 * (4 * 12 + 3)..];
    for (k, truth) in [0.018, 0.016, 0.002 - 0.0072].into_iter().enumerate() {
        assert!((at[k] + origin[k].as_f64().unwrap() - truth).abs() < 1e-7);
    }
    assert_eq!(at[3..7], [0.0, 0.0, 0.0, 1.0]);

    let (starts, touched) = (counts(&a["starts"]), counts(&a["points"]));
    let numbers = counts(&a["counts"]);
    assert_eq!((starts.len(), starts[ROWS]), (ROWS + 1, touched.len()));
    assert!(
        starts
            .windows(2)
            .zip(&numbers)
            .all(|(w, n)| w[1] - w[0] == *n)
    );
    assert!(numbers[12] > 2 * numbers[0]);
    let shifts = floats(&a["shifts"]);
    assert_eq!(shifts.len(), 3 * touched.len());
    let down: f64 = shifts.chunks_exact(3).map(|u| u[2]).sum();
    assert!(down < 0.0, "pressed upward");
    assert!(touched.iter().all(|&i| i < 160));
    let loads = floats(&a["loads"]);
    assert!(loads.len() == ROWS && loads[12] > 5.0 * loads[0]);

    // Without a field the points are there, without values; some sequences alone.
    let (_, plain) = view(&bench, "touch --sequences c,a");
    assert_eq!(plain["cloud"]["layers"], serde_json::json!([]));
    let ids = plain["motion"]["sequences"].as_array().unwrap();
    assert!(ids.len() == 2 && ids[0]["id"] == "c");
}

#[test]
fn an_arm_in_free_air_and_hostile_names() {
    let bench = Bench::new();
    let hostile = r#"</script><script>alert('x')</script><!-- & \"\u2028\u001b\u202e"#;
    let name = format!("{{\"name\": \"{hostile}\", ");
    bench.metadata(&METADATA.replacen('{', &name, 1));
    let (page, _) = view(&bench, "data --field truth");
    assert!(page.contains("&lt;/script&gt;&lt;script&gt;alert(&#39;x&#39;)"));
    assert!(!page.contains("<script>alert") && !page.contains("<!-- &"));
    let turned = ['\u{1b}', '\u{202e}', '\u{2028}'];
    assert!(!page.contains(turned) && page.contains("\u{FFFD}\u{FFFD}\u{FFFD}"));

    // The ID of a sequence and the name of a robot are in the data alone.
    let urdf = r#"<robot name="&lt;/script&gt;&lt;b&gt;"><link name="a"/><link name="b"/>
        <joint name="x" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#;
    fs::write(bench.root.join("data/r.urdf"), urdf).unwrap();
    for id in ["a", "b", "c"] {
        fs::remove_dir_all(bench.root.join(format!("data/seq_{id}"))).unwrap();
    }
    let id = "<img onerror=alert(1)>";
    let folder = bench.root.join(format!("data/seq_{id}"));
    fs::create_dir(&folder).unwrap();
    fs::remove_file(bench.root.join("data/points.npy")).unwrap();
    npy(&folder.join("angles.npy"), &[2, 1], &[0.1, 0.3]);
    npy(&folder.join("torques.npy"), &[2, 1], &[0.0, 0.0]);
    bench.metadata(r#"{"robot": "r.urdf", "rate_hz": 50, "base_pose": [[1,0,0,2],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}"#);
    let (page, data) = view(&bench, "data");
    assert!(!page.contains("<img") && !page.contains("<b>"));
    assert_eq!(data["motion"]["robot"]["name"], "</script><b>");
    let track = &data["motion"]["sequences"][0];
    assert_eq!(track["id"], id);
    assert!(floats(&track["loads"]).is_empty() && data["cloud"]["total"] == 0);
    let poses = floats(&track["poses"]);
    let x = poses[2 * 14 - 7] + data["origin"][0].as_f64().unwrap();
    assert!((x - 2.3).abs() < 1e-7, "{x}");
}

#[test]
fn what_is_refused() {
    let bench = Bench::new();
    let refused = |line: &str, code: i32, parts: &[&str]| {
        bench.fails(line, code, parts);
        assert!(!bench.root.join("a.html").exists());
    };
    refused("view data", 2, &["--out"]);
    refused("view data --out a.txt", 2, &["--out", ".html"]);
    refused("view data --out none/a.html", 3, &["none/a.html", "folder"]);
    refused("view data --out data/a.html", 2, &["--out", "data"]);
    refused("view truth --out truth/a.html", 2, &["--out", "truth"]);
    refused(
        "view data --out a.html --json=./a.html",
        2,
        &["--json", "--out", "same file"],
    );
    refused("view nowhere --out a.html", 1, &["nowhere"]);
    refused(
        "view truth --field truth --out a.html",
        2,
        &["--field needs a recording", "truth"],
    );
    refused("view truth --sequences a --out a.html", 2, &["--sequences"]);
    refused(
        "view data --sequences a,zz --out a.html",
        2,
        &["\"zz\"", "a, b, c"],
    );
    refused(
        "view data --full-scale 9 --out a.html",
        2,
        &["--full-scale", "--field"],
    );
    refused(
        "view truth --full-scale 0 --out a.html",
        2,
        &["--full-scale"],
    );
    fs::write(bench.root.join("bad.npz"), b"PK\x03\x04 cut").unwrap();
    refused("view bad.npz --out a.html", 1, &["bad.npz"]);
    fs::write(bench.root.join("f.ply"), b"ply").unwrap();
    refused("view f.ply --out a.html", 1, &["f.ply", ".npz"]);
    fs::write(bench.root.join("gap.json"), b"{\"schema\": 1}").unwrap();
    let parts = ["gap.json: no diagnosis", "dataset"];
    refused("view gap.json --out a.html", 1, &parts);

    npy(&bench.root.join("truth/K.npy"), &[160], &[1e99; 160]);
    refused("view truth --out a.html", 1, &["truth", "point 0", "1e99"]);
    npy(&bench.root.join("truth/K.npy"), &[160], &[f64::NAN; 160]);
    refused("view truth --out a.html", 1, &["K.npy", "row 0"]);
    npy(&bench.root.join("truth/K.npy"), &[160], &[1.0; 160]);
    npy(
        &bench.root.join("truth/points.npy"),
        &[160, 3],
        &[1e300; 480],
    );
    refused("view truth --out a.html", 1, &["truth", "row 0 x", "1e6 m"]);

    let mut angles = vec![0.0; 3 * ROWS];
    angles[3 * 5] = 1e9;
    npy(
        &bench.root.join("data/seq_b/angles.npy"),
        &[ROWS, 3],
        &angles,
    );
    refused(
        "view data --out a.html",
        1,
        &["b", "row 5", "link_1", "1e6 m"],
    );
    angles[3 * 5] = f64::INFINITY;
    npy(
        &bench.root.join("data/seq_b/angles.npy"),
        &[ROWS, 3],
        &angles,
    );
    refused("view data --out a.html", 1, &["seq_b", "angles.npy row 5"]);
}

#[test]
fn no_points_and_many() {
    let bench = Bench::new();
    let folder = |n: usize, points: &[f64], stiffness: &[f64]| {
        npy(&bench.root.join("truth/points.npy"), &[n, 3], points);
        npy(&bench.root.join("truth/K.npy"), &[n], stiffness);
    };
    folder(0, &[], &[]);
    let output = bench.run("view truth --out empty.html");
    let error = String::from_utf8_lossy(&output.stderr);
    if output.status.success() {
        let page = fs::read_to_string(bench.root.join("empty.html")).unwrap();
        assert_eq!(data(&page)["cloud"]["total"], 0);
    } else {
        assert!(error.contains("error: truth"), "{error}")
    }
    // All in one place.
    folder(2, &[0.5; 6], &[1.0, 2.0]);
    let (_, same) = view(&bench, "truth");
    assert_eq!(same["cloud"]["spacing"], 0.0);

    let n = 250_000;
    let points: Vec<f64> = (0..3 * n).map(|k| 0.001 * (k % 977) as f64).collect();
    folder(n, &points, &vec![5.0; n]);
    let (page, many) = view(&bench, "truth");
    assert!(page.contains("200000 of 250000 points are drawn"));
    assert_eq!(many["cloud"]["total"], n);
    assert_eq!(floats(&many["cloud"]["points"]).len(), 600_000);
    assert_eq!(floats(&many["cloud"]["layers"][0]["values"]).len(), 200_000);
}
