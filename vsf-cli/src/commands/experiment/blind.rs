use crate::blind::{Case, Score, text};
use crate::console::{Console, create_folder};
use crate::derived::keep_made;
use crate::range::{seed, whole};
use serde::Serialize;
use std::path::PathBuf;
use vsf::data::{Dataset, Overrides};
use vsf::gap::{Campaign, diagnose, effects};
use vsf::pipeline::SceneOptions;
use vsf_world::{MAKER, WorldError, draw_cases, generate};

/// What names of cases begin with.
const CASE: &str = "case_";

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The recordings come from a simulated world that shares no code with the diagnosis: it has its own kinematics, \
contact, objects and forms of every effect. Of every 20 cases, 4 have no effect, 10 have one, 3 have two, and \
3 have one that is not in the catalogue. 3 in 10 cases touch a plant, the others a soft body; 1 in 4 is \
subtle, 1 in 8 is only a push. Each case is diagnosed without its label, which is opened afterward; this takes \
about 70 s of CPU time per case.

JSON keys:
  seed
  cases (case, kind, level, protocol, truth, kind_of_answer, named, top,
      probability_of_truth, effect_set_95, right_joint, right_phase,
      test_error_nominal, test_error_corrected, closed_fraction,
      oracle_closed, error)
  scores
      group
      top1, top2, in_set, both_of_two, one_of_two, none_besides,
          quiet_without_effect, unknown_flagged, right_joint,
          right_phase, never_worse (each with hits, of, share, interval)
      mean_probability, ece, set_size, closed_of_oracle (null without a
          case)")]
pub struct Args {
    /// Number of cases, 1 to 10000
    #[arg(long, default_value_t = 20,
          value_parser = whole(1_usize..=10_000))]
    cases: usize,
    /// Seed of the cases
    #[arg(long, default_value_t = 0, value_parser = seed)]
    seed: u64,
    /// Folder in which to keep the recordings: new, empty, or with earlier cases; default: they are deleted
    #[arg(long, value_name = "FOLDER")]
    keep: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report<'a> {
    seed: u64,
    cases: &'a [Case],
    scores: Vec<Score>,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let scratch = tempfile::tempdir()?;
    let folder = args.keep.as_deref().unwrap_or(scratch.path());
    (console.outputs).folder("--keep", folder, "earlier cases", |names| {
        let is_case =
            |name: &&String| name.starts_with(CASE) && Dataset::maker(folder.join(name)).is_some();
        names.iter().find(|name| !is_case(name))
    })?;
    let id = |i: usize| format!("{CASE}{i:03}");
    (0..args.cases).try_for_each(|i| keep_made("--keep", &folder.join(id(i)), &[MAKER]))?;
    create_folder(folder)?;
    let specs = draw_cases(args.cases, args.seed);
    let bar = console.bar(specs.len(), "blind cases");
    let catalogue = effects::catalogue();
    let mut cases = Vec::with_capacity(specs.len());
    for (i, spec) in specs.iter().enumerate() {
        let id = id(i);
        let path = folder.join(&id);
        let label = match generate(spec, &path) {
            Ok(label) => label,
            Err(e @ WorldError::Data(_)) => return Err(e.into()),
            Err(e) => {
                // Some draws have no strength that fits; they are no cases.
                console.warn(format!("{id}: {e}"));
                bar.inc(1);
                continue;
            }
        };
        let outcome = (|| {
            let (dataset, _) = Dataset::open(&path, &Overrides::default())?;
            let campaign = Campaign::open(&dataset, &SceneOptions::default())?.with_suited_fields();
            let outcome = diagnose(&campaign, &catalogue, args.seed, |_| {})?;
            Ok::<_, anyhow::Error>((campaign, outcome))
        })();
        cases.push(match outcome {
            Ok((campaign, outcome)) => Case::new(id, &label, &campaign, &outcome),
            Err(e) => Case::failed(id, &label, &format!("{e:#}")),
        });
        bar.inc(1);
    }
    bar.finish_and_clear();
    let scores = Score::all(&cases);
    let report = text(&cases, &scores);
    console.results(
        &Report {
            seed: args.seed,
            cases: &cases,
            scores,
        },
        report,
    )?;
    if cases.iter().any(Case::is_diagnosed) {
        Ok(())
    } else {
        anyhow::bail!("no case could be diagnosed")
    }
}
