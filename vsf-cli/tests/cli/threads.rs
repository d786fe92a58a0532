//! Whole commands write the same bytes however many threads they have.

use std::fs;
use std::path::Path;
use std::process::Command;

#[test]
fn files_do_not_depend_on_threads() {
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/orange_tree_no");
    let written = |threads: &str| {
        let folder = tempfile::tempdir().unwrap();
        for line in [
            "estimate --out field.npz --json=estimate.json",
            "estimate --estimator replay --out online.npz",
            "diagnose --train 000 --test 001 --effects torque_bias,geometry_padding --html gap.html --model model.json --json=gap.json",
        ] {
            let output = Command::new(env!("CARGO_BIN_EXE_vsf"))
                .args(line.split_whitespace())
                .arg(&recording)
                .env("RAYON_NUM_THREADS", threads)
                .current_dir(&folder)
                .output()
                .unwrap();
            let error = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{line}: {error}");
        }
        let mut files: Vec<_> = fs::read_dir(&folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .map(|path| {
                (
                    path.file_name().unwrap().to_owned(),
                    fs::read(path).unwrap(),
                )
            })
            .collect();
        files.sort();
        files
    };
    let (one, two) = std::thread::scope(|scope| {
        let one = scope.spawn(|| written("1"));
        let two = written("2");
        (one.join().unwrap(), two)
    });
    assert_eq!(one.len(), 6);
    for ((name, one), (other, two)) in one.iter().zip(&two) {
        assert_eq!(name, other);
        assert!(one == two, "{} differs", name.display());
    }
}

/// Thousands of threads take minutes to do nothing.
#[test]
fn too_many_threads_are_refused() {
    for threads in ["100000", "-1", "two", "99999999999999999999"] {
        let output = Command::new(env!("CARGO_BIN_EXE_vsf"))
            .args(["info", "nowhere"])
            .env("RAYON_NUM_THREADS", threads)
            .output()
            .unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{error}");
        let named = format!("RAYON_NUM_THREADS={threads}");
        assert!(error.contains(&named), "{error}");
    }
}
