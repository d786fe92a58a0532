//! What is saved is read back: arrays and scalars bit by bit, poses to the last digit.

use crate::common::{Folder, cloud_of, golden, points_of};
use nalgebra::{Isometry3, Point3, Vector3};
use proptest::collection::{btree_map, vec};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::fs;
use vsf_data::{
    Attachment, CameraView, Clock, ContactParameters, DataError, DataWarning, Dataset, JointLog,
    JointType, McapExport, Overrides, RobotRef, Sequence, Splits, StiffnessField, Table,
    TorqueKind, read_points,
};

/// Any finite double, subnormals and both zeros included.
fn number() -> impl Strategy<Value = f64> {
    use prop::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO
}

fn positive() -> impl Strategy<Value = f64> {
    prop::num::f64::POSITIVE | prop::num::f64::NORMAL
}

/// Within reach.
fn point() -> impl Strategy<Value = Point3<f64>> {
    [number(), number(), number()].prop_map(|p| Point3::from(p.map(|c| c % 1e6)))
}

fn table(rows: usize, cols: usize) -> impl Strategy<Value = Table> {
    vec(number(), rows * cols).prop_map(move |data| Table::new(cols, data).unwrap())
}

fn pose() -> impl Strategy<Value = Isometry3<f64>> {
    let part = || [-3.0..3.0, -3.0..3.0, -3.0..3.0f64].prop_map(Vector3::from);
    (part(), part()).prop_map(|(t, r)| Isometry3::new(t, r))
}

fn text() -> impl Strategy<Value = String> {
    "[a-z \"\\\\é\n]{0,8}"
}

fn field() -> impl Strategy<Value = StiffnessField> {
    (1..6usize).prop_flat_map(|n| {
        let features = btree_map(
            "[a-z]{1,6}".prop_filter("reserved", |name| name != "features" && name != "points"),
            (1..4usize).prop_flat_map(move |cols| table(n, cols)),
            0..3,
        );
        let sd = prop::option::of(vec(positive().prop_map(f64::abs), n));
        let marks = [(); 2].map(|()| prop::option::of(text()));
        let learned_from = prop::option::of(vec(text(), 0..3));
        let contact = prop::option::of(contact());
        (
            vec(point(), n),
            vec(number(), n),
            sd,
            features,
            marks,
            learned_from,
            contact,
            prop::option::of(pose()),
        )
            .prop_map(
                |(points, stiffness, sd, features, marks, learned_from, contact, base)| {
                    let [recording, model] = marks;
                    StiffnessField {
                        points,
                        stiffness,
                        sd,
                        features,
                        recording,
                        learned_from,
                        model,
                        contact,
                        // Turned, it may differ in the last digit.
                        base_pose: base.map(|pose| pose.translation.into()),
                    }
                },
            )
    })
}

fn contact() -> impl Strategy<Value = ContactParameters> {
    let steps = (0..u32::MAX, 1..9usize);
    let links = prop::option::of(prop::collection::btree_set("[a-z]{1,3}", 1..3));
    let numbers = (1e-6..1.0, 0.0..9.0, 1e-9..1.0, 0.0..1.0, 0.0..1.0, steps);
    (numbers, links).prop_map(
        |(
            (threshold, friction, slip_step, padding, adhesion, (max_slip_iterations, subdivision)),
            links,
        )| {
            ContactParameters {
                threshold,
                friction,
                slip_step,
                max_slip_iterations,
                padding: padding - 0.9 * threshold,
                adhesion,
                subdivision,
                links: links.map(|names| names.into_iter().collect()),
            }
        },
    )
}

