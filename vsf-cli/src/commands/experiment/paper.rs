use super::figures::{Figures, file_stem};
use super::{Failed, Found, each, progress, table1 as first_table};
use crate::console::{Console, create_folder, texts};
use crate::exit::usage;
use crate::recording::Recording;
use crate::samples::{FAR_PLACES, NEAR_PLACES, ONE_PLACE};
use crate::settings::VisionKind;
use serde::Serialize;
use std::path::{Path, PathBuf};
use vsf::pipeline::{
    Campaign, MethodErrors, Overlap, OverlapShares, Table1Row, TrainedOn, UpdateSpeed, UpdateTimes,
    table1, update_speed, update_times, view_warnings,
};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Writes report.md, report.json and the figures to the folder, and prints the tables. Prior and noise are \
chosen from the train sequences of each prediction. Where the test split is a single sequence, every \
sequence is the test sequence in turn. Which of Tables III to V a recording belongs to is told from its \
contacts: FULL overlap where every sequence has at least a quarter of its contacts on points that each \
other one touches too, NO overlap where the median sequence has less than a quarter on points that any \
other touches, else PARTIAL. Run it alone on the machine: Tables I and II and Fig. 4 tell times.

JSON keys: recordings (recording, unit, overlap, shares (least_pair, with_all), train_sequences, test_sequences, \
leave_one_out, vision, table1 (a row as in `vsf experiment table1`), update_speed (contacts, rate_hz), errors \
(method, and the keys of `vsf evaluate`), curve (sequences, errors; PARTIAL overlap)), update_times (stage, times \
(contacts, median_ms, low_ms, high_ms)), written, failed (recording, error).")]
pub struct Args {
    /// Recordings with train and test sequences; a small set built into the program by default
    recordings: Vec<PathBuf>,
    /// Folder for the report and the figures: new, empty, or one of an earlier report
    #[arg(long, default_value = "vsf-paper")]
    out: PathBuf,
    /// How untouched points are guessed by what the camera sees
    #[arg(long, value_enum, default_value_t = VisionKind::Level)]
    vision: VisionKind,
}

/// What is told of one recording.
#[derive(Serialize)]
pub struct Entry {
    /// Its place among those given, from 1.
    #[serde(skip)]
    number: usize,
    pub recording: String,
    pub unit: String,
    pub overlap: Overlap,
    shares: OverlapShares,
    train_sequences: usize,
    test_sequences: usize,
    leave_one_out: bool,
    table1: Table1Row,
    update_speed: UpdateSpeed,
    errors: Vec<MethodErrors>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub curve: Vec<TrainedOn>,
    /// Files with pictures of the field, blind and with vision.
    #[serde(skip)]
    fields: Vec<String>,
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
    check_out(out)?;
    args.recordings
        .iter()
        .try_for_each(|r| console.keep_input(r))?;
    create_folder(out)?;
    let recordings = match args.recordings.is_empty() {
        true => [ONE_PLACE, NEAR_PLACES, FAR_PLACES]
            .iter()
            .map(|sample| sample.unpack_into(&out.join("recordings")))
            .collect::<Result<_, _>>()?,
        false => args.recordings.clone(),
    };
    let spinner = console.spinner("timing updates");
    let update_times = update_times()?;
    spinner.finish_and_clear();
    let figures = Figures::new(out);
    figures.update_times(&update_times)?;
    let all = recordings.len();
    let of = |number: usize, recording: &Recording, campaign: &Campaign| {
        let what = progress("experiments", number, all);
        let entry = entry(args, &figures, number, recording, campaign, what, console)?;
        figures.curve(number, &entry)?;
        Ok(entry)
    };
    // Whatever ends the run, there is a report of what is done.
    let keep = |found: &Found<Entry>| {
        let tables = tables(&found.all, &update_times);
        let text = format!(
            "# The experiments of the paper\n\n{tables}{}",
            figures_text(&found.all)
        );
        figures.write("report.md", text.as_bytes())?;
        let json =
            serde_json::to_string_pretty(&Report::of(found, args, &update_times, &figures))? + "\n";
        figures.write("report.json", json.as_bytes())
    };
    let found = each(&recordings, console, of, keep)?;
    keep(&found)?;
    console.json(&Report::of(&found, args, &update_times, &figures))?;
    let tables = tables(&found.all, &update_times);
    console.report(format!(
        "{tables}wrote {}\n",
        out.join("report.md").display()
    ))?;
    found.end()
}

