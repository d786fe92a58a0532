//! Every kind of bad input has its error, which names file, sequence and row.

use crate::common::{Folder, f8, npy};
use std::fs;
use std::io::Write;
use vsf_data::{DataError, DataWarning, Dataset, NpyError, Overrides, Table, write_file};

/// Opens the folder after a change and checks variant and message.
macro_rules! refused {
    ($change:expr, $pattern:pat, $text:expr) => {{
        let folder = Folder::new();
        folder.open().expect("valid before the change");
        #[allow(clippy::redundant_closure_call)]
        ($change)(&folder);
        let (error, text) = folder.error();
        assert!(matches!(error, $pattern), "{error:?}");
        assert!(text.contains($text), "{text}");
    }};
}

#[test]
fn missing_files() {
    let nowhere = Dataset::open("/no/such/folder", &Overrides::default());
    assert!(matches!(nowhere, Err(DataError::Missing { .. })));
    refused!(
        |f: &Folder| f.remove("seq_10/torques.npy"),
        DataError::Missing { .. },
        "seq_10/torques.npy: no such file"
    );
    refused!(
        |f: &Folder| f.write("camera/camera.json", camera_json(2, 2).as_bytes()),
        DataError::Missing { .. },
        "camera/color.png"
    );
    refused!(
        |f: &Folder| ["seq_2", "seq_10"]
            .iter()
            .for_each(|s| fs::remove_dir_all(f.path().join(s)).unwrap()),
        DataError::NoSequences { .. },
        "no touch sequences"
    );
}