fn sequence(id: String, cols: usize) -> impl Strategy<Value = Sequence> {
    (1..6usize).prop_flat_map(move |rows| {
        (
            Just(id.clone()),
            prop::collection::btree_set(0..1000u32, rows),
            table(rows, cols),
            prop::option::of(table(rows, cols)),
            table(rows, cols),
            prop::collection::btree_set(0..rows, 1..=rows),
            vec(text(), 0..3),
        )
            .prop_map(
                |(id, time, angles, velocities, torques, starts, tags)| Sequence {
                    id,
                    time: time.into_iter().map(|k| f64::from(k) / 7.0).collect(),
                    angles,
                    velocities,
                    torques,
                    touch_starts: starts.into_iter().collect(),
                    tags,
                },
            )
    })
}

fn camera() -> impl Strategy<Value = CameraView> {
    (1..5u32, 1..5u32).prop_flat_map(|(width, height)| {
        let n = (width * height) as usize;
        (
            vec(any::<u8>(), 3 * n),
            vec(any::<u16>(), n),
            [1e-3..1e6, 1e-3..1e6, -1e6..1e6, -1e6..1e6, 1e-9..1e3],
            pose(),
        )
            .prop_map(move |(color, depth, v, X_WC)| {
                let [fx, fy, cx, cy, depth_scale] = v;
                CameraView {
                    width,
                    height,
                    color,
                    depth,
                    fx,
                    fy,
                    cx,
                    cy,
                    depth_scale,
                    X_WC,
                    extra: BTreeMap::from([("lens".to_owned(), "[1.5,null]".to_owned())]),
                }
            })
    })
}

