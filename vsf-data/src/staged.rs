//! Files that are written together or not at all.

use crate::DataError;
use std::fs;
use std::io::{Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// Replaces the file `path` as a whole: a reader, and whoever comes after a killed process, finds
/// the old bytes or the new ones.
///
/// A link is followed. A device or a pipe is written to. A file that is marked read-only is kept.
///
/// # Errors
/// [`DataError::Io`]; the old file is then as it was.
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), DataError> {
    write_files([(path, bytes)])
}

/// [`write_file`] of several files, all of them or none.
///
/// # Errors
/// [`DataError::Io`] of the first that cannot be written; all old files are then as they were.
pub fn write_files<P: AsRef<Path>, B: AsRef<[u8]>>(
    files: impl IntoIterator<Item = (P, B)>,
) -> Result<(), DataError> {
    let mut staged = Staged::default();
    for (path, bytes) in files {
        staged.file(path.as_ref(), bytes.as_ref())?;
    }
    staged.commit()
}

/// Files written next to their places, which [`commit`](Self::commit) renames one after the other.
/// Whatever can fail for long (a full disk, a folder that may not be written) fails before the
/// first rename. Dropped without it, nothing has changed.
#[derive(Default)]
pub(crate) struct Staged {
    files: Vec<(TempPath, PathBuf)>,
    /// Those that did not exist before, parents first.
    folders: Vec<PathBuf>,
}

impl Staged {
    /// Creates a folder and those above it.
    pub fn folder(&mut self, path: &Path) -> Result<(), DataError> {
        let mut missing: Vec<_> = (path.ancestors())
            .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
            .collect();
        missing.reverse();
        self.folders.extend(missing.into_iter().map(Path::to_owned));
        fs::create_dir_all(path).map_err(|e| DataError::io("create", path, e))
    }

    /// Writes the new content of a file, in a folder that exists.
    pub fn file(&mut self, path: &Path, bytes: &[u8]) -> Result<(), DataError> {
        let failed = |e| DataError::io("write", path, e);
        let place = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        if let Ok(old) = place.metadata() {
            if !old.is_file() && !old.is_dir() {
                return fs::write(&place, bytes).map_err(failed);
            }
            if old.is_dir() {
                return Err(failed(Error::new(
                    ErrorKind::IsADirectory,
                    "it is a folder",
                )));
            }
            if old.permissions().readonly() {
                let why = "it is marked read-only";
                return Err(failed(Error::new(ErrorKind::PermissionDenied, why)));
            }
        }
        let folder = match place.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let mut options = tempfile::Builder::new();
        options.prefix(".vsf-").suffix(".part");
        // Readable as any other file is, not only by its owner as temporary files are.
        #[cfg(unix)]
        options.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = options.tempfile_in(folder).map_err(failed)?;
        // Not through the wrapper, which adds its own name to errors.
        file.as_file_mut().write_all(bytes).map_err(failed)?;
        file.as_file().sync_all().map_err(failed)?;
        self.files.push((file.into_temp_path(), place));
        Ok(())
    }

    /// Whether this file is to be written.
    pub fn holds(&self, path: &Path) -> bool {
        let place = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        self.files.iter().any(|(_, p)| *p == place)
    }

    /// Puts all files in their places, in the order in which they were written.
    pub fn commit(mut self) -> Result<(), DataError> {
        for (file, place) in self.files.drain(..) {
            file.persist(&place)
                .map_err(|e| DataError::io("write", place, e.error))?;
        }
        self.folders.clear();
        Ok(())
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        self.files.clear();
        for folder in self.folders.iter().rev() {
            // A folder that someone else uses by now stays.
            let _ = fs::remove_dir(folder);
        }
    }
}
