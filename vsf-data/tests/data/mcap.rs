//! Joint states in MCAP files of other programs.

use crate::common::{DEFINITION, Folder, State, arm, arm_measured, bag, bag_of, check_pause};
use mcap::Compression;
use nalgebra::Point3;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use tempfile::TempDir;
use vsf_data::{
    Advice, Clock, DataError, DataWarning, Dataset, EffortPrediction, JointLog, McapExport,
    Overrides, RobotRef, StiffnessField, Table,
};

/// Joint states of the arm at 100 Hz, with a pause of 3 s before the last two of five.
fn states() -> Vec<State> {
    [0, 1, 2, 302, 303].map(State::arm).to_vec()
}

fn read(path: &Path) -> Result<(Dataset, Vec<DataWarning>), DataError> {
    JointLog::open(&[path], None, Clock::Header)?.recording(&arm_measured(), &arm(), None)
}

/// The recording of a bag of these states, or what is wrong with it.
fn recorded(states: &[State]) -> Result<(Dataset, Vec<DataWarning>), DataError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("touch.mcap");
    bag(&path, None, states);
    read(&path)
}

fn refused(change: impl FnOnce(&mut Vec<State>)) -> String {
    let mut states = states();
    change(&mut states);
    let error = recorded(&states).unwrap_err();
    assert!(
        matches!(
            error,
            DataError::Message { .. } | DataError::Mcap { .. } | DataError::Advised { .. }
        ),
        "{error:?}"
    );
    error.to_string()
}

fn in_folder() -> (TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("touch.mcap");
    (folder, path)
}

/// Messages hold float32.
#[test]
fn a_field_too_large_for_a_message_is_refused() {
    let (_keep, path) = in_folder();
    let mut field = StiffnessField {
        points: vec![Point3::origin(); 2],
        stiffness: vec![1.0, 1e39],
        ..StiffnessField::default()
    };
    for far in [false, true] {
        if far {
            field.stiffness[1] = 1.0;
            field.points[1].x = -1e39;
        }
        let export = McapExport {
            field: Some(&field),
            ..McapExport::default()
        };
        let error = export.save(&path).unwrap_err().to_string();
        assert!(error.contains("row 1"), "{error}");
        assert!(!path.exists());
    }
}

#[test]
fn pauses_end_sequences() {
    for compression in [None, Some(Compression::Zstd), Some(Compression::Lz4)] {
        let (_keep, path) = in_folder();
        bag(&path, compression, &states());
        let (dataset, warnings) = read(&path).unwrap();
        assert_eq!(warnings, []);
        check_pause(&dataset, [303.0, 304.0]);
        dataset.save(path.with_extension("")).unwrap();

        let log = JointLog::open(&[&path], Some("/joint_states"), Clock::Log).unwrap();
        let (whole, _) = log.recording(&arm_measured(), &arm(), Some(4.0)).unwrap();
        assert_eq!(whole.sequences.len(), 1);
        assert_eq!(whole.sequences[0].time, [0.0, 0.01, 0.02, 3.02, 3.03]);
    }
}

/// A message may have its joints in another order, and others besides.
#[test]
fn joints_are_found_by_name() {
    let mut states = states();
    for state in &mut states[1..] {
        state.names = vec!["elbow", "finger", "shoulder"];
        let [a, b] = state.position[..] else { panic!() };
        state.position = vec![b, 9.0, a];
        let [a, b] = state.effort[..] else { panic!() };
        // What is not asked for may be anything.
        state.effort = vec![b, f64::NAN, a];
    }
    let plain = recorded(&self::states()).unwrap();
    assert_eq!(recorded(&states).unwrap(), plain);

    let mut gripper = State::arm(2);
    gripper.stamp += 1;
    gripper.names = vec!["finger"];
    (gripper.position, gripper.effort) = (vec![0.0], vec![]);
    states.insert(3, gripper);
    let (dataset, warnings) = recorded(&states).unwrap();
    assert_eq!(dataset, plain.0);
    assert!(matches!(
        &warnings[..],
        [DataWarning::OtherJoints { count: 1, .. }]
    ));
}