fn dataset() -> impl Strategy<Value = Dataset> {
    (1..4usize)
        .prop_flat_map(|cols| {
            let sequences = vec![
                sequence("1".to_owned(), cols),
                sequence("2".to_owned(), cols),
                sequence("a 10".to_owned(), cols),
            ];
            let gravity = prop::array::uniform3(-50.0..50.0).prop_map(Vector3::from);
            (
                (
                    text(),
                    text(),
                    gravity,
                    pose(),
                    any::<bool>(),
                    any::<bool>(),
                ),
                (
                    prop::option::of(1e-6..1e9),
                    prop::option::of(positive().prop_map(f64::abs)),
                    0..2usize,
                ),
                (point(), point()),
                (
                    prop::option::of(vec(point(), 1..5)),
                    prop::option::of(field()),
                    prop::option::of(contact()),
                ),
                prop::option::of(camera()),
                sequences,
            )
        })
        .prop_map(
            |(
                words,
                (rate_hz, gauge_length, tare_samples),
                (a, b),
                (points, field, contact),
                camera,
                sequences,
            )| {
                let (name, description, gravity, base_pose, measured, named) = words;
                let cols = sequences[0].width();
                let shortest = sequences.iter().map(Sequence::len).min().unwrap_or(0);
                Dataset {
                    name,
                    description,
                    robot: RobotRef::resolve("kinova_gen3", ".".as_ref()).unwrap(),
                    torque_kind: if measured {
                        TorqueKind::Measured
                    } else {
                        TorqueKind::External
                    },
                    rate_hz,
                    gravity,
                    base_pose,
                    object_bbox: measured.then(|| [a.inf(&b), a.sup(&b)]),
                    tare_samples: tare_samples.min(shortest - 1),
                    splits: Splits {
                        train: vec!["a 10".to_owned(), "1".to_owned()],
                        test: if named { vec!["2".to_owned()] } else { vec![] },
                    },
                    joints: named.then(|| (0..cols).map(|k| format!("joint {k}")).collect()),
                    joint_types: measured.then(|| vec![JointType::Prismatic; cols]),
                    attachment: if named {
                        Attachment::Bilateral
                    } else {
                        Attachment::Unilateral
                    },
                    gauge_length,
                    made_by: named.then(|| "a test".to_owned()),
                    contact,
                    rest_points: points,
                    field,
                    camera,
                    sequences,
                    extra: BTreeMap::from([("site".to_owned(), r#"{"lab":3}"#.to_owned())]),
                }
            },
        )
}

fn close(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    // q and -q are the same rotation.
    let (p, q) = (a.rotation.coords, b.rotation.coords);
    a.translation == b.translation && (p - q).amax().min((p + q).amax()) < 1e-15
}

/// Bits of every number, since 0 == -0.
fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn datasets(saved in dataset()) {
        let folder = tempfile::tempdir().unwrap();
        saved.save(folder.path()).unwrap();
        let (mut read, _) = Dataset::open(folder.path(), &Overrides::default()).unwrap();
        for (a, b) in saved.sequences.iter().zip(&read.sequences) {
            prop_assert_eq!(bits(a.angles.data()), bits(b.angles.data()));
            prop_assert_eq!(bits(&a.time), bits(&b.time));
        }
        prop_assert_eq!(bits(saved.gravity.as_slice()), bits(read.gravity.as_slice()));
        prop_assert!(close(&saved.base_pose, &read.base_pose));
        read.base_pose = saved.base_pose;
        if let (Some(a), Some(b)) = (&saved.camera, &mut read.camera) {
            prop_assert!(close(&a.X_WC, &b.X_WC));
            b.X_WC = a.X_WC;
        }
        prop_assert_eq!(&saved, &read);
        // Saving over itself, and what is on disk does not drift.
        read.save(folder.path()).unwrap();
        let names: Vec<_> = fs::read_dir(folder.path()).unwrap().collect();
        prop_assert!(names.iter().all(|e| !e.as_ref().unwrap().file_name().to_string_lossy().starts_with('.')));
    }

    #[test]
    fn recordings_in_mcap(saved in dataset()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let joints: Vec<String> = (0..saved.width()).map(|k| format!("joint {k}")).collect();
        let export = McapExport {
            recording: Some(&saved),
            joints: &joints,
            ..McapExport::default()
        };
        export.save(&path).unwrap();
        let log = JointLog::open(&[&path], None, Clock::Header).unwrap();
        let (mut read, _) = log.recording(&Overrides::default(), &joints, None).unwrap();
        for (a, b) in saved.sequences.iter().zip(&read.sequences) {
            prop_assert_eq!(bits(a.angles.data()), bits(b.angles.data()));
            prop_assert_eq!(bits(a.torques.data()), bits(b.torques.data()));
            prop_assert_eq!(bits(&a.time), bits(&b.time));
        }
        prop_assert!(close(&saved.base_pose, &read.base_pose));
        read.base_pose = saved.base_pose;
        let expected = Dataset { field: None, camera: None, ..saved };
        prop_assert_eq!(&expected, &read);
    }

    #[test]
    fn fields(saved in field()) {
        let folder = tempfile::tempdir().unwrap();
        saved.save_npz(folder.path().join("vsf.npz")).unwrap();
        saved.save_folder(folder.path().join("vsf")).unwrap();
        for name in ["vsf.npz", "vsf"] {
            let (read, warnings) = StiffnessField::open(folder.path().join(name)).unwrap();
            prop_assert_eq!(&saved, &read);
            prop_assert_eq!(bits(&saved.stiffness), bits(&read.stiffness));
            prop_assert_eq!(warnings.len(), 0);
        }
        saved.save_ply(folder.path().join("vsf.ply"), None).unwrap();
        prop_assert_eq!(&saved.points, &points_of(folder.path().join("vsf.ply")).unwrap());
    }
}

#[test]
fn a_folder_of_openvsf_opens_with_overrides() {
    let folder = tempfile::tempdir().unwrap();
    for id in ["0514_101500", "0514_093000"] {
        let place = folder.path().join(format!("seq_{id}"));
        fs::create_dir(&place).unwrap();
        // (4, 3): one is Fortran order, one f4.
        fs::copy(golden("f8_f.npy"), place.join("angles.npy")).unwrap();
        fs::copy(golden("f4_c.npy"), place.join("torques.npy")).unwrap();
    }
    let robot = RobotRef::resolve("kinova_gen3", ".".as_ref()).unwrap();
    let mut overrides = Overrides {
        robot: Some(robot),
        ..Overrides::default()
    };
    let error = Dataset::open(folder.path(), &overrides).unwrap_err();
    assert!(matches!(
        error,
        DataError::MissingKey { key: "rate_hz", .. }
    ));
    overrides.rate_hz = Some(50.0);
    overrides.splits = Some(Splits {
        train: vec!["0514_093000".to_owned()],
        test: vec!["0514_101500".to_owned()],
    });
    let (dataset, warnings) = Dataset::open(folder.path(), &overrides).unwrap();
    assert!(matches!(
        warnings[..],
        [DataWarning::CopiedSequences { .. }]
    ));
    assert_eq!(dataset.width(), 3);
    let test = dataset.test().next().unwrap();
    assert_eq!(test.id, "0514_101500");
    assert_eq!(test.time, [0.0, 0.02, 0.04, 0.06]);
    assert_eq!(&test.angles[2], [100.0, 7.0, 127.0]);
    assert_eq!(test.angles, test.torques);
    assert!(test.touches().eq(std::iter::once(0..4)));
    assert_eq!(dataset.gravity, Vector3::new(0.0, 0.0, -9.81));
    assert_eq!(
        dataset.name,
        folder.path().file_name().unwrap().to_str().unwrap()
    );
}

#[test]
fn overrides_go_before_the_file() {
    let folder = Folder::new();
    folder.json(
        r#"{"robot": "gone.urdf", "rate_hz": 9, "name": "file", "gravity": [0, 0, -1], "tare_samples": 1}"#,
    );
    let overrides = Overrides {
        robot: Some(RobotRef::resolve("kinova_gen3", ".".as_ref()).unwrap()),
        name: Some("caller".to_owned()),
        tare_samples: Some(2),
        ..Overrides::default()
    };
    let (dataset, _) = Dataset::open(folder.path(), &overrides).unwrap();
    assert_eq!(dataset.name, "caller");
    assert_eq!(dataset.tare_samples, 2);
    assert_eq!(dataset.gravity.z, -1.0);
}

#[test]
fn sequences_are_in_natural_order() {
    let ids: Vec<String> = Folder::new()
        .open()
        .unwrap()
        .0
        .train()
        .map(|s| s.id.clone())
        .collect();
    assert_eq!(ids, ["2", "10"]);
}

#[test]
fn tags_given_as_an_object_become_pairs() {
    let folder = Folder::new();
    folder.with(r#""sequence_tags": {"2": {"kp": 100, "motion": "lift"}, "10": ["loaded"]}"#);
    let (dataset, warnings) = folder.open().unwrap();
    assert_eq!(warnings, []);
    assert_eq!(
        dataset.sequence("2").unwrap().tags,
        ["kp=100", "motion=lift"]
    );
    assert_eq!(dataset.sequence("10").unwrap().tags, ["loaded"]);
}

#[test]
fn a_robot_file_is_found_from_the_new_folder() {
    let folder = Folder::new();
    folder.write("arm.urdf", b"<robot/>");
    folder.json(r#"{"robot": "arm.urdf", "rate_hz": 10}"#);
    let (dataset, _) = folder.open().unwrap();
    assert_eq!(dataset.robot.path, Some(folder.path().join("arm.urdf")));
    dataset.save(folder.path()).unwrap();
    assert_eq!(folder.open().unwrap().0.robot, dataset.robot);
    let elsewhere = tempfile::tempdir().unwrap();
    dataset.save(elsewhere.path()).unwrap();
    let (moved, _) = Dataset::open(elsewhere.path(), &Overrides::default()).unwrap();
    assert_eq!(moved.robot.path, dataset.robot.path);
}

#[test]
fn a_field_folder_is_not_mixed_with_another() {
    let folder = tempfile::tempdir().unwrap();
    let mut field = StiffnessField {
        points: vec![Point3::origin()],
        stiffness: vec![5.0],
        sd: Some(vec![1.0]),
        ..StiffnessField::default()
    };
    field.save_folder(folder.path()).unwrap();
    fs::write(folder.path().join(".hidden"), "").unwrap();
    field.recording = Some("a\0b \u{65e5}".to_owned());
    field.save_npz(folder.path().join(".a.npz")).unwrap();
    let (read, _) = StiffnessField::open(folder.path().join(".a.npz")).unwrap();
    assert_eq!(read, field);
    field.save_folder(folder.path()).unwrap();
    fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    let error = field.save_folder(folder.path()).unwrap_err();
    assert!(matches!(&error, DataError::Leftover { path } if path.ends_with("notes.txt")));
    fs::remove_file(folder.path().join("notes.txt")).unwrap();
    field.sd = None;
    let error = field.save_folder(folder.path()).unwrap_err();
    assert!(matches!(&error, DataError::Leftover { path } if path.ends_with("K_std.npy")));
    assert!(StiffnessField::open(folder.path()).unwrap().0.sd.is_some());
    field
        .features
        .insert("K_std".to_owned(), Table::new(1, vec![1.0]).unwrap());
    let error = field.save_npz(folder.path().join("a.npz")).unwrap_err();
    assert!(matches!(error, DataError::FeatureName { .. }));
    field.features.clear();
    // Hidden files of a folder are others'.
    let hidden = Table::new(1, vec![1.0]).unwrap();
    field.features.insert(".x".to_owned(), hidden);
    let error = field.save_folder(folder.path()).unwrap_err();
    assert!(matches!(error, DataError::FeatureName { .. }), "{error}");
    field.features.clear();
    field.sd = Some(vec![-1.0]);
    let error = field.save_npz(folder.path().join("a.npz")).unwrap_err();
    assert!(matches!(error, DataError::NegativeDeviation { row: 0, .. }));
}

/// Of a field whose parameters of contact cannot be, the parameter is named.
#[test]
fn contact_out_of_range_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let good = ContactParameters {
        threshold: 0.002,
        friction: 0.15,
        slip_step: 1e-4,
        max_slip_iterations: 200,
        padding: -0.001,
        adhesion: 0.0,
        subdivision: 2,
        links: None,
    };
    let mut field = StiffnessField {
        points: vec![Point3::origin()],
        stiffness: vec![5.0],
        contact: Some(good.clone()),
        ..StiffnessField::default()
    };
    field.save_folder(folder.path()).unwrap();
    let path = folder.path().join("format.json");
    let text = fs::read_to_string(&path).unwrap();
    for (from, to, says) in [
        ("0.002", "0.0", "threshold 0.0 must be 1e-9 to 1 m"),
        ("0.002", "1e300", "threshold 1e300 must be 1e-9 to 1 m"),
        ("0.002", "0.001", "padding -0.001 must be"),
        ("0.15", "-0.15", "friction -0.15 must be"),
        ("0.0001", "-1.0", "slip_step -1.0 must be"),
        (
            "\"adhesion\": 0.0",
            "\"adhesion\": -1.0",
            "adhesion -1.0 must be",
        ),
        (
            "\"subdivision\": 2",
            "\"subdivision\": 9",
            "subdivision 9 must be",
        ),
        ("0.002", "\"2 mm\"", "line"),
        ("0.002", "1e999", "line"),
        ("threshold", "treshold", "treshold"),
    ] {
        assert!(text.contains(from), "{from}");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let error = StiffnessField::open(folder.path()).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
    for threshold in [f64::NAN, f64::INFINITY, 0.0] {
        field.contact = Some(ContactParameters {
            threshold,
            ..good.clone()
        });
        let error = field.save_npz(folder.path().join(".a.npz")).unwrap_err();
        assert!(matches!(error, DataError::Metadata { .. }), "{error}");
    }
    for links in [vec![], vec!["a".to_owned(), "a".to_owned()]] {
        field.contact = Some(ContactParameters {
            links: Some(links),
            ..good.clone()
        });
        let error = field.save_npz(folder.path().join(".a.npz")).unwrap_err();
        assert!(error.to_string().contains("must name one link"), "{error}");
    }
    field.contact = None;
    field.features.insert(
        "contact_parameters".to_owned(),
        Table::new(1, vec![1.0]).unwrap(),
    );
    let error = field.save_npz(folder.path().join(".a.npz")).unwrap_err();
    assert!(matches!(error, DataError::FeatureName { .. }), "{error}");
}

#[test]
fn ply_colors_follow_the_scale() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let field = StiffnessField {
        points: vec![Point3::new(1.0, 2.0, 3.0), Point3::origin()],
        stiffness: vec![0.0, 500.0],
        ..StiffnessField::default()
    };
    for (full_scale, top) in [
        (None, [253, 231, 37]),
        (Some(2000.0), vsf_data::color(0.25)),
    ] {
        field.save_ply(&path, full_scale).unwrap();
        let bytes = fs::read(&path).unwrap();
        // Last vertex: 24 bytes position, 3 color, 8 stiffness.
        let vertex = &bytes[bytes.len() - 35..];
        assert_eq!(vertex[24..27], top);
        assert_eq!(vertex[27..], 500f64.to_le_bytes());
    }
    assert!(field.save_ply(&path, Some(0.0)).is_err());
}

#[test]
fn points_of_an_ascii_ply() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
        property int z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    fs::write(&path, format!("{header}0.5 1 2\n-1 0 7\n3 0 1 1\n")).unwrap();
    let expected = [Point3::new(0.5, 1.0, 2.0), Point3::new(-1.0, 0.0, 7.0)];
    assert_eq!(points_of(&path).unwrap(), expected);
    fs::write(&path, format!("{header}0.5 1 2\n-1 0 7\n")).unwrap();
    assert!(matches!(points_of(&path), Err(DataError::Ply { .. })));
    for (line, part) in [("-1 nan 7", "row 1 y: NaN"), ("-inf 0 7", "row 1 x: -inf")] {
        fs::write(&path, format!("{header}0.5 1 2\n{line}\n3 0 1 1\n")).unwrap();
        let error = points_of(&path).unwrap_err();
        assert!(matches!(error, DataError::NotFinite { .. }), "{error:?}");
        assert!(
            error.to_string().ends_with(&format!("a.ply {part}")),
            "{error}"
        );
    }
    let data = "0.5 1 2\n-1 0 7\n3 0 1 1\n";
    for (header, data, part) in [
        (
            header.replace("property int z", "property int y\nproperty int z"),
            data,
            "its header names a property twice",
        ),
        (
            header.replace("element face", "element vertex"),
            data,
            "its header names an element twice",
        ),
        (
            header.to_owned(),
            "0.5 1 2\n-1 0 7 8\n3 0 1 1\n",
            "vertex 1 has 4 numbers, but its header has 3 properties",
        ),
        (
            header.to_owned(),
            "0.5 1 2\n-1 2e6 7\n3 0 1 1\n",
            "row 1 y: 2e6 m is beyond 1e6 m",
        ),
    ] {
        fs::write(&path, header + data).unwrap();
        let error = points_of(&path).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    fs::write(&path, header.replace("vertex 2", "vertex 99999999999")).unwrap();
    assert!(matches!(points_of(&path), Err(DataError::Ply { .. })));
}

/// Text that was cut off within its last number is still text.
#[test]
fn clouds_whose_last_line_has_no_end_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let ply = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
               property float z\nend_header\n0 0 0\n1 2 3.25\n";
    let pcd = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n\
               VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n0 0 0\n1 2 3.25\n";
    for (name, text) in [("a.ply", ply), ("a.pcd", pcd)] {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        assert_eq!(read_points(&path).unwrap().1, []);
        fs::write(&path, &text[..text.len() - 2]).unwrap();
        let (points, warnings) = read_points(&path).unwrap();
        assert_eq!(points[1], Point3::new(1.0, 2.0, 3.2f32.into()));
        let [warning @ DataWarning::NoLineEnd { .. }] = &warnings[..] else {
            panic!("{warnings:?}");
        };
        assert!(warning.to_string().contains(name), "{warning}");
    }
}

#[test]
fn colors_of_a_ply() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let text = |of: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
             property float z\nproperty {of} red\nproperty {of} green\nproperty {of} blue\n\
             end_header\n1 2 3 10 20 30\n4 5 6 0 255 1\n"
        )
    };
    fs::write(&path, text("uchar")).unwrap();
    let cloud = cloud_of(&path).unwrap();
    let points: Vec<_> = cloud.iter().map(|p| p.position).collect();
    let colors: Vec<_> = cloud.iter().map(|p| p.color).collect();
    assert_eq!(
        points,
        [Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.0)]
    );
    assert_eq!(colors, [[10, 20, 30], [0, 255, 1]]);
    // Colors of another scale are not guessed; positions can still be read.
    fs::write(&path, text("float")).unwrap();
    assert!(matches!(cloud_of(&path), Err(DataError::Ply { .. })));
    assert_eq!(points_of(&path).unwrap(), points);
    fs::write(&path, text("uchar").replace("blue", "b")).unwrap();
    assert!(matches!(cloud_of(&path), Err(DataError::Ply { .. })));
}

