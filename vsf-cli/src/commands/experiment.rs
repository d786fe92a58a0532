use crate::console::Console;
use crate::recording::Recording;
use crate::settings::SceneSettings;
use clap::Subcommand;
use serde::Serialize;
use std::path::PathBuf;
use vsf::pipeline::{PriorShape, Table1Row, table1};

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
}

#[derive(Serialize)]
struct Report {
    rows: Vec<Table1Row>,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let Which::Table1 { recordings } = &args.which;
    let bar = console.bar(recordings.len(), "recordings");
    let mut rows = Vec::new();
    for (done, path) in recordings.iter().enumerate() {
        let recording = Recording::open(path, &SceneSettings::default(), console)?;
        let scene = recording.scene(console)?;
        rows.push(table1(&recording.dataset, &scene, PriorShape::default())?);
        bar.set_position(done as u64 + 1);
    }
    bar.finish_and_clear();
    let report = Report { rows };
    console.json(&report)?;
    console.report(text(&report.rows))
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
