//! Small recordings on disk, and bytes of `.npy` files written independently of the crate.
#![allow(dead_code)]

use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use vsf_data::{DataError, DataWarning, Dataset, Overrides};

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
        for id in ["2", "10"] {
            let values: Vec<f64> = (0..ROWS * COLS).map(|v| v as f64 / 8.0).collect();
            for name in ["angles", "torques"] {
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
