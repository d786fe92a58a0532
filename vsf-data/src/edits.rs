//! Whether `dataset.json` was edited since it was written: what a command has made it makes again, what a hand has set
//! it does not.

use serde_json::{Map, Value};

/// The key of the digest, in bytes that have one.
const KEY: &str = "digest";

/// Digest of the values of a JSON object, whatever their order and the blanks between them; a digest is none of them.
pub(crate) fn digest(bytes: &[u8]) -> Result<String, serde_json::Error> {
    let mut values: Map<String, Value> = serde_json::from_slice(bytes)?;
    values.remove(KEY);
    let mut values = Value::Object(values);
    values.sort_all_objects();
    Ok(blake3::hash(values.to_string().as_bytes()).to_hex()[..16].to_owned())
}

/// Whether a JSON object has a digest, but of other values.
pub(crate) fn are_edited(bytes: &[u8]) -> bool {
    let values: Map<String, Value> = serde_json::from_slice(bytes).unwrap_or_default();
    let known = values.get(KEY).and_then(Value::as_str);
    known.is_some_and(|known| digest(bytes).is_ok_and(|own| own != known))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn edits_show_and_layout_does_not() {
        let of = |text: &str| digest(text.as_bytes()).unwrap();
        let own = of(r#"{"a": 1, "b": {"x": 0.1, "y": [1, 2]}}"#);
        let with = |digest: &str, rest: &str| format!(r#"{{"digest": "{digest}", {rest}}}"#);
        let same = with(&own, r#""b":{"y":[1,2],"x":0.1},"a":1"#);
        assert!(!are_edited(same.as_bytes()));
        for changed in [
            r#""b":{"y":[1,2],"x":0.1},"a":2"#,
            r#""b":{"y":[2,1],"x":0.1},"a":1"#,
            r#""b":{"y":[1,2],"x":0.1},"a":1,"c":null"#,
            r#""b":{"y":[1,2],"x":0.1}"#,
        ] {
            assert!(are_edited(with(&own, changed).as_bytes()), "{changed}");
        }
        // What has none was never signed.
        for unsigned in [r#"{"a": 1}"#, "[]", "{", r#"{"digest": 5}"#] {
            assert!(!are_edited(unsigned.as_bytes()), "{unsigned}");
        }
    }
}
