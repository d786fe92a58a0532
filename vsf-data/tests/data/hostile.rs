//! Damaged bytes give data or an error, never a panic.

use crate::common::{ARM, Folder, State, bag, cloud_of, golden, points_of};
use proptest::prelude::*;
use proptest::sample::Index;
use std::fs;
use std::sync::LazyLock;
use vsf_data::{
    Clock, DataError, Dataset, JointLog, McapExport, Overrides, RobotRef, StiffnessField,
    TorqueKind,
};

/// One way to damage a file.
#[derive(Debug, Clone)]
enum Damage {
    Set(Index, u8),
    Cut(Index),
    Insert(Index, Vec<u8>),
    Remove(Index, usize),
}

fn damage() -> impl Strategy<Value = Vec<Damage>> {
    let bytes = prop::collection::vec(any::<u8>(), 1..9);
    let one = prop_oneof![
        4 => (any::<Index>(), any::<u8>()).prop_map(|(i, b)| Damage::Set(i, b)),
        // Digits turn shapes, sizes and numbers into other ones.
        4 => (any::<Index>(), b'0'..=b'9').prop_map(|(i, b)| Damage::Set(i, b)),
        1 => any::<Index>().prop_map(Damage::Cut),
        2 => (any::<Index>(), bytes).prop_map(|(i, b)| Damage::Insert(i, b)),
        1 => (any::<Index>(), 1..9usize).prop_map(|(i, n)| Damage::Remove(i, n)),
    ];
    prop::collection::vec(one, 1..6)
}

fn apply(bytes: &mut Vec<u8>, damage: &[Damage]) {
    for one in damage {
        if bytes.is_empty() {
            return;
        }
        let n = bytes.len();
        match one {
            Damage::Set(i, b) => bytes[i.index(n)] = *b,
            Damage::Cut(i) => bytes.truncate(i.index(n)),
            Damage::Insert(i, more) => {
                let at = i.index(n);
                bytes.splice(at..at, more.iter().copied());
            }
            Damage::Remove(i, count) => {
                let at = i.index(n);
                bytes.drain(at..(at + count).min(n));
            }
        }
    }
}

/// A saved recording with every optional file, and their names.
fn complete() -> (tempfile::TempDir, Vec<String>) {
    let folder = Folder::new();
    folder.with(
        r#""base_pose": [[1,0,0,0.5],[0,1,0,0],[0,0,1,0],[0,0,0,1]], "touch_starts": {"2": [0, 2]},
           "sequence_tags": {"10": ["a"]}, "note": [1, {"b": null}]"#,
    );
    let (mut dataset, _) = folder.open().unwrap();
    dataset.sequences[0].velocities = Some(dataset.sequences[0].angles.clone());
    let (mut field, _) = StiffnessField::open(golden("plain.npz")).unwrap();
    field.sd = Some(vec![1.0; 4]);
    dataset.field = Some(field);
    dataset.camera = Some(vsf_data::CameraView {
        width: 4,
        height: 3,
        color: (0..36).collect(),
        depth: (0..12).map(|d| d * 999).collect(),
        fx: 2.0,
        fy: 2.0,
        cx: 1.5,
        cy: 1.0,
        depth_scale: 0.001,
        X_WC: Default::default(),
        extra: Default::default(),
    });
    let saved = tempfile::tempdir().unwrap();
    dataset.save(saved.path()).unwrap();
    let names = [
        "dataset.json",
        "points.npy",
        "vsf.npz",
        "camera/color.png",
        "camera/depth.png",
        "camera/camera.json",
        "seq_2/angles.npy",
        "seq_2/time.npy",
        "seq_2/velocities.npy",
        "seq_10/torques.npy",
    ];
    (saved, names.map(str::to_owned).to_vec())
}

