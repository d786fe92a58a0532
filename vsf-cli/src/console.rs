use crate::file_kind::FileKind;
use crate::interrupt::writing;
use crate::outputs::Outputs;
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
    /// Where the command writes.
    pub outputs: Outputs,
}

/// What results say of the program that wrote them.
pub const MADE_BY: &str = concat!("vsf ", env!("CARGO_PKG_VERSION"));

/// Most rows of a table of sequences, and how many of more are shown.
const MOST_ROWS: usize = 100;
const FIRST_ROWS: usize = 40;

/// What machines read.
#[derive(Serialize)]
struct WithWarnings<'a, T: Serialize> {
    made_by: &'static str,
    #[serde(flatten)]
    result: &'a T,
    warnings: &'a [String],
}

impl Console {
    /// `json`: not wanted, to standard output (also by `-`), or to a file, whose folder must exist.
    pub fn new(quiet: bool, json: Option<Option<PathBuf>>) -> anyhow::Result<Self> {
        let json = json.map(|to| to.filter(|path| path.as_os_str() != "-"));
        let outputs = Outputs::default();
        if let Some(Some(path)) = &json {
            outputs.file("--json", path, Some(FileKind::Results))?;
        }
        Ok(Self {
            quiet,
            json,
            warnings: RefCell::default(),
            outputs,
        })
    }

    /// The report for people, unless quiet or standard output belongs to the machine.
    pub fn report(&self, text: impl Display) -> anyhow::Result<()> {
        if self.reports() {
            print(&harmless(&text.to_string()))
        } else {
            Ok(())
        }
    }

    /// The result for machines, if wanted, with all warnings so far; and the report for people, also where the former cannot
    /// be written.
    pub fn results(&self, result: &impl Serialize, report: impl Display) -> anyhow::Result<()> {
        let written = self.json_and(result, Vec::new());
        self.report(report)?;
        written
    }

    /// The result for machines, if wanted, and further files: all of them are written, or none.
    pub fn json_and(
        &self,
        result: &impl Serialize,
        mut files: Vec<(PathBuf, String)>,
    ) -> anyhow::Result<()> {
        let text = self.to_json(result)?;
        if let Some(Some(path)) = &self.json {
            files.push((path.clone(), text));
        } else if self.json.is_some() {
            print(&text)?;
        }
        Ok(writing(|| vsf::data::write_files(files))?)
    }

    /// The text of a result, with its maker and all warnings so far.
    pub fn to_json(&self, result: &impl Serialize) -> anyhow::Result<String> {
        let result = WithWarnings {
            made_by: MADE_BY,
            result,
            warnings: &self.warnings.borrow(),
        };
        Ok(serde_json::to_string_pretty(&result).context("cannot write JSON")? + "\n")
    }

    /// A warning, printed whatever else is; the same one once.
    pub fn warn(&self, warning: impl Display) {
        let warning = shortened(warning.to_string());
        let mut seen = self.warnings.borrow_mut();
        if !seen.contains(&warning) {
            complain(format_args!("warning: {warning}"));
            seen.push(warning);
        }
    }

    /// A line on standard error beside a report that machines read, unless quiet.
    pub fn remark(&self, text: impl Display) {
        if !self.quiet {
            complain(text);
        }
    }

    /// Whether standard output belongs to the report.
    pub fn reports(&self) -> bool {
        !self.quiet && self.json != Some(None)
    }

    /// All warnings so far.
    pub fn warnings(&self) -> Vec<String> {
        self.warnings.borrow().clone()
    }

    /// [`warn`](Self::warn) of each.
    pub fn warn_all(&self, warnings: impl IntoIterator<Item = impl Display>) {
        warnings.into_iter().for_each(|w| self.warn(w));
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

/// One line on standard error. That nobody reads it is no reason to stop.
pub fn complain(text: impl Display) {
    let line = shortened(harmless(&text.to_string())).replace('\n', " ");
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// A message of at most 4000 bytes: names that a hostile file made long are cut out of the middle.
fn shortened(message: String) -> String {
    const FIRST: usize = 3000;
    const LAST: usize = 990;
    if message.len() <= FIRST + LAST + 5 {
        return message;
    }
    let head = message.floor_char_boundary(FIRST);
    let tail = message.ceil_char_boundary(message.len() - LAST);
    format!("{} ... {}", &message[..head], &message[tail..])
}

/// Without the characters by which names in a file could command a terminal, or turn a line around; pages and
/// pictures show none of them either.
pub fn harmless(text: &str) -> String {
    let turns = |c: char| matches!(c, '\u{200E}'..='\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2066}'..='\u{2069}');
    let shown = |c: char| {
        if c.is_control() && c != '\n' || turns(c) {
            char::REPLACEMENT_CHARACTER
        } else {
            c
        }
    };
    text.chars().map(shown).collect()
}

/// The same in one line, of a name among other words.
pub fn in_line(name: &str) -> String {
    harmless(name).replace('\n', "\u{FFFD}")
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

/// Writes files of a folder, all of them or none; an interruption waits for them.
pub fn write_folder<P: AsRef<Path>, B: AsRef<[u8]>>(
    folder: &Path,
    files: impl IntoIterator<Item = (P, B)>,
) -> anyhow::Result<()> {
    Ok(writing(|| vsf::data::write_folder(folder, files))?)
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

/// Creates the folders above a file.
pub fn create_parent(file: &Path) -> anyhow::Result<()> {
    file.parent().map_or(Ok(()), create_folder)
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

/// A table with a row for every sequence; of very many, the first ones.
pub fn sequence_table(header: &[&str], rows: &[Vec<String>]) -> String {
    if rows.len() <= MOST_ROWS {
        return table(header, rows);
    }
    let more = rows.len() - FIRST_ROWS;
    table(header, &rows[..FIRST_ROWS]) + &format!("  and {more} more sequences (--json has all)\n")
}

/// What the name of so many things ends in.
pub fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
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

/// A number with so many decimals; what is rounded to zero has no sign.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|b| b == b'0' || b == b'.') => zero.to_owned(),
        _ => text,
    }
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

    #[test]
    fn of_very_many_sequences_the_first_are_shown() {
        let rows = |count: usize| -> Vec<Vec<String>> {
            (0..count).map(|k| vec![k.to_string()]).collect()
        };
        let lines = |count| sequence_table(&["sequence"], &rows(count)).lines().count();
        assert_eq!((lines(3), lines(100), lines(5000)), (4, 101, 42));
        let text = sequence_table(&["sequence"], &rows(5000));
        assert!(text.ends_with("39\n  and 4960 more sequences (--json has all)\n"));
    }

    #[test]
    fn names_begin_no_line() {
        assert_eq!(
            in_line("touch\nerror: forged"),
            "touch\u{FFFD}error: forged"
        );
    }

    #[test]
    fn long_messages_keep_their_ends() {
        assert_eq!(shortened("a".repeat(3995)).len(), 3995);
        // Characters of several bytes are not cut.
        let long = format!("{}: check it", "\u{1d6d1}".repeat(100_000));
        let short = shortened(long);
        assert!(short.len() <= 4000 && short.starts_with('\u{1d6d1}'));
        assert!(short.contains(" ... ") && short.ends_with(": check it"));
    }
}
