//! Any bytes as a point cloud in the PCD format.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::data::{read_pcd_cloud, read_pcd_points};
use vsf_fuzz::file;

fuzz_target!(|data: &[u8]| {
    let path = file("a.pcd", data);
    let _ = read_pcd_cloud(&path);
    let _ = read_pcd_points(&path);
});
