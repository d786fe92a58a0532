use super::figures::Figures;
use super::report::{figures_text, tables};
use super::{ContactArgs, Failed, Found, each, open, progress};
use crate::console::{Console, MADE_BY, create_folder, texts};
use crate::exit::usage;
use crate::outputs::unmarked;
use crate::recording::Recording;
use crate::samples::{FAR_PLACES, NEAR_PLACES, ONE_PLACE, Sample};
use crate::settings::VisionKind;
use serde::Serialize;
use std::path::{Path, PathBuf};
use vsf::pipeline::{
    Experiment, MethodErrors, Overlap, OverlapShares, Table1Row, TrainedOn, UpdateSpeed,
    UpdateTimes, table1, update_speed, update_times, view_warnings,
};

/// Where the recordings of the built-in set are written to.
const RECORDINGS: &str = "recordings";

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Writes report.md, report.json and the figures to the folder, and prints the tables. Prior and noise are chosen \
from the train sequences of each prediction. If the test split is a single sequence, every sequence is the \
test sequence in turn.

The contacts of a recording decide which of Tables III to V it belongs to:
  FULL overlap     every sequence has at least a quarter of its contacts
                   on points that each other sequence touches too
  NO overlap       the median sequence has less than a quarter of its
                   contacts on points that any other sequence touches
  PARTIAL overlap  all others

Run it alone on the machine: Tables I and II and Fig. 4 report times. The built-in set takes about 4 minutes \
of CPU time.

JSON keys:
  recordings (recording, unit, overlap, shares (least_pair, with_all),
      train_sequences, test_sequences, leave_one_out, threshold (m),
      table1 (a row as in `vsf experiment table1`),
      update_speed (contacts, rate_hz),
      errors (method, and the keys of `vsf evaluate`),
      curve (sequences, errors; PARTIAL overlap))
  vision
  update_times (stage, times (contacts, median_ms, low_ms, high_ms))
  written, failed (recording, error)")]
pub struct Args {
    /// Recordings with train and test sequences; default: a small built-in set
    recordings: Vec<PathBuf>,
    /// Folder for the report and the figures: new, empty, or with an earlier report to replace
    #[arg(long, default_value = "vsf-paper")]
    out: PathBuf,
    /// How to guess the stiffness of untouched points from what the camera sees
    #[arg(long, value_enum, default_value_t = VisionKind::Gp)]
    vision: VisionKind,
    #[command(flatten)]
    contact: ContactArgs,
}

/// What is told of one recording.
#[derive(Serialize)]
pub struct Entry {
    /// Its place among those given, from 1.
    #[serde(skip)]
    pub number: usize,
    pub recording: String,
    pub unit: String,
    pub overlap: Overlap,
    pub shares: OverlapShares,
    pub train_sequences: usize,
    pub test_sequences: usize,
    pub leave_one_out: bool,
    /// Contact threshold (m).
    pub threshold: f64,
    pub table1: Table1Row,
    pub update_speed: UpdateSpeed,
    pub errors: Vec<MethodErrors>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub curve: Vec<TrainedOn>,
    /// Files with pictures of the field, blind and with vision.
    #[serde(skip)]
    pub fields: Vec<String>,
}

#[derive(Serialize)]
struct Report<'a> {
    recordings: &'a [Entry],
    vision: String,
    update_times: &'a [UpdateTimes],
    written: Vec<String>,
    failed: &'a [Failed],
}

