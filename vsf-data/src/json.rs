//! JSON with errors that name file, line and column.

use crate::DataError;
use serde::Serialize;
use serde::de::{DeserializeOwned, Error, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::error::Category;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::path::Path;

/// An object in which no key occurs twice. By default, serde lets the last one win.
#[derive(Serialize)]
#[serde(transparent)]
pub(crate) struct UniqueMap<V>(pub BTreeMap<String, V>);

impl<'de, V: Deserialize<'de>> Deserialize<'de> for UniqueMap<V> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Entries<V>(PhantomData<V>);

        impl<'de, V: Deserialize<'de>> Visitor<'de> for Entries<V> {
            type Value = UniqueMap<V>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object by sequence ID")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut from: A) -> Result<Self::Value, A::Error> {
                let mut map = BTreeMap::new();
                while let Some((key, value)) = from.next_entry::<String, V>()? {
                    if map.contains_key(&key) {
                        return Err(A::Error::custom(format_args!("duplicate key {key:?}")));
                    }
                    map.insert(key, value);
                }
                Ok(UniqueMap(map))
            }
        }

        from.deserialize_map(Entries(PhantomData))
    }
}

/// Text that is not JSON, or JSON of another form than required.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line} column {column}: {problem}")]
pub struct JsonError {
    /// Line, from 1.
    pub line: usize,
    /// Column in bytes, from 1; 0 for the end of the previous line.
    pub column: usize,
    /// Key and problem.
    pub problem: String,
    /// Whether the text is JSON, but of another form.
    pub is_json: bool,
}

impl JsonError {
    fn new(e: &serde_json::Error) -> Self {
        let (line, column) = (e.line(), e.column());
        // The position is a field of the error already.
        let text = e.to_string();
        let position = format!(" at line {line} column {column}");
        Self {
            line,
            column,
            problem: plain(text.strip_suffix(&position).unwrap_or(&text)),
            is_json: e.classify() == Category::Data,
        }
    }

    fn at(self, path: &Path) -> DataError {
        let (path, line, column, problem) = (path.to_owned(), self.line, self.column, self.problem);
        if self.is_json {
            DataError::JsonType {
                path,
                line,
                column,
                problem,
            }
        } else {
            DataError::Json {
                path,
                line,
                column,
                problem,
            }
        }
    }
}

/// Parses a JSON file.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, DataError> {
    parse_json(bytes).map_err(|e| e.at(path))
}

/// Parses JSON.
///
/// # Errors
/// Text that is not JSON in UTF-8, or not of the form of `T`. The error has the line and column, the key, and the problem
/// in terms of JSON.
///
/// ```
/// let error = vsf_data::parse_json::<Vec<f64>>(br#"[0.1, "b"]"#).unwrap_err();
/// assert_eq!(error.problem, "[1]: invalid type: string \"b\", expected a number");
/// ```
pub fn parse_json<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, JsonError> {
    let text = text(bytes)?;
    let mut json = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut json).map_err(|e| {
        let key = e.path().to_string();
        let mut found = JsonError::new(e.inner());
        // Where an array is too long, or a number stands for a name, serde_json finds fault with the syntax.
        if !found.is_json && serde_json::from_str::<IgnoredAny>(text).is_ok() {
            found.is_json = true;
            let problem = &found.problem;
            if problem.starts_with("expected") || problem.starts_with("trailing") {
                found.problem =
                    "a value of another type, or of more entries, than it has to be".to_owned();
            }
        }
        if found.is_json && key != "." {
            found.problem = format!("{key}: {}", found.problem);
        }
        found
    })?;
    json.end().map_err(|e| JsonError::new(&e))?;
    Ok(value)
}

/// The text of a UTF-8 file, without a byte order mark.
fn text(bytes: &[u8]) -> Result<&str, JsonError> {
    // JSON begins with a character of ASCII, which the wider ones fill up with zeros, after a mark, too.
    let is_wide = bytes.iter().take(4).any(|b| *b == 0);
    let (at, problem) = if bytes.starts_with(b"\xef\xbb\xbf") {
        (0, "a byte order mark; save it as UTF-8 without one")
    } else if is_wide {
        (0, "UTF-16 or UTF-32; save it as UTF-8")
    } else {
        match std::str::from_utf8(bytes) {
            Ok(text) => return Ok(text),
            Err(e) => (e.valid_up_to(), "not UTF-8 text; save it as UTF-8"),
        }
    };
    let before = &bytes[..at];
    let begin = before
        .iter()
        .rposition(|b| *b == b'\n')
        .map_or(0, |n| n + 1);
    Err(JsonError {
        line: before.iter().filter(|b| **b == b'\n').count() + 1,
        column: at - begin + 1,
        problem: problem.to_owned(),
        is_json: false,
    })
}

pub(crate) fn encode<T: Serialize>(path: &Path, value: &T) -> Result<Vec<u8>, DataError> {
    let mut text = serde_json::to_vec_pretty(value).map_err(|e| failure(path, &e))?;
    text.push(b'\n');
    Ok(text)
}

pub(crate) fn failure(path: &Path, e: &serde_json::Error) -> DataError {
    JsonError::new(e).at(path)
}

/// The problem with the expected type in terms of JSON.
fn plain(problem: &str) -> String {
    match problem.rsplit_once(", expected ") {
        Some((before, "f64")) => format!("{before}, expected a number"),
        Some((before, "u32" | "u64" | "usize")) => {
            format!("{before}, expected a whole number >= 0")
        }
        _ => problem.to_owned(),
    }
}

/// Unknown keys with their values as JSON text, as callers see them.
pub(crate) fn to_text(unknown: Map<String, Value>) -> BTreeMap<String, String> {
    unknown
        .into_iter()
        .map(|(k, v)| (k, v.to_string()))
        .collect()
}

pub(crate) fn from_text(
    path: &Path,
    unknown: &BTreeMap<String, String>,
) -> Result<Map<String, Value>, DataError> {
    unknown
        .iter()
        .map(|(k, v)| Ok((k.clone(), parse(path, v.as_bytes())?)))
        .collect()
}