#[test]
fn damaged_recordings_never_panic() {
    let (folder, names) = complete();
    let whole: Vec<Vec<u8>> = names
        .iter()
        .map(|n| fs::read(folder.path().join(n)).unwrap())
        .collect();
    let mut config = ProptestConfig::with_cases(1500);
    config.failure_persistence = None;
    proptest!(config, |(file in 0..names.len(), damage in damage())| {
        let path = folder.path().join(&names[file]);
        let mut bytes = whole[file].clone();
        apply(&mut bytes, &damage);
        fs::write(&path, &bytes).unwrap();
        let result = Dataset::open(folder.path(), &Overrides::default());
        fs::write(&path, &whole[file]).unwrap();
        if let Err(error) = result {
            // Every message names a file of the folder.
            let text = error.to_string();
            prop_assert!(text.contains(&folder.path().display().to_string()), "{}", text);
        }
    });
    Dataset::open(folder.path(), &Overrides::default()).unwrap();
}

#[test]
fn truncations_are_errors() {
    let (folder, names) = complete();
    for name in names {
        let path = folder.path().join(&name);
        let whole = fs::read(&path).unwrap();
        // dataset.json ends in a newline, which may go.
        for length in (0..whole.len() - 1).step_by(1 + whole.len() / 250) {
            fs::write(&path, &whole[..length]).unwrap();
            let result = Dataset::open(folder.path(), &Overrides::default());
            assert!(result.is_err(), "{name} cut to {length} bytes");
        }
        fs::write(&path, &whole).unwrap();
    }
}

/// An export with all its parts, and a bag of ROS 2 in chunks with compression.
fn mcap_files() -> Vec<Vec<u8>> {
    let folder = Folder::new();
    let path = folder.path().join("a.mcap");
    let (dataset, _) = folder.open().unwrap();
    let (field, _) = StiffnessField::open(golden("plain.npz")).unwrap();
    let export = McapExport {
        recording: Some(&dataset),
        joints: &ARM.map(str::to_owned),
        field: Some(&field),
        ..McapExport::default()
    };
    export.save(&path).unwrap();
    let mut files = vec![fs::read(&path).unwrap()];
    let states: Vec<State> = (0..4).map(State::arm).collect();
    for compression in [mcap::Compression::Zstd, mcap::Compression::Lz4] {
        bag(&path, Some(compression), &states);
        files.push(fs::read(&path).unwrap());
    }
    files
}

/// Whatever comes of a file, with all that it can give.
fn read_mcap(bytes: &[u8]) -> Result<Dataset, DataError> {
    read_log("a.mcap", bytes)
}

fn read_log(name: &str, bytes: &[u8]) -> Result<Dataset, DataError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    let given = Overrides {
        robot: Some(RobotRef::resolve("planar_arm", ".".as_ref()).unwrap()),
        torque_kind: Some(TorqueKind::External),
        ..Overrides::default()
    };
    let log = JointLog::open(&[&path], None, Clock::Header)?;
    Ok(log.recording(&given, &ARM.map(str::to_owned), None)?.0)
}

#[test]
fn cut_mcap_files_are_errors() {
    for whole in mcap_files() {
        read_mcap(&whole).unwrap();
        for length in (0..whole.len()).step_by(7) {
            let error = read_mcap(&whole[..length]).unwrap_err().to_string();
            assert!(
                error.contains("a.mcap: the file ends in the middle"),
                "{length}: {error}"
            );
        }
    }
}

/// Lengths beyond what the file holds, at every place where a length could stand.
#[test]
fn huge_lengths_in_mcap_files_reserve_nothing() {
    for whole in mcap_files() {
        for at in (0..whole.len() - 8).step_by(11) {
            for length in [[0xff; 8], [0xff, 0xff, 0xff, 0x7f, 0, 0, 0, 0]] {
                let mut bytes = whole.clone();
                bytes[at..at + 8].copy_from_slice(&length);
                let _ = read_mcap(&bytes);
            }
        }
    }
}

/// A record of an MCAP file.
fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

