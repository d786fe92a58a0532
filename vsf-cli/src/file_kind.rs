//! Which files an output replaces: those of its own kind; of pictures any, of the others what `vsf` writes.

use crate::console::read_text;
use crate::exit::usage;
use crate::html;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use vsf::data::StiffnessField;
use vsf::gap::ModelFile;
use vsf::vision::LearnedPrior;

/// Where a file says what it is, in bytes from its begin.
const HEAD: u64 = 4096;

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
}

impl FileKind {
    /// Refuses a place that holds anything else. An empty file is nothing to lose, devices and pipes are left to be tried.
    pub fn check(self, flag: &str, path: &Path) -> anyhow::Result<()> {
        let is_empty = || path.metadata().is_ok_and(|m| m.len() == 0);
        if !path.is_file() || is_empty() || self.is_at(path) {
            return Ok(());
        }
        let (path, what) = (path.display(), self.what());
        Err(usage(format!(
            "{flag} {path} holds something else; choose a new file, or {what} to replace"
        )))
    }

    fn what(self) -> &'static str {
        match self {
            Self::Results => "results of --json",
            Self::Page => "a page of vsf",
            Self::Model => "a corrected model",
            Self::Learned => "what was learned earlier",
            Self::Npz => "a field",
            Self::Ply => "a .ply of a field",
            Self::Mcap => "an .mcap of vsf",
            Self::Png | Self::Svg => "a picture",
        }
    }

    fn is_at(self, path: &Path) -> bool {
        match self {
            Self::Results => read_text(path).is_ok_and(|text| are_results(&text)),
            Self::Page => holds(path, b"<!DOCTYPE html>", html::GENERATOR.as_bytes()),
            Self::Model => read_text(path).is_ok_and(|text| ModelFile::from_json(&text).is_ok()),
            Self::Learned => LearnedPrior::open(path).is_ok(),
            Self::Npz => StiffnessField::open(path).is_ok(),
            Self::Ply => holds(path, b"ply", b"property double stiffness\n"),
            // The library that the header names.
            Self::Mcap => holds(path, b"\x89MCAP", b"vsf "),
            Self::Png => holds(path, b"\x89PNG", b"IHDR"),
            Self::Svg => holds(path, b"<", b"<svg"),
        }
    }
}

/// Whether a file begins so, and has a mark near its begin.
fn holds(path: &Path, begin: &[u8], mark: &[u8]) -> bool {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    let is_marked = || head.windows(mark.len()).any(|part| part == mark);
    read.is_ok() && head.starts_with(begin) && is_marked()
}

/// All results list their warnings.
fn are_results(text: &str) -> bool {
    let value: Result<serde_json::Value, _> = serde_json::from_str(text);
    value.is_ok_and(|v| v.get("warnings").is_some_and(serde_json::Value::is_array))
}
