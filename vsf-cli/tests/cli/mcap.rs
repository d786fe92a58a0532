//! MCAP files end to end: what is exported comes back, bags become recordings.

use crate::common::{Bench, METADATA, ROWS};
use std::fs;
use std::path::Path;

/// Efforts of a topic, message after message: the last array of a JointState.
fn efforts(path: &Path, topic: &str) -> Vec<f64> {
    let bytes = fs::read(path).unwrap();
    let messages = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap);
    let own = messages.filter(|m| m.channel.topic == topic);
    own.flat_map(|m| {
        let numbers = m.data[m.data.len() - 24..].chunks_exact(8);
        numbers
            .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
            .collect::<Vec<_>>()
    })
    .collect()
}

/// The numbers of an array of f64.
fn numbers(path: &Path) -> Vec<f64> {
    let bytes = fs::read(path).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[start..]
        .chunks_exact(8)
        .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

/// The joint states of an export alone, as a driver would have logged them.
fn bag(from: &Path, to: &Path) {
    let bytes = fs::read(from).unwrap();
    let mut out = mcap::Writer::new(fs::File::create(to).unwrap()).unwrap();
    for message in mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap)
    {
        if message.channel.topic == "/joint_states" {
            out.write(&message).unwrap();
        }
    }
    out.finish().unwrap();
}

fn same_arrays(a: &Path, b: &Path, names: [(&str, &str); 3]) {
    for (x, y) in names {
        for array in ["angles", "torques", "time"] {
            let read =
                |folder: &Path, id| fs::read(folder.join(format!("seq_{id}/{array}.npy"))).unwrap();
            assert!(read(a, x) == read(b, y), "{array} of {x}");
        }
    }
}

#[test]
fn exports_come_back_as_they_were() {
    let bench = Bench::touched();
    let root = &bench.root;
    bench.ok("export touch --out plain.mcap");
    let json = bench.ok("import plain.mcap --out back --json");
    assert!(json.contains("\"topic\": \"/joint_states\""), "{json}");
    assert!(json.contains("\"robot\": \"cartesian_stage"), "{json}");
    same_arrays(
        &root.join("touch"),
        &root.join("back"),
        [("a", "a"), ("b", "b"), ("c", "c")],
    );
    let read = |path: &str| fs::read(root.join(path)).unwrap();
    assert!(read("touch/points.npy") == read("back/points.npy"));
    // But for the command that has written it, and the digest of that.
    let text = |path| {
        let text = String::from_utf8(read(path)).unwrap();
        let lines = text.lines().filter(|line| !line.contains("\"digest\""));
        lines.collect::<Vec<_>>().join("\n")
    };
    let imported = text("touch/dataset.json").replace("vsf simulate", "vsf import");
    assert_eq!(imported, text("back/dataset.json"));

    let warnings = bench.warned(
        "import plain.mcap --box 0,0,0,0.01,0.01,0.01 --spacing 0.005 --no-velocities --out boxed",
    );
    assert!(!warnings.contains("outside"), "{warnings}");

    // Predictions and field are in it, and do not hinder.
    bench.ok("estimate touch --out field.npz --out field.mcap");
    bench.ok("export touch --field field.npz --out made/all.mcap --out made/all.ply");
    bench.ok("export field.npz --out made/field.mcap --full-scale 50");
    bench.ok("export field.npz --out made/sd.mcap --deviation");
    let read = |name| fs::read(root.join("made").join(name)).unwrap();
    assert!(read("field.mcap") != read("sd.mcap"));
    assert!(fs::metadata(root.join("made/field.mcap")).unwrap().len() > 160 * 24);
    bench.ok("predict touch --field field.npz --sequences a,b,c --out predicted");
    let all = root.join("made/all.mcap");
    for (topic, array) in [
        ("/joint_states", "touch/seq_{}/torques.npy"),
        ("/predicted/joint_states", "predicted/seq_{}/torques.npy"),
        (
            "/predicted/joint_states_sd",
            "predicted/seq_{}/torques_sd.npy",
        ),
    ] {
        let of = |id| numbers(&root.join(array.replace("{}", id)));
        let expected = ["a", "b", "c"].map(of).concat();
        let found = efforts(&all, topic);
        assert_eq!(found.len(), 3 * 3 * ROWS);
        let far = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-12;
        assert!(!found.iter().zip(&expected).any(far), "{topic}");
    }
    // Of the three topics with joint states, the recorded one.
    bench.ok("import made/all.mcap --out again");
    let json = |folder| bench.ok(&format!("evaluate {folder} --field field.npz --json"));
    assert_eq!(json("touch"), json("again"));
}

