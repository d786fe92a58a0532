//! Where a command writes, told before it reads or works: it replaces nothing that it reads, nothing of its own
//! twice, and no files of others or of another kind.

use crate::exit::usage;
use crate::file_kind::FileKind;
use anyhow::Context;
use std::cell::RefCell;
use std::fs::{DirEntry, File};
use std::io::{Error, ErrorKind};
use std::path::{Component, Path, PathBuf};

/// The places that a command writes to, each with its flag.
#[derive(Default)]
pub struct Outputs {
    claimed: RefCell<Vec<(&'static str, PathBuf)>>,
    /// Pipes among them, open until the end: whoever reads one leaves when it is closed.
    pipes: RefCell<Vec<File>>,
}

impl Outputs {
    /// Claims a file in a folder that exists, new or of a kind that is replaced.
    pub fn file(
        &self,
        flag: &'static str,
        path: &Path,
        kind: Option<FileKind>,
    ) -> anyhow::Result<()> {
        if names_folder(path) || !opened(path.parent().unwrap_or(path)).is_dir() {
            let why = format!("{flag} must name a file in a folder that exists");
            return Err(Error::new(ErrorKind::NotFound, why)).with_context(|| cannot(flag, path));
        }
        self.claim(flag, path)?;
        kind.map_or(Ok(()), |kind| kind.check(flag, path))
    }

    /// Claims a file, new or of its kind; folders above it that are missing will be created.
    pub fn file_anywhere(
        &self,
        flag: &'static str,
        path: &Path,
        kind: FileKind,
    ) -> anyhow::Result<()> {
        if names_folder(path) {
            return Err(usage(format!("{flag} {}: it is a folder", path.display())));
        }
        self.claim(flag, path)?;
        kind.check(flag, path)
    }

    /// Claims a folder. Refused is one that holds a name that is `odd`, or a link; `what` may be replaced there. Names
    /// that begin with a dot do not count: a killed command leaves such.
    pub fn folder(
        &self,
        flag: &'static str,
        path: &Path,
        what: &str,
        odd: impl Fn(&[String]) -> Option<&String>,
    ) -> anyhow::Result<()> {
        self.claim(flag, path)?;
        if path.exists() && !path.is_dir() {
            return Err(usage(format!("{flag} {}: it is no folder", path.display())));
        }
        let names = if path.exists() {
            names_in(path).with_context(|| format!("cannot list {flag} {}", path.display()))?
        } else {
            Vec::new()
        };
        if let Some(name) = odd(&names) {
            return Err(usage(format!(
                "{flag} {} holds other files ({name:?}); choose a new or empty folder, or {what} to replace",
                path.display()
            )));
        }
        match names.iter().find(|name| path.join(name).is_symlink()) {
            Some(name) => Err(usage(format!(
                "{flag}: {} is a link, and what it leads to would be changed; remove it or choose another folder",
                path.join(name).display()
            ))),
            None => Ok(()),
        }
    }

    /// Refuses outputs in the place of something that is read, or inside of it.
    pub fn keep(&self, input: &Path) -> anyhow::Result<()> {
        let claimed = self.claimed.borrow();
        let lost = |(_, path): &&(&str, PathBuf)| place(path).starts_with(place(input));
        match claimed.iter().find(lost) {
            Some((flag, path)) => Err(usage(format!(
                "{flag} {} would change {}, which is read",
                path.display(),
                input.display()
            ))),
            None => Ok(()),
        }
    }

    fn claim(&self, flag: &'static str, path: &Path) -> anyhow::Result<()> {
        if path.as_os_str() == "-" {
            return Err(usage(format!(
                "{flag} writes to no standard output; name a file or folder (./- for one of that name)"
            )));
        }
        writable(path).with_context(|| cannot(flag, path))?;
        let pipe = open_pipe(path).with_context(|| cannot(flag, path))?;
        self.pipes.borrow_mut().extend(pipe);
        let mut claimed = self.claimed.borrow_mut();
        let here = place(path);
        for (other_flag, other) in claimed.iter() {
            let there = place(other);
            if here == there {
                return Err(usage(format!("{other_flag} and {flag} name the same file")));
            }
            if here.starts_with(&there) || there.starts_with(&here) {
                return Err(usage(format!(
                    "{other_flag} {} and {flag} {}: one lies in the other",
                    other.display(),
                    path.display()
                )));
            }
        }
        claimed.push((flag, path.to_owned()));
        Ok(())
    }
}

/// The names in a folder in order, but for those that begin with a dot.
fn names_in(folder: &Path) -> Result<Vec<String>, Error> {
    let name =
        |entry: Result<DirEntry, Error>| Ok(entry?.file_name().to_string_lossy().into_owned());
    let names: Result<Vec<String>, Error> = folder.read_dir()?.map(name).collect();
    let mut names = names?;
    names.retain(|name| !name.starts_with('.'));
    names.sort_unstable();
    Ok(names)
}

/// In a folder that may hold anything beside one of these, the first name where none of them is.
pub fn unmarked<'a>(names: &'a [String], marks: &[&str]) -> Option<&'a String> {
    let is_marked = names.iter().any(|name| marks.contains(&name.as_str()));
    names.first().filter(|_| !is_marked)
}