#[test]
fn velocities_are_taken_where_they_are() {
    let mut states = states();
    for (k, state) in states.iter_mut().enumerate() {
        state.velocity = vec![k as f64, 1.0];
    }
    // A controller without velocities fills in NaN.
    states[3].velocity = vec![f64::NAN; 2];
    states[4].velocity = vec![];
    let (dataset, _) = recorded(&states).unwrap();
    let velocities = |k: usize| dataset.sequences[k].velocities.as_ref();
    assert_eq!(&velocities(0).unwrap()[2], [2.0, 1.0]);
    assert_eq!(velocities(1), None);
    states[1].velocity = vec![];
    let error = recorded(&states).unwrap_err().to_string();
    assert!(
        error.contains("/joint_states message 1: no velocity"),
        "{error}"
    );

    // There is a way round.
    states[1].velocity = vec![f64::NAN, 1.0];
    let (_keep, path) = in_folder();
    bag(&path, None, &states);
    let log = JointLog::open(&[&path], None, Clock::Header).unwrap();
    let error = log.recording(&arm_measured(), &arm(), None).unwrap_err();
    assert!(
        matches!(
            error,
            DataError::Advised {
                advice: Advice::NoVelocities,
                ..
            }
        ),
        "{error:?}"
    );
    let (dataset, _) = (log.without_velocities())
        .recording(&arm_measured(), &arm(), None)
        .unwrap();
    assert!(dataset.sequences.iter().all(|s| s.velocities.is_none()));
}

#[test]
fn samples_that_cannot_be_are_named() {
    let text = refused(|s| s[3].effort.clear());
    assert!(
        text.contains("touch.mcap /joint_states message 3: no effort"),
        "{text}"
    );
    let text = refused(|s| s[2].position.clear());
    assert!(text.contains("message 2: no position"), "{text}");
    let text = refused(|s| s[1].effort[1] = f64::NAN);
    assert!(
        text.contains("message 1: effort of joint \"elbow\" is NaN"),
        "{text}"
    );
    let text = refused(|s| s[1].position[0] = f64::INFINITY);
    assert!(
        text.contains("position of joint \"shoulder\" is inf"),
        "{text}"
    );
    let text = refused(|s| s[4].effort.push(0.0));
    assert!(text.contains("message 4: 3 efforts of 2 joints"), "{text}");
    let text = refused(|s| s[2].stamp = s[1].stamp);
    assert!(
        text.contains("message 2: stamp 100.01 s is not after 100.01 s"),
        "{text}"
    );
    let text = refused(|s| s[3].stamp = 5_000_000_000);
    assert!(
        text.contains("message 3: stamp 5 s is not after 100.02 s"),
        "{text}"
    );
    let text = refused(|s| s[2].names = vec!["elbow", "wrist"]);
    assert!(
        text.contains("message 2: no joint shoulder; there are elbow, wrist"),
        "{text}"
    );
    let text = refused(|s| s[0].names = vec!["elbow", "elbow"]);
    assert!(
        text.contains("message 0: joint \"elbow\" is named twice"),
        "{text}"
    );
    let text = refused(|s| s.iter_mut().for_each(|s| s.names = vec!["x", "y"]));
    assert!(
        text.contains("has the robot's joints shoulder, elbow; there are x, y"),
        "{text}"
    );
}

#[test]
fn several_topics_are_told_apart() {
    let mut states = states();
    let mut other = State::arm(2);
    other.topic = "/filtered";
    other.effort = vec![7.0, 8.0];
    states.push(other);
    let error = recorded(&states).unwrap_err().to_string();
    assert!(
        error.contains("several topics, /filtered, /joint_states"),
        "{error}"
    );

    let (_keep, path) = in_folder();
    bag(&path, None, &states);
    let on = |topic| JointLog::open(&[&path], Some(topic), Clock::Header);
    let (dataset, _) = on("/filtered")
        .unwrap()
        .recording(&arm_measured(), &arm(), None)
        .unwrap();
    assert_eq!(&dataset.sequences[0].torques[0], [7.0, 8.0]);
    let error = on("/none").unwrap_err().to_string();
    assert!(
        error.contains("no topic /none; there are joint states on /filtered"),
        "{error}"
    );
    let error = on("/rosout").unwrap_err().to_string();
    assert!(
        error.contains("/rosout (std_msgs/msg/String in cdr) has no"),
        "{error}"
    );
}

