//! Files that are written together or not at all.

use crate::{DataError, edits, files};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{Error, ErrorKind, Write};
use std::path::{Component, Path, PathBuf};
use std::time::Duration;
use tempfile::{TempDir, TempPath};

/// Prefix of the names of hidden files.
const PREFIX: &str = ".vsf-";
const SUFFIX: &str = ".part";
/// No write takes this long: hidden files of this age are left over from a killed process.
const STALE: Duration = Duration::from_secs(3600);

/// Replaces the file `path` atomically. Readers find the old bytes or the new ones, even after the process is killed.
///
/// A link is followed. A device or a pipe is written to directly. A file that is marked read-only is kept.
///
/// # Errors
/// [`DataError::Io`]; the old file is then unchanged.
pub fn write_file(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), DataError> {
    write_files([(path, bytes)])
}

/// [`write_file`] for several files. None is replaced before all of them can be.
///
/// # Errors
/// [`DataError::Io`] for the first file that cannot be written; all old files are then unchanged. If only a rename is
/// refused (for example over a file of another user in `/tmp`), the files before it are new.
pub fn write_files<P: AsRef<Path>, B: AsRef<[u8]>>(
    files: impl IntoIterator<Item = (P, B)>,
) -> Result<(), DataError> {
    let mut staged = Staged::default();
    for (path, bytes) in files {
        staged.file(path.as_ref(), bytes.as_ref())?;
    }
    staged.commit()
}

/// Writes files to `folder`, given by their paths in it, all or none. Missing folders are created.
///
/// The folder itself may be a link; a link within it is not followed.
///
/// # Errors
/// [`DataError::Link`], [`DataError::Io`]; all old files are then unchanged, except for renames as in [`write_files`].
pub fn write_folder<P: AsRef<Path>, B: AsRef<[u8]>>(
    folder: impl AsRef<Path>,
    files: impl IntoIterator<Item = (P, B)>,
) -> Result<(), DataError> {
    let folder = folder.as_ref();
    let mut staged = Staged::below(folder)?;
    for (path, bytes) in files {
        staged.file(&folder.join(path), bytes.as_ref())?;
    }
    staged.commit()
}

/// Files written under hidden names, which [`commit`](Self::commit) renames.
///
/// Lasting failures (a full disk, a folder without write permission) occur before the renaming. Dropping it without a
/// commit changes nothing. A killed process leaves hidden files that are in nobody's way, and that a later write to that
/// folder removes.
///
/// A new folder gets its name once it is complete. In an existing folder, files are replaced one after the other. A process
/// killed meanwhile leaves it without the file that is written last.
#[derive(Default)]
pub(crate) struct Staged {
    /// The folder of all files, if they have one in common.
    folder: Option<Folder>,
    files: Vec<(TempPath, PathBuf)>,
    /// Files to remove, unless they are written.
    removed: Vec<PathBuf>,
    /// Digests of the files written to the folder.
    written: edits::Files,
}

struct Folder {
    given: PathBuf,
    /// The target of the folder's path.
    place: PathBuf,
    state: State,
}

enum State {
    /// A folder to be created; its files are here until then.
    New(TempDir),
    /// The names in an existing folder.
    There(Vec<OsString>),
}

impl Staged {
    /// For files in a folder, which is created with its parents if it does not exist.
    pub fn below(folder: &Path) -> Result<Self, DataError> {
        let failed = |e| DataError::io("create", folder, e);
        if folder.is_symlink() && !folder.exists() {
            return Err(failed(nowhere()));
        }
        let state = if folder.is_dir() {
            State::There(visible(folder)?)
        } else if folder.exists() {
            return Err(failed(ErrorKind::NotADirectory.into()));
        } else {
            let mut options = hidden();
            #[cfg(unix)]
            options.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
            let above = existing(folder);
            State::New(options.tempdir_in(above).map_err(failed)?)
        };
        let folder = Folder {
            given: folder.to_owned(),
            place: folder.canonicalize().unwrap_or_else(|_| folder.to_owned()),
            state,
        };
        Ok(Self {
            folder: Some(folder),
            ..Self::default()
        })
    }

