//! Any bytes as an MCAP file with joint states, and the recording that is in it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::data::{Clock, JointLog};
use vsf_fuzz::{file, recordings};

fuzz_target!(|data: &[u8]| {
    let path = file("a.mcap", data);
    let Ok(log) = JointLog::open(&[path], Some("/joint_states"), Clock::Header) else {
        return;
    };
    recordings(&log);
});
