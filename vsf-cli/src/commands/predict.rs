use crate::console::{Console, number, plural, sequence_table};
use crate::corrected::Modeled;
use crate::derived::{PREDICTED, derived, deviations_of, save};
use crate::recording::{FieldArgs, SplitPart};
use anyhow::Context;
use serde::Serialize;
use std::borrow::Cow;
use std::path::PathBuf;
use vsf::data::{Dataset, Sequence, Table, TorqueKind};
use vsf::pipeline::{SequencePrediction, check_torques, predict};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
--out becomes a recording of its own, robot and camera included. It has the same joint angles, and in \
torques.npy the predicted external torques, including those of a corrected model (--model). Each sequence also \
gets torques_sd.npy, (T, d): the standard deviation of independent points plus the noise that the field was \
estimated with. It is missing in free air, where a model alone predicts.

For torques that can be read like the recording's own, and by the same model again, use `vsf simulate`: \
external torques leave out the weight that some effects act on, and effects that last from one sequence to the \
next need all sequences.

JSON keys: out, noise_sd, sequences (sequence, samples, contact_samples, largest (largest norm of the torques \
over the joints), unit).")]
pub struct Args {
    /// IDs of the sequences to predict; default: the test split
    #[arg(long, value_delimiter = ',')]
    sequences: Option<Vec<String>>,
    /// Folder to write: new, empty, or with a recording of the same sequences by `vsf simulate` or `vsf predict` to
    /// replace
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    of: FieldArgs,
}

#[derive(Serialize)]
struct Report<'a> {
    out: Cow<'a, str>,
    noise_sd: Vec<f64>,
    sequences: Vec<Entry<'a>>,
}

#[derive(Serialize)]
struct Entry<'a> {
    sequence: &'a str,
    samples: usize,
    contact_samples: usize,
    largest: f64,
    unit: &'static str,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let (recording, field, scene, model) = args.of.open_for(&args.out, console)?;
    let sequences = recording.sequences(args.sequences.as_deref(), SplitPart::Test)?;
    let belief = &field.stored.belief;
    let noise_sd = field.noise_sd(scene.robot().joint_count(), console)?;
    let loaded = model
        .as_ref()
        .map_or_else(Vec::new, |m| m.following_reading());
    if !loaded.is_empty() && sequences.iter().all(|s| s.is_unmeasured()) {
        console.warn(format!(
            "all torques that were read are zero, as of planned motions: {} of the model, which follows the load, has none; \
             `vsf simulate` takes it from the field",
            loaded.join(" and ")
        ));
    }
    let modeled = Modeled::new(model.as_ref(), &recording, &scene, &sequences, console)?;
    let predictions = modeled.predict(|trace| predict(&scene, belief, &noise_sd, trace))?;

    let predicted = sequences
        .iter()
        .zip(&predictions)
        .map(|(s, p)| with_torques(s, p))
        .collect::<Result<Vec<_>, _>>()?;
    let dataset = Dataset {
        torque_kind: TorqueKind::External,
        ..derived(&recording, PREDICTED, &args.of, &scene, predicted)?
    };
    let deviations = predictions.iter().filter(|p| !p.sd.is_empty()).map(|p| {
        let sd = Table::new(scene.robot().joint_count(), p.sd.concat())?;
        check_torques(&scene, &p.id, &sd)
            .context("deviations of the predictions, by K_std of the field")?;
        Ok((deviations_of(&p.id), sd.npy()))
    });
    let deviations = deviations.collect::<anyhow::Result<Vec<_>>>()?;
    save(dataset, &recording.packages(), &args.out, deviations)?;
    let norm = |row: &Vec<f64>| row.iter().map(|t| t * t).sum::<f64>().sqrt();
    let entries = modeled.traces.iter().zip(&predictions).map(|(t, p)| Entry {
        sequence: &t.id,
        samples: t.observations.len(),
        contact_samples: t.contact_samples(),
        largest: p.mean.iter().map(norm).fold(0.0, f64::max),
        unit: scene.error_unit(),
    });
    let report = Report {
        out: args.out.to_string_lossy(),
        noise_sd,
        sequences: entries.collect(),
    };
    let (count, out) = (predictions.len(), args.out.display());
    let files = if scene.rest().is_empty() {
        "torques.npy"
    } else {
        "torques.npy and torques_sd.npy"
    };
    let s = plural(count);
    let row = |e: &Entry<'_>| {
        let (samples, touching) = (e.samples.to_string(), e.contact_samples.to_string());
        let largest = format!("{} {}", number(e.largest), e.unit);
        vec![e.sequence.to_owned(), samples, touching, largest]
    };
    let rows: Vec<_> = report.sequences.iter().map(row).collect();
    let header = ["sequence", "samples", "in contact", "largest ||tau_hat||"];
    let text =
        sequence_table(&header, &rows) + &format!("wrote {out}: {files} of {count} sequence{s}\n");
    console.results(&report, text)
}

fn with_torques(sequence: &Sequence, prediction: &SequencePrediction) -> anyhow::Result<Sequence> {
    Ok(Sequence {
        torques: Table::new(sequence.width(), prediction.mean.concat())?,
        ..sequence.clone()
    })
}