impl<'a> Report<'a> {
    fn of(
        found: &'a Found<Entry>,
        args: &Args,
        update_times: &'a [UpdateTimes],
        figures: &Figures,
    ) -> Self {
        Self {
            recordings: &found.all,
            vision: args.vision.name(),
            update_times,
            written: texts(&figures.written()),
            failed: &found.failed,
        }
    }
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let out = &args.out;
    console
        .outputs
        .folder("--out", out, "an earlier report", |names| {
            let foreign = |name: &&String| {
                let kind = Figures::kind(name);
                kind.is_some_and(|kind| kind.check("--out", &out.join(name)).is_err())
            };
            let marks = [Figures::REPORT, RECORDINGS, Figures::UPDATE_TIMES];
            unmarked(names, &marks).or_else(|| names.iter().find(foreign))
        })?;
    let recordings = if args.recordings.is_empty() {
        let samples = [ONE_PLACE, NEAR_PLACES, FAR_PLACES];
        let place = |sample: &Sample| Path::new(RECORDINGS).join(sample.name);
        for sample in &samples {
            if let Some(path) = sample.changed_in(&out.join(place(sample))) {
                return Err(usage(format!(
                    "{}: it is not as this command writes it, which would replace it; choose another folder (--out), or move \
                     it away",
                    path.display()
                )));
            }
        }
        let unpack = |sample: &Sample| sample.unpack(out, &place(sample));
        samples.iter().map(unpack).collect::<Result<_, _>>()?
    } else {
        args.recordings.clone()
    };
    let all = recordings.len();
    let opened = open(&recordings, &args.contact, console)?;
    create_folder(out)?;
    let spinner = console.spinner("timing updates");
    let update_times = update_times()?;
    spinner.finish_and_clear();
    let figures = Figures::new(out);
    // First of all: it tells the folder for that of a report, should the run end before there is one.
    figures.update_times(&update_times)?;
    let of = |number: usize, recording: &Recording, experiment: &Experiment| {
        let what = progress("experiments", number, all);
        let entry = entry(args, &figures, number, recording, experiment, what, console)?;
        figures.curve(number, &entry)?;
        Ok(entry)
    };
    // Whatever ends the run, there is a report of what is done.
    let keep = |found: &Found<Entry>| {
        let tables = tables(&found.all, &update_times);
        let text = format!(
            "# The experiments of the paper\n\n<!-- {MADE_BY} -->\n\n{tables}{}",
            figures_text(&found.all)
        );
        figures.write(Figures::REPORT, text.as_bytes())?;
        let json = console.to_json(&Report::of(found, args, &update_times, &figures))?;
        figures.write(Figures::RESULTS, json.as_bytes())
    };
    let found = each(opened, console, of, keep)?;
    keep(&found)?;
    let tables = tables(&found.all, &update_times);
    let report = out.join(Figures::REPORT);
    console.results(
        &Report::of(&found, args, &update_times, &figures),
        format!("{tables}wrote {}\n", report.display()),
    )?;
    found.end()
}

fn entry(
    args: &Args,
    figures: &Figures,
    number: usize,
    recording: &Recording,
    experiment: &Experiment,
    what: String,
    console: &Console,
) -> anyhow::Result<Entry> {
    let vision = args.vision.spec();
    if vision.is_some()
        && let Some(view) = recording.view()?
    {
        console.warn_all(view_warnings(experiment.scene().rest(), &view));
    }
    let shares = OverlapShares::of(experiment);
    let overlap = shares.overlap();
    let with_curve = overlap == Overlap::Partial && experiment.curve_lens().len() > 1;
    let steps = if with_curve {
        experiment.curve_lens().len()
    } else {
        1
    };
    let bar = console.bar(steps + 3, what);
    let update_speed = update_speed(experiment)?;
    bar.inc(1);
    let table1 = table1(experiment)?;
    bar.inc(1);
    let fields = figures.fields(number, recording, experiment, vision.as_ref())?;
    bar.inc(1);
    let mut curve = Vec::new();
    let errors = if with_curve {
        curve = experiment.curve(vision.as_ref(), || bar.inc(1))?;
        curve.last().map_or_else(Vec::new, |all| all.errors.clone())
    } else {
        experiment.errors(vision.as_ref())?
    };
    bar.finish_and_clear();
    Ok(Entry {
        number,
        recording: recording.dataset.name.clone(),
        unit: table1.unit.clone(),
        overlap,
        shares,
        train_sequences: experiment.train_len(),
        test_sequences: experiment.test_len(),
        leave_one_out: experiment.leave_one_out(),
        threshold: experiment.scene().contact().threshold,
        table1,
        update_speed,
        errors,
        curve,
        fields,
    })
}
