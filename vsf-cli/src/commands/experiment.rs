mod blind;
mod figures;
mod paper;
mod priors;
mod report;
mod table1;

use crate::console::Console;
use crate::exit::{message, usage};
use crate::range::length;
use crate::recording::{Recording, SplitPart};
use crate::settings::SceneSettings;
use clap::Subcommand;
use serde::Serialize;
use std::path::{Path, PathBuf};
use vsf::pipeline::Experiment;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
A recording that cannot be used is left out and reported at the end; the exit code is that of the first such \
error. The JSON key `failed` lists such recordings (recording, error).")]
pub struct Args {
    #[command(subcommand)]
    which: Which,
}

#[derive(Debug, Subcommand)]
enum Which {
    /// All experiments of the paper's section IV, as a report: Tables I to V and Figs. 4, 5, 7
    Paper(paper::Args),
    /// Table I: memory replay, the exact posterior and the constrained optimum, with the same prior and noise
    Table1(table1::Args),
    /// Compare kinds of priors: independent points, a common level, smooth parts
    Priors(priors::Args),
    /// Blind test of the diagnosis: how often it finds hidden effects in recordings of an independent world
    Blind(blind::Args),
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    match &args.which {
        Which::Paper(args) => paper::run(args, console),
        Which::Table1(args) => table1::run(args, console),
        Which::Priors(args) => priors::run(args, console),
        Which::Blind(args) => blind::run(args, console),
    }
}

/// Contact in an experiment.
#[derive(Debug, clap::Args)]
struct ContactArgs {
    /// Contact threshold delta [m]: a point is touched within this distance of a link's surface; default: 0.8 of
    /// the points' spacing (paper: 0.002)
    #[arg(long, value_parser = length)]
    threshold: Option<f64>,
}

/// What an experiment found on recordings, and the recordings on which it failed.
struct Found<T> {
    all: Vec<T>,
    failures: Vec<anyhow::Error>,
    failed: Vec<Failed>,
}

/// A recording that could not be used.
#[derive(Serialize)]
struct Failed {
    recording: String,
    error: String,
}

impl<T> Found<T> {
    fn fail(&mut self, path: &Path, error: anyhow::Error) {
        let place = path.display().to_string();
        let error = if message(&error).contains(&place) {
            error
        } else {
            error.context(place.clone())
        };
        self.failed.push(Failed {
            recording: place,
            error: message(&error),
        });
        self.failures.push(error);
    }

    /// Fails where nothing was found.
    fn checked(self) -> anyhow::Result<Self> {
        if self.all.is_empty() {
            self.end()?;
            anyhow::bail!("no recording is given");
        }
        Ok(self)
    }

    /// Errors for the recordings that failed; the tables of the others are out by now.
    fn end(self) -> anyhow::Result<()> {
        let mut failures = self.failures.into_iter();
        let first = failures.next();
        failures.for_each(|e| crate::exit::complain_of(&e));
        first.map_or(Ok(()), Err)
    }
}

/// Opens recordings, each with its number, from 1; of one name, they are called by their paths. Fails where
/// none can be opened.
fn open(
    paths: &[PathBuf],
    contact: &ContactArgs,
    console: &Console,
) -> anyhow::Result<Found<(usize, Recording)>> {
    paths.iter().try_for_each(|p| console.outputs.keep(p))?;
    if let Some(k) = (1..paths.len()).find(|&k| paths[..k].contains(&paths[k])) {
        return Err(usage(format!("{} is given twice", paths[k].display())));
    }
    let mut found = Found {
        all: Vec::new(),
        failures: Vec::new(),
        failed: Vec::new(),
    };
    for (k, path) in paths.iter().enumerate() {
        let settings = SceneSettings::with_threshold(contact.threshold);
        match Recording::open(path, &settings, console) {
            Ok(recording) => found.all.push((k + 1, recording)),
            Err(error) => found.fail(path, error),
        }
    }
    let names: Vec<String> = (found.all.iter())
        .map(|(_, r)| r.dataset.name.clone())
        .collect();
    for (_, recording) in &mut found.all {
        let name = &mut recording.dataset.name;
        if names.iter().filter(|n| *n == name).count() > 1 {
            *name = recording.path.display().to_string();
        }
    }
    found.checked()
}

/// Makes an experiment on open recordings one after another. `of` is told the number of each as well;
/// `keep` gets what is there after each. Fails where all recordings do.
fn each<T>(
    opened: Found<(usize, Recording)>,
    console: &Console,
    of: impl Fn(usize, &Recording, &Experiment) -> anyhow::Result<T>,
    keep: impl Fn(&Found<T>) -> anyhow::Result<()>,
) -> anyhow::Result<Found<T>> {
    let run = |number: usize, recording: &Recording| {
        let mut sequences = recording.split(SplitPart::Train, false)?;
        sequences.extend(recording.split(SplitPart::Test, false)?);
        let scene = recording.scene_to_learn(None, None, console)?;
        recording.compare_contact(&scene, console);
        let traces = recording.traces(&scene, &sequences, console)?;
        let experiment = Experiment::new(&recording.dataset, &scene, &traces)?;
        of(number, recording, &experiment)
    };
    let mut found = Found {
        all: Vec::new(),
        failures: opened.failures,
        failed: opened.failed,
    };
    for (number, recording) in opened.all {
        match run(number, &recording) {
            Ok(result) => {
                found.all.push(result);
                keep(&found)?;
            }
            Err(error) => found.fail(&recording.path, error),
        }
    }
    found.checked()
}

/// What a bar shows while recording `number` of `all` is worked on.
fn progress(what: &str, number: usize, all: usize) -> String {
    match all {
        1 => what.to_owned(),
        _ => format!("{what}, recording {number} of {all}"),
    }
}