#[test]
fn other_types_are_refused() {
    let (_keep, path) = in_folder();
    let swapped = DEFINITION.replace("float64[] effort", "float32[] effort");
    let cases = [
        (
            ["sensor_msgs/msg/JointState", "ros2msg", "cdr"],
            &*swapped,
            "in another way",
        ),
        (
            ["sensor_msgs/msg/JointState", "jsonschema", "json"],
            "{}",
            "JointState in json",
        ),
        (
            ["sensor_msgs/msg/JointState", "ros2msg", "protobuf"],
            DEFINITION,
            "in protobuf",
        ),
        (
            ["geometry_msgs/msg/Wrench", "ros2msg", "cdr"],
            "",
            "geometry_msgs/msg/Wrench in cdr",
        ),
    ];
    for (kinds, definition, part) in cases {
        bag_of(&path, None, kinds, definition, &states());
        let error = read(&path).unwrap_err().to_string();
        assert!(
            error.contains("no messages of sensor_msgs/JointState"),
            "{error}"
        );
        assert!(error.contains(part), "{error}");
    }
    // Bytes that are not what the type says.
    bag_of(
        &path,
        None,
        ["sensor_msgs/JointState", "ros1msg", "ros1"],
        "",
        &states(),
    );
    let error = read(&path).unwrap_err();
    assert!(
        matches!(error, DataError::Message { message: 0, .. }),
        "{error:?}"
    );
}

#[test]
fn bags_in_several_files_are_one_recording() {
    let folder = tempfile::tempdir().unwrap();
    let whole = states();
    for (name, part) in [("bag_2.mcap", &whole[..1]), ("bag_10.MCAP", &whole[1..])] {
        bag(&folder.path().join(name), None, part);
    }
    fs::write(folder.path().join("metadata.yaml"), "").unwrap();
    let (mut dataset, _) = read(folder.path()).unwrap();
    dataset.name = "touch".to_owned();
    assert_eq!(dataset, recorded(&whole).unwrap().0);

    let files = ["bag_10.MCAP", "bag_2.mcap"].map(|name| folder.path().join(name));
    let log = JointLog::open(&files, None, Clock::Header).unwrap();
    let error = log
        .recording(&arm_measured(), &arm(), None)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("bag_2.mcap /joint_states message 0: stamp 100 s"),
        "{error}"
    );
    assert!(
        error.contains("not after 103.03 s of message 3 before it, in"),
        "{error}"
    );
    assert!(
        error.ends_with("read in the order given and must follow one another in time"),
        "{error}"
    );

    let empty = tempfile::tempdir().unwrap();
    assert!(matches!(read(empty.path()), Err(DataError::Missing { .. })));
    let none: [&Path; 0] = [];
    let error = JointLog::open(&none, None, Clock::Header).unwrap_err();
    assert!(matches!(error, DataError::Argument { .. }));
}

/// Only stamps of one file are worth replacing, and only once.
#[test]
fn advice_is_of_use() {
    let (_keep, path) = in_folder();
    let mut states = states();
    states[2].stamp = states[1].stamp;
    bag(&path, None, &states);
    let error = |clock| {
        let log = JointLog::open(&[&path], None, clock).unwrap();
        log.recording(&arm_measured(), &arm(), None).unwrap_err()
    };
    let advised = error(Clock::Header);
    assert!(
        matches!(
            advised,
            DataError::Advised {
                advice: Advice::LogTime,
                ..
            }
        ),
        "{advised:?}"
    );
    let plain = error(Clock::Log);
    assert!(matches!(plain, DataError::Message { .. }), "{plain:?}");
    assert!(plain.to_string().contains("time of logging 100.011 s"));
}