#[test]
fn wrong_shapes() {
    let eight = [0.0; 8];
    refused!(
        |f: &Folder| f.write("seq_2/torques.npy", &f8("(8,)", &eight)),
        DataError::Shape { .. },
        "seq_2/torques.npy: shape [8], expected (T, d)"
    );
    refused!(
        |f: &Folder| f.write("seq_2/torques.npy", &f8("(2, 4)", &eight)),
        DataError::Rows { .. },
        "seq_2/torques.npy: 2 rows, but angles.npy has 4"
    );
    refused!(
        |f: &Folder| f.write("seq_2/velocities.npy", &f8("(4, 1)", &[0.0; 4])),
        DataError::Shape { .. },
        "seq_2/velocities.npy: shape [4, 1], expected 2 columns, as angles.npy has"
    );
    refused!(
        |f: &Folder| f.write("seq_2/time.npy", &f8("(3,)", &[0.0, 1.0, 2.0])),
        DataError::Rows { .. },
        "seq_2/time.npy: 3 rows"
    );
    refused!(
        |f: &Folder| f.write("points.npy", &f8("(3, 2)", &[0.0; 6])),
        DataError::Shape { .. },
        "points.npy: shape [3, 2]"
    );
    refused!(
        |f: &Folder| f.write("points.npy", &f8("(0, 3)", &[])),
        DataError::Empty { .. },
        "points.npy: the point cloud is empty"
    );
    refused!(
        |f: &Folder| ["angles", "torques"]
            .iter()
            .for_each(|n| f.write(&format!("seq_2/{n}.npy"), &f8("(0, 2)", &[]))),
        DataError::Empty { .. },
        "seq_2/angles.npy"
    );
    refused!(
        |f: &Folder| ["angles", "torques"]
            .iter()
            .for_each(|n| f.write(&format!("seq_10/{n}.npy"), &f8("(2, 4)", &eight))),
        DataError::Shape { .. },
        "seq_10/angles.npy: shape [2, 4], expected 2 columns, as the first sequence"
    );
    refused!(
        |f: &Folder| f.with(r#""joints": ["a", "b", "c"]"#),
        DataError::Metadata { key: "joints", .. },
        "dataset.json: joints: lists 3 columns"
    );
    refused!(
        |f: &Folder| f.with(r#""joint_types": ["revolute"]"#),
        DataError::Metadata {
            key: "joint_types",
            ..
        },
        "dataset.json: joint_types: lists 1 columns"
    );
}

#[test]
fn numbers_that_are_not_finite() {
    let mut values = [0.0; 8];
    values[5] = f64::NAN;
    refused!(
        |f: &Folder| f.write("seq_10/torques.npy", &f8("(4, 2)", &values)),
        DataError::NotFinite { .. },
        "seq_10/torques.npy row 2 joint 2: NaN"
    );
    refused!(
        |f: &Folder| f.write("points.npy", &f8("(1, 3)", &[0.0, f64::INFINITY, 0.0])),
        DataError::NotFinite { .. },
        "points.npy row 0 y: inf"
    );
    refused!(
        |f: &Folder| f.write("seq_2/time.npy", &f8("(4,)", &[0.0, f64::NAN, 2.0, 3.0])),
        DataError::NotFinite { .. },
        "seq_2/time.npy row 1: NaN"
    );
    refused!(
        |f: &Folder| f.write("seq_2/time.npy", &f8("(4,)", &[0.0, 1.0, 1.0, 3.0])),
        DataError::TimeOrder { .. },
        "seq_2/time.npy row 2: time 1.0 s is not after 1.0 s of the row before"
    );
    // Speeds would be beyond anything.
    refused!(
        |f: &Folder| f.write("seq_2/time.npy", &f8("(4,)", &[0.0, 1.0, 1.0 + 1e-11, 3.0])),
        DataError::TimeOrder { .. },
        "is not after 1.0 s of the row before by a nanosecond"
    );
    refused!(
        |f: &Folder| f.write("seq_2/time.npy", &f8("(4,)", &[0.0, 1.0, 2.0, 1e300])),
        DataError::FarTime { .. },
        "seq_2/time.npy row 3: time 1e300 s is beyond"
    );
}

#[test]
fn damaged_npy() {
    let cases: [(Vec<u8>, NpyError); 8] = [
        (b"hello".to_vec(), NpyError::Magic),
        (
            b"\x93NUMPY\x04\x00\x02\x00{}".to_vec(),
            NpyError::Version { major: 4, minor: 0 },
        ),
        (
            b"\x93NUMPY\x01\x00\xff\xff{}".to_vec(),
            NpyError::Header("the file ends inside the header"),
        ),
        (npy("|O", "(4, 2)", b"\x80\x04]."), NpyError::Object),
        (
            npy(">f8", "(4, 2)", &[0; 64]),
            NpyError::BigEndian(">f8".to_owned()),
        ),
        (
            f8("(4, 2)", &[0.0; 7]),
            NpyError::Truncated {
                expected: 64,
                got: 56,
            },
        ),
        (f8("(4, 2)", &[0.0; 9]), NpyError::Trailing { extra: 8 }),
        (
            f8("(4611686018427387904, 4611686018427387904)", &[]),
            NpyError::Shape(vec![1 << 62, 1 << 62]),
        ),
    ];
    for (bytes, expected) in cases {
        let folder = Folder::new();
        folder.write("seq_2/angles.npy", &bytes);
        let (error, text) = folder.error();
        assert!(text.starts_with("seq_2/angles.npy: "), "{text}");
        let DataError::Npy { source, .. } = error else {
            panic!("{error:?}");
        };
        assert_eq!(source, expected);
    }
}

#[test]
fn malformed_npy_headers() {
    let headers = [
        "",
        "[]",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (4, 2)} x",
        "{'descr': '<f8', 'fortran_order': 0, 'shape': (4, 2)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (8)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (4 2)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-4, 2)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999,)}",
        "{'descr': '<f8', 'fortran_order': False}",
        "{'descr': '<f8', 'descr': '<f8', 'fortran_order': False, 'shape': (4, 2)}",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (4, 2), 'x': 1}",
        "{'descr': '<f8, 'fortran_order': False, 'shape': (4, 2)}",
        "{'descr': '<f8' 'fortran_order': False, 'shape': (4, 2)}",
    ];
    for header in headers {
        let folder = Folder::new();
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.extend([0; 64]);
        folder.write("seq_2/angles.npy", &bytes);
        let (error, text) = folder.error();
        let malformed = matches!(
            error,
            DataError::Npy {
                source: NpyError::Header(_),
                ..
            }
        );
        assert!(malformed, "{header}: {text}");
    }
}