/// Header of a PCD file of three points with a normal, padding and color.
fn pcd(points: usize, data: &str) -> String {
    format!(
        "# .PCD v.7 - Point Cloud Data file format\nVERSION .7\nFIELDS x y z n _ rgb\n\
         SIZE 4 4 8 2 1 4\nTYPE F F F I U F\nCOUNT 1 1 1 2 3 1\nWIDTH {points}\nHEIGHT 1\n\
         VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
}

/// The example of the Point Cloud Library's documentation packs colors so.
const PACKED: f32 = 4.2108e6;

/// Values of three points by field: the second one is a pixel without return.
fn pcd_columns() -> [Vec<Vec<u8>>; 6] {
    let f32s = |v: [f32; 3]| v.map(|v| v.to_le_bytes().to_vec()).to_vec();
    let nan = f64::NAN;
    [
        f32s([0.5, f32::NAN, -1.0]),
        f32s([1.0, f32::NAN, 0.25]),
        [2.0, nan, 1e-3]
            .map(|v: f64| v.to_le_bytes().to_vec())
            .to_vec(),
        vec![vec![1, 2, 3, 4]; 3],
        vec![vec![9; 3]; 3],
        f32s([PACKED, 0.0, f32::from_bits(0x00ff_0102)]),
    ]
}

#[test]
fn points_and_colors_of_a_pcd() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pcd");
    let positions = [Point3::new(0.5, 1.0, 2.0), Point3::new(-1.0, 0.25, 1e-3)];
    let colors = [[128, 128, 224], [255, 1, 2]];
    let check = |bytes: &[u8], kind: &str| {
        fs::write(&path, bytes).unwrap();
        assert_eq!(points_of(&path).unwrap(), positions, "{kind}");
        let cloud = cloud_of(&path).unwrap();
        assert!(cloud.iter().map(|p| p.color).eq(colors), "{kind}");
        assert!(cloud.iter().map(|p| p.position).eq(positions), "{kind}");
        let (points, warnings) = read_points(&path).unwrap();
        assert_eq!(points, positions, "{kind}");
        assert!(
            matches!(
                warnings[..],
                [DataWarning::WithoutReturn {
                    count: 1,
                    total: 3,
                    ..
                }]
            ),
            "{kind}: {warnings:?}"
        );
    };
    let last = f32::from_bits(0x00ff_0102);
    let ascii = format!(
        "0.5 1 2 7 7 0 0 0 4.2108e+06\nnan nan nan 7 7 0 0 0 0\n-1 0.25 1e-3 7 7 0 0 0 {last:e}\n"
    );
    check((pcd(3, "ascii") + &ascii).as_bytes(), "ascii");
    // Where the sensor was changes nothing, but is told.
    let moved = pcd(3, "ascii").replace("0 0 0 1 0 0 0", "0 0 1.5 1 0 0 0") + &ascii;
    fs::write(&path, moved).unwrap();
    let (points, warnings) = read_points(&path).unwrap();
    assert_eq!(points, positions);
    let told = warnings.iter().map(ToString::to_string);
    let text = "VIEWPOINT 0 0 1.5 1 0 0 0 is not applied";
    assert_eq!(told.filter(|w| w.contains(text)).count(), 1);
    let columns = pcd_columns();
    let rows: Vec<u8> = (0..3)
        .flat_map(|i| columns.iter().flat_map(move |c| c[i].clone()))
        .collect();
    check(&[pcd(3, "binary").as_bytes(), &rows].concat(), "binary");
    // LZF without any repetition: runs of at most 32 bytes, each after its length less 1.
    let whole: Vec<u8> = columns.iter().flat_map(|c| c.concat()).collect();
    let runs = whole
        .chunks(32)
        .flat_map(|run| [&[run.len() as u8 - 1], run].concat());
    let packed: Vec<u8> = runs.collect();
    let sizes = [packed.len() as u32, whole.len() as u32]
        .map(u32::to_le_bytes)
        .concat();
    let header = pcd(3, "binary_compressed");
    check(&[header.as_bytes(), &sizes, &packed].concat(), "compressed");
}

