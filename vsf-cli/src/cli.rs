use crate::commands::{
    bench, diagnose, estimate, evaluate, experiment, export, import, info, learn, live, points,
    predict, regions, simulate, view,
};
use clap::{Command as Line, CommandFactory, Parser, Subcommand};
use std::path::PathBuf;

/// Lines of a table are broken here, short enough for narrow terminals: where `clap` breaks one, its columns are lost.
const AFTER_HELP: &str = "\
Exit codes:
  0    done
  1    a recording, field, robot or other input is missing or cannot
       be used; the message names file, sequence and row
  2    wrong usage: a flag, an entry of a configuration file, or a
       parameter out of range
  3    the system refuses to read or write a file
  130  interrupted (Ctrl-C, SIGTERM); files already written are whole,
       a second signal stops at once (the first one ends the stream of
       `vsf live`, which then writes its field: 0)

RAYON_NUM_THREADS is the number of threads (1 to 1024, no more than four
a core are started), by default that of the cores; results do not depend
on it";

/// Stiffness fields of soft objects from a robot arm's joint angles and torques.
///
/// Without a command: the quick start. It estimates a field from an embedded recording, predicts
/// touches that it has not seen, and writes the results to ./vsf-quickstart/.
#[derive(Debug, Parser)]
#[command(version, after_help = AFTER_HELP, args_conflicts_with_subcommands = false)]
#[command(max_term_width = 100)]
pub struct Cli {
    /// What to do; the quick start if nothing is given
    #[command(subcommand)]
    pub command: Option<Command>,
    /// No report and no progress bars; errors, warnings and --json remain
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Machine-readable results to FILE, or (also by -) to standard output in place of the report. Give it
    /// last, or as --json=FILE. Every result has the keys `made_by`, vsf and its version, and `warnings`, a list of
    /// texts
    #[arg(long, global = true, value_name = "FILE", num_args = 0..=1)]
    pub json: Option<Option<PathBuf>>,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make a recording of the joint states in MCAP files, as ROS 2 bags are, or in CSV files
    Import(import::Args),
    /// Describe a recording: metadata, robot, sequences, points, contact; or a field: what it learned from, and how
    Info(info::Args),
    /// Make the rest points of an object from what a depth camera saw of it
    Points(points::Args),
    /// Estimate a stiffness field from the train sequences of a recording
    Estimate(estimate::Args),
    /// Estimate a stiffness field while samples come in, as lines of JSON on standard input or datagrams
    Live(live::Args),
    /// Learn how stiff things are that look so, from the fields of several objects
    Learn(learn::Args),
    /// Predict the torques of sequences from a field, with their standard deviations
    Predict(predict::Args),
    /// Measure the prediction error of a field, or of a baseline, on the test sequences
    Evaluate(evaluate::Args),
    /// Find the regions of a field that are stiffer than the rest, as inclusions in tissue are
    Regions(regions::Args),
    /// Diagnose the sim-to-real gap: where it lies, which effect causes it, how far it closes
    Diagnose(diagnose::Args),
    /// Replace the torques of a recording by those of a field: a synthetic recording
    Simulate(simulate::Args),
    /// Write a field as point cloud or picture, torques as plots, or all as MCAP for Foxglove and rviz
    Export(export::Args),
    /// Write a page to look at a field and its touches from all sides, in any browser
    View(view::Args),
    /// Time the online step on this machine: kinematics, contact, columns, update
    Bench(bench::Args),
    /// Run the paper's experiments on recordings, or a blind test of the diagnosis
    Experiment(experiment::Args),
}

impl Cli {
    /// The command line: a negative number is the value of the flag before it, which says what it may be, and no flag.
    pub fn line() -> Line {
        fn with_numbers(command: Line) -> Line {
            command
                .mut_args(|arg| {
                    if arg.get_action().takes_values() {
                        arg.allow_negative_numbers(true)
                    } else {
                        arg
                    }
                })
                .mut_subcommands(with_numbers)
        }
        with_numbers(Self::command())
    }
}
