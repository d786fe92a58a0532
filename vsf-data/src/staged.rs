//! Files that are written together or not at all.

use crate::{DataError, files};
use std::ffi::OsString;
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
/// that is killed hidden files stay that are in nobody's way, and during the renames a folder that lacks
/// the file that is written last.
#[derive(Default)]
pub(crate) struct Staged {
    files: Vec<(TempPath, PathBuf)>,
    /// Those to create, and what was in those that were there.
    folders: Vec<(PathBuf, Option<Vec<OsString>>)>,
}

impl Staged {
    /// A folder to create, and those above it.
    pub fn folder(&mut self, path: &Path) -> Result<(), DataError> {
        if (path.ancestors().find(|p| p.exists())).is_some_and(|p| !p.is_dir()) {
            let error = ErrorKind::NotADirectory.into();
            return Err(DataError::io("create", path, error));
        }
        let known = path.exists().then(|| visible(path));
        self.folders.push((path.to_owned(), known.transpose()?));
        Ok(())
    }

    /// Writes the new content of a file, in a folder that exists or is to be created.
    pub fn file(&mut self, path: &Path, bytes: &[u8]) -> Result<(), DataError> {
        let failed = |e| DataError::io("write", path, e);
        let place = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        if place.is_symlink() {
            let why = "it is a link that leads nowhere";
            return Err(failed(Error::new(ErrorKind::NotFound, why)));
        }
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
        let mut options = hidden();
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

    /// Puts all files in their places, in the order in which they were written; refused where another program has
    /// changed the folders meanwhile.
    pub fn commit(self) -> Result<(), DataError> {
        // Two programs at once must not mix in one folder.
        let mixed = |folder: &Path| {
            let why = "another program has written there meanwhile";
            DataError::io(
                "write to",
                folder,
                Error::new(ErrorKind::AlreadyExists, why),
            )
        };
        for (folder, known) in &self.folders {
            if let Some(known) = known
                && visible(folder)? != *known
            {
                return Err(mixed(folder));
            }
        }
        let mut created = Created::default();
        for (folder, _) in self.folders.iter().filter(|(_, known)| known.is_none()) {
            if !created.folder(folder)? {
                return Err(mixed(folder));
            }
        }
        // A process that is killed from here on leaves a folder that lacks its last file and cannot be read, not one of
        // old and new files that can.
        let last = self.files.last().map(|(_, place)| place.clone());
        let aside = match last.filter(|_| self.files.len() > 1 && !self.folders.is_empty()) {
            Some(last) => Aside::put(&last)?,
            None => None,
        };
        for (file, place) in self.files {
            file.persist(&place)
                .map_err(|e| DataError::io("write", place, e.error))?;
        }
        created.0.clear();
        if let Some(aside) = aside {
            aside.remove();
        }
        Ok(())
    }
}

/// A file that is to be replaced, under another name until then; it comes back where it is dropped.
struct Aside {
    file: Option<TempPath>,
    place: PathBuf,
}

impl Aside {
    /// Nothing where there is no such file.
    fn put(place: &Path) -> Result<Option<Self>, DataError> {
        if !place.is_file() {
            return Ok(None);
        }
        let failed = |e| DataError::io("write", place, e);
        let folder = place.parent().unwrap_or(place);
        let file = hidden().tempfile_in(folder).map_err(failed)?;
        let file = file.into_temp_path();
        fs::rename(place, &file).map_err(failed)?;
        let (file, place) = (Some(file), place.to_owned());
        Ok(Some(Self { file, place }))
    }

    /// Drops the old file.
    fn remove(mut self) {
        self.file = None;
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            // Failing this, it stays under its other name.
            let _ = file.persist(&self.place).map_err(|e| e.path.keep());
        }
    }
}

/// Files that are in nobody's way: readers do not see names that begin with a dot.
fn hidden() -> tempfile::Builder<'static, 'static> {
    let mut options = tempfile::Builder::new();
    options.prefix(".vsf-").suffix(".part");
    options
}

/// The names in a folder but those that begin with a dot, such as files of other programs to come.
fn visible(folder: &Path) -> Result<Vec<OsString>, DataError> {
    let names = files::list(folder)?.into_iter();
    let names = names.filter_map(|path| path.file_name().map(ToOwned::to_owned));
    Ok(names
        .filter(|n| !n.as_encoded_bytes().starts_with(b"."))
        .collect())
}

/// Folders that did not exist before, parents first; they go where they are not cleared.
#[derive(Default)]
struct Created(Vec<PathBuf>);

impl Created {
    /// Creates a folder and those above it; false where another program did.
    fn folder(&mut self, path: &Path) -> Result<bool, DataError> {
        let mut missing: Vec<_> = (path.ancestors())
            .take_while(|p| !p.as_os_str().is_empty() && !p.exists())
            .collect();
        missing.reverse();
        for folder in missing {
            match fs::create_dir(folder) {
                Ok(()) => self.0.push(folder.to_owned()),
                Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
                Err(e) => return Err(DataError::io("create", path, e)),
            }
        }
        Ok(self.0.iter().any(|p| p == path))
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

    /// What is written last tells whether a folder is whole: it is away while others are replaced, and comes back where
    /// one cannot be.
    #[test]
    fn a_replacement_that_fails_leaves_the_last_file() {
        let home = tempfile::tempdir().unwrap();
        for name in ["a", "last"] {
            fs::write(home.path().join(name), b"old").unwrap();
        }
        let mut staged = Staged::default();
        staged.folder(home.path()).unwrap();
        for name in ["a", "last"] {
            staged.file(&home.path().join(name), b"new").unwrap();
        }
        // A folder in the place of a file.
        fs::remove_file(home.path().join("a")).unwrap();
        fs::create_dir(home.path().join("a")).unwrap();
        staged.commit().unwrap_err();
        assert_eq!(fs::read(home.path().join("last")).unwrap(), b"old");
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 2);
    }

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
        // A folder that was there is written to, unless it has changed.
        let (first, second) = (stage(), stage());
        first.commit().unwrap();
        assert_eq!(fs::read(folder.join("a")).unwrap(), b"ours");
        fs::write(folder.join("b"), b"theirs").unwrap();
        assert!(second.commit().is_err());
    }
}
