pub mod bench;
pub mod diagnose;
pub mod estimate;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod import;
pub mod info;
pub mod learn;
pub mod live;
pub mod points;
pub mod predict;
mod quickstart;
pub mod regions;
pub mod simulate;
pub mod view;

use crate::cli::Command;
use crate::console::Console;

/// Runs a command, or the quick start.
pub fn run(command: &Option<Command>, console: &Console) -> anyhow::Result<()> {
    match command {
        None => quickstart::run(console),
        Some(Command::Info(args)) => info::run(args, console),
        Some(Command::Points(args)) => points::run(args, console),
        Some(Command::Estimate(args)) => estimate::run(args, console),
        Some(Command::Learn(args)) => learn::run(args, console),
        Some(Command::Live(args)) => live::run(args, console),
        Some(Command::Predict(args)) => predict::run(args, console),
        Some(Command::Evaluate(args)) => evaluate::run(args, console),
        Some(Command::Diagnose(args)) => diagnose::run(args, console),
        Some(Command::Simulate(args)) => simulate::run(args, console),
        Some(Command::Regions(args)) => regions::run(args, console),
        Some(Command::Export(args)) => export::run(args, console),
        Some(Command::Import(args)) => import::run(args, console),
        Some(Command::View(args)) => view::run(args, console),
        Some(Command::Bench(args)) => bench::run(args, console),
        Some(Command::Experiment(args)) => experiment::run(args, console),
    }
}
