//! Any bytes as a CSV file of joint states, and the recording that is in it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::data::{Clock, JointLog};
use vsf_fuzz::{file, recordings};

fuzz_target!(|data: &[u8]| {
    if let Ok(log) = JointLog::open(&[file("a.csv", data)], None, Clock::Header) {
        recordings(&log);
    }
});
