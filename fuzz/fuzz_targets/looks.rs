//! Any bytes as a learned prior.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::vision::LearnedPrior;

fuzz_target!(|data: &[u8]| {
    if let Ok(text) = std::str::from_utf8(data) {
        let _ = LearnedPrior::from_json(text);
    }
});
