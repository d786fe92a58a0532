//! Where parameters come from: flags, over a configuration file, over a preset.
//!
//! Values of a file or preset are handed to the command as further flags, so that whatever a flag
//! checks holds for them too.

use crate::cli::Cli;
use crate::console::{Console, read_text};
use crate::exit::usage;
use crate::settings::name_of;
use anyhow::Context;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches, ValueEnum};
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::de::{DeTable, DeValue};

/// The structs of flags that several commands take; they stand at the top of a file.
const SHARED: [&str; 3] = ["MetadataSettings", "ContactSettings", "EstimatorSettings"];
/// Flags that say where parameters come from and results go, and are none themselves.
const NO_PARAMETERS: [&str; 5] = ["config", "preset", "quiet", "json", "help"];

/// Where parameters come from besides the flags.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Parameter sources")]
pub struct Sources {
    /// TOML file of parameters, named like the long flags; flags override it
    ///
    /// Parameters of recording, contact and estimator stand at the top level and apply to every command (`threshold
    /// = 0.002`). A command's other options stand in a table of its name (`[simulate]`, `noise-sd = 0.05`), which
    /// overrides the top level. Unknown keys are refused.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Named set of values, overridden by the configuration file and by flags
    #[arg(long)]
    preset: Option<Preset>,
}

impl Sources {
    /// Refuses an output in the place of the file.
    pub fn keep(&self, console: &Console) -> anyhow::Result<()> {
        (self.config.iter()).try_for_each(|file| console.outputs.keep(file))
    }
}

/// Where flags come from that are not on the command line, by their names.
#[derive(Debug, Default)]
pub struct Origins(BTreeMap<String, String>);

impl Origins {
    /// The error, with the place of the flag whose fault it is by its first word.
    pub fn locate(&self, error: anyhow::Error) -> anyhow::Error {
        let text = error.to_string();
        let flag = text.split(|c: char| c != '-' && !c.is_ascii_alphanumeric());
        match flag.take(1).find_map(|flag| self.0.get(flag)) {
            Some(place) => error.context(place.clone()),
            None => error,
        }
    }
}

/// Flag and name of the parameter that decides which others there are.
const ESTIMATOR: &str = "estimator";

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Preset {
    /// All values of the paper: prior N(0, 0.1²), noise sd 1, eq. 7 and Alg. 1 as printed (20 replays, buffer
    /// emptied before each sequence, variances shrunk again by every replay), threshold 2 mm, friction 0.15, slip
    /// step 0.1 mm, points instead of cubes. Means are projected to K >= 0 once, after all replays of an update;
    /// readings without contact are not replayed. Another `--estimator` keeps its own replay settings
    Paper,
}

impl Preset {
    fn place(self) -> String {
        format!("--preset {}", name_of(&self))
    }

    fn estimator(self) -> &'static str {
        let Self::Paper = self;
        "printed"
    }

    fn values(self) -> [(&'static str, &'static str); 11] {
        let Self::Paper = self;
        [
            (ESTIMATOR, self.estimator()),
            ("replay", "20"),
            ("replay-variance", "shrink"),
            ("clear-replay", "true"),
            ("prior-sd", "0.1"),
            ("noise-sd", "1"),
            ("smooth-share", "0"),
            ("threshold", "0.002"),
            ("friction", "0.15"),
            ("slip-step", "0.0001"),
            ("subdivision", "1"),
        ]
    }
}

/// Reads the command line, and says where flags come from that are not on it. Wrong usage of flags ends
/// the process, as do `--help` and `--version`.
///
/// # Errors
/// A configuration file that cannot be used; `--json` in front of what is no file of its own.
pub fn parse() -> anyhow::Result<(Cli, Origins)> {
    let mut line: Vec<OsString> = std::env::args_os().collect();
    let mut origins = Origins::default();
    // What a flag must give may come from the file.
    let lenient = Cli::line()
        .mut_subcommands(|command| command.mut_args(|arg| arg.required(false)))
        .try_get_matches_from(&line);
    if let Ok(matches) = lenient
        && let Some((name, given)) = matches.subcommand()
    {
        let end = line.iter().position(|a| a == "--").unwrap_or(line.len());
        for further in further(name, given)? {
            origins.0.insert(further.flag, further.place);
            line.splice(end..end, further.words);
        }
    }
    let matches = Cli::line().try_get_matches_from(&line);
    let parsed = matches.and_then(|matches| Cli::from_arg_matches(&matches));
    match swallowed(&line).filter(|word| is_missed(word, &parsed)) {
        Some(word) => Err(usage(format!(
            "--json takes {word:?} for the file to write; give --json last, or its file as --json=FILE"
        ))),
        None => match parsed {
            Ok(cli) => Ok((cli, origins)),
            Err(e) => say(&e),
        },
    }
}

