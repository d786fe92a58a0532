//! The `vsf` command: stiffness fields from touch recordings.

#![forbid(unsafe_code)]

mod blind;
mod cli;
mod commands;
mod config;
mod console;
mod contact_flags;
mod corrected;
mod derived;
mod diagnosis;
mod exit;
mod explain;
mod field_file;
mod file_kind;
mod fit;
mod html;
mod interrupt;
mod outputs;
mod pictures;
mod range;
mod recording;
mod samples;
mod settings;
mod view;

use console::Console;
use std::num::NonZero;
use std::process::ExitCode;
use std::thread::available_parallelism;

/// The variable that tells the number of threads, the most that it may, and the most of a core, of which more only wait for each
/// other.
const THREADS: &str = "RAYON_NUM_THREADS";
const MOST_THREADS: usize = 1024;
const MOST_OF_CORE: usize = 4;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => exit::report(&error),
    }
}

fn run() -> anyhow::Result<()> {
    let (cli, origins) = config::parse()?;
    threads()?;
    interrupt::install()?;
    let console = Console::new(cli.quiet, cli.json)?;
    commands::run(&cli.command, &console).map_err(|e| origins.locate(e))
}

/// Starts as many threads as are asked for, up to [`MOST_OF_CORE`] a core.
fn threads() -> anyhow::Result<()> {
    let Some(given) = std::env::var_os(THREADS).filter(|given| !given.is_empty()) else {
        return Ok(());
    };
    let given = given.to_string_lossy();
    let asked = (given.parse().ok()).filter(|n| (0..=MOST_THREADS).contains(n));
    let asked: usize = asked.ok_or_else(|| {
        exit::usage(format!(
            "{THREADS}={given}: must be 1 to {MOST_THREADS}; give the number of cores, or unset it"
        ))
    })?;
    let cores = available_parallelism().map_or(1, NonZero::get);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(asked.min(MOST_OF_CORE * cores));
    Ok(pool.build_global()?)
}
