use crate::exit::usage;
use crate::interrupt::writing;
use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::borrow::Cow;
use std::cell::RefCell;
use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Where results go.
pub struct Console {
    quiet: bool,
    json: Option<Option<PathBuf>>,
    warnings: RefCell<Vec<String>>,
}

/// What machines read.
#[derive(Serialize)]
struct WithWarnings<'a, T: Serialize> {
    #[serde(flatten)]
    result: &'a T,
    warnings: &'a [String],
}

impl Console {
    /// `json`: not wanted, to standard output (also by `-`), or to a file, whose folder must exist.
    pub fn new(quiet: bool, json: Option<Option<PathBuf>>) -> anyhow::Result<Self> {
        let json = json.map(|to| to.filter(|path| path.as_os_str() != "-"));
        if let Some(Some(path)) = &json {
            check_file("--json", path)?;
        }
        Ok(Self {
            quiet,
            json,
            warnings: RefCell::default(),
        })
    }

    /// The report for people, unless quiet or standard output belongs to the machine.
    pub fn report(&self, text: impl Display) -> anyhow::Result<()> {
        match self.quiet || self.json == Some(None) {
            true => Ok(()),
            false => print(&harmless(&text.to_string())),
        }
    }

    /// The result for machines, if wanted, with all warnings so far.
    pub fn json(&self, result: &impl Serialize) -> anyhow::Result<()> {
        self.json_and(result, Vec::new())
    }

    /// [`Console::json`], and further files: all of them are written, or none.
    pub fn json_and(
        &self,
        result: &impl Serialize,
        mut files: Vec<(PathBuf, String)>,
    ) -> anyhow::Result<()> {
        let result = WithWarnings {
            result,
            warnings: &self.warnings.borrow(),
        };
        let text = serde_json::to_string_pretty(&result).context("cannot write JSON")? + "\n";
        if let Some(Some(path)) = &self.json {
            files.push((path.clone(), text));
        } else if self.json.is_some() {
            print(&text)?;
        }
        Ok(writing(|| vsf::data::write_files(files))?)
    }

    /// Refuses outputs, each with its flag, that are no files in folders that exist, that lie in
    /// `input`, or that name a place twice.
    pub fn check_outputs(&self, outputs: &[(&str, &Path)], input: &Path) -> anyhow::Result<()> {
        let json = self
            .json
            .iter()
            .flatten()
            .map(|json| ("--json", json.as_path()));
        let all: Vec<_> = json.chain(outputs.iter().copied()).collect();
        for (k, &(flag, path)) in all.iter().enumerate() {
            check_file(flag, path)?;
            if place(path).starts_with(place(input)) {
                let (path, input) = (path.display(), input.display());
                return Err(usage(format!(
                    "{flag} {path} would replace a part of {input}"
                )));
            }
            if let Some((other, _)) = all[..k].iter().find(|(_, p)| place(p) == place(path)) {
                return Err(usage(format!("{other} and {flag} name the same file")));
            }
        }
        Ok(())
    }

    /// Refuses an output for machines that is another output, or lies in it.
    pub fn keep_apart(&self, out: &[impl AsRef<Path>]) -> anyhow::Result<()> {
        let Some(Some(json)) = &self.json else {
            return Ok(());
        };
        let holds = |out: &&Path| place(json).starts_with(place(out));
        match out.iter().map(AsRef::as_ref).find(holds) {
            Some(out) => Err(usage(format!(
                "--json {} would replace --out {} or a part of it",
                json.display(),
                out.display()
            ))),
            None => Ok(()),
        }
    }

    /// Refuses an output for machines in the place of an input, or inside of it.
    pub fn keep_input(&self, input: &Path) -> anyhow::Result<()> {
        match &self.json {
            Some(Some(json)) if place(json).starts_with(place(input)) => Err(usage(format!(
                "--json {} would replace a part of {}",
                json.display(),
                input.display()
            ))),
            _ => Ok(()),
        }
    }

    /// A warning, printed whatever else is; the same one once.
    pub fn warn(&self, warning: impl Display) {
        let warning = warning.to_string();
        let mut seen = self.warnings.borrow_mut();
        if !seen.contains(&warning) {
            complain(format_args!("warning: {warning}"));
            seen.push(warning);
        }
    }

    /// A bar of `steps` steps on standard error, drawn on terminals only.
    pub fn bar(&self, steps: usize, what: impl Into<Cow<'static, str>>) -> ProgressBar {
        if self.quiet {
            return ProgressBar::hidden();
        }
        let style = ProgressStyle::with_template("{msg} {bar:30} {pos}/{len} {elapsed}");
        let bar = ProgressBar::new(steps as u64)
            .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
            .with_message(what);
        bar.tick();
        bar
    }

    /// A spinner for work of unknown length, drawn on terminals only.
    pub fn spinner(&self, what: impl Into<Cow<'static, str>>) -> ProgressBar {
        if self.quiet {
            return ProgressBar::hidden();
        }
        let bar = ProgressBar::new_spinner().with_message(what);
        bar.enable_steady_tick(std::time::Duration::from_millis(120));
        bar
    }
}

/// Refuses what is no file in a folder that exists.
fn check_file(flag: &str, path: &Path) -> anyhow::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
    if names_folder(path) || folder.is_some_and(|f| !f.is_dir()) {
        let why = format!("{flag} must name a file in a folder that exists");
        return Err(std::io::Error::new(ErrorKind::NotFound, why))
            .with_context(|| format!("cannot write {}", path.display()));
    }
    check_name(flag, path)
}

