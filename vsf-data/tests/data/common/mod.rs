//! Small recordings on disk, and bytes of `.npy` files written independently of the crate.

use nalgebra::Point3;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use vsf_data::{
    ColoredPoint, DataError, DataWarning, Dataset, Overrides, RobotRef, TorqueKind, read_cloud,
    read_points,
};

/// The points of a cloud, without what should be known of them.
pub fn points_of(path: impl AsRef<Path>) -> Result<Vec<Point3<f64>>, DataError> {
    Ok(read_points(path)?.0)
}

pub fn cloud_of(path: impl AsRef<Path>) -> Result<Vec<ColoredPoint>, DataError> {
    Ok(read_cloud(path)?.0)
}

pub const ROWS: usize = 4;
pub const COLS: usize = 2;

/// A `.npy` file, version 1.0.
pub fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let dict = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((dict.len() as u16).to_le_bytes());
    bytes.extend(dict.bytes());
    bytes.extend(data);
    bytes
}

pub fn f8(shape: &str, values: &[f64]) -> Vec<u8> {
    let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    npy("<f8", shape, &data)
}

pub fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden/numpy")
        .join(name)
}

/// A valid recording: sequences 2 and 10 of two joints and four samples, points, metadata.
pub struct Folder(pub TempDir);

impl Folder {
    pub fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for (id, shift) in [("2", 0.0), ("10", 0.5)] {
            for (name, shift) in [("angles", 0.0), ("torques", shift)] {
                let values = (0..ROWS * COLS).map(|v| v as f64 / 8.0 + shift);
                let values: Vec<f64> = values.collect();
                folder.write(&format!("seq_{id}/{name}.npy"), &f8("(4, 2)", &values));
            }
        }
        folder.write("points.npy", &f8("(2, 3)", &[0.0, 0.1, 0.2, 0.3, 0.4, 0.5]));
        folder.json(r#"{"robot": "kinova_gen3", "rate_hz": 100}"#);
        folder
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn write(&self, name: &str, bytes: &[u8]) {
        let path = self.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    pub fn json(&self, text: &str) {
        self.write("dataset.json", text.as_bytes());
    }

    /// dataset.json with a robot, a rate and these further members.
    pub fn with(&self, members: &str) {
        self.json(&format!(
            r#"{{"robot": "kinova_gen3", "rate_hz": 100, {members}}}"#
        ));
    }

    pub fn remove(&self, name: &str) {
        fs::remove_file(self.path().join(name)).unwrap();
    }

    pub fn open(&self) -> Result<(Dataset, Vec<DataWarning>), DataError> {
        Dataset::open(self.path(), &Overrides::default())
    }

    /// The error of opening it, and its message with the folder's path taken out.
    pub fn error(&self) -> (DataError, String) {
        let error = self.open().expect_err("the folder must be refused");
        let text = error.to_string();
        let text = text.replace(&format!("{}/", self.path().display()), "");
        (error, text)
    }
}

/// Joints of the arm of which joint states are read.
pub const ARM: [&str; 2] = ["shoulder", "elbow"];

pub fn arm() -> [String; 2] {
    ARM.map(str::to_owned)
}

/// What joint states do not say: that they are of the arm, and efforts those of its actuators.
pub fn arm_measured() -> Overrides {
    Overrides {
        robot: Some(RobotRef::resolve("planar_arm", ".".as_ref()).unwrap()),
        torque_kind: Some(TorqueKind::Measured),
        ..Overrides::default()
    }
}

/// Checks the recording of a file `touch.*` of five joint states of the arm at 100 Hz, with a pause after the third;
/// `effort` is that of the fourth.
pub fn check_pause(dataset: &Dataset, effort: [f64; 2]) {
    assert_eq!(dataset.name, "touch");
    assert_eq!(dataset.torque_kind, TorqueKind::Measured);
    let [a, b] = &dataset.sequences[..] else {
        panic!("{} sequences", dataset.sequences.len());
    };
    assert_eq!((&*a.id, &*b.id), ("000", "001"));
    assert_eq!(
        (&a.time[..], &b.time[..]),
        (&[0.0, 0.01, 0.02][..], &[0.0, 0.01][..])
    );
    assert_eq!(&a.angles[1], [0.1, -0.1]);
    assert_eq!(&b.torques[0], effort);
    assert_eq!(a.velocities, None);
}

/// `sensor_msgs/msg/JointState` as ROS 2 serializes it, written independently of the crate.
#[derive(Debug, Clone)]
pub struct State {
    pub topic: &'static str,
    /// [ns]
    pub stamp: i64,
    pub names: Vec<&'static str>,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub effort: Vec<f64>,
}

impl State {
    /// Of the arm, `k` hundredths of a second after time 100 s.
    pub fn arm(k: i64) -> Self {
        let v = k as f64;
        Self {
            topic: "/joint_states",
            stamp: 100_000_000_000 + 10_000_000 * k,
            names: ARM.to_vec(),
            position: vec![0.1 * v, -0.1 * v],
            velocity: vec![],
            effort: vec![1.0 + v, 2.0 + v],
        }
    }

    fn cdr(&self) -> Vec<u8> {
        fn align(body: &mut Vec<u8>, size: usize) {
            while !body.len().is_multiple_of(size) {
                body.push(0);
            }
        }
        fn length(body: &mut Vec<u8>, n: usize) {
            align(body, 4);
            body.extend((n as u32).to_le_bytes());
        }
        fn text(body: &mut Vec<u8>, text: &str) {
            length(body, text.len() + 1);
            body.extend(text.bytes().chain([0]));
        }
        let mut body = Vec::new();
        body.extend(((self.stamp / 1_000_000_000) as i32).to_le_bytes());
        body.extend(((self.stamp % 1_000_000_000) as u32).to_le_bytes());
        text(&mut body, "base");
        length(&mut body, self.names.len());
        self.names.iter().for_each(|name| text(&mut body, name));
        for array in [&self.position, &self.velocity, &self.effort] {
            length(&mut body, array.len());
            for value in array {
                align(&mut body, 8);
                body.extend(value.to_le_bytes());
            }
        }
        [&[0, 1, 0, 0][..], &body].concat()
    }
}

pub const DEFINITION: &str = "std_msgs/Header header\nstring[] name\nfloat64[] position\n\
                              float64[] velocity\nfloat64[] effort\n";

/// An MCAP file as rosbag2 writes it, logged a millisecond after the stamps, with another topic in it.
pub fn bag(path: &Path, compression: Option<mcap::Compression>, states: &[State]) {
    bag_of(
        path,
        compression,
        ["sensor_msgs/msg/JointState", "ros2msg", "cdr"],
        DEFINITION,
        states,
    );
}

pub fn bag_of(
    path: &Path,
    compression: Option<mcap::Compression>,
    [schema, encoding, message]: [&str; 3],
    definition: &str,
    states: &[State],
) {
    let options = mcap::WriteOptions::new()
        .profile("ros2")
        .compression(compression);
    let mut out = options
        .chunk_size(Some(400))
        .create(fs::File::create(path).unwrap())
        .unwrap();
    let text = out
        .add_schema("std_msgs/msg/String", "ros2msg", b"string data")
        .unwrap();
    let joints = out
        .add_schema(schema, encoding, definition.as_bytes())
        .unwrap();
    let none = Default::default();
    for state in states {
        let log = out.add_channel(text, "/rosout", "cdr", &none).unwrap();
        let channel = out
            .add_channel(joints, state.topic, message, &none)
            .unwrap();
        let log_time = (state.stamp + 1_000_000) as u64;
        for (channel_id, data) in [
            (log, vec![0, 1, 0, 0, 1, 0, 0, 0, 0]),
            (channel, state.cdr()),
        ] {
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: 0,
                log_time,
                publish_time: log_time,
            };
            out.write_to_known_channel(&header, &data).unwrap();
        }
    }
    out.finish().unwrap();
}
