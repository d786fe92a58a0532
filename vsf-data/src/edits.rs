//! Whether a recording or a field was edited since it was written. A command may make again what it made, but not what was
//! edited by hand.

use crate::Dataset;
use crate::dataset::{CAMERA, FIELD, POINTS};
use crate::sequence::PREFIX;
use blake3::Hasher;
use serde_json::{Map, Number, Value};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The key of the digest in the metadata.
const KEY: &str = "digest";

/// Digests of files, by their paths in the folder.
pub(crate) type Files = BTreeMap<PathBuf, blake3::Hash>;

/// Digest of the values of the metadata, a JSON object, and of other files. It does not depend on the order of the values,
/// on white space, or on how numbers are written. An existing digest is left out.
pub(crate) fn digest(metadata: &[u8], files: &Files) -> Result<String, serde_json::Error> {
    let mut values: Map<String, Value> = serde_json::from_slice(metadata)?;
    values.remove(KEY);
    let mut values = as_floats(Value::Object(values));
    values.sort_all_objects();
    let mut hasher = Hasher::new();
    hasher.update(values.to_string().as_bytes());
    for (path, hash) in files {
        hasher.update(path.to_string_lossy().as_bytes());
        hasher.update(hash.as_bytes());
    }
    Ok(hasher.finalize().to_hex()[..16].to_owned())
}

/// Whether the recording in a folder is as a command wrote it; `bytes` are its metadata. Links count as unchanged, since
/// they are not written to.
pub(crate) fn is_as_written(folder: &Path, bytes: &[u8]) -> bool {
    match found(folder) {
        Ok(Some(files)) => agrees(bytes, &files),
        Ok(None) => known(bytes).is_some(),
        Err(_) => false,
    }
}

/// Whether the digest in the metadata agrees with them and with these files.
pub(crate) fn agrees(metadata: &[u8], files: &Files) -> bool {
    known(metadata).is_some_and(|known| digest(metadata, files).is_ok_and(|own| own == known))
}

/// The digest in the metadata.
fn known(metadata: &[u8]) -> Option<String> {
    let values: Map<String, Value> = serde_json::from_slice(metadata).ok()?;
    values.get(KEY)?.as_str().map(str::to_owned)
}

/// The files of a recording, without others in the folder; `None` if one of them is a link.
fn found(folder: &Path) -> Result<Option<Files>, std::io::Error> {
    let mut found = Files::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(inside) = folders.pop() {
        for entry in fs::read_dir(folder.join(&inside))? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let path = inside.join(&name);
            let is_part = [POINTS, FIELD, CAMERA, Dataset::ROBOT].contains(&&*name);
            let is_own = inside != Path::new("") || is_part || name.starts_with(PREFIX);
            if name.starts_with('.') || !is_own {
                continue;
            }
            if entry.file_type()?.is_symlink() {
                return Ok(None);
            }
            if entry.path().is_dir() {
                folders.push(path)
            } else {
                found.insert(path, blake3::hash(&fs::read(entry.path())?));
            }
        }
    }
    Ok(Some(found))
}

/// The same values with all numbers as floating-point numbers, since some programs write them so.
fn as_floats(value: Value) -> Value {
    match value {
        Value::Number(n) => {
            let float = n.as_f64().and_then(Number::from_f64);
            Value::Number(float.unwrap_or(n))
        }
        Value::Array(values) => Value::Array(values.into_iter().map(as_floats).collect()),
        Value::Object(values) => {
            let values = values.into_iter().map(|(k, v)| (k, as_floats(v)));
            Value::Object(values.collect())
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn edits_show_and_layout_does_not() {
        let files: Files = [(PathBuf::from("points.npy"), blake3::hash(b"1"))].into();
        let of = |text: &str| digest(text.as_bytes(), &files).unwrap();
        let own = of(r#"{"a": 1, "b": {"x": 0.1, "y": [1, 2]}}"#);
        assert_eq!(
            of(r#"{"digest": "0", "b":{"y":[1.0,2],"x":0.1},"a":1e0}"#),
            own
        );
        for changed in [
            r#"{"b":{"y":[1,2],"x":0.1},"a":2}"#,
            r#"{"b":{"y":[2,1],"x":0.1},"a":1}"#,
            r#"{"b":{"y":[1,2],"x":0.1},"a":1,"c":null}"#,
            r#"{"b":{"y":[1,2],"x":0.1}}"#,
        ] {
            assert_ne!(of(changed), own, "{changed}");
        }
        assert_ne!(
            digest(br#"{"a": 1, "b": {"x": 0.1, "y": [1, 2]}}"#, &Files::new()).unwrap(),
            own
        );
    }
}
