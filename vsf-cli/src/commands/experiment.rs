use crate::console::{Console, number};
use crate::recording::Recording;
use crate::settings::SceneSettings;
use clap::Subcommand;
use serde::Serialize;
use std::path::PathBuf;
use vsf::pipeline::{PriorRow, PriorShape, Scene, Table1Row, compare_priors, table1};

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    which: Which,
}

#[derive(Debug, Subcommand)]
enum Which {
    /// Table I: memory replay beside the exact posterior and the constrained optimum, with the same
    /// prior and noise
    #[command(after_help = "\
Prints a Markdown table: the error of the fit to the train sequences (the paper's figure), the error on
the test sequences, and the rate of contact and estimator together. Run it alone on the machine.

JSON keys: rows (recording, unit, mean_contacts, touched_points, hyper, zero_error, cells (estimator,
fit_error, fit_sd, test_error, test_sd, rate_hz)).")]
    Table1 {
        /// Recordings with train and test sequences, one row each
        #[arg(required = true)]
        recordings: Vec<PathBuf>,
    },
    /// What each kind of prior gives: independent points, a common level, smooth parts
    #[command(after_help = "\
Prints a Markdown table per recording: the error on the test sequences, and the shares of single readings \
in contact within 1 and 2 predicted standard deviations. Prior and noise are chosen for every row on the \
train sequences; the estimator is the constrained optimum.

JSON keys: recordings (recording, rows (prior, shape, prior_sd, evaluation, as in `vsf evaluate`)).")]
    Priors {
        /// Recordings with train and test sequences
        #[arg(required = true)]
        recordings: Vec<PathBuf>,
    },
}

/// What is told of one recording.
#[derive(Serialize)]
struct PriorTable {
    recording: String,
    rows: Vec<PriorRow>,
}

#[derive(Serialize)]
struct PriorReport {
    recordings: Vec<PriorTable>,
}

#[derive(Serialize)]
struct Report {
    rows: Vec<Table1Row>,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    match &args.which {
        Which::Table1 { recordings } => {
            let rows = each(recordings, console, |recording, scene| {
                Ok(table1(&recording.dataset, scene, PriorShape::default())?)
            })?;
            let report = Report { rows };
            console.json(&report)?;
            console.report(text(&report.rows))
        }
        Which::Priors { recordings } => {
            let recordings = each(recordings, console, |recording, scene| {
                Ok(PriorTable {
                    recording: recording.dataset.name.clone(),
                    rows: compare_priors(&recording.dataset, scene)?,
                })
            })?;
            let report = PriorReport { recordings };
            console.json(&report)?;
            console.report(report.recordings.iter().map(prior_text).collect::<String>())
        }
    }
}

/// Opens the recordings one after another.
fn each<T>(
    paths: &[PathBuf],
    console: &Console,
    of: impl Fn(&Recording, &Scene) -> anyhow::Result<T>,
) -> anyhow::Result<Vec<T>> {
    let bar = console.bar(paths.len(), "recordings");
    let open = |path: &PathBuf| {
        let recording = Recording::open(path, &SceneSettings::default(), console)?;
        let found = of(&recording, &recording.scene(console)?)?;
        bar.inc(1);
        Ok(found)
    };
    let found = paths.iter().map(open).collect();
    bar.finish_and_clear();
    found
}

fn prior_text(table: &PriorTable) -> String {
    let unit = table.rows.first().map_or("", |row| &row.evaluation.unit);
    let mut text = format!(
        "{}\n\n| prior | test error [{unit}] | within 1 sd | within 2 sd |\n| --- | --- | --- | --- |\n",
        table.recording
    );
    for row in &table.rows {
        let e = &row.evaluation;
        text += &format!(
            "| {} | {} ± {} |",
            row.prior,
            number(e.mean_error),
            number(e.sd_error)
        );
        for share in e
            .calibration
            .iter()
            .flat_map(|c| [c.within_1_sigma, c.within_2_sigma])
        {
            text += &format!(" {:.0} % |", 100.0 * share);
        }
        text += "\n";
    }
    text + "\n"
}

fn text(rows: &[Table1Row]) -> String {
    let names = rows.first().map_or(&[][..], |row| &row.cells);
    let mut text = "| recording | zero |".to_owned();
    names
        .iter()
        .for_each(|c| text += &format!(" {} |", c.estimator));
    text += &format!("\n| --- | --- |{}\n", " --- |".repeat(names.len()));
    for row in rows {
        text += &format!("| {} | {:.2} {} |", row.recording, row.zero_error, row.unit);
        for cell in &row.cells {
            text += &format!(
                " {:.2} ± {:.2} fit, {:.2} ± {:.2} test",
                cell.fit_error, cell.fit_sd, cell.test_error, cell.test_sd
            );
            if let Some(rate) = cell.rate_hz {
                text += &format!(", {rate:.0} Hz");
            }
            text += " |";
        }
        text += "\n";
    }
    text
}
