use super::{ContactArgs, Failed, each, open, progress};
use crate::console::{Console, number};
use serde::Serialize;
use std::path::PathBuf;
use vsf::pipeline::{PriorRow, compare_priors};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints a Markdown table per recording with the error on the test sequences, and the shares of single readings \
in contact that lie within 1 and 2 predicted standard deviations. Prior and noise are chosen for every row on \
the train sequences; the estimator is the constrained optimum.

JSON keys: recordings (recording, rows (prior, shape, prior_sd, evaluation (as in `vsf evaluate`))), failed \
(recording, error).")]
pub struct Args {
    /// Recordings with train and test sequences
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    contact: ContactArgs,
}

/// What is told of one recording.
#[derive(Serialize)]
struct PriorTable {
    recording: String,
    rows: Vec<PriorRow>,
}

#[derive(Serialize)]
struct Report<'a> {
    recordings: &'a [PriorTable],
    failed: &'a [Failed],
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let all = args.recordings.len();
    let found = each(
        open(&args.recordings, &args.contact, console)?,
        console,
        |number, recording, experiment| {
            let spinner = console.spinner(progress("priors", number, all));
            let rows = compare_priors(experiment)?;
            spinner.finish_and_clear();
            Ok(PriorTable {
                recording: recording.dataset.name.clone(),
                rows,
            })
        },
        |_| Ok(()),
    )?;
    console.results(
        &Report {
            recordings: &found.all,
            failed: &found.failed,
        },
        found.all.iter().map(text).collect::<String>(),
    )?;
    found.end()
}

fn text(table: &PriorTable) -> String {
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