#[test]
fn joints_are_named_once() {
    let (_keep, path) = in_folder();
    bag(&path, None, &states());
    let log = JointLog::open(&[&path], None, Clock::Header).unwrap();
    for (names, part) in [
        (["elbow", "elbow"], "\"elbow\" is there twice"),
        (["elbow", ""], "a name is empty"),
    ] {
        let error = log.recording(&arm_measured(), &names.map(str::to_owned), None);
        let error = error.unwrap_err();
        assert!(
            matches!(error, DataError::Argument { what: "joints", .. }),
            "{error:?}"
        );
        assert!(error.to_string().contains(part), "{error}");
    }
}

/// Compression of rosbag2's own, which other programs do not read either.
#[test]
fn bags_that_rosbag2_compressed_are_recognized() {
    const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
    let (folder, path) = in_folder();
    let compressed = folder.path().join("bag_0.mcap.zstd");
    fs::write(&compressed, [&ZSTD[..], &[0; 40]].concat()).unwrap();
    for place in [folder.path(), &compressed] {
        let error = read(place).unwrap_err().to_string();
        assert!(error.contains("bag_0.mcap.zstd: compressed"), "{error}");
        assert!(error.contains("zstd -d"), "{error}");
    }
    // Unpacked beside it.
    bag(&path, None, &states());
    read(folder.path()).unwrap();

    let bytes = fs::read(&path).unwrap();
    let mut out = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let mut message = message.unwrap();
        message.data = [&ZSTD[..], &message.data].concat().into();
        out.write(&message).unwrap();
    }
    out.finish().unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(
        error.contains("message 0: compressed by rosbag2"),
        "{error}"
    );
    assert!(error.contains("ros2 bag convert"), "{error}");
}

#[test]
fn nothing_is_guessed() {
    let (_keep, path) = in_folder();
    bag(&path, None, &states());
    let log = JointLog::open(&[&path], None, Clock::Header).unwrap();
    let missing = |given: Overrides| match log.recording(&given, &arm(), None) {
        Err(DataError::MissingKey { key, .. }) => key,
        other => panic!("{other:?}"),
    };
    assert_eq!(
        missing(Overrides {
            robot: None,
            ..arm_measured()
        }),
        "robot"
    );
    assert_eq!(
        missing(Overrides {
            torque_kind: None,
            ..arm_measured()
        }),
        "torque_kind"
    );
}

