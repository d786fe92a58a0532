//! Any line for the example `live`.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf_examples::live::Sample;
use vsf_fuzz::JOINTS;

fuzz_target!(|line: &[u8]| {
    if let Ok(sample) = Sample::parse(line, JOINTS) {
        assert!(sample.q.iter().chain(&sample.tau).all(|x| x.is_finite()));
    }
});