    /// Writes the new content of a file.
    pub fn file(&mut self, path: &Path, bytes: &[u8]) -> Result<(), DataError> {
        let failed = |e| DataError::io("write", path, e);
        let place = self.place_of(path)?;
        if let Some(Ok(inside)) = self.folder.as_ref().map(|f| path.strip_prefix(&f.given)) {
            self.written.insert(inside.to_owned(), blake3::hash(bytes));
        }
        if self.is_new() {
            fs::create_dir_all(parent(&place)).map_err(failed)?;
            let mut file = File::create_new(&place).map_err(failed)?;
            file.write_all(bytes).map_err(failed)?;
            return file.sync_all().map_err(failed);
        }
        // Those of /dev and /proc to a pipe have no other path, and are written through.
        if place.is_symlink() && !place.exists() {
            return Err(failed(nowhere()));
        }
        let old = place.metadata().ok();
        if let Some(old) = &old {
            if !old.is_file() && !old.is_dir() {
                if self.folder.is_some() {
                    let why = "a pipe or device lies there";
                    return Err(failed(Error::new(ErrorKind::InvalidInput, why)));
                }
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
        let above = match &self.folder {
            Some(_) => existing(&place),
            None => parent(&place),
        };
        let mut options = hidden();
        // Readable as any other file is, not only by its owner as temporary files are.
        #[cfg(unix)]
        options.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = options.tempfile_in(above).map_err(failed)?;
        // Not through the wrapper, which adds its own name to errors.
        file.as_file_mut().write_all(bytes).map_err(failed)?;
        // What is replaced stays as private, or as open to a group, as it was.
        if let Some(old) = old {
            let kept = file.as_file().set_permissions(old.permissions());
            kept.map_err(failed)?;
        }
        file.as_file().sync_all().map_err(failed)?;
        self.files.push((file.into_temp_path(), place));
        Ok(())
    }

    /// Marks a file for removal, if there is one and nothing is written in its place.
    pub fn remove(&mut self, path: &Path) -> Result<(), DataError> {
        self.removed.push(self.place_of(path)?);
        Ok(())
    }

    fn place_of(&self, path: &Path) -> Result<PathBuf, DataError> {
        match &self.folder {
            Some(folder) => folder.place_of(path),
            None => Ok(path.canonicalize().unwrap_or_else(|_| path.to_owned())),
        }
    }

    /// Digests of the files written to the folder so far.
    pub fn written(&self) -> &edits::Files {
        &self.written
    }

    /// Whether this file of the folder will be written.
    pub fn holds(&self, path: &Path) -> bool {
        let place = self.folder.as_ref().and_then(|f| f.place_of(path).ok());
        place.is_some_and(|place| {
            if self.is_new() {
                place.is_file()
            } else {
                self.files.iter().any(|(_, p)| *p == place)
            }
        })
    }

    fn is_new(&self) -> bool {
        let state = self.folder.as_ref().map(|folder| &folder.state);
        matches!(state, Some(State::New(_)))
    }

    /// Moves all files to their places, in the order in which they were written, and removes those marked for removal.
    /// Refused if another program has changed the folder meanwhile.
    pub fn commit(self) -> Result<(), DataError> {
        let mut created = Created::default();
        let mut aside = None;
        if let Some(folder) = self.folder {
            // Two programs at once must not mix in one folder.
            let mixed = || {
                let why = "another program has written there meanwhile";
                let error = Error::new(ErrorKind::AlreadyExists, why);
                DataError::io("write to", &folder.given, error)
            };
            match folder.state {
                State::New(whole) => {
                    let place = &folder.place;
                    created.folder(parent(place))?;
                    fs::rename(whole.path(), place).map_err(|e| {
                        if place.exists() {
                            mixed()
                        } else {
                            DataError::io("create", place, e)
                        }
                    })?;
                    // It has its name, and goes no more.
                    let _ = whole.keep();
                    created.0.clear();
                    remove_stale(parent(place));
                    return Ok(());
                }
                State::There(known) if visible(&folder.place)? != known => return Err(mixed()),
                State::There(_) => {}
            }
            for (_, place) in &self.files {
                created.folder(parent(place))?;
            }
            // A process that is killed from here on leaves a folder that lacks its last file and cannot be read, not one
            // of old and new files that can.
            if let [_, .., (_, last)] = &self.files[..] {
                aside = Aside::put(last)?;
            }
        }
        let is_written = |place: &PathBuf| self.files.iter().any(|(_, p)| p == place);
        let removed = self.removed.iter().filter(|place| !is_written(place));
        let removed = removed.map(|place| Aside::put(place));
        let removed = removed.collect::<Result<Vec<_>, _>>()?;
        let mut above = BTreeSet::new();
        for (file, place) in self.files {
            above.extend(file.parent().map(ToOwned::to_owned));
            file.persist(&place)
                .map_err(|e| DataError::io("write", place, e.error))?;
        }
        created.0.clear();
        aside.into_iter().for_each(Aside::remove);
        removed.into_iter().flatten().for_each(Aside::remove);
        above.iter().for_each(|folder| remove_stale(folder));
        Ok(())
    }
}

impl Folder {
    /// The place of a file in the folder. It must neither be a link nor lie behind one, since the file would then belong
    /// elsewhere.
    fn place_of(&self, path: &Path) -> Result<PathBuf, DataError> {
        let inside = path.strip_prefix(&self.given).ok();
        let plain = |p: &&Path| p.components().all(|c| matches!(c, Component::Normal(_)));
        let Some(inside) = inside.filter(plain) else {
            let why = format!("it is not in {}", self.given.display());
            let error = Error::new(ErrorKind::InvalidInput, why);
            return Err(DataError::io("write", path, error));
        };
        if let State::New(whole) = &self.state {
            return Ok(whole.path().join(inside));
        }
        let inner = inside.components().count();
        match path.ancestors().take(inner).find(|p| p.is_symlink()) {
            Some(link) => Err(DataError::Link {
                path: link.to_owned(),
            }),
            None => Ok(self.place.join(inside)),
        }
    }
}

fn nowhere() -> Error {
    Error::new(ErrorKind::NotFound, "it is a link that leads nowhere")
}

/// The folder of a path; `.` for a bare name.
fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(above) if !above.as_os_str().is_empty() => above,
        _ => Path::new("."),
    }
}

