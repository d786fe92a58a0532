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
use std::process::ExitCode;

/// The variable that tells the number of threads, and the most that it may.
const THREADS: &str = "RAYON_NUM_THREADS";
const MOST_THREADS: usize = 1024;

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

/// Refuses thousands of threads: each takes memory and time before it does anything.
fn threads() -> anyhow::Result<()> {
    let given = std::env::var(THREADS).unwrap_or_default();
    match given.parse::<usize>() {
        Ok(n) if n > MOST_THREADS => Err(exit::usage(format!(
            "{THREADS}={n}: at most {MOST_THREADS} threads; give the number of cores, or unset it"
        ))),
        _ => Ok(()),
    }
}
