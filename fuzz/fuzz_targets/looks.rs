//! Any bytes as a learned prior.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::vision::LearnedPrior;
use vsf_fuzz::file;

fuzz_target!(|data: &[u8]| {
    let _ = LearnedPrior::open(file("looks.json", data));
});
