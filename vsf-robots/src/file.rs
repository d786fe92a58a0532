use crate::RobotError;
use std::fs::File;
use std::io::{Error, ErrorKind, Read};
use std::path::Path;

/// Reads a file of at most `most` bytes. A robot description may name any path, also an endless device.
pub(crate) fn read(path: &Path, most: u64) -> Result<Vec<u8>, RobotError> {
    let read = || {
        let mut bytes = Vec::new();
        let kind = path.metadata()?.file_type();
        if !kind.is_file() && !kind.is_dir() {
            // Pipes wait.
            let why = "it is a pipe or a device; save it as a file";
            return Err(Error::new(ErrorKind::InvalidInput, why));
        }
        File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > most {
            let why = format!("it is longer than {most} bytes");
            return Err(Error::new(ErrorKind::FileTooLarge, why));
        }
        Ok(bytes)
    };
    read().map_err(|source| RobotError::Read {
        path: path.to_owned(),
        source,
    })
}