/// What the reader of the `mcap` crate would panic on.
#[test]
fn records_that_contradict_themselves_are_errors() {
    let refused = |records: &[u8]| {
        let header = record(1, &[0; 8]);
        let bytes = [mcap::MAGIC, &header, records].concat();
        read_mcap(&bytes).unwrap_err().to_string()
    };
    // A chunk without compression, whose only record is longer than the chunk.
    let inside = [&[5][..], &100u64.to_le_bytes()].concat();
    let size = (inside.len() as u64).to_le_bytes();
    let chunk = [&[0; 16][..], &size, &[0; 4], &[0; 4], &size, &inside].concat();
    let text = refused(&[record(6, &chunk), record(0x80, &[0; 200])].concat());
    assert!(text.contains("100 bytes are announced"), "{text}");
    // An attachment without room for its sum.
    let attachment = [&[0; 16][..], &[0; 4], &[0; 4], &[0; 8]].concat();
    let text = refused(&record(9, &attachment));
    assert!(text.contains("a.mcap"), "{text}");
    // Names longer than the record, for which no memory is reserved.
    for opcode in [3, 4, 9] {
        let text = refused(&record(opcode, &[0xff; 40]));
        assert!(text.contains("4294967295 bytes are announced"), "{text}");
    }
    // Metadata of a channel that reach beyond it.
    let channel = [&[0; 4][..], &[0; 4], &[0; 4], &9u32.to_le_bytes(), &[0; 8]].concat();
    let text = refused(&record(4, &channel));
    assert!(text.contains("9 bytes are announced"), "{text}");
    // Metadata whose last name has no value: what follows them would be taken for its length.
    let channel = [
        &[0; 4][..],
        &[0; 4],
        &[0; 4],
        &4u32.to_le_bytes(),
        &[0; 4],
        &[0xef; 8],
    ]
    .concat();
    let text = refused(&record(4, &channel));
    assert!(text.contains("a record of kind 4"), "{text}");
    // A message of a channel that was never defined.
    let text = refused(&record(5, &[0; 30]));
    assert!(text.contains("channel 0, which is not defined"), "{text}");
}

/// Attachments are of a file, never of a chunk, which could unpack to any number of them.
#[test]
fn attachments_in_chunks_are_not_kept() {
    let name = b"points.npy";
    let length = (name.len() as u32).to_le_bytes();
    let attachment = [&[0; 16][..], &length, name, &[0; 4], &[0; 8], &[0; 4]].concat();
    let inside = record(9, &attachment);
    let size = (inside.len() as u64).to_le_bytes();
    let chunk = [&[0; 16][..], &size, &[0; 4], &[0; 4], &size, &inside].concat();
    // Behind the header of a bag.
    let bag = &mcap_files()[1];
    let length = u64::from_le_bytes(bag[9..17].try_into().unwrap());
    let with = |more: &[u8]| {
        let (header, rest) = bag.split_at(17 + length as usize);
        read_mcap(&[header, more, rest].concat())
    };
    assert_eq!(with(&record(6, &chunk)).unwrap().rest_points, None);
    let error = with(&inside).unwrap_err().to_string();
    assert!(error.contains("points.npy"), "{error}");
}