fn check_out(out: &Path) -> anyhow::Result<()> {
    let holds_more = out
        .read_dir()
        .is_ok_and(|mut entries| entries.next().is_some());
    if holds_more && !out.join("report.md").is_file() && !out.join("recordings").is_dir() {
        return Err(usage(format!(
            "--out {} holds other files; choose a new or empty folder, or an earlier report to replace",
            out.display()
        )));
    }
    Ok(())
}

fn entry(
    args: &Args,
    figures: &Figures,
    number: usize,
    recording: &Recording,
    campaign: &Campaign,
    what: String,
    console: &Console,
) -> anyhow::Result<Entry> {
    let vision = args.vision.spec();
    if vision.is_some()
        && let Some(view) = recording.view()?
    {
        let warnings = view_warnings(&campaign.scene().rest, &view);
        warnings.iter().for_each(|w| console.warn(w));
    }
    let shares = OverlapShares::of(campaign);
    let overlap = shares.overlap();
    let with_curve = overlap == Overlap::Partial && campaign.curve_lens().len() > 1;
    let steps = if with_curve {
        campaign.curve_lens().len()
    } else {
        1
    };
    let bar = console.bar(steps + 3, what);
    let update_speed = update_speed(campaign)?;
    bar.inc(1);
    let table1 = table1(campaign)?;
    bar.inc(1);
    let fields = figures.fields(number, recording, campaign, vision.as_ref())?;
    bar.inc(1);
    let mut curve = Vec::new();
    let errors = if with_curve {
        curve = campaign.curve(vision.as_ref(), || bar.inc(1))?;
        curve.last().map_or_else(Vec::new, |all| all.errors.clone())
    } else {
        campaign.errors(vision.as_ref())?
    };
    bar.finish_and_clear();
    Ok(Entry {
        number,
        recording: recording.dataset.name.clone(),
        unit: table1.unit.clone(),
        overlap,
        shares,
        train_sequences: campaign.train_len(),
        test_sequences: campaign.test_len(),
        leave_one_out: campaign.leave_one_out(),
        table1,
        update_speed,
        errors,
        curve,
        fields,
    })
}

/// Tables I to V and the numbers of Figs. 4 and 7, as Markdown.
fn tables(entries: &[Entry], update_times: &[UpdateTimes]) -> String {
    let mut text = "\
## Recordings

Overlap is told from contacts: the share of a sequence's contacts on points that another one touches, the
least of all pairs, and on points that any other touches, the median.

| recording | overlap | least pair | with all others | train | test |
| --- | --- | --- | --- | --- | --- |
"
    .to_owned();
    for e in entries {
        let test = match e.leave_one_out {
            true => format!("each of {} in turn", e.test_sequences),
            false => e.test_sequences.to_string(),
        };
        text += &format!(
            "| {} | {} | {:.2} | {:.2} | {} | {test} |\n",
            e.recording, e.overlap, e.shares.least_pair, e.shares.with_all, e.train_sequences
        );
    }
    text += "\n## Table I: with and without memory replay\n\n";
    text += &first_table::text(entries.iter().map(|e| &e.table1));
    text += "
## Table II: update speed

Kinematics, contact and diagonal filter with 20 replays on one thread, over the samples in contact.

| recording | contacts | updates a second |
| --- | --- | --- |
";
    for e in entries {
        let (contacts, rate) = (e.update_speed.contacts, e.update_speed.rate_hz);
        text += &format!(
            "| {} | {:.0} ± {:.0} | {:.0} ± {:.0} |\n",
            e.recording, contacts.mean, contacts.sd, rate.mean, rate.sd
        );
    }
    for (title, overlap) in [
        ("Table III: FULL overlap", Overlap::Full),
        ("Table IV: PARTIAL overlap", Overlap::Partial),
        ("Table V: NO overlap", Overlap::No),
    ] {
        let of_table: Vec<_> = entries.iter().filter(|e| e.overlap == overlap).collect();
        text += &errors_table(title, &of_table);
    }
    text += &curves(entries);
    text + &update_time_table(update_times)
}

