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

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => exit::report(&error),
    }
}

fn run() -> anyhow::Result<()> {
    let (cli, origins) = config::parse()?;
    interrupt::install()?;
    let console = Console::new(cli.quiet, cli.json)?;
    commands::run(&cli.command, &console).map_err(|e| origins.locate(e))
}
