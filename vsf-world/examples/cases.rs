//! Writes drawn cases and their labels.
//!
//! ```sh
//! cargo run --release -p vsf-world --example cases -- FOLDER COUNT SEED [EFFECTS [plant]]
//! ```
//!
//! Every case is a folder `case_<n>`; `labels.json` holds the truth, without the oracle's torques.
//! `EFFECTS`, such as `none,payload,latency+adhesion`, take turns instead of the drawn ones, clear and
//! in rich sequences.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use rayon::prelude::*;
use std::path::Path;
use vsf_world::{CaseSpec, Kind, Level, Protocol, draw_cases, generate};

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    assert!(args.len() >= 3, "FOLDER COUNT SEED [EFFECTS [plant]]");
    let folder = Path::new(&args[0]);
    let (count, seed) = (
        args[1].parse().expect("count"),
        args[2].parse().expect("seed"),
    );
    let mut specs = draw_cases(count, seed);
    if let Some(names) = args.get(3) {
        let kind = if args.get(4).is_some_and(|k| k == "plant") {
            Kind::Plant
        } else {
            Kind::Springs
        };
        let names: Vec<&str> = names.split(',').collect();
        specs = (0..count)
            .map(|i| CaseSpec {
                kind,
                protocol: Protocol::Rich,
                effects: match names[i % names.len()] {
                    "none" => vec![],
                    name => name.split('+').map(str::to_owned).collect(),
                },
                level: Level::Clear,
                seed: seed + i as u64,
            })
            .collect();
    }
    let labels: Vec<_> = (specs.par_iter().enumerate())
        .map(|(i, spec)| {
            let id = format!("case_{i:03}");
            let begin = std::time::Instant::now();
            match generate(spec, &folder.join(&id)) {
                Ok(mut label) => {
                    label.oracle.clear();
                    let rest = format!(
                        "{:.1} s, ratio {:.2}, peaks {:.1?}",
                        begin.elapsed().as_secs_f64(),
                        label.ratio_test,
                        label.peak_tau
                    );
                    println!(
                        "{id} {:?} {:?} {:?}: {rest}",
                        spec.kind, spec.level, spec.effects
                    );
                    Some((id, label))
                }
                Err(e) => {
                    println!("{id} {:?} {:?}: {e}", spec.kind, spec.effects);
                    None
                }
            }
        })
        .collect();
    let labels: std::collections::BTreeMap<_, _> = labels.into_iter().flatten().collect();
    let text = serde_json::to_string_pretty(&labels).unwrap();
    std::fs::write(folder.join("labels.json"), text).unwrap();
}
