//! Any bytes as the saved state of an estimator: the first says of which and in which format. One that is
//! restored goes on estimating.
#![no_main]

use libfuzzer_sys::fuzz_target;
use serde::de::DeserializeOwned;
use vsf::core::{Belief, Estimator, Noise, Observation};
use vsf_fuzz::{Dense, Dual, Plain, Replay};

/// More would only take time: the number is the caller's to choose.
const REPLAYS: usize = 1000;

fn read<E: DeserializeOwned>(json: bool, bytes: &[u8]) -> Option<E> {
    if json {
        serde_json::from_slice(bytes).ok()
    } else {
        postcard::from_bytes(bytes).ok()
    }
}

fn go_on(mut estimator: impl Estimator<Scalar = f64>) {
    let before = estimator.belief().clone();
    let mut obs = Observation::new(Noise::uniform(1, 0.5).expect("noise"));
    let touched = obs.rebuild(before.len(), &[0], &[2.0], |_, w| w[0] = 1.0);
    if touched.is_err() {
        return;
    }
    if estimator.update(&obs).is_err() {
        assert_eq!(*estimator.belief(), before);
    }
    let after = estimator.belief();
    Belief::new(after.mean().to_vec(), after.variance().to_vec()).expect("a belief");
}

fuzz_target!(|data: &[u8]| {
    let Some((&which, bytes)) = data.split_first() else {
        return;
    };
    let json = which & 1 != 0;
    match which / 2 % 4 {
        0 => read::<Plain>(json, bytes).into_iter().for_each(go_on),
        1 => read::<Replay>(json, bytes)
            .filter(|e| e.inner().config().replays <= REPLAYS)
            .into_iter()
            .for_each(go_on),
        2 => read::<Dual>(json, bytes)
            .filter(|e| e.config().replays <= REPLAYS)
            .into_iter()
            .for_each(go_on),
        _ => read::<Dense>(json, bytes).into_iter().for_each(go_on),
    }
});
