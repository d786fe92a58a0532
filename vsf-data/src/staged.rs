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

/// Files written next to their places, or to the folders to come, which [`commit`](Self::commit)
/// creates and renames one after the other. Whatever can fail for long (a full disk, a folder that may
/// not be written) fails before the first rename. Dropped without it, nothing has changed; of a process
/// that is killed hidden files stay that are in nobody's way.
#[derive(Default)]
pub(crate) struct Staged {
    files: Vec<(TempPath, PathBuf)>,
    /// Those to create, and whether they were there.
    folders: Vec<(PathBuf, bool)>,
}

impl Staged {
    /// A folder to create, and those above it.
    pub fn folder(&mut self, path: &Path) -> Result<(), DataError> {
        if (path.ancestors().find(|p| p.exists())).is_some_and(|p| !p.is_dir()) {
            let error = ErrorKind::NotADirectory.into();
            return Err(DataError::io("create", path, error));
        }
        self.folders.push((path.to_owned(), path.exists()));
        Ok(())
    }

    /// Writes the new content of a file, in a folder that exists or is to be created.
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
        let to_come = |p: &&Path| !p.exists() && self.folders.iter().any(|(f, _)| f.starts_with(p));
        let mut above = place.ancestors().skip(1).skip_while(to_come);
        let folder = match above.next() {
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

    /// Puts all files in their places, in the order in which they were written; refused where a folder that was to be
    /// created has come into being meanwhile.
    pub fn commit(self) -> Result<(), DataError> {
        // Two programs at once must not mix in one folder.
        if let Some((folder, _)) = (self.folders.iter()).find(|(f, known)| !known && f.exists()) {
            let why = "another program has made it meanwhile";
            let error = Error::new(ErrorKind::AlreadyExists, why);
            return Err(DataError::io("create", folder, error));
        }
        let mut created = Created::default();
        for (folder, _) in &self.folders {
            created.folder(folder)?;
        }
        for (file, place) in self.files {
            file.persist(&place)
                .map_err(|e| DataError::io("write", place, e.error))?;
        }
        created.0.clear();
        Ok(())
    }
}

/// Folders that did not exist before, parents first; they go where they are not cleared.
#[derive(Default)]
struct Created(Vec<PathBuf>);

impl Created {
    fn folder(&mut self, path: &Path) -> Result<(), DataError> {
        let mut missing: Vec<_> = (path.ancestors())
            .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
            .collect();
        missing.reverse();
        self.0.extend(missing.into_iter().map(Path::to_owned));
        fs::create_dir_all(path).map_err(|e| DataError::io("create", path, e))
    }
}

impl Drop for Created {
    fn drop(&mut self) {
        for folder in self.0.iter().rev() {
            // One that holds anything stays.
            let _ = fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn what_another_program_made_meanwhile_is_left_alone() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("new");
        let stage = || {
            let mut staged = Staged::default();
            staged.folder(&folder).unwrap();
            staged.file(&folder.join("a"), b"ours").unwrap();
            staged
        };
        let (first, second) = (stage(), stage());
        first.commit().unwrap();
        fs::write(folder.join("a"), b"theirs").unwrap();
        let error = second.commit().unwrap_err().to_string();
        assert!(error.contains("another program"), "{error}");
        assert_eq!(fs::read(folder.join("a")).unwrap(), b"theirs");
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1);
        // A folder that was there is written to.
        stage().commit().unwrap();
        assert_eq!(fs::read(folder.join("a")).unwrap(), b"ours");
    }
}
