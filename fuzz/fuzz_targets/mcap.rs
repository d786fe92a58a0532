//! Any bytes as an MCAP file with joint states, and the recording that is in it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::data::{Clock, JointLog, Overrides, RobotRef, TorqueKind};
use vsf_fuzz::{JOINTS, file};

fuzz_target!(|data: &[u8]| {
    let path = file("a.mcap", data);
    let Ok(log) = JointLog::open(&[path], Some("/joint_states"), Clock::Header) else {
        return;
    };
    let given = Overrides {
        robot: RobotRef::resolve("planar_arm", ".".as_ref()).ok(),
        torque_kind: Some(TorqueKind::Measured),
        ..Overrides::default()
    };
    let joints: Vec<String> = (1..=JOINTS).map(|j| format!("joint_{j}")).collect();
    for gap in [None, Some(0.5)] {
        let _ = log.recording(&given, &joints, gap);
    }
});
