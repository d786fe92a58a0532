//! Which files an output replaces: those of its own kind that `vsf` has written.

use crate::console::read_text;
use crate::exit::usage;
use anyhow::Context;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use vsf::gap::ModelFile;
use vsf::vision::LearnedPrior;

/// Where a file says what it is, in bytes from its start.
const HEAD: u64 = 4096;
/// Where an archive does, in bytes from its end.
const TAIL: u64 = 64;

/// What a command writes to a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// What `--json` gives.
    Results,
    /// An HTML page.
    Page,
    Model,
    Learned,
    Npz,
    Ply,
    Mcap,
    Png,
    Svg,
    /// A report in Markdown.
    Report,
}

impl FileKind {
    /// Refuses a place that holds anything else. An empty file is nothing to lose, devices and pipes are left to be tried.
    pub fn check(self, flag: &str, path: &Path) -> anyhow::Result<()> {
        let is_empty = || path.metadata().is_ok_and(|m| m.len() == 0);
        if !path.is_file() || is_empty() {
            return Ok(());
        }
        File::open(path)
            .with_context(|| format!("cannot read what {flag} {} holds", path.display()))?;
        if self.is_at(path) {
            return Ok(());
        }
        let (path, what) = (path.display(), self.what());
        Err(usage(format!(
            "{flag} {path} holds something else than {what} by vsf; choose a new file, or delete this one"
        )))
    }

    fn what(self) -> &'static str {
        match self {
            Self::Results => "results of --json",
            Self::Page => "a page",
            Self::Model => "a corrected model",
            Self::Learned => "what was learned",
            Self::Npz => "a field",
            Self::Ply => "a .ply of a field",
            Self::Mcap => "an .mcap",
            Self::Png | Self::Svg => "a picture",
            Self::Report => "a report",
        }
    }

    fn is_at(self, path: &Path) -> bool {
        match self {
            Self::Results => object(path).is_some_and(|text| are_results(&text)),
            Self::Page => holds(
                path,
                b"<!DOCTYPE html>",
                b"name=\"generator\" content=\"vsf ",
            ),
            Self::Model => object(path).is_some_and(|text| is_own_model(&text)),
            Self::Learned => {
                object(path).is_some_and(|text| LearnedPrior::from_json(&text).is_ok())
            }
            Self::Npz => is_own_archive(path),
            Self::Ply => holds(path, b"ply", b"\ncomment vsf "),
            // The library that the header names, behind the length of that name.
            Self::Mcap => holds(path, b"\x89MCAP", b"\0\0\0vsf "),
            Self::Png => holds(path, b"\x89PNG", b"tEXtSoftware\0vsf "),
            Self::Svg => holds(path, b"<svg", b"<!-- vsf "),
            Self::Report => holds(path, b"# ", b"<!-- vsf "),
        }
    }
}

/// Whether a file begins so, and has a mark near its start.
fn holds(path: &Path, begin: &[u8], mark: &[u8]) -> bool {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    read.is_ok() && head.starts_with(begin) && contains(&head, mark)
}

/// Whether an archive has a comment of `vsf`: it ends with that, behind the comment's length.
fn is_own_archive(path: &Path) -> bool {
    let ends = || {
        let (mut file, mut begin, mut end) = (File::open(path)?, [0; 2], Vec::new());
        file.read_exact(&mut begin)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
        file.take(TAIL).read_to_end(&mut end)?;
        std::io::Result::Ok((begin, end))
    };
    ends().is_ok_and(|(begin, end)| begin == *b"PK" && contains(&end, b"\0vsf "))
}

/// The text of a file that may be an object of JSON.
fn object(path: &Path) -> Option<String> {
    let mut begin = [0; 1];
    File::open(path)
        .and_then(|mut file| file.read_exact(&mut begin))
        .ok()?;
    (begin == *b"{").then(|| read_text(path).ok()).flatten()
}

/// Whether they hold a mark, which the version follows.
fn contains(bytes: &[u8], mark: &[u8]) -> bool {
    let is_mark = |part: &[u8]| part.starts_with(mark) && part[mark.len()].is_ascii_digit();
    bytes.windows(mark.len() + 1).any(is_mark)
}

/// Models may be written by hand.
fn is_own_model(text: &str) -> bool {
    ModelFile::from_json(text).is_ok_and(|model| model.made_by.is_some_and(|by| is_own(&by)))
}

/// All results list their warnings; the metadata of a recording, which say who made it, too, do not.
fn are_results(text: &str) -> bool {
    let value: serde_json::Value = serde_json::from_str(text).unwrap_or_default();
    let made_by = value.get("made_by").and_then(serde_json::Value::as_str);
    let warnings = value.get("warnings");
    made_by.is_some_and(is_own) && warnings.is_some_and(serde_json::Value::is_array)
}

fn is_own(made_by: &str) -> bool {
    contains(made_by.as_bytes(), b"vsf ")
}
