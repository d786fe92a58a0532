//! Any bytes as a point cloud in the PCD format.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::data::{read_cloud, read_points};
use vsf_fuzz::file;

fuzz_target!(|data: &[u8]| {
    let path = file("a.pcd", data);
    let _ = read_cloud(&path);
    let _ = read_points(&path);
});