/// Where a file or folder is or would be, with links followed as far as it is there.
pub fn place(path: &Path) -> PathBuf {
    let real = |base| Some((opened(base).canonicalize().ok()?, base));
    let found = path.ancestors().find_map(real);
    let rest = |base: &Path| path.strip_prefix(base).map(Path::to_owned).ok();
    found
        .and_then(|(real, base)| Some(real.join(rest(base)?)))
        .unwrap_or_else(|| path.to_owned())
}

fn cannot(flag: &str, path: &Path) -> String {
    format!("cannot write {flag} {}", path.display())
}

/// A folder by a path that opens it: `.` where it is empty, as that above a name alone.
fn opened(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    }
}

/// Whether a path is that of a folder, or is written as of one, with a slash at its end.
fn names_folder(path: &Path) -> bool {
    let last = path.as_os_str().as_encoded_bytes().last();
    path.is_dir() || last.is_some_and(|b| std::path::is_separator(char::from(*b)))
}

/// Opens a pipe. One that nobody reads would have to be waited for, perhaps for ever.
#[cfg(unix)]
fn open_pipe(path: &Path) -> Result<Option<File>, Error> {
    use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
    if !path.metadata().is_ok_and(|m| m.file_type().is_fifo()) {
        return Ok(None);
    }
    let mut options = File::options();
    let opened = options.write(true).custom_flags(libc::O_NONBLOCK);
    match opened.open(path) {
        Err(e) if e.raw_os_error() == Some(libc::ENXIO) => {
            let why = "it is a pipe that nothing reads; start its reader first, or name a file";
            Err(Error::new(ErrorKind::NotConnected, why))
        }
        opened => opened.map(Some),
    }
}

#[cfg(not(unix))]
fn open_pipe(_: &Path) -> Result<Option<File>, Error> {
    Ok(None)
}

/// Refuses what could not be written in the end: names that no file can have, what lies below a file or in a folder
/// that is closed, files marked read-only. Pipes and devices are left to be tried.
fn writable(path: &Path) -> Result<(), Error> {
    match path.symlink_metadata() {
        Ok(found) if found.is_symlink() && !path.exists() => {
            let why = "it is a link that leads nowhere";
            return Err(Error::new(ErrorKind::NotFound, why));
        }
        Ok(_) => {}
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {}
        Err(e) => return Err(e),
    }
    let found = path.metadata().ok();
    if let Some(there) = found.as_ref().filter(|m| !m.is_dir()) {
        if !there.is_file() {
            return Ok(());
        }
        if there.permissions().readonly() {
            let why = "it is marked read-only";
            return Err(Error::new(ErrorKind::PermissionDenied, why));
        }
    }
    let to_come = |base: &&Path| !base.exists() && !base.as_os_str().is_empty();
    let is_folder = found.is_some_and(|m| m.is_dir());
    let mut above = path.ancestors().skip(usize::from(!is_folder));
    let base = above.find(|base| !to_come(base)).unwrap_or(path);
    let rest = path.strip_prefix(base).unwrap_or(path);
    // Where it leads is known only once the folder before it has been created.
    if rest.components().any(|c| c == Component::ParentDir) {
        let why = "`..` stands behind a folder that does not exist";
        return Err(Error::new(ErrorKind::InvalidInput, why));
    }
    let base = opened(base);
    if !base.is_dir() {
        let why = format!("{} is no folder", base.display());
        return Err(Error::new(ErrorKind::NotADirectory, why));
    }
    tempfile::Builder::new()
        .prefix(".vsf-")
        .tempfile_in(base)
        .map(drop)
}