#[test]
fn pcd_files_that_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pcd");
    let row = "0.5 1 2 7 7 0 0 0 1\n";
    let refused = |text: String, part: &str| {
        fs::write(&path, text).unwrap();
        let error = cloud_of(&path).unwrap_err().to_string();
        assert!(error.contains("a.pcd") && error.contains(part), "{error}");
    };
    refused(pcd(2, "ascii") + row, "damaged");
    refused(pcd(9, "ascii") + row, "do not fit");
    refused(pcd(usize::MAX, "binary") + row, "do not fit");
    refused(pcd(1, "binary_compressed") + row, "do not fit");
    refused(
        pcd(1, "ascii").replace("COUNT 1", "COUNT 18446744073709551615") + row,
        "do not fit",
    );
    refused(
        pcd(1, "ascii").replace("FIELDS x", "FIELDS X") + row,
        "no field x",
    );
    refused(pcd(1, "ascii").replace("rgb", "label") + row, "rgb");
    refused(pcd(1, "ascii") + &row.replace("0.5", "inf"), "row 0 x: inf");
    refused(pcd(1, "ascii") + &row.replace("0.5", "nan"), "row 0 x: NaN");
    let second = "nan nan nan 7 7 0 0 0 1\n".to_owned() + &row.replace("0.5", "inf");
    refused(pcd(2, "ascii") + &second, "row 1 x: inf");
    refused(pcd(1, "ascii") + &row.replace("0.5", "half"), "damaged");
    refused(
        pcd(1, "ascii") + &row.replace("0.5 1 2", "nan nan nan"),
        "the coordinates of all 1 are NaN",
    );
    refused(
        pcd(1, "ascii") + row + row,
        "2 points, but its header says POINTS 1",
    );
    refused(
        pcd(0, "ascii") + row,
        "1 points, but its header says POINTS 0",
    );
    refused(
        pcd(1, "binary") + &"1".repeat(2 * 31),
        "2 points, but its header",
    );
    refused(
        pcd(1, "ascii").replace("HEIGHT 1", "HEIGHT 480") + row,
        "WIDTH 1, HEIGHT 480 and POINTS 1",
    );
    refused(pcd(0, "ascii"), "empty");
    refused("ply\n".to_owned(), "DATA");
    // Positions can be read without colors.
    fs::write(&path, pcd(1, "ascii").replace("rgb", "label") + row).unwrap();
    assert_eq!(points_of(&path).unwrap(), [Point3::new(0.5, 1.0, 2.0)]);
    assert!(matches!(
        points_of(folder.path().join("b.pcd")),
        Err(DataError::Missing { .. })
    ));
}
