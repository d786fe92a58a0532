//! A recording with one of its files replaced: the first byte says which, the rest are its new content.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::fs;
use std::path::PathBuf;
use std::sync::LazyLock;
use vsf::data::{Dataset, Overrides};
use vsf_fuzz::{RECORDED, recording, scratch};

static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = scratch().join("recording");
    recording().save(&folder).expect("a recording");
    folder
});

fuzz_target!(|data: &[u8]| {
    let Some((&which, bytes)) = data.split_first() else {
        return;
    };
    let path = FOLDER.join(RECORDED[usize::from(which) % RECORDED.len()]);
    let whole = fs::read(&path).expect("a file of the recording");
    fs::write(&path, bytes).expect("a file of the recording");
    let _ = Dataset::open(&*FOLDER, &Overrides::default());
    fs::write(&path, whole).expect("a file of the recording");
});