/// Whether a path is that of a folder, or is written as of one, with a slash at its end.
pub fn names_folder(path: &Path) -> bool {
    let last = path.as_os_str().as_encoded_bytes().last();
    path.is_dir() || last.is_some_and(|b| std::path::is_separator(char::from(*b)))
}

/// Refuses a name that the system takes for no file, such as one too long.
fn check_name(flag: &str, path: &Path) -> anyhow::Result<()> {
    match path.symlink_metadata() {
        Err(e) if e.kind() != ErrorKind::NotFound => {
            Err(e).with_context(|| format!("cannot write {flag} {}", path.display()))
        }
        _ => Ok(()),
    }
}

/// One line on standard error. That nobody reads it is no reason to stop.
pub fn complain(text: impl Display) {
    let line = harmless(&text.to_string()).replace('\n', " ");
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Without the characters by which names in a file could command a terminal, or turn a line around; pages and
/// pictures show none of them either.
pub fn harmless(text: &str) -> String {
    let turns = |c: char| matches!(c, '\u{200E}'..='\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2066}'..='\u{2069}');
    let shown = |c: char| match c.is_control() && c != '\n' || turns(c) {
        true => char::REPLACEMENT_CHARACTER,
        false => c,
    };
    text.chars().map(shown).collect()
}

/// A reader that went away (`vsf info | head`) is no error.
fn print(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
        done => done.context("cannot write to standard output"),
    }
}

/// The text of a file that a flag names.
pub fn read_text(path: &Path) -> anyhow::Result<String> {
    Ok(vsf::data::read_text(path)?)
}

/// Replaces a file as a whole; an interruption waits for it.
pub fn write_file(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    Ok(writing(|| vsf::data::write_file(path, bytes))?)
}

/// The report of a command that only writes files.
#[derive(Serialize)]
pub struct Written {
    /// Their paths.
    pub written: Vec<String>,
}

/// Paths as JSON has them: Unicode.
pub fn texts(paths: &[PathBuf]) -> Vec<String> {
    let text = |p: &PathBuf| p.to_string_lossy().into_owned();
    paths.iter().map(text).collect()
}

/// Creates a folder and those above it.
pub fn create_folder(path: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(path).with_context(|| format!("cannot create {}", path.display()))
}

/// Columns of text, the first to the left, the others to the right.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    let mut lines = vec![header.iter().map(ToString::to_string).collect::<Vec<_>>()];
    lines.extend_from_slice(rows);
    let width = |column: usize| {
        let cell = |line: &Vec<String>| line.get(column).map_or(0, |c| c.chars().count());
        lines.iter().map(cell).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    let mut text = String::new();
    for line in lines {
        for (column, cell) in line.iter().enumerate() {
            let width = widths.get(column).copied().unwrap_or(0);
            text += &match column {
                0 => format!("  {cell:<width$}"),
                _ => format!("  {cell:>width$}"),
            };
        }
        text = text.trim_end().to_owned() + "\n";
    }
    text
}

/// Four significant digits.
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (3 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    match value.abs() {
        v if (1e-4..1e6).contains(&v) => format!("{value:.decimals$}"),
        _ => format!("{value:.3e}"),
    }
}

/// Refuses what lies below something that is no folder, and names that no file can have.
pub fn check_above(flag: &str, out: &Path) -> anyhow::Result<()> {
    let mut above = out.ancestors().skip(1);
    match above.find(|p| p.exists() && !p.is_dir()) {
        Some(above) => {
            let why = format!("{} is no folder", above.display());
            Err(std::io::Error::new(ErrorKind::NotADirectory, why))
                .with_context(|| format!("cannot write {flag} {}", out.display()))
        }
        None => check_name(flag, out),
    }
}

/// Refuses a folder to write to that is none, or holds a name that is `odd`; `what` may be replaced
/// there. Names that begin with a dot do not count: a killed command leaves such.
pub fn check_folder(
    flag: &str,
    out: &Path,
    what: &str,
    odd: impl Fn(&[String]) -> Option<&String>,
) -> anyhow::Result<()> {
    check_above(flag, out)?;
    if out.exists() && !out.is_dir() {
        return Err(usage(format!("{flag} {}: it is no folder", out.display())));
    }
    let names = out.read_dir().into_iter().flatten().flatten();
    let names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.filter(|name| !name.starts_with('.')).collect();
    names.sort_unstable();
    match odd(&names) {
        Some(name) => Err(usage(format!(
            "{flag} {} holds other files ({name:?}); choose a new or empty folder, or {what} to replace",
            out.display()
        ))),
        None => Ok(()),
    }
}

/// In a folder that may hold anything beside one of these, the first name where none of them is.
pub fn unmarked<'a>(names: &'a [String], marks: &[&str]) -> Option<&'a String> {
    let is_marked = names.iter().any(|name| marks.contains(&name.as_str()));
    names.first().filter(|_| !is_marked)
}

/// Where a file or folder is or would be, with links followed as far as it is there.
pub fn place(path: &Path) -> PathBuf {
    let real = |base: &Path| match base.as_os_str().is_empty() {
        true => Path::new(".").canonicalize().ok(),
        false => base.canonicalize().ok(),
    };
    let found = path.ancestors().find_map(|base| Some((real(base)?, base)));
    let rest = |base: &Path| path.strip_prefix(base).map(Path::to_owned).ok();
    found
        .and_then(|(real, base)| Some(real.join(rest(base)?)))
        .unwrap_or_else(|| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_command_a_terminal() {
        assert_eq!(harmless("Stab für K\n"), "Stab für K\n");
        assert_eq!(
            harmless("a\u{1b}[2Jb\u{7}\u{202E}c\u{2028}"),
            "a\u{FFFD}[2Jb\u{FFFD}\u{FFFD}c\u{FFFD}"
        );
    }
}