/// Ends the process with what `--help`, `--version` or a wrong flag have clap say.
///
/// # Errors
/// Standard output cannot be written to; a reader that went away does not count.
fn say(message: &clap::Error) -> anyhow::Result<(Cli, Origins)> {
    match message.print() {
        Err(e) if !message.use_stderr() && e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(e).context("cannot write to standard output")
        }
        _ => std::process::exit(message.exit_code()),
    }
}

/// The word that `--json` without `=` takes for its file.
fn swallowed(line: &[OsString]) -> Option<String> {
    let at = line.iter().position(|a| a == "--json")?;
    let word = line.get(at + 1)?.to_string_lossy();
    (!word.starts_with('-')).then(|| word.into_owned())
}

/// Whether that word was more likely meant as input or command: it is a folder, or one is missing.
fn is_missed(word: &str, parsed: &Result<Cli, clap::Error>) -> bool {
    let is_command = || Cli::line().find_subcommand(word).is_some();
    match parsed {
        Ok(cli) => Path::new(word).is_dir() || (cli.command.is_none() && is_command()),
        Err(e) => match (e.kind(), e.get(ContextKind::InvalidArg)) {
            (ErrorKind::InvalidSubcommand, _) => is_command(),
            (ErrorKind::MissingRequiredArgument, Some(ContextValue::Strings(missing))) => {
                missing.iter().any(|arg| arg.starts_with('<'))
            }
            _ => false,
        },
    }
}

/// A flag that preset or file add.
struct Further {
    flag: String,
    values: Vec<String>,
    /// The words of the line that give it.
    words: Vec<OsString>,
    /// Where it stands.
    place: String,
}

impl Further {
    /// The flag of `arg` with these values, checked.
    fn new(
        arg: &Arg,
        values: impl IntoIterator<Item = String>,
        place: String,
    ) -> anyhow::Result<Self> {
        let values: Vec<String> = values.into_iter().collect();
        Ok(Self {
            flag: format!("--{}", arg.get_long().unwrap_or_default()),
            words: flags(arg, &values)?,
            values,
            place,
        })
    }
}

/// The flags that preset and file add to those of command `name`.
fn further(name: &str, given: &ArgMatches) -> anyhow::Result<Vec<Further>> {
    let mut all = Cli::line();
    all.build();
    let none = || Command::new("");
    let command = all.find_subcommand(name).cloned().unwrap_or_else(none);
    let path = |id| given.try_get_one::<PathBuf>(id).ok().flatten();
    let preset = given.try_get_one::<Preset>("preset").ok().flatten();
    let mut values: BTreeMap<&str, Further> = BTreeMap::new();
    if let Some(preset) = preset {
        for (key, value) in preset.values() {
            if let Some(arg) = find(shared(&command), key) {
                let further = Further::new(arg, [value.to_owned()], preset.place())?;
                values.insert(arg.get_id().as_str(), further);
            }
        }
    }
    if let Some(path) = path("config") {
        let text = read_text(path)?;
        let file = File { path, text: &text };
        for (own, key, further) in file.read(&all)? {
            let place = match own {
                None => find(shared(&command), &key),
                Some(own) if own == name => find(parameters(&command), &key),
                Some(_) => None,
            };
            if let Some(arg) = place {
                values.insert(arg.get_id().as_str(), further);
            }
        }
    }
    let by_hand = |id: &str| given.value_source(id) == Some(ValueSource::CommandLine);
    values.retain(|id, _| !by_hand(id));
    // One that is given in place of another goes before that, too.
    for arg in (command.get_arguments()).filter(|arg| by_hand(arg.get_id().as_str())) {
        for other in command.get_arg_conflicts_with(arg) {
            values.remove(other.get_id().as_str());
        }
    }
    if let Some(preset) = preset {
        let by_hand = given.try_get_raw(ESTIMATOR).ok().flatten();
        let by_hand = by_hand.and_then(|mut values| values.next());
        let own = |name: &OsStr| name == preset.estimator();
        let keeps = match (by_hand, values.get(ESTIMATOR)) {
            (Some(name), _) => own(name),
            (None, Some(further)) => further.values.iter().all(|v| own(v.as_ref())),
            (None, None) => true,
        };
        let is_of_its_estimator =
            |f: &Further| f.place == preset.place() && f.flag.contains("replay");
        values.retain(|_, f| keeps || !is_of_its_estimator(f));
    }
    Ok(values.into_values().collect())
}

/// The parameters of a command, those that it shares with others included.
fn parameters(command: &Command) -> impl Iterator<Item = &Arg> {
    let is_parameter = |arg: &&Arg| arg.get_long().is_some_and(|l| !NO_PARAMETERS.contains(&l));
    command.get_arguments().filter(is_parameter)
}

/// The parameters of a command that stand at the top of a file.
fn shared(command: &Command) -> impl Iterator<Item = &Arg> {
    parameters(command).filter(|arg| {
        (command.get_groups())
            .filter(|g| SHARED.contains(&g.get_id().as_str()))
            .any(|g| g.get_args().any(|id| id == arg.get_id()))
    })
}

fn find<'a>(args: impl IntoIterator<Item = &'a Arg>, key: &str) -> Option<&'a Arg> {
    args.into_iter().find(|arg| arg.get_long() == Some(key))
}

