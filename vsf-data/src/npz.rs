//! `.npz` archives: zip files whose entries are `.npy` files.

use crate::{DataError, MADE_BY, files};
use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Most bytes in all entries together. A few bytes of zip can unpack to more than any memory.
const MAX_BYTES: u64 = 4 << 30;

/// The bytes of the entries, by name without `.npy`.
pub(crate) fn read(path: &Path) -> Result<BTreeMap<String, Vec<u8>>, DataError> {
    read_within(path, MAX_BYTES)
}

fn read_within(path: &Path, most: u64) -> Result<BTreeMap<String, Vec<u8>>, DataError> {
    let damaged = |e: ZipError| failure(path, &e);
    let bytes = files::read(path)?;
    let mut zip = ZipArchive::new(Cursor::new(&bytes)).map_err(damaged)?;
    let directory = bytes.get(zip.central_directory_start() as usize..);
    let twice = |name: &str| DataError::Npz {
        path: path.join(name),
        problem: "the entry occurs twice".to_owned(),
    };
    if let Some(name) = repeated(directory.unwrap_or_default()) {
        return Err(twice(&name));
    }
    let mut entries = BTreeMap::new();
    let mut left = most;
    for i in 0..zip.len() {
        let mut entry = zip.by_index(i).map_err(damaged)?;
        let name = entry.name().strip_suffix(".npy").unwrap_or(entry.name());
        let name = name.to_owned();
        let inside = path.join(entry.name());
        let mut bytes = Vec::new();
        // Nothing is reserved by the size that the archive claims.
        let limited = (&mut entry).take(left + 1).read_to_end(&mut bytes);
        limited.map_err(|e| failure(&inside, &ZipError::Io(e)))?;
        left = left
            .checked_sub(bytes.len() as u64)
            .ok_or_else(|| DataError::Npz {
                path: path.to_owned(),
                problem: format!("unpacks to more than {most} bytes"),
            })?;
        // Both with the ending and without.
        if entries.insert(name, bytes).is_some() {
            return Err(twice(entry.name()));
        }
    }
    Ok(entries)
}

/// A name that occurs twice in the central directory. The `zip` crate (6.0) keeps only the last of such entries.
fn repeated(mut directory: &[u8]) -> Option<String> {
    const HEADER: usize = 46;
    let mut names = BTreeSet::new();
    while let Some((header, rest)) = directory.split_first_chunk::<HEADER>()
        && header.starts_with(b"PK\x01\x02")
    {
        let [name, extra, comment] =
            [28, 30, 32].map(|at| usize::from(u16::from_le_bytes([header[at], header[at + 1]])));
        let (name, rest) = rest.split_at_checked(name)?;
        if !names.insert(name) {
            return Some(String::from_utf8_lossy(name).into_owned());
        }
        directory = rest.get(extra + comment..)?;
    }
    None
}

/// Packs the entries into an archive, stored as `numpy.savez` does; `.npy` is appended to the names.
///
/// The comment of the archive, which other readers skip, names this program. `path` is for messages.
pub(crate) fn encode(
    path: &Path,
    entries: &BTreeMap<String, Vec<u8>>,
) -> Result<Vec<u8>, DataError> {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    zip.set_comment(MADE_BY);
    let mut fill = || {
        for (name, bytes) in entries {
            let large = bytes.len() as u64 >= zip::ZIP64_BYTES_THR;
            zip.start_file(format!("{name}.npy"), options.large_file(large))?;
            zip.write_all(bytes)?;
        }
        Ok(())
    };
    fill().map_err(|e| failure(path, &e))?;
    let bytes = zip.finish().map_err(|e| failure(path, &e))?;
    Ok(bytes.into_inner())
}

fn failure(path: &Path, e: &ZipError) -> DataError {
    DataError::Npz {
        path: path.to_owned(),
        // The cause of an error in reading says more than that there is one.
        problem: e
            .source()
            .map_or_else(|| e.to_string(), ToString::to_string),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let entries = ["aa", "ab"].map(|name| (name.to_owned(), vec![7; 100]));
        let whole = encode(&path, &entries.into()).unwrap();
        let refused = |bytes: &[u8], part: &str| {
            std::fs::write(&path, bytes).unwrap();
            let error = read(&path).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        let mut flipped = whole.clone();
        let data = whole.windows(100).position(|w| w == [7; 100]).unwrap();
        flipped[data] ^= 1;
        refused(&flipped, "checksum");
        // Both places where an archive names its second entry.
        let mut doubled = whole;
        while let Some(at) = doubled.windows(6).position(|w| w == b"ab.npy") {
            doubled[at + 1] = b'a';
        }
        refused(
            &doubled,
            "aa.npy: not a readable .npz (zip) archive: the entry occurs twice",
        );
    }

    #[test]
    fn entries_share_one_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let entries = ["a", "b", "c"].map(|name| (name.to_owned(), vec![0; 1000]));
        std::fs::write(&path, encode(&path, &entries.into()).unwrap()).unwrap();
        assert_eq!(read_within(&path, 3000).unwrap().len(), 3);
        for most in [2999, 1500, 0] {
            let error = read_within(&path, most).unwrap_err().to_string();
            assert!(
                error.contains(&format!("unpacks to more than {most}")),
                "{error}"
            );
        }
    }
}
