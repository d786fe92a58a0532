//! Joint states in CSV files become recordings.

use crate::common::Bench;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// The numbers of an array of f64.
fn numbers(path: &Path) -> Vec<f64> {
    let bytes = fs::read(path).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let numbers = bytes[start..].chunks_exact(8);
    numbers
        .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
        .collect()
}

/// A sequence as the text of its arrays, with these titles, its joints in reverse.
fn text(sequence: &Path, titles: &str) -> String {
    let [time, angles, torques] = ["time", "angles", "torques"]
        .map(|name| numbers(&sequence.join(name).with_extension("npy")));
    let rows = angles.chunks(3).zip(torques.chunks(3));
    let mut text = titles.to_owned() + "\n";
    for (t, (q, tau)) in time.iter().zip(rows) {
        let [q, tau] = [q, tau].map(|v| format!("{:?},{:?},{:?}", v[2], v[1], v[0]));
        writeln!(text, "{t:?},{q},{tau}").unwrap();
    }
    text
}

/// A file for each sequence comes back to the last bit, by the names of the joints or their numbers.
#[test]
fn sequences_come_back_as_they_were() {
    let bench = Bench::touched();
    let root = &bench.root;
    let json = bench.ok("info touch --json");
    let names: Vec<_> = (json.split("\"name\": \"").skip(2).take(3))
        .map(|rest| rest.split('"').next().unwrap())
        .collect();
    let named = format!(
        "time,q_{2},q_{1},q_{0},{2}.torque,{1}.torque,{0}.torque",
        names[0], names[1], names[2]
    );
    let cases = [
        ("named", named.as_str()),
        ("from_1", "t,q3,q2,q1,tau_3,tau_2,tau_1"),
        (
            "from_0",
            "timestamp,pos_2,pos_1,pos_0,2_effort,1_effort,0_effort",
        ),
    ];
    for (case, titles) in cases {
        fs::create_dir(root.join(case)).unwrap();
        for id in ["a", "b", "c"] {
            let text = text(&root.join(format!("touch/seq_{id}")), titles);
            fs::write(root.join(case).join(id).with_extension("csv"), text).unwrap();
        }
        let json = bench.ok(&format!(
            "import {case}/a.csv {case}/b.csv {case}/c.csv --robot cartesian_stage --torque-kind external \
             --points touch/points.npy --train 000,001 --test 002 --out {case}_rec --json"
        ));
        assert!(json.contains("\"topic\": null"), "{json}");
        let of = |split: &str| json.matches(&format!("\"split\": \"{split}\"")).count();
        assert_eq!([of("train"), of("test")], [2, 1], "{json}");
        let says = |out: &str, files: &[&str], flags: &str| {
            let files: String = files.iter().map(|f| format!("{case}/{f}.csv ")).collect();
            let text = bench.ok(&format!(
                "import {files}--robot cartesian_stage --torque-kind external {flags} --out {case}_{out}"
            ));
            text.contains("--train and --test say which do")
        };
        let points = "--points touch/points.npy";
        assert!(says("untested", &["a", "b"], points));
        assert!(!says(
            "planned",
            &["a", "b"],
            &format!("{points} --planned")
        ));
        assert!(!says("one", &["a"], points));
        assert!(!says("free", &["a", "b"], ""));
        let metadata = fs::read_to_string(root.join(format!("{case}_rec/dataset.json"))).unwrap();
        assert!(
            metadata.contains(&format!("\"name\": \"{case}_rec\"")),
            "{metadata}"
        );
        for (own, id) in [("a", "000"), ("b", "001"), ("c", "002")] {
            for array in ["angles", "torques", "time"] {
                let read = |folder: &str, id: &str| {
                    fs::read(root.join(folder).join(format!("seq_{id}/{array}.npy"))).unwrap()
                };
                let same = read("touch", own) == read(&format!("{case}_rec"), id);
                assert!(same, "{case}: {array} of {own}");
            }
        }
    }
    bench.ok("estimate named_rec --out field.npz");

    // Names of its own in another order exchange columns.
    let turned = [names[1], names[0], names[2]].join(",");
    let warnings = bench.warned(&format!(
        "import named/a.csv --names {turned} --robot cartesian_stage --torque-kind external --out turned"
    ));
    let part = format!(
        "--names has the robot's own names in another order: {0} is read from {1}, {1} is read from {0};",
        names[0], names[1]
    );
    assert!(warnings.contains(&part), "{warnings}");
    // The same order, and numbers, are what was meant.
    for (file, names) in [
        ("named/a.csv", names.join(",")),
        ("from_1/a.csv", "3,2,1".to_owned()),
    ] {
        let warnings = bench.warned(&format!(
            "import {file} --names {names} --robot cartesian_stage --torque-kind external --out turned"
        ));
        assert!(!warnings.contains("--names"), "{warnings}");
    }
}