/// What a header does not count is damage, be it text or binary; white space is none.
#[test]
fn clouds_with_more_than_they_count() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let (field, _) = StiffnessField::open(golden("plain.npz")).unwrap();
    field.save_ply(&path, None).unwrap();
    let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
                property float z\nend_header\n0 1 2\n";
    for bytes in [text.as_bytes().to_vec(), fs::read(&path).unwrap()] {
        for (more, fits) in [(&b"\n \n"[..], true), (b"3 4 5\n", false)] {
            fs::write(&path, [&bytes, more].concat()).unwrap();
            match points_of(&path) {
                Ok(_) => assert!(fits),
                Err(e) => assert!(!fits && e.to_string().contains("left behind"), "{e}"),
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(1500) })]

    #[test]
    fn damaged_archives_never_panic(
        name in prop::sample::select(vec!["plain.npz", "compressed.npz", "openvsf.npz"]),
        damage in damage(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let mut bytes = fs::read(golden(name)).unwrap();
        apply(&mut bytes, &damage);
        let path = folder.path().join("a.npz");
        fs::write(&path, &bytes).unwrap();
        let _ = StiffnessField::open(&path);
    }

    #[test]
    fn damaged_clouds_never_panic(damage in damage(), ascii in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let mut bytes = if ascii {
            b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n\
              property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
              end_header\n0 1 2\n3 4 5\n3 0 1 1\n".to_vec()
        } else {
            let (field, _) = StiffnessField::open(golden("plain.npz")).unwrap();
            field.save_ply(&path, None).unwrap();
            fs::read(&path).unwrap()
        };
        apply(&mut bytes, &damage);
        fs::write(&path, &bytes).unwrap();
        let _ = points_of(&path);
    }

    #[test]
    fn damaged_pcd_clouds_never_panic(
        damage in damage(),
        kind in prop::sample::select(vec!["ascii", "binary", "binary_compressed"]),
    ) {
        let header = format!(
            "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n\
             WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {kind}\n"
        );
        let run = [&[31u8], &[7; 32][..]].concat();
        let data = match kind {
            "ascii" => b"1 2 3 4\n5 6 7 8\n".to_vec(),
            "binary" => vec![7; 32],
            _ => [&33u32.to_le_bytes()[..], &32u32.to_le_bytes(), &run].concat(),
        };
        let mut bytes = [header.as_bytes(), &data].concat();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pcd");
        fs::write(&path, &bytes).unwrap();
        prop_assert_eq!(cloud_of(&path).unwrap().len(), 2);
        apply(&mut bytes, &damage);
        fs::write(&path, &bytes).unwrap();
        let _ = points_of(&path);
        let _ = cloud_of(&path);
    }

    #[test]
    fn damaged_mcap_files_never_panic(file in 0..3usize, damage in damage()) {
        static FILES: LazyLock<Vec<Vec<u8>>> = LazyLock::new(mcap_files);
        let mut bytes = FILES[file].clone();
        apply(&mut bytes, &damage);
        if let Err(error) = read_mcap(&bytes) {
            prop_assert!(error.to_string().contains("a.mcap"), "{}", error);
        }
    }

    #[test]
    fn damaged_csv_files_never_panic(damage in damage()) {
        let text = "time,q_shoulder,q_elbow,dq_shoulder,dq_elbow,tau_shoulder,tau_elbow\n\
                    1700000000.25,0.1,-2e-3,,,1,2\n1700000000.5,0.1,-0.2,,,1,2\n";
        let mut bytes = text.as_bytes().to_vec();
        prop_assert!(read_log("a.csv", &bytes).is_ok());
        apply(&mut bytes, &damage);
        if let Err(error) = read_log("a.csv", &bytes) {
            prop_assert!(error.to_string().contains("a.csv"), "{}", error);
        }
    }

    #[test]
    fn any_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let folder = tempfile::tempdir().unwrap();
        for magic in [&b""[..], b"\x93NUMPY\x01\x00", b"PK\x03\x04", b"ply\n", mcap::MAGIC] {
            let path = folder.path().join("a.npz");
            fs::write(&path, [magic, &bytes].concat()).unwrap();
            prop_assert!(StiffnessField::open(&path).is_err());
            for name in ["a.ply", "a.pcd"] {
                let cloud = folder.path().join(name);
                fs::copy(&path, &cloud).unwrap();
                prop_assert!(points_of(&cloud).is_err());
            }
            prop_assert!(JointLog::open(&[&path], None, Clock::Header).is_err());
            let text = folder.path().join("a.csv");
            fs::copy(&path, &text).unwrap();
            prop_assert!(JointLog::open(&[&text], None, Clock::Header).is_err());
        }
    }
}