#[test]
fn robots() {
    refused!(
        |f: &Folder| f.json(r#"{"rate_hz": 1}"#),
        DataError::MissingKey { key: "robot", .. },
        "dataset.json: robot is required"
    );
    refused!(
        |f: &Folder| f.json(r#"{"robot": "robot.urdf", "rate_hz": 1}"#),
        DataError::RobotNotFound { .. },
        "\"robot.urdf\": no file robot.urdf"
    );
    refused!(
        |f: &Folder| f.json(r#"{"robot": "", "rate_hz": 1}"#),
        DataError::RobotNotFound { .. },
        "robot"
    );
    refused!(
        |f: &Folder| f.json(r#"{"robot": "kinova_gen3"}"#),
        DataError::MissingKey { key: "rate_hz", .. },
        "seq_2: rate_hz is required"
    );
}

#[test]
fn json_that_is_not_json_or_of_wrong_type() {
    refused!(
        |f: &Folder| f.json("{\n \"robot\": kinova\n}"),
        DataError::Json { line: 2, .. },
        "dataset.json line 2 column 11: invalid JSON"
    );
    refused!(
        |f: &Folder| f.json("{\n \"robot\": 7\n}"),
        DataError::JsonType { line: 2, .. },
        "dataset.json line 2 column 11: robot: invalid type: integer `7`, expected a string"
    );
    refused!(
        |f: &Folder| f.json(r#"{"splits": {"train": [0]}}"#),
        DataError::JsonType { .. },
        ": splits.train[0]: invalid type"
    );
    refused!(
        |f: &Folder| f.json(r#"{"gravity": [0, 0, 0, 0]}"#),
        DataError::JsonType { .. },
        ": gravity: a value of another type, or of more entries"
    );
    refused!(
        |f: &Folder| f.json(r#"{"torque_kind": 5}"#),
        DataError::JsonType { .. },
        ": torque_kind: a value of another type"
    );
    refused!(
        |f: &Folder| f.json(r#"{"rate_hz": [70]}"#),
        DataError::JsonType { .. },
        ": rate_hz: invalid type: sequence, expected a number"
    );
    refused!(
        |f: &Folder| f.json(r#"{"tare_samples": -1}"#),
        DataError::JsonType { .. },
        ": tare_samples: invalid value: integer `-1`, expected a whole number >= 0"
    );
    refused!(
        |f: &Folder| f.json(r#"{"rate_hz": 1e400}"#),
        DataError::JsonType { .. },
        ": rate_hz: number out of range"
    );
    for text in [
        "[]",
        r#"{"robot": "a", "robot": "b"}"#,
        r#"{"rate_hz": "70"}"#,
        r#"{"torque_kind": "internal"}"#,
        r#"{"gravity": [0, 0]}"#,
        r#"{"base_pose": [[1, 0, 0, 0]]}"#,
        r#"{"tare_samples": -1}"#,
        r#"{"splits": {"train": [0]}}"#,
        r#"{"splits": {"validation": ["2"]}}"#,
        r#"{"joint_types": ["ball"]}"#,
        r#"{"touch_starts": {"2": [0.5]}}"#,
        r#"{"touch_starts": {"2": [0], "2": [1]}}"#,
        r#"{"sequence_tags": {"2": "loaded"}}"#,
        r#"{"sequence_tags": {"2": {"a": []}}}"#,
    ] {
        refused!(
            |f: &Folder| f.json(text),
            DataError::JsonType { .. },
            "dataset.json line"
        );
    }
    refused!(
        |f: &Folder| f.json("{"),
        DataError::Json { .. },
        "dataset.json line 1"
    );
    for (bytes, problem) in [
        (
            &b"\xff\xfe{\0}\0"[..],
            "line 1 column 1: invalid JSON: UTF-16",
        ),
        (b"{\0}\0", "line 1 column 1: invalid JSON: UTF-16"),
        (
            b"{\n \"name\": \"caf\xe9\"}",
            "line 2 column 14: invalid JSON: not UTF-8",
        ),
        (
            b"\xef\xbb\xbf{}",
            "line 1 column 1: invalid JSON: a byte order mark",
        ),
    ] {
        refused!(
            |f: &Folder| f.write("dataset.json", bytes),
            DataError::Json { .. },
            problem
        );
    }
}

#[test]
fn values_without_meaning() {
    for (members, key) in [
        (r#""rate_hz": 0"#, "rate_hz"),
        (r#""rate_hz": -5"#, "rate_hz"),
        (r#""rate_hz": 1e-308"#, "rate_hz"),
        (r#""rate_hz": 1e300"#, "rate_hz"),
        (r#""gauge_length": 0"#, "gauge_length"),
        (r#""object_bbox": [[0, 0, 1], [1, 1, 0]]"#, "object_bbox"),
        (r#""joints": ["a", "a"]"#, "joints"),
        (
            r#""joints": ["a", "b"], "joint_types": ["revolute"]"#,
            "joint_types",
        ),
        (
            r#""base_pose": [[1,0,0,0],[0,1,0,0],[0,0,2,0],[0,0,0,1]]"#,
            "base_pose",
        ),
        (
            r#""base_pose": [[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]"#,
            "base_pose",
        ),
        (
            r#""base_pose": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1,1]]"#,
            "base_pose",
        ),
    ] {
        let folder = Folder::new();
        folder.json(&format!(r#"{{"robot": "kinova_gen3", {members}}}"#));
        let (error, _) = folder.error();
        let DataError::Metadata { key: found, .. } = error else {
            panic!("{error:?}");
        };
        assert_eq!(found, key);
    }
}

#[test]
fn splits_tags_and_touches() {
    refused!(
        |f: &Folder| f.with(r#""splits": {"train": ["2"], "test": []}"#),
        DataError::EmptySplit { split: "test", .. },
        "test is empty"
    );
    refused!(
        |f: &Folder| f.with(r#""splits": {}"#),
        DataError::EmptySplit { .. },
        "train is empty"
    );
    refused!(
        |f: &Folder| f.with(r#""splits": {"train": ["2"], "test": ["3"]}"#),
        DataError::UnknownSequence { key: "splits", .. },
        "splits names sequence \"3\", but there is no folder seq_3"
    );
    refused!(
        |f: &Folder| f.with(r#""splits": {"train": ["2"], "test": ["2"]}"#),
        DataError::DuplicateSequence { .. },
        "\"2\" is listed twice in splits train and test"
    );
    refused!(
        |f: &Folder| f.with(r#""splits": {"train": ["2", "2"]}"#),
        DataError::DuplicateSequence { .. },
        "\"2\" is listed twice in train"
    );
    refused!(
        |f: &Folder| f.with(r#""touch_starts": {"3": [0]}"#),
        DataError::UnknownSequence {
            key: "touch_starts",
            ..
        },
        "seq_3"
    );
    refused!(
        |f: &Folder| f.with(r#""sequence_tags": {"3": ["loaded"]}"#),
        DataError::UnknownSequence {
            key: "sequence_tags",
            ..
        },
        "seq_3"
    );
    refused!(
        |f: &Folder| f.with(r#""touch_starts": {"2": [0, 4]}"#),
        DataError::TouchStarts { index: 1, .. },
        "sequence \"2\": entry 1 is row 4: the sequence has 4 rows"
    );
    refused!(
        |f: &Folder| f.with(r#""touch_starts": {"2": [0, 2, 2]}"#),
        DataError::TouchStarts { index: 2, .. },
        "rows must increase"
    );
    refused!(
        |f: &Folder| f.with(r#""tare_samples": 4"#),
        DataError::TareSamples { .. },
        "tare_samples = 4, but sequence \"2\" has 4 samples"
    );
}

#[test]
fn warnings_name_what_was_seen() {
    let folder = Folder::new();
    folder.with(
        r#""operator": {"x": [1]}, "splits": {"test": ["2"]}, "object_bbox": [[0, 0, 0], [0.25, 1, 1]]"#,
    );
    let (dataset, warnings) = folder.open().unwrap();
    assert_eq!(dataset.extra["operator"], r#"{"x":[1]}"#);
    for key in ["robot", "rate_hz", "digest", "contact_parameters"] {
        let mut twice = dataset.clone();
        twice.extra.insert(key.to_owned(), "1".to_owned());
        let error = twice
            .save(tempfile::tempdir().unwrap().path().join("twice"))
            .unwrap_err();
        assert!(error.to_string().contains(key), "{error}");
    }
    assert_eq!(dataset.train().count(), 0);
    assert_eq!(dataset.test().count(), 1);
    assert!(matches!(&warnings[0], DataWarning::UnknownKeys { keys, .. } if keys == &["operator"]));
    let box_ = DataWarning::PointsOutsideBox {
        path: folder.path().join("points.npy"),
        count: 1,
        total: 2,
    };
    assert_eq!(warnings[1], box_);
    assert!(matches!(&warnings[2], DataWarning::UnassignedSequences { ids, .. } if ids == &["10"]));
    let many = DataWarning::UnassignedSequences {
        path: folder.path().to_owned(),
        ids: (0..800).map(|id| format!("{id:03}")).collect(),
    };
    let told = many.to_string();
    assert!(
        told.contains(": 000, 001, 002") && told.ends_with("018, 019 and 780 more"),
        "{told}"
    );
    assert_eq!(warnings.len(), 3);

    let folder = Folder::new();
    folder.with(r#""attachment": "bilateral", "gauge_length": 0.1"#);
    let (_, warnings) = folder.open().unwrap();
    assert!(
        matches!(&warnings[..], [DataWarning::ClampedSpecimen { keys, .. }]
            if keys == &["attachment", "gauge_length"])
    );

    let folder = Folder::new();
    folder.write("seq_10/torques.npy", &f8("(4, 2)", &[0.0; 8]));
    let (_, warnings) = folder.open().unwrap();
    assert!(matches!(&warnings[..], [DataWarning::ZeroTorques { ids, .. }] if ids == &["10"]));

    let folder = Folder::new();
    let beside = ["torques_sd.npy", "._time.npy", "notes.txt"];
    for name in ["Torques.npy", "velocity.NPY"].iter().chain(&beside) {
        folder.write(&format!("seq_10/{name}"), b"what is not read");
    }
    let (_, warnings) = folder.open().unwrap();
    let [warning @ DataWarning::OtherArrays { others: 1, .. }] = &warnings[..] else {
        panic!("{warnings:?}");
    };
    assert_eq!(
        warning.to_string(),
        format!(
            "{}: not read; the arrays of a sequence are time.npy, angles.npy, velocities.npy, torques.npy; 1 \
             more of that kind",
            folder.path().join("seq_10/Torques.npy").display()
        )
    );

    // Names that do not go on as the time does; a clock that starts anew is none of that.
    let time = |from: f64| f8("(4,)", &[from, from + 1.0, from + 2.0, from + 3.0]);
    for (first, second, earlier) in [(100.0, 0.0, true), (0.0, 100.0, false), (1.0, 0.0, false)] {
        let folder = Folder::new();
        folder.write("seq_2/time.npy", &time(first));
        folder.write("seq_10/time.npy", &time(second));
        let (_, warnings) = folder.open().unwrap();
        let told = warnings.iter().any(|w| {
            matches!(w, DataWarning::EarlierSequences { first, of, others: 0, .. }
                if first == "10" && of == "2")
        });
        assert_eq!(told, earlier, "{warnings:?}");
    }

    // One touch under two names.
    let folder = Folder::new();
    for file in ["angles.npy", "torques.npy"] {
        let bytes = fs::read(folder.path().join("seq_10").join(file)).unwrap();
        folder.write(&format!("seq_11/{file}"), &bytes);
    }
    let (_, warnings) = folder.open().unwrap();
    assert!(
        matches!(&warnings[..], [DataWarning::CopiedSequences { first, of, others: 0, .. }]
            if first == "11" && of == "10"),
        "{warnings:?}"
    );

    // The torques of one touch with the angles of another.
    let folder = Folder::new();
    let torques = fs::read(folder.path().join("seq_10/torques.npy")).unwrap();
    folder.write("seq_2/torques.npy", &torques);
    folder.write("seq_2/angles.npy", &f8("(4, 2)", &[0.5; 8]));
    let (_, warnings) = folder.open().unwrap();
    assert!(
        matches!(&warnings[..], [DataWarning::CopiedTorques { first, of, others: 0, .. }]
            if first == "10" && of == "2"),
        "{warnings:?}"
    );

    // A touch that tests, cut out of one that trains, and rounded anew.
    let folder = Folder::new();
    let numbers = |skip: usize, by: f64| -> Vec<f64> {
        (2 * skip..40)
            .map(|k| (0.3 * k as f64).sin() + by)
            .collect()
    };
    for (id, skip, by) in [("10", 0, 0.0), ("2", 4, 1e-9)] {
        let shape = format!("({}, 2)", 20 - skip);
        for file in ["angles.npy", "torques.npy"] {
            folder.write(&format!("seq_{id}/{file}"), &f8(&shape, &numbers(skip, by)));
        }
        let stamps: Vec<f64> = (0..20 - skip).map(|k| 0.01 * k as f64).collect();
        let shape = format!("({},)", 20 - skip);
        folder.write(&format!("seq_{id}/time.npy"), &f8(&shape, &stamps));
    }
    for (train, test) in [("10", "2"), ("2", "10")] {
        folder.with(&format!(
            r#""splits": {{"train": ["{train}"], "test": ["{test}"]}}"#
        ));
        let (_, warnings) = folder.open().unwrap();
        let told = warnings.iter().any(|w| {
            matches!(w, DataWarning::OverlappingSequences { first, of, rows: 16, others: 0, .. }
                if first == test && of == train)
        });
        assert!(told, "{warnings:?}");
    }

    // A touch that trains, and nearly the same once more to test.
    let folder = Folder::new();
    let angles = fs::read(folder.path().join("seq_10/angles.npy")).unwrap();
    folder.write("seq_2/angles.npy", &angles);
    for (train, test) in [("2", "10"), ("10", "2")] {
        folder.with(&format!(
            r#""splits": {{"train": ["{train}"], "test": ["{test}"]}}"#
        ));
        let (_, warnings) = folder.open().unwrap();
        assert!(
            matches!(&warnings[..], [DataWarning::RetracedSequences { first, of, others: 0, .. }]
                if first == test && of == train),
            "{warnings:?}"
        );
    }

    // Milliseconds.
    let folder = Folder::new();
    let stamps = [0.0, 10.0, 20.0, 31.0];
    folder.write("seq_2/time.npy", &f8("(4,)", &stamps));
    let (_, warnings) = folder.open().unwrap();
    let [other @ DataWarning::OtherRate { ids, .. }] = &warnings[..] else {
        panic!("{warnings:?}");
    };
    assert_eq!(ids, &["2"]);
    let text = other.to_string();
    assert!(
        text.contains("samples of sequence 2 are 1.000e1 s apart"),
        "{text}"
    );

    // Another rate than the stamps have is told, and does not count. Sequences share one, so the stamps of one may
    // differ from it by more than those of all.
    let one = ["2"];
    let both = ["2", "10"];
    for (rate_hz, stamped, is_told) in [
        (70.0, &both[..], true),
        (95.0, &both, false),
        (110.0, &both, false),
        (130.0, &both, true),
        (130.0, &one, false),
        (210.0, &one, true),
    ] {
        let folder = Folder::new();
        folder.json(&format!(
            r#"{{"robot": "kinova_gen3", "rate_hz": {rate_hz}}}"#
        ));
        let stamps = [0.0, 0.01, 0.02, 0.03];
        for id in stamped {
            folder.write(&format!("seq_{id}/time.npy"), &f8("(4,)", &stamps));
        }
        let (dataset, warnings) = folder.open().unwrap();
        assert_eq!(dataset.sequence("2").unwrap().time, stamps);
        let told = |w: &DataWarning| matches!(w, DataWarning::OtherRate { .. });
        assert_eq!(
            warnings.iter().any(told),
            is_told,
            "{rate_hz}: {warnings:?}"
        );
    }
}

fn camera_json(width: u32, height: u32) -> String {
    format!(
        r#"{{"width": {width}, "height": {height}, "fx": 1, "fy": 1, "cx": 0, "cy": 0,
        "depth_scale": 0.001,
        "world_from_camera": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"#
    )
}

fn png(color: png::ColorType, depth: png::BitDepth, width: u32, bytes: usize) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, 2);
    encoder.set_color(color);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&vec![7; bytes]).unwrap();
    writer.finish().unwrap();
    out
}

#[test]
fn cameras() {
    use png::{BitDepth, ColorType};
    let rgb = png(ColorType::Rgb, BitDepth::Eight, 2, 12);
    let depth = png(ColorType::Grayscale, BitDepth::Sixteen, 2, 8);
    let fill = |f: &Folder| {
        f.write("camera/camera.json", camera_json(2, 2).as_bytes());
        f.write("camera/color.png", &rgb);
        f.write("camera/depth.png", &depth);
    };
    let valid = Folder::new();
    fill(&valid);
    let camera = valid.open().unwrap().0.camera.unwrap();
    assert_eq!(camera.depth, [0x0707; 4]);
    for (name, bytes, text) in [
        ("color.png", rgb[..rgb.len() - 20].to_vec(), "damaged PNG"),
        ("color.png", b"no image".to_vec(), "damaged PNG"),
        (
            "color.png",
            depth.clone(),
            "Grayscale with 16 bits, expected Rgb with 8",
        ),
        (
            "depth.png",
            rgb.clone(),
            "Rgb with 8 bits, expected Grayscale with 16",
        ),
        (
            "depth.png",
            png(ColorType::Grayscale, BitDepth::Sixteen, 3, 12),
            "3 x 2 pixels, camera.json says 2 x 2",
        ),
    ] {
        let folder = Folder::new();
        fill(&folder);
        folder.write(&format!("camera/{name}"), &bytes);
        let (error, message) = folder.error();
        assert!(matches!(error, DataError::Png { .. }), "{error:?}");
        assert!(message.contains(text), "{message}");
    }
    for (from, to, key) in [
        ("\"fx\": 1", "\"fx\": 0", "fx"),
        ("\"fx\": 1", "\"fx\": 1e300", "fx"),
        ("\"cy\": 0", "\"cy\": -1e7", "cy"),
        ("\"width\": 2", "\"width\": 4000000000", "width"),
        ("[0,0,1,0]", "[0,0,1.1,0]", "world_from_camera"),
        (
            "{\"width\"",
            "{\"convention\": \"opengl\", \"width\"",
            "convention",
        ),
    ] {
        let folder = Folder::new();
        fill(&folder);
        let text = camera_json(2, 2).replace(from, to);
        folder.write("camera/camera.json", text.as_bytes());
        let (error, _) = folder.error();
        assert!(
            matches!(error, DataError::Metadata { key: k, .. } if k == key),
            "{error:?}"
        );
    }
}

#[test]
fn two_fields_are_ambiguous() {
    refused!(
        |f: &Folder| for name in ["a", "b"] {
            f.write(&format!("{name}/points.npy"), &f8("(1, 3)", &[0.0; 3]));
            f.write(&format!("{name}/K.npy"), &f8("(1,)", &[1.0]));
        },
        DataError::AmbiguousField { .. },
        "two stored fields"
    );
}

#[test]
fn saving_refuses_what_opening_refuses() {
    let (mut dataset, _) = Folder::new().open().unwrap();
    dataset.sequences[0].torques.data_mut()[3] = f64::NAN;
    let target = tempfile::tempdir().unwrap();
    let error = dataset.save(target.path().join("new")).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("seq_2/torques.npy row 1 joint 2: NaN")
    );
    assert!(!target.path().join("new").exists());
    dataset.sequences[0].torques = Table::new(2, vec![0.0; 8]).unwrap();
    dataset.sequences[0].id = "../escape".to_owned();
    let error = dataset.save(target.path()).unwrap_err();
    assert!(matches!(error, DataError::SequenceId { .. }), "{error:?}");
}

/// What a folder would be refused for, nothing in memory passes with either.
#[test]
fn data_in_memory_is_checked_without_a_folder() {
    let (good, _) = Folder::new().open().unwrap();
    good.check().unwrap();
    let refused = |change: fn(&mut Dataset), text: &str| {
        let mut wrong = good.clone();
        change(&mut wrong);
        let found = wrong.check().unwrap_err().to_string();
        assert!(found.starts_with("./") && found.contains(text), "{found}");
        wrong
    };
    let of_sequence = |change: fn(&mut Dataset), text: &str| {
        let wrong = &refused(change, text).sequences[0];
        for error in [wrong.check().err(), wrong.derivatives(1).err()] {
            let found = error.unwrap().to_string();
            assert!(found.contains(text), "{found}");
        }
    };
    of_sequence(
        |d| d.sequences[0].torques = Table::new(2, vec![0.0; 2]).unwrap(),
        "seq_2/torques.npy: 1 rows, but angles.npy has 4",
    );
    of_sequence(
        |d| d.sequences[0].velocities = Table::new(1, vec![0.0; 4]).ok(),
        "seq_2/velocities.npy: shape [4, 1], expected 2 columns",
    );
    of_sequence(
        |d| d.sequences[0].time.clear(),
        "seq_2/time.npy: 0 rows, but angles.npy has 4",
    );
    of_sequence(
        |d| d.sequences[0].touch_starts = vec![3, 1],
        "touch_starts of sequence \"2\": entry 1 is row 1",
    );
    refused(
        |d| d.splits.test = d.splits.train.clone(),
        "sequence \"2\" is listed twice in splits train and test",
    );
    refused(|d| d.gravity.z = f64::NAN, "gravity: must be finite");
    refused(
        |d| d.gravity.z = -9810.0,
        "-9810.0] m/s^2 is longer than 100;",
    );
}

#[test]
fn saving_does_not_mix_recordings() {
    let folder = Folder::new();
    let (mut dataset, _) = folder.open().unwrap();
    dataset.save(folder.path()).unwrap();
    dataset.sequences.pop();
    dataset.splits.train = vec!["2".to_owned()];
    let error = dataset.save(folder.path()).unwrap_err();
    assert!(matches!(&error, DataError::Leftover { path } if path.ends_with("seq_10")));
    let (mut dataset, _) = folder.open().unwrap();
    dataset.rest_points = None;
    let error = dataset.save(folder.path()).unwrap_err();
    assert!(matches!(&error, DataError::Leftover { path } if path.ends_with("points.npy")));
}

#[test]
fn places_that_cannot_be_written() {
    let (dataset, _) = Folder::new().open().unwrap();
    let target = tempfile::tempdir().unwrap();
    let file = target.path().join("file");
    fs::write(&file, "in the way").unwrap();
    for place in [file.clone(), file.join("below")] {
        let error = dataset.save(&place).unwrap_err();
        assert!(
            matches!(&error, DataError::Io { path, .. } if *path == place),
            "{error:?}"
        );
    }
    assert_eq!(fs::read(&file).unwrap(), b"in the way");
    // A folder where a file should go: the rename fails, and nothing is left behind.
    let blocked = target.path().join("blocked");
    fs::create_dir_all(blocked.join("seq_2/time.npy")).unwrap();
    let error = dataset.save(&blocked).unwrap_err();
    assert!(
        matches!(
            &error,
            DataError::Io {
                action: "write",
                ..
            }
        ),
        "{error:?}"
    );
    assert_eq!(fs::read_dir(blocked.join("seq_2")).unwrap().count(), 1);
    // Nor is anything of the other files, which came first.
    assert_eq!(fs::read_dir(&blocked).unwrap().count(), 1);
}

#[test]
fn a_failure_changes_no_file() {
    let folder = Folder::new();
    let (mut dataset, _) = folder.open().unwrap();
    let old = fs::read(folder.path().join("seq_2/torques.npy")).unwrap();
    dataset.sequences[0].torques.data_mut().fill(9.0);
    // dataset.json comes last.
    folder.remove("dataset.json");
    fs::create_dir(folder.path().join("dataset.json")).unwrap();
    dataset.save(folder.path()).unwrap_err();
    let new = fs::read(folder.path().join("seq_2/torques.npy")).unwrap();
    assert_eq!(old, new);
    assert!(!folder.path().join("seq_2/time.npy").exists());
}

#[cfg(unix)]
#[test]
fn files_are_replaced_where_they_are() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::write(at("real"), "old").unwrap();
    symlink(at("real"), at("link")).unwrap();
    write_file(at("link"), b"new").unwrap();
    assert!(at("link").is_symlink());
    assert_eq!(fs::read(at("real")).unwrap(), b"new");
    write_file("/dev/null", b"gone").unwrap();
    fs::set_permissions(at("real"), fs::Permissions::from_mode(0o640)).unwrap();
    write_file(at("real"), b"new").unwrap();
    let mode = at("real").metadata().unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o640);
    fs::set_permissions(at("real"), fs::Permissions::from_mode(0o444)).unwrap();
    let error = write_file(at("real"), b"newer").unwrap_err().to_string();
    assert!(
        error.contains("real") && error.contains("read-only"),
        "{error}"
    );
    let error = write_file(folder.path(), b"x").unwrap_err().to_string();
    assert!(error.contains("folder"), "{error}");
    assert_eq!(fs::read(at("real")).unwrap(), b"new");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[cfg(unix)]
#[test]
fn read_only_folder() {
    use std::os::unix::fs::PermissionsExt;
    let (dataset, _) = Folder::new().open().unwrap();
    let target = tempfile::tempdir().unwrap();
    let locked = target.path().join("locked");
    fs::create_dir(&locked).unwrap();
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o555)).unwrap();
    if fs::write(locked.join("probe"), "").is_ok() {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED read_only_folder: this user may write anywhere"
        );
        return;
    }
    let error = dataset.save(&locked).unwrap_err();
    assert!(matches!(error, DataError::Io { .. }), "{error:?}");
}