/// The flags that give `arg` these values, checked as on the command line.
fn flags(arg: &Arg, values: &[String]) -> anyhow::Result<Vec<OsString>> {
    let long = arg.get_long().unwrap_or_default();
    let is_switch = matches!(arg.get_action(), ArgAction::SetTrue);
    let flag = |value: &String| match (is_switch, value.as_str()) {
        (true, "true") => Some(format!("--{long}")),
        (true, "false") => None,
        _ => Some(format!("--{long}={value}")),
    };
    let flags: Vec<OsString> = (values.iter())
        .filter_map(flag)
        .map(OsString::from)
        .collect();
    let alone = Command::new("").no_binary_name(true).arg(arg.clone());
    match alone.try_get_matches_from(&flags) {
        Ok(_) => Ok(flags),
        Err(e) => {
            let text = e.to_string();
            let text = text.split("\n\n").next().unwrap_or_default();
            let words: Vec<&str> = text.split_whitespace().collect();
            let text = words.join(" ");
            Err(usage(text.strip_prefix("error: ").unwrap_or(&text)))
        }
    }
}

/// A configuration file.
struct File<'a> {
    path: &'a Path,
    text: &'a str,
}

/// A command (none: at the top), a key, and its value as a flag.
type Entry = (Option<String>, String, Further);

impl File<'_> {
    /// All entries, each checked; those at the top come first.
    fn read(&self, all: &Command) -> anyhow::Result<Vec<Entry>> {
        let table = DeTable::parse(self.text)
            .map_err(|e| self.wrong(e.span().unwrap_or_default(), e.message()))?;
        let takers = || {
            all.get_subcommands()
                .filter(|c| find(c.get_arguments(), "config").is_some())
        };
        let (mut top, mut own) = (Vec::new(), Vec::new());
        for (key, value) in table.get_ref() {
            let DeValue::Table(inner) = value.get_ref() else {
                let args: Vec<&Arg> = takers().flat_map(shared).collect();
                let further = self.entry(&args, key, value)?;
                top.push((None, key.get_ref().to_string(), further));
                continue;
            };
            let Some(command) = takers().find(|c| c.get_name() == key.get_ref()) else {
                let known: Vec<&str> = takers().map(Command::get_name).collect();
                let (name, known) = (key.get_ref(), known.join(", "));
                let problem = format!("unknown table [{name}]; there are {known}");
                return Err(self.wrong(key.span(), &problem));
            };
            let args: Vec<&Arg> = parameters(command).collect();
            for (key, value) in inner {
                let name = Some(command.get_name().to_owned());
                own.push((
                    name,
                    key.get_ref().to_string(),
                    self.entry(&args, key, value)?,
                ));
            }
        }
        top.extend(own);
        Ok(top)
    }

    /// One entry as a flag of the one of `args` that it names.
    fn entry(
        &self,
        args: &[&Arg],
        key: &toml::Spanned<std::borrow::Cow<str>>,
        value: &toml::Spanned<DeValue>,
    ) -> anyhow::Result<Further> {
        let name = key.get_ref();
        let Some(arg) = find(args.iter().copied(), name) else {
            let mut known: Vec<&str> = args.iter().filter_map(|a| a.get_long()).collect();
            known.sort_unstable();
            known.dedup();
            let known = known.join(", ");
            let problem = format!("unknown key {name:?}; the keys here are {known}");
            return Err(self.wrong(key.span(), &problem));
        };
        let texts = texts(value.get_ref()).filter(|texts| !texts.is_empty());
        let texts = texts.ok_or_else(|| {
            let problem = "takes a number, a text, true or false, or a list that is not empty";
            self.wrong(value.span(), &format!("{name} {problem}"))
        })?;
        Further::new(arg, texts, self.place(value.span()))
            .map_err(|e| self.wrong(value.span(), &e.to_string()))
    }

    fn wrong(&self, span: Range<usize>, problem: &str) -> anyhow::Error {
        usage(format!("{}: {problem}", self.place(span)))
    }

    fn place(&self, span: Range<usize>) -> String {
        let before = self.text.get(..span.start).unwrap_or_default();
        let line = before.matches('\n').count() + 1;
        format!("{} line {line}", self.path.display())
    }
}

/// A value as the texts of one flag or several.
fn texts(value: &DeValue) -> Option<Vec<String>> {
    let one = match value {
        DeValue::String(s) => s.to_string(),
        DeValue::Integer(i) => i.to_string(),
        DeValue::Float(f) => f.to_string(),
        DeValue::Boolean(b) => b.to_string(),
        DeValue::Array(list) => {
            let each = list.iter().map(|v| match v.get_ref() {
                DeValue::Array(_) => None,
                v => texts(v),
            });
            return Some(each.collect::<Option<Vec<_>>>()?.concat());
        }
        DeValue::Datetime(_) | DeValue::Table(_) => return None,
    };
    Some(vec![one])
}