/// The nearest existing folder above a path.
fn existing(path: &Path) -> &Path {
    let mut above = path.ancestors().skip(1);
    match above.find(|p| p.exists()) {
        Some(found) => found,
        None => Path::new("."),
    }
}

/// A file to be replaced or removed, under another name until then. Dropping it restores the file.
struct Aside {
    file: Option<TempPath>,
    place: PathBuf,
}

impl Aside {
    /// `None` if there is no such file.
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

    /// Deletes the old file.
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

/// Builder of hidden files. They are in nobody's way, since readers ignore names that begin with a dot.
fn hidden() -> tempfile::Builder<'static, 'static> {
    let mut options = tempfile::Builder::new();
    options.prefix(PREFIX).suffix(SUFFIX);
    options
}

/// The hidden files and folders in a folder, left over or being written.
pub(crate) fn hidden_in(folder: &Path) -> Vec<PathBuf> {
    let is_hidden = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().as_encoded_bytes();
        name.starts_with(PREFIX.as_bytes()) && name.ends_with(SUFFIX.as_bytes())
    };
    let all = files::list(folder).unwrap_or_default();
    all.into_iter().filter(is_hidden).collect()
}

/// Removes what killed processes left in a folder. What cannot be removed is in nobody's way.
fn remove_stale(folder: &Path) {
    for path in hidden_in(folder) {
        let Ok(found) = path.symlink_metadata() else {
            continue;
        };
        let age = found.modified().ok().and_then(|t| t.elapsed().ok());
        if age.is_some_and(|age| age > STALE) {
            let _ = if found.is_dir() {
                fs::remove_dir_all(&path)
            } else {
                fs::remove_file(&path)
            };
        }
    }
}

/// The names in a folder that do not begin with a dot; the latter may be files that other programs are writing.
fn visible(folder: &Path) -> Result<Vec<OsString>, DataError> {
    let names = files::list(folder)?.into_iter();
    let names = names.filter_map(|path| path.file_name().map(ToOwned::to_owned));
    Ok(names
        .filter(|n| !n.as_encoded_bytes().starts_with(b"."))
        .collect())
}

/// Folders that were created, parents first. They are removed on drop unless the list is cleared.
#[derive(Default)]
struct Created(Vec<PathBuf>);

