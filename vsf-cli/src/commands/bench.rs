use crate::console::{Console, number, table};
use crate::exit::usage;
use crate::range::{minutes, replays, whole};
use vsf::filter::{DiagonalForm, DualConfig, ReplayConfig};
use vsf::pipeline::{
    BenchOptions, BenchReport, FilterSpec, LOADED_STEPS, SoakOptions, SoakReport, SoakTenth, bench,
    soak,
};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
JSON keys:
  points, contacts, steps_per_second, median_ms, p99_ms
  kinematics, contact, columns, update (per stage: median_ms, p99_ms)
  bandwidth_gb_per_s (at which one thread reads memory)
  loaded (the last 20 steps of the push: contacts, steps_per_second,
      median_ms, contact_ms, update_ms, update_bytes, update_over_read)

JSON keys with --soak:
  points, rate_hz, steps
  late (steps that had not ended when the next sample was due)
  resident_start_mb, resident_end_mb (memory of the process)
  tenths (of the run: steps, contacts, median_ms, p99_ms, max_ms,
      resident_mb)")]
pub struct Args {
    /// Number of rest points, rounded to a cube number, up to 50 million
    #[arg(long, default_value_t = BenchOptions::default().points as u64,
          value_parser = whole(1_u64..=50_000_000))]
    points: u64,
    /// Number of steps of the push, 2 to 100000
    #[arg(long, default_value_t = BenchOptions::default().steps as u64,
          value_parser = whole(2_u64..=100_000))]
    steps: u64,
    /// Estimator to time
    #[arg(long, value_enum, default_value = "replay")]
    estimator: Online,
    /// Number of past observations replayed after every update
    #[arg(long, default_value_t = FilterSpec::replay().replays(), value_parser = replays)]
    replay: usize,
    /// Run at 1 kHz for this time instead [min], pushing to and fro, to check that steps stay fast and memory flat
    #[arg(long, value_name = "MINUTES", value_parser = minutes, conflicts_with = "steps")]
    soak: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Online {
    /// Diagonal Kalman filter with memory replay (Alg. 1)
    Replay,
    /// Replays that converge to the constrained optimum of independent points
    Dual,
}

impl Args {
    fn spec(&self) -> FilterSpec {
        let replays = self.replay;
        match self.estimator {
            Online::Replay => FilterSpec::Replay {
                form: DiagonalForm::default(),
                config: ReplayConfig {
                    replays,
                    ..ReplayConfig::default()
                },
            },
            Online::Dual => FilterSpec::Dual(DualConfig {
                replays,
                ..DualConfig::default()
            }),
        }
    }
}

/// Needs no data: a Kinova Gen3 pushes into a cube of points.
pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let spinner = console.spinner("pushing");
    if let Some(minutes) = args.soak {
        let report = soak(&SoakOptions {
            points: args.points as usize,
            estimator: args.spec(),
            seconds: 60.0 * minutes,
        })?;
        spinner.finish_and_clear();
        return console.results(&report, soak_text(&report, args.replay));
    }
    let report = bench(&BenchOptions {
        points: args.points as usize,
        steps: args.steps as usize,
        estimator: args.spec(),
    })?;
    spinner.finish_and_clear();
    if report.contacts == 0 {
        let points = report.points;
        return Err(usage(format!(
            "--points {points}: the push ends without contact, there is nothing to time; take more"
        )));
    }
    console.results(&report, text(&report, args.replay))
}

fn text(report: &BenchReport, replays: usize) -> String {
    let line =
        |name: &str, median: f64, p99: f64| vec![name.to_owned(), number(median), number(p99)];
    let stages = [
        ("kinematics", report.kinematics),
        ("contact", report.contact),
        ("columns", report.columns),
        ("update", report.update),
    ];
    let mut rows: Vec<_> = stages.map(|(n, s)| line(n, s.median_ms, s.p99_ms)).into();
    rows.push(line("whole step", report.median_ms, report.p99_ms));
    let loaded = &report.loaded;
    format!(
        "{} rest points, {} contacts at the end of the push, {replays} replays per update\n{}\
         {:.0} steps per second on one thread; over the last {LOADED_STEPS} steps, with {:.0} contacts, {:.0}\n\
         an update with these replays takes {:.2} times as long as reading its {:.1} MB once at {:.1} GB/s\n",
        report.points,
        report.contacts,
        table(&["stage", "median ms", "p99 ms"], &rows),
        report.steps_per_second,
        loaded.contacts,
        loaded.steps_per_second,
        loaded.update_over_read,
        loaded.update_bytes * 1e-6,
        report.bandwidth_gb_per_s,
    )
}

fn soak_text(report: &SoakReport, replays: usize) -> String {
    let memory = |mb: Option<f64>| mb.map_or("unknown".to_owned(), |mb| format!("{mb:.0}"));
    let row = |(k, t): (usize, &SoakTenth)| {
        vec![
            format!("{}", k + 1),
            t.steps.to_string(),
            t.contacts.to_string(),
            number(t.median_ms),
            number(t.p99_ms),
            number(t.max_ms),
            memory(t.resident_mb),
        ]
    };
    let rows: Vec<_> = report.tenths.iter().enumerate().map(row).collect();
    format!(
        "{} rest points, {replays} replays per update, {:.0} samples a second due: {} steps, {} of them late\n{}\
         resident memory {} MB before the buffers are filled, {} MB after the last step\n",
        report.points,
        report.rate_hz,
        report.steps,
        report.late,
        table(
            &[
                "tenth",
                "steps",
                "contacts",
                "median ms",
                "p99 ms",
                "max ms",
                "resident MB"
            ],
            &rows
        ),
        memory(report.resident_start_mb),
        memory(report.resident_end_mb),
    )
}
