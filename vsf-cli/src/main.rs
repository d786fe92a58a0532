//! The `vsf` command: stiffness fields from touch recordings.

#![forbid(unsafe_code)]

mod cli;
mod commands;
mod console;
mod exit;
mod field_file;
mod interrupt;
mod pictures;
mod recording;
mod settings;

use clap::Parser;
use cli::Cli;
use console::Console;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let outcome = interrupt::install()
        .and_then(|()| commands::run(&cli.command, &Console::new(cli.quiet, cli.json)));
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => exit::report(&error),
    }
}