impl Created {
    /// Creates a folder and its parents.
    fn folder(&mut self, path: &Path) -> Result<(), DataError> {
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
        Ok(())
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
        let mut staged = Staged::below(home.path()).unwrap();
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
    fn files_are_removed_with_the_others_or_not_at_all() {
        let home = tempfile::tempdir().unwrap();
        let at = |name: &str| home.path().join(name);
        for name in ["a", "gone", "last"] {
            fs::write(at(name), b"old").unwrap();
        }
        let stage = || {
            let mut staged = Staged::below(home.path()).unwrap();
            for name in ["gone", "never_there", "last"] {
                staged.remove(&at(name)).unwrap();
            }
            for name in ["a", "last"] {
                staged.file(&at(name), b"new").unwrap();
            }
            staged
        };
        drop(stage());
        assert_eq!(fs::read(at("gone")).unwrap(), b"old");
        let staged = stage();
        fs::remove_file(at("a")).unwrap();
        fs::create_dir(at("a")).unwrap();
        staged.commit().unwrap_err();
        assert_eq!(fs::read(at("gone")).unwrap(), b"old");
        fs::remove_dir(at("a")).unwrap();
        fs::write(at("a"), b"old").unwrap();
        stage().commit().unwrap();
        assert!(!at("gone").exists());
        assert_eq!(fs::read(at("last")).unwrap(), b"new");
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 2);
        let mut outside = Staged::below(home.path()).unwrap();
        outside.remove(&at("../gone")).unwrap_err();
    }

    #[test]
    fn what_another_program_made_meanwhile_is_left_alone() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("new");
        let stage = || {
            let mut staged = Staged::below(&folder).unwrap();
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

    /// A folder that is new is nowhere until it is whole, and its files are in no other's way.
    #[test]
    fn a_new_folder_comes_whole() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("above/new");
        let mut staged = Staged::below(&folder).unwrap();
        let (inner, last) = (folder.join("inner/a"), folder.join("last"));
        staged.file(&inner, b"a").unwrap();
        assert!(staged.holds(&inner) && !staged.holds(&last));
        staged.file(&last, b"b").unwrap();
        assert!(!home.path().join("above").exists());
        staged.commit().unwrap();
        assert_eq!(fs::read(inner).unwrap(), b"a");
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1);
    }

    #[test]
    fn nothing_is_written_outside_of_the_folder() {
        let home = tempfile::tempdir().unwrap();
        for name in ["../a", "/a"] {
            write_folder(home.path(), [(name, b"new")]).unwrap_err();
            write_folder(home.path().join("new"), [(name, b"new")]).unwrap_err();
        }
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_to_a_folder_and_not_in_it() {
        use std::os::unix::fs::symlink;
        let home = tempfile::tempdir().unwrap();
        let at = |name: &str| home.path().join(name);
        fs::create_dir_all(at("kept/inner")).unwrap();
        fs::create_dir(at("out")).unwrap();
        fs::write(at("kept/inner/a"), b"old").unwrap();
        symlink("../kept/inner", at("out/inner")).unwrap();
        symlink("../kept/inner/a", at("out/a")).unwrap();
        symlink("nowhere", at("out/b")).unwrap();
        for (name, link) in [("inner/a", "inner"), ("a", "a"), ("b", "b")] {
            let files = [("first", b"new"), (name, b"new")];
            let error = write_folder(at("out"), files).unwrap_err();
            assert!(
                matches!(&error, DataError::Link { path } if *path == at("out").join(link)),
                "{error}"
            );
        }
        assert_eq!(fs::read(at("kept/inner/a")).unwrap(), b"old");
        assert_eq!(fs::read_dir(at("out")).unwrap().count(), 3);
        symlink("kept", at("to_kept")).unwrap();
        write_folder(at("to_kept"), [("inner/a", b"new")]).unwrap();
        assert_eq!(fs::read(at("kept/inner/a")).unwrap(), b"new");
    }

    #[test]
    fn what_killed_processes_left_goes_in_time() {
        let home = tempfile::tempdir().unwrap();
        let at = |name: &str| home.path().join(name);
        let names = [".vsf-old.part", ".vsf-new.part", ".vsf-other", "a.part"];
        for name in names {
            let file = File::create(at(name)).unwrap();
            if name != ".vsf-new.part" {
                let time = std::time::SystemTime::now() - 2 * STALE;
                file.set_modified(time).unwrap();
            }
        }
        write_file(at("a"), b"a").unwrap();
        let there = names.map(|name| at(name).exists());
        assert_eq!(there, [false, true, true, true]);
    }
}
