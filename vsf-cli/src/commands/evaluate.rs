use crate::console::{Console, number, sequence_table, table};
use crate::corrected::Modeled;
use crate::exit::usage;
use crate::field_file::FieldFile;
use crate::range::{count, seed, whole};
use crate::recording::{FieldArgs, Recording, SplitPart};
use serde::Serialize;
use std::collections::BTreeMap;
use vsf::data::{Sequence, listed};
use vsf::pipeline::{
    Baseline, Evaluation, MlpConfig, PipelineError, Scene, SequenceError, SequencePrediction,
    Trace, predict, score,
};
use vsf::vision::GpConfig;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The error is the paper's metric, the norm ||tau_hat - tau|| over the joints at every sample.

A recording without points (an arm in free air) has no field: give --model or --baseline.

JSON keys:
  predictor (field, model, zero, knn, mlp or gp)
  mean_error, sd_error, samples, unit (N m or N)
  zero_error (mean norm of the readings)
  per_sequence (sequence, mean_error, sd_error, samples, zero_error,
      contact_samples, mean_contacts, new_places: share of contact at
      points that the field has not learned from, if it stores which
      these are)
  per_joint (joint, unit, mean_abs_error, rms_error, zero_error: mean
      absolute reading)
  calibration (within_1_sigma, within_2_sigma: shares of single readings
      in contact; only for predictors with standard deviations)
  baselines (with a field and --baseline or --model: an object with the
      same keys, by name; model is the corrected model with a field of
      zeros)")]
pub struct Args {
    /// IDs of the sequences to predict; default: the test split
    #[arg(long, value_delimiter = ',')]
    sequences: Option<Vec<String>>,
    /// Predictors to compare with the field, or to use instead of it if --field is left out: zero torque, and the
    /// paper's regressions of torques on joint positions and on position and axis of the end effector, fitted to
    /// the train split. None of them includes the effects of --model
    #[arg(long, value_enum, value_delimiter = ',')]
    baseline: Vec<Kind>,
    /// Number of neighbors of the knn baseline
    #[arg(long, default_value_t = 50, value_parser = count)]
    neighbors: usize,
    /// Units of each hidden layer of the mlp baseline, 1 to 4096; default: the best of the paper's sizes on
    /// held-out samples
    #[arg(long, value_delimiter = ',',
          value_parser = whole(1_usize..=4096))]
    hidden: Option<Vec<usize>>,
    /// Seed of the mlp baseline
    #[arg(long, default_value_t = 0, value_parser = seed)]
    seed: u64,
    /// Maximum number of train samples of the gp baseline, evenly spread
    #[arg(long, default_value_t = 1500, value_parser = whole(2..=GpConfig::MOST_SAMPLES))]
    gp_samples: usize,
    #[command(flatten)]
    of: FieldArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// No torque
    Zero,
    /// Nearest train samples, with RBF weights
    Knn,
    /// Multilayer perceptron
    Mlp,
    /// Gaussian process with a Matern 3/2 kernel
    Gp,
}

/// Predictions are told to be too sure where a smaller share of readings lies within two standard deviations.
const SURE: f64 = 0.8;

