//! A small recording, written with nothing but the standard library, and the built command.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

pub const ROWS: usize = 24;

pub struct Bench {
    _keep: TempDir,
    pub root: PathBuf,
}

impl Bench {
    /// A folder with `data/`: a block of points under a cartesian stage, sequences a, b (train)
    /// and c (test), torques zero; and `truth/`, a field that is stiffer on one side.
    pub fn new() -> Self {
        let keep = tempfile::tempdir().unwrap();
        let root = keep.path().to_owned();
        let mut points = Vec::new();
        for (x, y, z) in grid() {
            points.extend([0.004 * x, 0.004 * y, -0.004 * z]);
        }
        let n = points.len() / 3;
        let stiffness: Vec<f64> = grid()
            .map(|(x, ..)| if x < 5.0 { 30.0 } else { 90.0 })
            .collect();
        for folder in ["data", "truth"] {
            fs::create_dir(root.join(folder)).unwrap();
            npy(&root.join(folder).join("points.npy"), &[n, 3], &points);
        }
        npy(&root.join("truth/K.npy"), &[n], &stiffness);
        for (id, shift) in [("a", 0.0), ("b", 0.002), ("c", 0.001)] {
            let folder = root.join("data").join(format!("seq_{id}"));
            fs::create_dir(&folder).unwrap();
            let mut angles = Vec::new();
            for k in 0..ROWS {
                let depth = 0.0006 * (k.min(ROWS - k)) as f64;
                angles.extend([0.018 + shift, 0.016, 0.002 - depth]);
            }
            npy(&folder.join("angles.npy"), &[ROWS, 3], &angles);
            npy(&folder.join("torques.npy"), &[ROWS, 3], &[0.0; 3 * ROWS]);
        }
        let bench = Self { _keep: keep, root };
        bench.metadata(METADATA);
        bench
    }

    /// [`Bench::new`] with the torques of `truth` in `touch/`.
    pub fn touched() -> Self {
        let bench = Self::new();
        bench.ok("simulate data --field truth --out touch --noise-sd 0.002 --seed 3");
        bench
    }

    pub fn metadata(&self, json: &str) {
        fs::write(self.root.join("data/dataset.json"), json).unwrap();
    }

    pub fn run(&self, line: &str) -> Output {
        vsf(&self.root, line)
    }

    /// Runs a command that must succeed and returns its standard output.
    pub fn ok(&self, line: &str) -> String {
        let output = self.run(line);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "vsf {line}: {error}");
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs a command that must succeed and returns its standard error.
    pub fn warned(&self, line: &str) -> String {
        let output = self.run(line);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "vsf {line}: {error}");
        error
    }

    /// Runs a command that must fail with `code`, in one line that holds all of `parts`.
    pub fn fails(&self, line: &str, code: i32, parts: &[&str]) {
        let output = self.run(line);
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "vsf {line}: {error}");
        assert!(
            !error.contains("panicked") && !error.contains("RUST_BACKTRACE"),
            "{error}"
        );
        assert!(error.contains("error: "), "{error}");
        for part in parts {
            assert!(
                error.contains(part),
                "vsf {line}: {part:?} is not in: {error}"
            );
        }
    }
}

pub const METADATA: &str = r#"{"robot": "cartesian_stage", "rate_hz": 50,
    "splits": {"train": ["a", "b"], "test": ["c"]}}"#;

/// A cube of 2 cm about the origin, as OBJ.
pub const BOX: &str = "\
    v -0.01 -0.01 -0.01\nv 0.01 -0.01 -0.01\nv 0.01 0.01 -0.01\nv -0.01 0.01 -0.01\n\
    v -0.01 -0.01 0.01\nv 0.01 -0.01 0.01\nv 0.01 0.01 0.01\nv -0.01 0.01 0.01\n\
    f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

fn grid() -> impl Iterator<Item = (f64, f64, f64)> {
    (0..10)
        .flat_map(|x| (0..8).flat_map(move |y| (0..2).map(move |z| (x as f64, y as f64, z as f64))))
}

pub fn vsf(folder: &Path, line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vsf"))
        .args(line.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Writes an array of f64.
pub fn npy(path: &Path, shape: &[usize], data: &[f64]) {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let bytes: Vec<u8> = data.iter().flat_map(|v| v.to_le_bytes()).collect();
    raw_npy(path, "<f8", &shape, &bytes);
}

pub fn raw_npy(path: &Path, dtype: &str, shape: &str, bytes: &[u8]) {
    let dict = format!("{{'descr': '{dtype}', 'fortran_order': False, 'shape': ({shape}), }}");
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend(118u16.to_le_bytes());
    file.extend(format!("{dict:<117}\n").bytes());
    file.extend(bytes);
    fs::write(path, file).unwrap();
}