/// Predictions stand beside what was measured, gravity and offset included.
#[test]
fn predictions_are_readings() {
    let bench = Bench::new();
    bench.metadata(&METADATA.replace(
        "\"rate_hz\"",
        "\"torque_kind\": \"measured\", \"base_pose\": [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], \
         \"gravity\": [0.5, 1.0, -9.81], \"tare_samples\": 1, \"rate_hz\"",
    ));
    bench.ok("simulate data --field truth --out touch");
    bench.ok("export touch --field truth --out all.mcap");
    let path = bench.root.join("all.mcap");
    let measured = efforts(&path, "/joint_states");
    let predicted = efforts(&path, "/predicted/joint_states");
    assert!(measured.iter().any(|v| v.abs() > 0.1), "{measured:?}");
    let error = measured
        .iter()
        .zip(&predicted)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    assert!(error < 1e-9, "{error}");
}

/// A bag, two commands, a field.
#[test]
fn bags_become_fields() {
    let bench = Bench::touched();
    let root = &bench.root;
    bench.ok("export touch --out all.mcap");
    fs::create_dir(root.join("bag")).unwrap();
    bag(&root.join("all.mcap"), &root.join("bag/bag_0.mcap"));
    bench.ok(
        "import bag --robot cartesian_stage --torque-kind external --points touch/points.npy \
         --train 000,001 --test 002 --out rec",
    );
    let ids = [("a", "000"), ("b", "001"), ("c", "002")];
    same_arrays(&root.join("touch"), &root.join("rec"), ids);
    bench.ok("estimate rec --out field.npz");
    let text = bench.ok("evaluate rec --field field.npz");
    assert!(text.contains("002"), "{text}");

    // Columns by other names than the robot's.
    let json = bench.ok("info touch --json");
    let names: Vec<_> = (json.split("\"name\": \"").skip(2).take(3))
        .map(|rest| rest.split('"').next().unwrap())
        .collect();
    let names = [names[1], names[2], names[0]].join(",");
    let warnings = bench.warned(&format!(
        "import bag --robot cartesian_stage --torque-kind external --names {names} --out turned"
    ));
    assert!(
        warnings.contains("--names has the robot's own names in another order: "),
        "{warnings}"
    );
    let [plain, turned] =
        ["rec", "turned"].map(|f| numbers(&root.join(f).join("seq_001/angles.npy")));
    let rows = plain.chunks(3).zip(turned.chunks(3));
    assert!(rows.clone().all(|(a, b)| [a[1], a[2], a[0]] == b[..]));

    // The block of points as a box: 10 x 8 x 2 points, 4 mm apart.
    let json = bench.ok(
        "import bag --robot cartesian_stage --torque-kind external --gap 100 --log-time \
         --box -0.002,-0.002,-0.006,0.038,0.030,0.002 --spacing 0.004 --out filled --json",
    );
    assert!(json.contains("\"points\": 160"), "{json}");
    let (found, expected) = (
        numbers(&root.join("filled/points.npy")),
        numbers(&root.join("touch/points.npy")),
    );
    let near = |p: &[f64]| {
        expected
            .chunks(3)
            .any(|q| p.iter().zip(q).all(|(a, b)| (a - b).abs() < 1e-12))
    };
    assert!(found.chunks(3).all(near));

    // A depth of 14 mm makes four layers of 3.5 mm: the surface stays where it is.
    bench.ok(
        "import bag --robot cartesian_stage --torque-kind external --gap 100 --log-time \
         --box 0,0,-0.014,0.04,0.04,0 --spacing 0.004 --out deep",
    );
    let deep = numbers(&root.join("deep/points.npy"));
    let top = deep.chunks(3).map(|p| p[2]).fold(f64::MIN, f64::max);
    assert!((top + 0.00175).abs() < 1e-12, "{top}");
}

