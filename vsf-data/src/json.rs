//! JSON with errors that name file, line and column.

use crate::DataError;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::error::Category;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;

pub(crate) fn parse<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, DataError> {
    serde_json::from_slice(bytes).map_err(|e| failure(path, &e))
}

pub(crate) fn encode<T: Serialize>(path: &Path, value: &T) -> Result<Vec<u8>, DataError> {
    let mut text = serde_json::to_vec_pretty(value).map_err(|e| failure(path, &e))?;
    text.push(b'\n');
    Ok(text)
}

fn failure(path: &Path, e: &serde_json::Error) -> DataError {
    let (path, line, column) = (path.to_owned(), e.line(), e.column());
    // The position is a field of the error already.
    let text = e.to_string();
    let position = format!(" at line {line} column {column}");
    let problem = text.strip_suffix(&position).unwrap_or(&text).to_owned();
    match e.classify() {
        Category::Data => DataError::JsonType {
            path,
            line,
            column,
            problem,
        },
        _ => DataError::Json {
            path,
            line,
            column,
            problem,
        },
    }
}

/// Unknown keys with their values as JSON text, the form in which callers see them.
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
