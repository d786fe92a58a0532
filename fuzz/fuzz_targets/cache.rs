//! A cached grid with any content behind a header and a checksum that are right, then distances from it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::fs;
use std::path::PathBuf;
use std::sync::LazyLock;
use vsf::contact::{GridOptions, GridSdf, Sdf};
use vsf::core::TriMesh;
use vsf::core::nalgebra::Point3;
use vsf_fuzz::{scratch, tetrahedron};

/// Magic, version and key, before the checksum and the content.
const KEPT: usize = 44;

struct Cached {
    mesh: TriMesh,
    options: GridOptions,
    path: PathBuf,
    header: Vec<u8>,
}

static CACHED: LazyLock<Cached> = LazyLock::new(|| {
    let folder = scratch().join("cache");
    let (mesh, options) = tetrahedron(&folder);
    GridSdf::bake(&mesh, &options).expect("a grid");
    let mut files = fs::read_dir(&folder).expect("a folder");
    let path = files.next().expect("a file").expect("a file").path();
    let mut header = fs::read(&path).expect("a grid");
    header.truncate(KEPT);
    Cached {
        mesh,
        options,
        path,
        header,
    }
});

fuzz_target!(|payload: &[u8]| {
    let hash = blake3::hash(payload);
    let bytes = [&CACHED.header, &hash.as_bytes()[..], payload].concat();
    fs::write(&CACHED.path, bytes).expect("a file");
    let (grid, _) = GridSdf::bake(&CACHED.mesh, &CACHED.options).expect("a grid, read or made");
    for x in [-1e9, -0.05, 0.0, 0.01, 1e9] {
        grid.sample(&Point3::new(x, 0.01, 0.01));
    }
});
