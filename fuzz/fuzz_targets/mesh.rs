//! Any bytes as the mesh of a collision shape: the first says whether STL or OBJ, the rest are the file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::robots::{RobotModel, UrdfOptions};
use vsf_fuzz::{file, scratch};

fuzz_target!(|data: &[u8]| {
    let Some((kind, bytes)) = data.split_first() else {
        return;
    };
    let name = if kind % 2 == 0 { "a.stl" } else { "a.obj" };
    file(name, bytes);
    let urdf = format!(
        r#"<robot name="r"><link name="l"><collision><geometry><mesh filename="{name}"
           scale="0.1 -0.2 0.3"/></geometry></collision></link></robot>"#
    );
    let _ = RobotModel::from_urdf_str(&urdf, scratch(), &UrdfOptions::default());
});