/// Stamps run on over the sequences, which pauses keep apart: without its attachments, or cut by
/// another tool, an export is still a bag.
#[test]
fn exports_have_one_clock() {
    let folder = Folder::new();
    folder.with(r#""splits": {"train": ["2"], "test": ["10"]}"#);
    let (dataset, _) = folder.open().unwrap();
    let path = folder.path().join("all.mcap");
    let zeros = Table::new(2, vec![0.5; 8]).unwrap();
    let predictions = vec![
        EffortPrediction {
            mean: zeros.clone(),
            sd: Some(zeros)
        };
        2
    ];
    let mut export = McapExport {
        recording: Some(&dataset),
        joints: &arm(),
        base: Some("base"),
        predictions: &predictions,
        ..McapExport::default()
    };
    export.save(&path).unwrap();

    let bytes = fs::read(&path).unwrap();
    let mut stamps = BTreeMap::<String, Vec<u64>>::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let own = stamps.entry(message.channel.topic.clone()).or_default();
        own.push(message.log_time / 1_000_000);
    }
    let expected = [1000, 1010, 1020, 1030, 3030, 3040, 3050, 3060];
    let topics = [
        "/joint_states",
        "/predicted/joint_states",
        "/predicted/joint_states_sd",
        "/tf",
    ];
    assert!(stamps.keys().eq(topics), "{:?}", stamps.keys());
    assert!(stamps.values().all(|s| *s == expected), "{stamps:?}");

    let log = JointLog::open(&[&path], Some("/joint_states"), Clock::Header).unwrap();
    let (split, warnings) = log
        .recording(&Overrides::default(), &arm(), Some(1.0))
        .unwrap();
    let tables = |d: &Dataset| {
        d.sequences
            .iter()
            .map(|s| s.torques.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(tables(&split), tables(&dataset));
    assert_eq!(warnings, []);
    assert_eq!(split.splits.train, ["000", "001"]);
    // Of no length, and shorter than the time between samples.
    for gap in [-1.0, 1e-4] {
        let error = log
            .recording(&Overrides::default(), &arm(), Some(gap))
            .unwrap_err();
        assert!(
            matches!(error, DataError::Argument { what: "gap", .. }),
            "{gap}: {error}"
        );
    }

    // Names and predictions are those of the recording.
    export.predictions = &predictions[..1];
    assert!(matches!(
        export.save(&path),
        Err(DataError::Argument {
            what: "predictions",
            ..
        })
    ));
    export.predictions = &[];
    export.joints = &[];
    assert!(matches!(
        export.save(&path),
        Err(DataError::Argument { what: "joints", .. })
    ));
    assert_eq!(fs::read(&path).unwrap(), bytes);
}

/// A viewer that comes late sees the next one.
#[test]
fn fields_are_there_in_every_sequence() {
    let folder = Folder::new();
    let (dataset, _) = folder.open().unwrap();
    let path = folder.path().join("all.mcap");
    let points = vec![Point3::origin(); 2];
    let mut field = StiffnessField {
        points,
        stiffness: vec![1.0, 2.0],
        sd: Some(vec![0.5, 0.25]),
        ..StiffnessField::default()
    };
    let clouds = |export: &McapExport| {
        export.save(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        let messages = mcap::MessageStream::new(&bytes).unwrap();
        let clouds = messages.map(Result::unwrap);
        let clouds = clouds.filter(|m| m.channel.topic == "/stiffness_field");
        let time = |m: mcap::Message| (m.log_time / 1_000_000, m.data.into_owned());
        clouds.map(time).collect::<Vec<_>>()
    };
    let joints = arm();
    let mut export = McapExport {
        recording: Some(&dataset),
        joints: &joints,
        field: Some(&field),
        ..McapExport::default()
    };
    let found = clouds(&export);
    assert_eq!([found[0].0, found[1].0], [1000, 3030]);
    assert_eq!(found.len(), 2);
    export.recording = None;
    let alone = clouds(&export);
    assert_eq!(alone, found[..1]);

    // Blue, green, red, 0 at the end of each point, the data in front of `is_dense`.
    let colors = |cloud: &[u8]| {
        let data = &cloud[cloud.len() - 1 - 2 * 24..];
        [data[20], data[44]]
    };
    let bright = vsf_data::color(1.0)[2];
    let dark = vsf_data::color(0.5)[2];
    assert_eq!(colors(&alone[0].1), [dark, bright]);
    export.deviation = true;
    assert_eq!(colors(&clouds(&export)[0].1), [bright, dark]);
    field.sd = None;
    let export = McapExport {
        field: Some(&field),
        deviation: true,
        ..McapExport::default()
    };
    assert!(matches!(
        export.save(&path),
        Err(DataError::Argument {
            what: "deviation",
            ..
        })
    ));
}

/// A name without an ending is not that of a built-in robot.
#[test]
fn robots_of_files_stay_files() {
    let folder = Folder::new();
    let (mut dataset, _) = folder.open().unwrap();
    folder.write("planar_arm", b"<robot/>");
    dataset.robot = RobotRef::resolve("./planar_arm", folder.path()).unwrap();
    let path = folder.path().join("all.mcap");
    let joints = arm();
    let export = McapExport {
        recording: Some(&dataset),
        joints: &joints,
        ..McapExport::default()
    };
    export.save(&path).unwrap();
    let log = JointLog::open(&[&path], None, Clock::Header).unwrap();
    let given = Overrides {
        robot: Some(dataset.robot.clone()),
        ..Overrides::default()
    };
    let robot = log.metadata(&given).unwrap().robot.unwrap();
    assert_eq!(robot.path, dataset.robot.path);
    // Nor is one that lies there taken for it.
    let refused = || {
        matches!(
            log.metadata(&Overrides::default()),
            Err(DataError::MissingKey { key: "robot", .. })
        )
    };
    assert!(refused());
    folder.remove("planar_arm");
    assert!(refused());
}

/// What a file says of its sequences is not of those split anew.
#[test]
fn gaps_leave_out_what_is_of_other_sequences() {
    let folder = Folder::new();
    folder.with(r#""tare_samples": 2, "object_bbox": [[0, 0, 0], [1, 1, 1]]"#);
    let (dataset, _) = folder.open().unwrap();
    let path = folder.path().join("all.mcap");
    let joints = &arm();
    let recording = Some(&dataset);
    let export = McapExport {
        recording,
        joints,
        ..McapExport::default()
    };
    export.save(&path).unwrap();
    let log = JointLog::open(&[&path], None, Clock::Header).unwrap();
    let tare = |given: Overrides, gap| {
        let (dataset, warnings) = log.recording(&given, &arm(), gap).unwrap();
        (dataset.tare_samples, warnings)
    };
    assert_eq!(tare(Overrides::default(), None), (2, vec![]));
    let given = Overrides {
        tare_samples: Some(1),
        ..Overrides::default()
    };
    assert_eq!(tare(given, Some(1.0)), (1, vec![]));
    let (samples, warnings) = tare(Overrides::default(), Some(1.0));
    assert_eq!(samples, 0);
    assert!(
        matches!(
            warnings[..],
            [DataWarning::TareSamplesLeftOut {
                tare_samples: 2,
                ..
            }]
        ),
        "{warnings:?}"
    );

    // Other points are compared with the box.
    let log = log.with_points(vec![Point3::new(0.5, 0.5, 2.0)]);
    let (dataset, warnings) = log.recording(&Overrides::default(), &arm(), None).unwrap();
    assert_eq!(dataset.rest_points, Some(vec![Point3::new(0.5, 0.5, 2.0)]));
    assert!(
        matches!(
            warnings[..],
            [DataWarning::PointsOutsideBox { count: 1, .. }]
        ),
        "{warnings:?}"
    );
}

/// Attachments that do not fit the messages are not made to fit.
#[test]
fn cut_exports_are_refused() {
    let folder = Folder::new();
    let (mut dataset, _) = folder.open().unwrap();
    let path = folder.path().join("all.mcap");
    let save = |dataset: &Dataset| {
        let joints = &arm();
        let recording = Some(dataset);
        McapExport {
            recording,
            joints,
            ..McapExport::default()
        }
        .save(&path)
        .unwrap();
        fs::read(&path).unwrap()
    };
    let whole = save(&dataset);
    dataset.sequences.pop();
    dataset.splits.train.pop();
    let part = save(&dataset);
    let attachments = |bytes: &[u8]| {
        let summary = mcap::Summary::read(bytes).unwrap().unwrap();
        let read = |index| {
            let mcap::Attachment { name, data, .. } = mcap::read::attachment(bytes, index).unwrap();
            (name, data.into_owned())
        };
        summary
            .attachment_indexes
            .iter()
            .map(read)
            .collect::<Vec<_>>()
    };
    assert_eq!(attachments(&whole).len(), attachments(&part).len() + 1);
    let mut out = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    for (name, data) in attachments(&whole) {
        let attachment = mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name,
            media_type: String::new(),
            data: data.into(),
        };
        out.attach(&attachment).unwrap();
    }
    for message in mcap::MessageStream::new(&part).unwrap() {
        out.write(&message.unwrap()).unwrap();
    }
    out.finish().unwrap();
    drop(out);
    let error = read(&path).unwrap_err().to_string();
    assert!(
        error.contains("/joint_states has 4 joint states, other than"),
        "{error}"
    );
}
