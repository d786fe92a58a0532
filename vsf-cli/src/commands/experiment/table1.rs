use super::{ContactArgs, Failed, each, open, progress};
use crate::console::Console;
use serde::Serialize;
use std::path::PathBuf;
use vsf::pipeline::{Table1Row, table1};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints a Markdown table with the error of the fit to the train sequences (as in the paper), the error on the \
test sequences, and the rate of contact and estimator together. Run it alone on the machine.

JSON keys: rows (recording, unit, mean_contacts, touched_points, hyper, zero_error, cells (estimator, \
fit_error, fit_sd, test_error, test_sd, rate_hz)), failed (recording, error).")]
pub struct Args {
    /// Recordings with train and test sequences, one row each
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    contact: ContactArgs,
}

#[derive(Serialize)]
struct Report<'a> {
    rows: &'a [Table1Row],
    failed: &'a [Failed],
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let all = args.recordings.len();
    let found = each(
        open(&args.recordings, &args.contact, console)?,
        console,
        |number, _, experiment| {
            let spinner = console.spinner(progress("estimators", number, all));
            let row = table1(experiment)?;
            spinner.finish_and_clear();
            Ok(row)
        },
        |_| Ok(()),
    )?;
    console.results(
        &Report {
            rows: &found.all,
            failed: &found.failed,
        },
        text(&found.all),
    )?;
    found.end()
}

/// One row per recording.
pub fn text<'a>(rows: impl IntoIterator<Item = &'a Table1Row>) -> String {
    let mut rows = rows.into_iter().peekable();
    let names = rows.peek().map_or(&[][..], |row| &row.cells);
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