/// Mean and deviation of the error of every method.
fn errors_table(title: &str, entries: &[&Entry]) -> String {
    let Some(widest) = entries.iter().max_by_key(|e| e.errors.len()) else {
        return String::new();
    };
    let methods: Vec<_> = widest.errors.iter().map(|e| e.method).collect();
    let mut text = format!(
        "\n## {title}\n\nMean ± standard deviation of ||tau_hat - tau|| over the samples of the test sequences.\n\n\
         | recording |"
    );
    methods
        .iter()
        .for_each(|m| text += &format!(" {} |", m.name()));
    text += &format!("\n| --- |{}\n", " --- |".repeat(methods.len()));
    for entry in entries {
        text += &format!("| {} [{}] |", entry.recording, entry.unit);
        for method in &methods {
            text += &match entry.errors.iter().find(|e| e.method == *method) {
                None => " no camera |".to_owned(),
                Some(e) => {
                    let e = &e.evaluation;
                    format!(" {:.2} ± {:.2} |", e.mean_error, e.sd_error)
                }
            };
        }
        text += "\n";
    }
    text
}

/// The numbers of Fig. 7.
fn curves(entries: &[Entry]) -> String {
    let mut text = String::new();
    for entry in entries.iter().filter(|e| !e.curve.is_empty()) {
        let methods: Vec<_> = entry.errors.iter().map(|e| e.method).collect();
        text += &format!(
            "\n## Fig. 7: error against the number of train sequences, {} [{}]\n\n| train sequences |",
            entry.recording, entry.unit
        );
        methods
            .iter()
            .for_each(|m| text += &format!(" {} |", m.name()));
        text += &format!("\n| --- |{}\n", " --- |".repeat(methods.len()));
        for place in &entry.curve {
            text += &format!("| {} |", place.sequences);
            for e in &place.errors {
                text += &format!(" {:.2} |", e.evaluation.mean_error);
            }
            text += "\n";
        }
    }
    text
}

/// The numbers of Fig. 4.
fn update_time_table(stages: &[UpdateTimes]) -> String {
    let mut text = "
## Fig. 4: time of an update against the number of contacts

Medians [ms] over a push of a Kinova Gen3 into a cube of 97,336 points.

| contacts |"
        .to_owned();
    stages
        .iter()
        .for_each(|s| text += &format!(" {} |", s.stage));
    text += &format!("\n| --- |{}\n", " --- |".repeat(stages.len()));
    let rows = stages.first().map_or(0, |s| s.times.len());
    for row in 0..rows {
        let contacts = stages.first().map_or(0.0, |s| s.times[row].contacts);
        text += &format!("| {contacts:.0} |");
        for stage in stages {
            text += &format!(" {:.3} |", stage.times[row].median_ms);
        }
        text += "\n";
    }
    text + "\n"
}

fn figures_text(entries: &[Entry]) -> String {
    let mut text = "![Fig. 4](update_time.svg)\n".to_owned();
    for entry in entries.iter().filter(|e| !e.curve.is_empty()) {
        let stem = file_stem(entry.number, &entry.recording);
        text += &format!("\n![Fig. 7, {}]({stem}_curve.svg)\n", entry.recording);
    }
    text += "\n## Fig. 5: fields, by touch alone and with vision\n";
    for entry in entries {
        text += &format!("\n{}\n\n", entry.recording);
        for picture in &entry.fields {
            text += &format!("![{picture}]({picture})\n");
        }
    }
    text
}