#[derive(Serialize)]
struct Report {
    predictor: &'static str,
    #[serde(flatten)]
    evaluation: Evaluation,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    baselines: BTreeMap<&'static str, Evaluation>,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let model = args.of.model.open(console)?;
    let recording = args.of.recording.open(console)?;
    let sequences = recording.sequences(args.sequences.as_deref(), SplitPart::Test)?;
    let given = args.of.field.as_deref();
    let in_air = given.is_none() && !recording.has_points();
    let by_model = in_air && model.is_some();
    let (field, scene) = if given.is_some() || args.baseline.is_empty() || by_model {
        let (field, scene) = recording.field_and_scene(given, model.as_ref(), console)?;
        (Some(field), scene)
    } else {
        (None, recording.scene_to_learn_or_air(console)?)
    };
    recording.compare_contact(&scene, console);
    if sequences.iter().all(|s| s.is_unmeasured()) {
        return Err(usage(
            "all torques of these sequences are zero, as of motions that are planned and not made: there is nothing to compare \
             predictions to; `vsf predict` writes them",
        ));
    }
    let modeled = Modeled::new(model.as_ref(), &recording, &scene, &sequences, console)?;
    let traces = &modeled.traces;
    let mut found = Vec::new();
    if let Some(field) = &field {
        let (name, ids) = (
            &recording.dataset.name,
            sequences.iter().map(|s| s.id.as_str()),
        );
        let others = field.compare_sequences(name, ids.collect(), console);
        if let Some(model) = &model {
            model.compare_sequences(name, &others, console);
        }
        let predictions = modeled.predict(predictor(field, &scene, console)?)?;
        let name = if in_air { "model" } else { "field" };
        let mut errors = score(&scene, traces, &predictions)?;
        let touched = &field.stored.touched;
        if !touched.is_empty() {
            errors = errors.with_new_places(touched, traces);
        }
        let of_zero = |s: &SequenceError| s.mean_error / s.zero_error;
        let touching = || errors.per_sequence.iter().filter(|s| s.contact_samples > 0);
        let fails = || touching().filter(|s| s.mean_error >= s.zero_error);
        let worst = fails().max_by(|a, b| of_zero(a).total_cmp(&of_zero(b)));
        if touching().count() > 0 && errors.mean_error >= errors.zero_error {
            console.warn(format!(
                "the field's error, {} {unit}, is not below that of zero torque, {} {unit}: these touches are of places \
                 that it has not learned from (at new places, below), units, signs or parameters of contact are wrong, or the readings \
                 hold what no stiffness explains, such as friction of the joints (`vsf diagnose` looks for it)",
                number(errors.mean_error),
                number(errors.zero_error),
                unit = errors.unit,
            ));
        } else if let Some(worst) = worst {
            console.warn(format!(
                "the field's error is not below that of zero torque in {} of {} sequences, most of all in {} ({} {unit}, {} with zero \
                 torque): these touches are light, or of places that it has not learned from, or something is wrong with their \
                 readings or with the parameters of contact",
                fails().count(),
                touching().count(),
                worst.sequence,
                number(worst.mean_error),
                number(worst.zero_error),
                unit = errors.unit,
            ));
        }
        if in_air && errors.mean_error > errors.zero_error {
            console.warn(format!(
                "the model's error, {} {unit}, is above that of the nominal model, {} {unit}: it is of another robot, recording \
                 or load, or units or signs are wrong",
                number(errors.mean_error),
                number(errors.zero_error),
                unit = errors.unit,
            ));
        }
        if let Some(c) = (errors.calibration).filter(|c| c.within_2_sigma < SURE) {
            console.warn(format!(
                "{:.0} % of the readings in contact lie within two predicted standard deviations, where 95 % would by chance \
                 alone: predictions are surer than they are right, as beside touched places, or by an estimator that \
                 keeps no correlations",
                100.0 * c.within_2_sigma
            ));
        }
        found.push((name, errors));
        if model.is_some() && !in_air {
            let joints = scene.robot().joint_count();
            let zeros = |trace: &Trace| {
                Ok(SequencePrediction {
                    id: trace.id.clone(),
                    mean: vec![vec![0.0; joints]; trace.observations.len()],
                    sd: Vec::new(),
                })
            };
            found.push(("model", score(&scene, traces, &modeled.predict(zeros)?)?));
        }
    }
    let train = &recording.dataset.splits.train;
    let learns = args.baseline.iter().any(|kind| *kind != Kind::Zero);
    let trained = sequences
        .iter()
        .map(|s| &s.id)
        .filter(|id| learns && train.contains(id));
    let trained: Vec<&str> = trained.map(String::as_str).collect();
    if !trained.is_empty() {
        console.warn(format!(
            "baselines learn from the train split, and {} is of it: their errors there are those of a fit",
            listed(&trained)
        ));
    }
    for &kind in &args.baseline {
        let (name, baseline) = match kind {
            Kind::Zero => ("zero", Baseline::Zero),
            Kind::Knn => ("knn", Baseline::Knn { k: args.neighbors }),
            Kind::Mlp => {
                let (hidden, seed) = (args.hidden.clone(), args.seed);
                ("mlp", Baseline::Mlp(MlpConfig { hidden, seed }))
            }
            Kind::Gp => {
                let max_samples = args.gp_samples;
                ("gp", Baseline::Gp { max_samples })
            }
        };
        if found.iter().all(|(n, _)| *n != name) {
            let spinner = console.spinner("learning a baseline");
            let measured = measure(&baseline, &recording, &scene, &sequences, traces)?;
            spinner.finish_and_clear();
            found.push((name, measured));
        }
    }
    let text = text(&found);
    let mut found = found.into_iter();
    let Some((predictor, evaluation)) = found.next() else {
        return Err(usage("nothing to evaluate: give --field or --baseline"));
    };
    let baselines = found.collect();
    console.results(
        &Report {
            predictor,
            evaluation,
            baselines,
        },
        text,
    )
}

