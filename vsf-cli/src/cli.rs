use crate::commands::{
    bench, diagnose, estimate, evaluate, experiment, export, import, info, learn, live, points,
    predict, regions, simulate, view,
};
use clap::{Command as Line, CommandFactory, Parser, Subcommand};
use std::path::PathBuf;

/// Lines of a table are broken here, short enough for narrow terminals: where `clap` breaks one, its columns are lost.
const AFTER_HELP: &str = "\
Exit codes:
  0    success
  1    an input (recording, field, robot, ...) is missing or unusable;
       the message names file, sequence and row
  2    wrong usage: a flag, an entry of a configuration file, or a
       parameter out of range
  3    the operating system refuses to read or write a file
  130  interrupted (Ctrl-C, SIGTERM); files already written are
       complete; a second signal stops at once (in `vsf live`, the
       first one ends the stream; the field is written, exit code 0)

RAYON_NUM_THREADS sets the number of threads, 1 to 1024 (at most four a
core are started); default: the number of cores. Results do not depend
on it";

/// Estimate stiffness fields of soft objects from a robot arm's joint angles and torques.
///
/// Without a command, the quick start runs. It estimates a field from a built-in recording, predicts
/// unseen touches, and writes the results to ./vsf-quickstart/.
#[derive(Debug, Parser)]
#[command(version, after_help = AFTER_HELP, args_conflicts_with_subcommands = false)]
#[command(max_term_width = 100)]
pub struct Cli {
    /// Command to run; default: the quick start
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Suppress the report and progress bars, but not errors, warnings and --json
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Write machine-readable results to FILE; without FILE, or with -, to standard output instead of the report.
    /// Give it last, or as --json=FILE. Every result has the keys `made_by` (vsf and its version) and `warnings` (a
    /// list of strings)
    #[arg(long, global = true, value_name = "FILE", num_args = 0..=1)]
    pub json: Option<Option<PathBuf>>,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Convert joint states in MCAP files (such as ROS 2 bags) or CSV files to a recording
    Import(import::Args),
    /// Describe a recording (metadata, robot, sequences, points, contact) or a field (its source and parameters)
    Info(info::Args),
    /// Generate the rest points of an object from a depth camera's view of it
    Points(points::Args),
    /// Estimate a stiffness field from a recording's train sequences
    Estimate(estimate::Args),
    /// Estimate a stiffness field online, from samples as JSON lines on standard input or as UDP datagrams
    Live(live::Args),
    /// Learn to predict stiffness from appearance, from the fields of several objects
    Learn(learn::Args),
    /// Predict the joint torques of sequences from a field, with standard deviations
    Predict(predict::Args),
    /// Measure the prediction error of a field or a baseline on the test sequences
    Evaluate(evaluate::Args),
    /// Find the regions of a field that are stiffer than the rest, such as inclusions in tissue
    Regions(regions::Args),
    /// Diagnose the sim-to-real gap: where it lies, which effect causes it, how much of it closes
    Diagnose(diagnose::Args),
    /// Make a synthetic recording: replace the torques of a recording by those of a field
    Simulate(simulate::Args),
    /// Export a field as a point cloud or picture, torques as plots, or all as MCAP for Foxglove and rviz
    Export(export::Args),
    /// Write an HTML page that shows a field and its touches in 3-D, in any browser
    View(view::Args),
    /// Time the stages of the online step on this machine: kinematics, contact, columns, update
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
