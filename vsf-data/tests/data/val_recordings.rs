//! Every recording of the project's data folder opens as it is, and survives saving.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use vsf_data::{DataWarning, Dataset, Overrides};

/// The folder with the recordings: `VSF_DATA`, or `shared/data` beside the repository.
fn data() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("VSF_DATA").map_or_else(beside, PathBuf::from);
    folder.is_dir().then_some(folder)
}

fn recordings(below: &Path, found: &mut Vec<PathBuf>) {
    if below.join("dataset.json").is_file() {
        found.push(below.to_owned());
        return;
    }
    for entry in fs::read_dir(below).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            recordings(&path, found);
        }
    }
}

#[test]
fn every_recording_opens_and_saves() {
    let Some(folder) = data() else {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED every_recording_opens_and_saves: no data folder, set VSF_DATA"
        );
        return;
    };
    let mut found = Vec::new();
    recordings(&folder, &mut found);
    assert!(!found.is_empty(), "no recordings in {}", folder.display());
    let (mut samples, mut cameras) = (0, 0);
    for (index, path) in found.iter().enumerate() {
        let (dataset, warnings) =
            Dataset::open(path, &Overrides::default()).unwrap_or_else(|e| panic!("{e}"));
        // Runs with the motor off are recorded with zero torque.
        let expected = |w: &DataWarning| matches!(w, DataWarning::ZeroTorques { .. });
        assert!(warnings.iter().all(expected), "{warnings:?}");
        let used = dataset.train().count() + dataset.test().count();
        assert_eq!(used, dataset.sequences.len());
        samples += dataset.sequences.iter().map(|s| s.len()).sum::<usize>();
        cameras += usize::from(dataset.camera.is_some());
        for sequence in &dataset.sequences {
            let rows: usize = sequence.touches().map(|r| r.len()).sum();
            assert_eq!(rows, sequence.len());
            sequence
                .derivatives(2)
                .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        }
        // Saving waits for the disk, so not all of them.
        if index % 6 != 0 {
            continue;
        }
        let copy = tempfile::tempdir().unwrap();
        dataset.save(copy.path()).unwrap();
        let (read, _) = Dataset::open(copy.path(), &Overrides::default()).unwrap();
        assert_eq!(read.sequences, dataset.sequences);
        assert_eq!(read.rest_points, dataset.rest_points);
        assert_eq!(read.splits, dataset.splits);
        let turned = read.base_pose.rotation.coords - dataset.base_pose.rotation.coords;
        assert!(turned.amax() < 1e-15);
    }
    eprintln!(
        "{} recordings, {samples} samples, {cameras} cameras",
        found.len()
    );
}
