use crate::console::{Console, number, plural};
use crate::derived::{SIMULATED, derived, save};
use crate::range::{scatter, seed};
use crate::recording::{FieldArgs, SplitPart, untouched};
use serde::Serialize;
use std::borrow::Cow;
use std::path::PathBuf;
use vsf::pipeline::{add_noise, motion_warnings, simulate};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The new recording has the joint angles, times, points, camera and robot of DATASET, and the torques that the \
field gives, of the same torque kind. With a corrected model (--model), effects that follow the load use that \
of the field alone.

JSON keys: out, sequences, samples, threshold (of contact, m; null in free air), noise_sd, seed.")]
pub struct Args {
    /// IDs of the sequences to simulate; default: all
    #[arg(long, value_delimiter = ',')]
    sequences: Option<Vec<String>>,
    /// Folder to write: new, empty, or with a recording of the same sequences by `vsf simulate` or `vsf predict` to
    /// replace
    #[arg(long)]
    out: PathBuf,
    /// Standard deviation of the noise added to every reading [N m or N]
    #[arg(long, default_value_t = 0.0, value_parser = scatter)]
    noise_sd: f64,
    /// Seed of the noise; the same seed gives the same readings
    #[arg(long, default_value_t = 0, value_parser = seed)]
    seed: u64,
    #[command(flatten)]
    of: FieldArgs,
}

#[derive(Serialize)]
struct Report<'a> {
    out: Cow<'a, str>,
    sequences: usize,
    samples: usize,
    threshold: Option<f64>,
    noise_sd: f64,
    seed: u64,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let (recording, field, scene, model) = args.of.open_for(&args.out, console)?;
    let sequences = recording.sequences(args.sequences.as_deref(), SplitPart::All)?;
    console.warn_all(motion_warnings(scene.robot(), &sequences));
    let spinner = console.spinner("simulating");
    let stiffness = &field.field.stiffness;
    let traces = scene.traces(&sequences, || {})?;
    console.warn_all(untouched(&scene, &traces, &sequences));
    let mut simulated = match model {
        None => simulate(&scene, stiffness, &sequences, &traces)?,
        Some(model) => model.simulate(&recording.dataset, &scene, stiffness, &sequences)?,
    };
    add_noise(&mut simulated, args.noise_sd, args.seed)?;
    spinner.finish_and_clear();
    let report = Report {
        out: args.out.to_string_lossy(),
        sequences: simulated.len(),
        samples: simulated.iter().map(|s| s.len()).sum(),
        threshold: (!scene.rest().is_empty()).then(|| scene.contact().threshold),
        noise_sd: args.noise_sd,
        seed: args.seed,
    };
    let dataset = derived(&recording, SIMULATED, &args.of, &scene, simulated)?;
    save(dataset, &recording.packages(), &args.out, Vec::new())?;
    let out = args.out.display();
    let contact = match report.threshold {
        None => "in free air".to_owned(),
        Some(threshold) => format!("contact threshold {} mm", number(1e3 * threshold)),
    };
    let s = plural(report.sequences);
    let text = format!(
        "wrote {out}: {} sequence{s}, {} samples, {contact}\n",
        report.sequences, report.samples,
    );
    console.results(&report, text)
}