#[test]
fn what_is_missing_is_said() {
    let bench = Bench::touched();
    let root = &bench.root;
    bench.ok("export touch --out all.mcap");
    bag(&root.join("all.mcap"), &root.join("bag.mcap"));
    let whole = fs::read(root.join("bag.mcap")).unwrap();
    fs::write(root.join("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    let known = "--robot cartesian_stage --torque-kind external --out rec";
    bench.fails(
        "import bag.mcap --torque-kind external --out rec",
        2,
        &["--robot is required"],
    );
    bench.fails(
        "import bag.mcap --robot cartesian_stage --out rec",
        2,
        &["--torque-kind is required"],
    );
    bench.fails(
        "import bag.mcap --robot planar_arm --torque-kind external --out rec",
        1,
        &[
            "bag.mcap: no message on /joint_states has the robot's joints",
            "their names in the files by --names",
        ],
    );
    bench.fails(
        &format!("import bag.mcap --names x {known}"),
        2,
        &["--names takes a name for each of ", "1 given"],
    );
    for (names, part) in [
        ("x,x,y", "\"x\" is there twice"),
        ("x,,y", "a name is empty"),
    ] {
        let line = format!("import bag.mcap --names {names} {known}");
        bench.fails(&line, 2, &["--names: ", part]);
    }
    bench.fails(
        &format!("import bag.mcap --points touch/points.npy --json=touch/points.npy {known}"),
        2,
        &["--json", "touch/points.npy"],
    );
    fs::copy(root.join("bag.mcap"), root.join("bag_2.mcap")).unwrap();
    bench.fails(
        &format!("import bag.mcap bag_2.mcap {known}"),
        1,
        &["in the order given"],
    );
    let cases = [
        ("import none.mcap", 1, "none.mcap: no such file"),
        (
            "import cut.mcap",
            1,
            "cut.mcap: the file ends in the middle of a record",
        ),
        (
            "import touch/points.npy",
            1,
            "points.npy: no MCAP file, and not named .csv or .tsv",
        ),
        ("import touch", 1, "*.mcap: no such file"),
        (
            "import bag.mcap --topic /x",
            1,
            "no topic /x; there are joint states on /joint_states",
        ),
        ("import bag.mcap --gap 0", 2, "--gap"),
        ("import bag.mcap --test 9", 2, "--train, --test"),
        (
            "import bag.mcap --points a.csv",
            1,
            "a.csv is no .ply, .pcd, .npy or .npz",
        ),
        (
            "import bag.mcap --box 0,0,0,1,1",
            2,
            "--box takes 6 numbers, 5 given",
        ),
        (
            "import bag.mcap --box 0,0,0,1,1,1 --spacing 1e-9",
            2,
            "more than",
        ),
        ("import bag.mcap --spacing 0.1", 2, "--box"),
        (
            "import bag.mcap --points p.ply --spacing 0.1",
            2,
            "--points",
        ),
        ("import bag.mcap --box 0,0,1,1,1,1", 2, "edge of length 0"),
        (
            "import bag.mcap --box 0,0,0,1,1,1 --spacing 10",
            2,
            "more than the box",
        ),
        (
            "import bag.mcap --out touch/seq_a",
            2,
            "the argument '--out",
        ),
    ];
    for (line, code, part) in cases {
        bench.fails(&format!("{line} {known}"), code, &[part]);
    }
    bench.fails(
        "import bag.mcap --robot cartesian_stage --torque-kind external --out .",
        2,
        &["holds other files"],
    );
    assert!(!root.join("rec").exists());
    bench.fails(
        "export touch --out x.mcap --torques plots",
        2,
        &["--field is required"],
    );
    for flag in ["--deviation", "--full-scale 9"] {
        bench.fails(
            &format!("export touch --out x.mcap {flag}"),
            2,
            &["--deviation and --full-scale are of a field", "--field"],
        );
    }
    bench.fails(
        "export truth --out x.mcap --deviation",
        1,
        &["truth: the field has no standard deviation"],
    );
    bench.fails("estimate field.mcap", 1, &["no such data set folder"]);
    bench.fails(
        "info data/points.npy",
        1,
        &["a recording is a folder", "vsf import"],
    );
    bench.fails(
        "export all.mcap --out x.ply",
        1,
        &["a .mcap is for looking at"],
    );
}