#[test]
fn what_is_wrong_is_said_in_flags() {
    let bench = Bench::new();
    let root = &bench.root;
    let titles = "time,q1,q2,q3,tau1,tau2,tau3";
    fs::write(
        root.join("a.csv"),
        format!("{titles}\n0,0,0,0,0,0,0\n0.1,0,0,0,0,0,0\n"),
    )
    .unwrap();
    fs::write(root.join("bad.csv"), format!("{titles}\n0,0,0,x,0,0,0\n")).unwrap();
    fs::copy(root.join("a.csv"), root.join("a.txt")).unwrap();
    let known = "--robot cartesian_stage --torque-kind external --out rec";
    let cases = [
        ("none.csv", 1, "none.csv: no such file"),
        (
            "bad.csv",
            1,
            "bad.csv line 2 column \"q3\": \"x\" is not a number",
        ),
        (
            "a.txt",
            1,
            "a.txt: no MCAP file, and not named .csv or .tsv",
        ),
        ("a.csv a.txt", 1, "a.csv: given beside a.txt"),
        ("a.csv --topic /x", 2, "--topic: CSV files have no topics"),
        ("a.csv --log-time", 2, "--log-time: CSV files have no times"),
        (
            "a.csv --names a,b,c",
            1,
            "their names in the files by --names",
        ),
    ];
    for (line, code, part) in cases {
        bench.fails(&format!("import {line} {known}"), code, &[part]);
    }
    assert!(!root.join("rec").exists());
    // What is of all files names them all.
    fs::copy(root.join("a.csv"), root.join("b.csv")).unwrap();
    fs::write(
        root.join("c.csv"),
        format!("{titles}\n0,0,0,0,0,0,1\n0.1,0,0,0,0,0,1\n"),
    )
    .unwrap();
    let line = format!("import a.csv c.csv b.csv {known}").replace("--out rec", "--out copies");
    let warning = bench.warned(&line);
    let part = "a.csv and 2 more files: torques are all zero, as if nothing was measured, in sequence 000, 002";
    assert!(warning.contains(part), "{warning}");
    // Which file a sequence is from is told, a pause or not.
    let paused =
        format!("{titles}\n0,0,0,0,0,0,1\n0.1,0,0,0,0,0,1\n9,0,0,0,0,0,1\n9.1,0,0,0,0,0,1\n");
    fs::write(root.join("paused.csv"), paused).unwrap();
    let told =
        bench.ok(&format!("import paused.csv c.csv {known}").replace("--out rec", "--out paused"));
    let of: Vec<&str> = (told.lines())
        .filter(|line| line.trim_start().starts_with("00"))
        .filter_map(|line| line.split_whitespace().last())
        .collect();
    assert_eq!(of, ["paused.csv", "paused.csv", "c.csv"], "{told}");
    let still = "<robot name='still'><link name='a'/><link name='b'/><joint name='j' type='fixed'>
        <parent link='a'/><child link='b'/></joint></robot>";
    fs::write(root.join("still.urdf"), still).unwrap();
    let line = format!("import a.csv {known}").replace("cartesian_stage", "still.urdf");
    bench.fails(&line, 1, &["no joint that moves"]);
    // Numbers are those of the robot in every file.
    let other = "time,q0,q1,q2,q3,tau0,tau1,tau2,tau3\n0,0,0,0,0,0,0,0,0\n0.1,0,0,0,0,0,0,0,0\n";
    fs::write(root.join("other.csv"), other).unwrap();
    let parts = ["other.csv: its joints are 0, 1, 2, 3, and those of other files 1, 2, 3"];
    bench.fails(&format!("import a.csv other.csv {known}"), 1, &parts);
    let line = format!("import a.csv --gap 0.01 {known}");
    let part = "2 of 2 samples are more than 0.01 s from any other";
    bench.fails(&line, 2, &["--gap", part]);
    assert!(!root.join("rec").exists());
}