/// What a field predicts of a trace, with deviations where the field has them.
fn predictor<'a>(
    field: &'a FieldFile,
    scene: &'a Scene,
    console: &Console,
) -> anyhow::Result<impl Fn(&Trace) -> Result<SequencePrediction, PipelineError> + 'a> {
    let belief = &field.stored.belief;
    let channels = scene.robot().joint_count();
    let noise_sd = if field.stored.has_deviations() {
        Some(field.noise_sd(channels, console)?)
    } else {
        None
    };
    Ok(move |trace: &Trace| match &noise_sd {
        Some(noise_sd) => predict(scene, belief, noise_sd, trace),
        None => {
            let prediction = predict(scene, belief, &vec![0.0; channels], trace)?;
            Ok(SequencePrediction {
                sd: Vec::new(),
                ..prediction
            })
        }
    })
}

/// The errors of a baseline that is fitted on the train split.
pub fn measure(
    baseline: &Baseline,
    recording: &Recording,
    scene: &Scene,
    sequences: &[&Sequence],
    traces: &[Trace],
) -> anyhow::Result<Evaluation> {
    let train = match baseline {
        Baseline::Zero => Vec::new(),
        _ => recording.sequences(None, SplitPart::Train)?,
    };
    let predictions = baseline.predict(scene, &train, sequences)?;
    Ok(score(scene, traces, &predictions)?)
}

fn text(found: &[(&'static str, Evaluation)]) -> String {
    let Some((first, evaluation)) = found.first() else {
        return String::new();
    };
    let unit = &evaluation.unit;
    let mut text = format!(
        "mean and sd of ||tau_hat - tau|| over {} samples [{unit}]\n",
        evaluation.samples
    );
    let rows: Vec<_> = found
        .iter()
        .map(|(name, e)| vec![(*name).to_owned(), number(e.mean_error), number(e.sd_error)])
        .collect();
    text += &table(&["predictor", "mean", "sd"], &rows);
    text += &format!("\nby sequence, {first} [{unit}]\n");
    let tells_new = (evaluation.per_sequence.iter()).any(|s| s.new_places.is_some());
    let rows: Vec<_> = evaluation
        .per_sequence
        .iter()
        .map(|s| {
            let new = |share: f64| format!("{:.0} %", 100.0 * share);
            let mut row = vec![
                s.sequence.clone(),
                number(s.mean_error),
                number(s.sd_error),
                number(s.zero_error),
                s.samples.to_string(),
                s.contact_samples.to_string(),
            ];
            if tells_new {
                row.push(s.new_places.map_or_else(|| "-".to_owned(), new));
            }
            row
        })
        .collect();
    let mut header = vec![
        "sequence",
        "mean",
        "sd",
        "zero torque",
        "samples",
        "in contact",
    ];
    if tells_new {
        header.push("at new places");
    }
    text += &sequence_table(&header, &rows);
    text += &format!("\nby joint, {first}\n");
    let rows: Vec<_> = evaluation
        .per_joint
        .iter()
        .map(|j| {
            vec![
                j.joint.clone(),
                number(j.mean_abs_error),
                number(j.rms_error),
                number(j.zero_error),
                j.unit.to_owned(),
            ]
        })
        .collect();
    text += &table(
        &["joint", "mean abs", "rms", "zero torque, mean abs", "unit"],
        &rows,
    );
    if let Some(c) = &evaluation.calibration {
        text += &format!(
            "\nreadings in contact within 1 and 2 predicted standard deviations: {:.0} %, {:.0} % (of normal errors: 68 %, 95 %)\n",
            100.0 * c.within_1_sigma,
            100.0 * c.within_2_sigma
        );
    }
    text
}
