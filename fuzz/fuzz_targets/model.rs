//! Any text as a corrected model, applied to an arm that knows all effects.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;
use vsf::gap::effects::catalogue;
use vsf::gap::{ModelFile, Site};
use vsf_fuzz::site;

static SITE: LazyLock<Site> = LazyLock::new(site);

fuzz_target!(|text: &str| {
    let Ok(file) = ModelFile::from_json(text) else {
        return;
    };
    let again = ModelFile::from_json(&file.to_json()).expect("what was written is read");
    assert_eq!(again, file);
    if let Ok(model) = file.model(&SITE, &catalogue()) {
        model.compensator(&SITE).expect("a model was checked");
    }
});
