//! Wall time and memory of a diagnosis: a session of six sequences of a simulated Gen3 with a wrong payload, in
//! which a soft body of some thousand points is touched, and the same with each point as several, 50,000
//! altogether.
//!
//! `cargo bench -p vsf-benches --bench diagnose`, once, since it takes minutes; in tests a few effects only, with
//! the points as they are. The memory is the most that the process has had, the making of the recording
//! included.

use std::error::Error;
use std::time::Instant;
use vsf::core::nalgebra::{Point3, Vector3};
use vsf::data::{Dataset, Overrides};
use vsf::gap::{Campaign, diagnose, effects};
use vsf::pipeline::{ProcessMemory, SceneOptions};
use vsf_world::{CaseSpec, Kind, Level, Protocol, generate};

const FINE: usize = 50_000;

fn main() -> Result<(), Box<dyn Error>> {
    let has = |flag: &str| std::env::args().any(|a| a == flag);
    let is_test = has("--test") || !has("--bench");
    let spec = CaseSpec {
        kind: Kind::Springs,
        protocol: Protocol::Rich,
        effects: vec!["payload".to_owned()],
        level: Level::Clear,
        seed: 41,
    };
    let folder = tempfile::tempdir()?;
    generate(&spec, folder.path())?;
    let (mut dataset, _) = Dataset::open(folder.path(), &Overrides::default())?;
    let catalogue = if is_test {
        effects::named(&["payload".to_owned(), "torque_bias".to_owned()])?
    } else {
        effects::catalogue()
    };
    let samples: Vec<usize> = dataset.sequences.iter().map(|s| s.len()).collect();
    println!("samples of the sequences: {samples:?}");
    println!("  points  seconds  peak memory [MB]  verdict");
    let run = |dataset: &Dataset| -> Result<(), Box<dyn Error>> {
        let clock = Instant::now();
        let campaign = Campaign::open(dataset, &SceneOptions::default())?.with_suited_fields();
        let mut begins = Vec::new();
        let step = |step| begins.push((step, clock.elapsed().as_secs_f64()));
        let verdict = diagnose(&campaign, &catalogue, 0, step)?.diagnosis.verdict;
        let seconds = clock.elapsed().as_secs_f64();
        let points = campaign.site().rest.len();
        let memory = ProcessMemory::now();
        let memory = memory.map_or("unknown".to_owned(), |m| format!("{:.0}", m.peak_mb));
        println!(
            "{points:>8}  {seconds:>7.1}  {memory:>16}  {:?}",
            verdict.effects
        );
        let ends = begins.iter().skip(1).map(|(_, begin)| *begin);
        let ends = ends.chain([seconds]);
        let steps = begins.iter().zip(ends);
        let steps = steps.map(|((step, begin), end)| format!("{step:?} {:.1}", end - begin));
        println!("  of these: {}", steps.collect::<Vec<_>>().join(", "));
        Ok(())
    };
    run(&dataset)?;
    if !is_test {
        dataset.rest_points = dataset.rest_points.map(|points| finer(&points));
        run(&dataset)?;
    }
    Ok(())
}

/// Every point of a lattice as eight, of these the ones farthest from the middle: an object whose surface is whole.
fn finer(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let spacing = vsf::core::RestPoints::new(points.to_vec()).map_or(0.0, |rest| rest.spacing());
    let side = |bit: usize| spacing * (0.5 * bit as f64 - 0.25);
    let corner = |k: usize| Vector3::new(side(k & 1), side(k >> 1 & 1), side(k >> 2));
    let mut fine: Vec<Point3<f64>> = (points.iter())
        .flat_map(|p| (0..8).map(move |k| p + corner(k)))
        .collect();
    let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
    let middle = sum / points.len() as f64;
    let from_middle = |p: &Point3<f64>| (p.coords - middle).amax();
    fine.sort_by(|a, b| from_middle(b).total_cmp(&from_middle(a)));
    fine.truncate(FINE);
    fine
}
