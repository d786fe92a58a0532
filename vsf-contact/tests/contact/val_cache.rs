//! The cache of grids: hits, and every way in which a file can be unfit.

use crate::common;

use nalgebra::Point3;
use std::fs;
use std::path::{Path, PathBuf};
use vsf_contact::{CacheUse, GridOptions, GridReport, GridSdf};
use vsf_core::TriMesh;

fn mesh(h: f64) -> TriMesh {
    let (vertices, faces) = common::cube(h);
    TriMesh::new(vertices, faces).unwrap()
}

fn options(folder: &Path) -> GridOptions {
    GridOptions {
        resolution: Some(0.02),
        cache_dir: Some(folder.to_owned()),
        ..Default::default()
    }
}

fn bake(folder: &Path) -> (GridSdf, GridReport) {
    GridSdf::bake(&mesh(0.04), &options(folder)).unwrap()
}

fn files(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder)
        .unwrap()
        .map(|f| f.unwrap().path())
        .collect()
}

/// Four bytes for each of as many nodes as there are numbers.
#[test]
fn any_number_of_nodes_may_be_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let unlimited = GridOptions {
        max_nodes: usize::MAX,
        ..options(folder.path())
    };
    for found in [CacheUse::Stored, CacheUse::Hit] {
        let (_, report) = GridSdf::bake(&mesh(0.04), &unlimited).unwrap();
        assert_eq!(report.cache, found);
    }
}

#[test]
fn a_stored_grid_is_read_back_bit_by_bit() {
    let folder = tempfile::tempdir().unwrap();
    let below = folder.path().join("a/b");
    let (made, mut first) = bake(&below);
    assert_eq!(first.cache, CacheUse::Stored);
    let (read, second) = bake(&below);
    assert_eq!(second.cache, CacheUse::Hit);
    assert!(made == read);
    first.cache = CacheUse::Hit;
    assert_eq!(first, second);
    assert_eq!(files(&below).len(), 1, "no temporary file is left");
}

/// A cache may be shared by users.
#[cfg(unix)]
#[test]
fn a_stored_grid_is_as_readable_as_any_file() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    bake(folder.path());
    let stored = files(folder.path()).remove(0);
    let plain = folder.path().join("plain");
    fs::write(&plain, "").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&stored), mode(&plain));
}

#[test]
fn other_meshes_and_options_have_other_files() {
    let folder = tempfile::tempdir().unwrap();
    let base = options(folder.path());
    let variants = [
        (mesh(0.04), base.clone()),
        (mesh(0.041), base.clone()),
        (
            mesh(0.04),
            GridOptions {
                resolution: Some(0.021),
                ..base.clone()
            },
        ),
        (
            mesh(0.04),
            GridOptions {
                margin: 0.02,
                ..base.clone()
            },
        ),
        (
            mesh(0.04),
            GridOptions {
                max_error: 1e-3,
                ..base
            },
        ),
    ];
    for (mesh, options) in &variants {
        let (_, report) = GridSdf::bake(mesh, options).unwrap();
        assert_eq!(report.cache, CacheUse::Stored);
    }
    assert_eq!(files(folder.path()).len(), variants.len());
}

/// Stores a grid, damages the file, and expects it to be replaced by the same grid.
fn damaged(damage: impl FnOnce(&mut Vec<u8>), reason: &str) {
    let folder = tempfile::tempdir().unwrap();
    let (made, _) = bake(folder.path());
    let path = files(folder.path()).remove(0);
    let mut bytes = fs::read(&path).unwrap();
    damage(&mut bytes);
    fs::write(&path, bytes).unwrap();
    let (again, report) = bake(folder.path());
    match &report.cache {
        CacheUse::Replaced(said) => assert!(said.contains(reason), "{said}"),
        other => panic!("{reason}: {other:?}"),
    }
    assert!(made == again);
    assert_eq!(bake(folder.path()).1.cache, CacheUse::Hit);
}

const HEADER: usize = 76;

/// Makes the checksum of an altered payload right again.
fn sign(bytes: &mut [u8]) {
    let hash = *blake3::hash(&bytes[HEADER..]).as_bytes();
    bytes[44..HEADER].copy_from_slice(&hash);
}

#[test]
fn damaged_files_are_replaced() {
    damaged(|b| b.clear(), "shorter");
    damaged(|b| b.truncate(40), "shorter");
    damaged(|b| b.truncate(b.len() - 5), "checksum");
    damaged(|b| b.push(0), "checksum");
    damaged(|b| b[0] ^= 1, "not a grid");
    damaged(|b| b[8] ^= 1, "version");
    damaged(|b| b[20] ^= 1, "another mesh");
    damaged(|b| b[50] ^= 1, "checksum");
    damaged(|b| *b.last_mut().unwrap() ^= 1, "checksum");
}

#[test]
fn hostile_files_with_a_right_checksum_are_replaced() {
    let dims = |n: [u64; 3]| {
        move |b: &mut Vec<u8>| {
            for (a, n) in n.iter().enumerate() {
                b[HEADER + 8 * a..HEADER + 8 * a + 8].copy_from_slice(&n.to_le_bytes());
            }
            sign(b);
        }
    };
    damaged(dims([u64::MAX; 3]), "size");
    damaged(dims([1 << 40, 1 << 40, 2]), "size");
    damaged(dims([0, 5, 5]), "size");
    let nan = |at: usize| {
        move |b: &mut Vec<u8>| {
            b[at..at + 8].copy_from_slice(&f64::NAN.to_le_bytes());
            sign(b);
        }
    };
    damaged(nan(HEADER + 24), "out of range");
    damaged(nan(HEADER + 48), "out of range");
    damaged(
        |b| {
            let end = b.len();
            b[end - 4..].copy_from_slice(&f32::INFINITY.to_le_bytes());
            sign(b);
        },
        "out of range",
    );
    damaged(
        |b| {
            b.truncate(HEADER + 16);
            sign(b);
        },
        "shorter",
    );
    damaged(|b| b.resize(80_000_000, 0), "longer");
}

/// A pipe would be waited for.
#[cfg(unix)]
#[test]
fn a_pipe_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    bake(folder.path());
    let path = files(folder.path()).remove(0);
    fs::remove_file(&path).unwrap();
    let made = std::process::Command::new("mkfifo").arg(&path).status();
    assert!(made.unwrap().success());
    let replaced = CacheUse::Replaced("no file".to_owned());
    assert_eq!(bake(folder.path()).1.cache, replaced);
    assert_eq!(bake(folder.path()).1.cache, CacheUse::Hit);
}

#[test]
fn a_cache_that_cannot_be_written_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "not a folder").unwrap();
    let (grid, report) = bake(&file);
    assert!(
        matches!(report.cache, CacheUse::NotStored(_)),
        "{:?}",
        report.cache
    );
    let (same, off) = GridSdf::bake(
        &mesh(0.04),
        &GridOptions {
            cache_dir: None,
            ..options(&file)
        },
    )
    .unwrap();
    assert_eq!(off.cache, CacheUse::Off);
    assert!(same == grid && grid.dims()[0] > 2 && grid.origin() < Point3::origin());
}
