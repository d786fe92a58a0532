//! Any bytes as a field in an archive. What is read can be written, and is then read as the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use vsf::data::StiffnessField;
use vsf_fuzz::{file, scratch};

fuzz_target!(|data: &[u8]| {
    let Ok((field, _)) = StiffnessField::open(file("a.npz", data)) else {
        return;
    };
    let copy = scratch().join("copy.npz");
    if field.save_npz(&copy).is_ok() {
        let (read, _) = StiffnessField::open(&copy).expect("what was written is read");
        assert_eq!(read, field);
    }
});