/// What no command would read again is not written.
#[test]
fn what_cannot_be_worked_with_is_no_recording() {
    let bench = Bench::new();
    let titles = "time,q1,q2,q3,tau1,tau2,tau3";
    let import = "import a.csv --robot cartesian_stage --torque-kind external --out new";
    for (rows, flags, parts) in [
        (
            "0,0,1e30,0,0,0,0\n0.1,0,0,0,0,0,0",
            "",
            &["a.csv: sequence 000 row 0 joint 2: a position of 1e30"][..],
        ),
        (
            "0,0,0,0,0,0,0\n0.1,0,0,0,0,0,1e300",
            "",
            &["a.csv: sequence 000 row 1 joint 3: a torque of 1e300"],
        ),
        (
            "0,0,0,0,0,0,0",
            "--torque-kind measured",
            &["at least two samples"],
        ),
    ] {
        fs::write(bench.root.join("a.csv"), format!("{titles}\n{rows}\n")).unwrap();
        let line = if flags.starts_with("--torque-kind") {
            import.replace("--torque-kind external", flags)
        } else {
            format!("{import} {flags}")
        };
        bench.fails(&line, 1, parts);
        assert!(!bench.root.join("new").exists(), "{line}");
    }
    let far = format!("{import} --box 1e8,0,0,100000000.1,0.1,0.1");
    bench.fails(&far, 2, &["--box: 1e8 m is beyond 1e6 m"]);
}

/// A motion that is planned has no torques: it is predicted as the recording of the same motion is.
#[test]
fn motions_that_are_planned_need_no_torques() {
    let bench = Bench::touched();
    let root = &bench.root;
    let mut text = "t,q1,q2,q3\n".to_owned();
    let [time, angles] = ["time", "angles"]
        .map(|name| numbers(&root.join("touch/seq_c").join(name).with_extension("npy")));
    for (t, q) in time.iter().zip(angles.chunks(3)) {
        writeln!(text, "{t:?},{:?},{:?},{:?}", q[0], q[1], q[2]).unwrap();
    }
    fs::write(root.join("plan.csv"), text).unwrap();
    let import = "import plan.csv --robot cartesian_stage --torque-kind external --points touch/points.npy --out plan";
    bench.fails(import, 1, &["has no column of its effort", "--planned"]);
    // Which needs no look at the files.
    bench.fails(
        &format!(
            "{} --planned --train 000",
            import.replace("plan.csv", "none.csv")
        ),
        2,
        &["--train", "no torques to learn from"],
    );
    bench.fails(
        &format!("{import} --planned --test 0"),
        2,
        &["--test", "no sequence \"0\"", "000, 001"],
    );
    let text = bench.ok(&format!("{import} --planned"));
    assert!(
        text.contains("3 joints of cartesian_stage from CSV"),
        "{text}"
    );
    assert!(text.contains("vsf info plan"), "{text}");
    for recording in ["touch", "plan"] {
        bench.ok(&format!(
            "predict {recording} --field truth --threshold 0.002 --out of_{recording}"
        ));
    }
    let info = bench.ok("info plan --json");
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(
        (info["train"].to_string(), info["test"].to_string()),
        ("[]".to_owned(), "[\"000\"]".to_owned())
    );
    bench.fails("evaluate plan --field truth", 2, &["nothing to compare"]);
    let of = |folder: &str| numbers(&root.join(folder).join("torques.npy"));
    let predicted = of("of_plan/seq_000");
    assert_eq!(predicted, of("of_touch/seq_c"));
    assert!(predicted.iter().any(|tau| *tau != 0.0));
}
