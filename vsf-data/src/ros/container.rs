//! Reading of MCAP files, record by record, with any chunks and compression; and writing of messages and attachments.

use super::messages::Definition;
use super::wire::Reader;
use crate::{DataError, files};
use mcap::records::{MessageHeader, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{Attachment, McapError, WriteOptions, Writer, parse_record};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::Path;

pub(crate) use mcap::records::{Channel, Record, SchemaHeader};

/// Longest record or chunk. Memory is reserved by the length that a compressed chunk claims.
const MOST: usize = 256 << 20;

/// The first bytes of zstd-compressed data.
pub(crate) const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Calls `visit` for the schemas, channels, messages and attachments of a file, in its order. The file may be larger than
/// memory: one record or chunk is held at a time.
pub(crate) fn read(
    path: &Path,
    mut visit: impl FnMut(Record) -> Result<(), DataError>,
) -> Result<(), DataError> {
    let wrong = |problem: String| wrong(path, problem);
    let damaged = |e: McapError| wrong(in_words(e));
    let (file, mut left) = files::open(path)?;
    let mut file = BufReader::new(file);
    let start = file
        .fill_buf()
        .map_err(|e| DataError::io("read", path, e))?;
    if start.starts_with(&ZSTD) {
        let problem =
            "compressed as a whole, as by rosbag2 (compression mode file); `zstd -d` unpacks it";
        return Err(wrong(problem.to_owned()));
    }
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_record_length_limit(MOST);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.map_err(damaged)? {
            // Nothing is reserved that the file does not hold.
            LinearReadEvent::ReadRequest(need) if need as u64 > left => {
                return Err(damaged(McapError::UnexpectedEof));
            }
            LinearReadEvent::ReadRequest(need) => {
                let read = file.read_exact(reader.insert(need));
                read.map_err(|e| DataError::io("read", path, e))?;
                reader.notify_read(need);
                left -= need as u64;
            }
            LinearReadEvent::Record { opcode, data } if opcode == op::CHUNK => {
                check_chunk(data).map_err(wrong)?;
                let mut inside = chunk(data);
                while let Some(event) = inside.next_event() {
                    match event.map_err(damaged)? {
                        // All of the chunk is there already.
                        LinearReadEvent::ReadRequest(_) => inside.notify_read(0),
                        // Not where one may be: they are of a file, not of a chunk.
                        LinearReadEvent::Record { opcode, .. } if opcode == op::ATTACHMENT => {}
                        LinearReadEvent::Record { opcode, data } => {
                            one(opcode, data, &mut visit, wrong)?;
                        }
                    }
                }
            }
            LinearReadEvent::Record { opcode, data } => one(opcode, data, &mut visit, wrong)?,
        }
    }
    match left {
        0 => Ok(()),
        left => Err(wrong(format!(
            "{left} bytes after its end; several recordings are imported file by file"
        ))),
    }
}

fn one(
    opcode: u8,
    data: &[u8],
    visit: &mut impl FnMut(Record) -> Result<(), DataError>,
    wrong: impl Fn(String) -> DataError,
) -> Result<(), DataError> {
    match opcode {
        op::SCHEMA | op::CHANNEL | op::MESSAGE | op::ATTACHMENT => {
            check_lengths(opcode, data).map_err(&wrong)?;
            visit(parse_record(opcode, data).map_err(|e| wrong(in_words(e)))?)
        }
        _ => Ok(()),
    }
}

/// A reader of the records in a chunk, which checks their checksum.
fn chunk(data: &[u8]) -> LinearReader {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_validate_chunk_crcs(true)
        .with_record_length_limit(MOST);
    let mut reader = LinearReader::new_with_options(options);
    let length = (data.len() as u64).to_le_bytes();
    for part in [&[op::CHUNK][..], &length, data] {
        reader.insert(part.len()).copy_from_slice(part);
        reader.notify_read(part.len());
    }
    reader
}

/// Refuses records that reach beyond the end of an uncompressed chunk. The `mcap` crate (0.26) trusts their lengths.
fn check_chunk(data: &[u8]) -> Result<(), String> {
    let mut from = Reader::packed(data);
    from.bytes(8 + 8 + 8 + 4)?; // first and last time, size, sum
    if !from.text()?.is_empty() {
        return Ok(());
    }
    let size = length(&mut from)?;
    let mut records = Reader::packed(from.bytes(size)?);
    while records.left() > 0 {
        records.bytes(1)?;
        let size = length(&mut records)?;
        records.bytes(size)?;
    }
    Ok(())
}

/// Refuses a record that announces more than it holds. The `mcap` crate (0.26) reserves memory for texts of any length, and
/// takes the checksum of an attachment for granted.
fn check_lengths(opcode: u8, data: &[u8]) -> Result<(), String> {
    let mut from = Reader::packed(data);
    let mut skip = || match opcode {
        op::SCHEMA => {
            from.bytes(2)?; // number
            from.text()?;
            from.text().map(drop)
        }
        op::CHANNEL => {
            from.bytes(2 + 2)?; // numbers of channel and schema
            from.text()?;
            from.text()?;
            let size = from.u32()?;
            let mut metadata = Reader::packed(from.bytes(size as usize)?);
            while metadata.left() > 0 {
                // A name, and what it stands for.
                metadata.text()?;
                metadata.text()?;
            }
            Ok(())
        }
        op::ATTACHMENT => {
            from.bytes(8 + 8)?; // times of logging and creation
            from.text()?;
            from.text()?;
            let size = length(&mut from)?;
            from.bytes(size)?;
            from.bytes(4).map(drop) // sum
        }
        _ => Ok(()),
    };
    skip().map_err(|problem| format!("damaged MCAP: a record of kind {opcode}: {problem}"))
}

fn length(from: &mut Reader) -> Result<usize, String> {
    let length = from.u64()?;
    usize::try_from(length).map_err(|_| format!("{length} bytes are announced"))
}

fn in_words(e: McapError) -> String {
    match e {
        McapError::BadMagic => "no MCAP file, and not named .csv or .tsv; bags of ROS 1 and \
             SQLite bags of ROS 2 are converted by `mcap convert` or `ros2 bag convert`"
            .to_owned(),
        McapError::UnexpectedEof => {
            "the file ends in the middle of a record; `mcap recover` saves what is left of a \
             recording that was cut off"
                .to_owned()
        }
        other => format!("damaged MCAP: {other}"),
    }
}

/// An uncompressed output file: every reader accepts it, and sensor data hardly compress.
pub(crate) struct Output<'a> {
    /// For messages.
    path: &'a Path,
    writer: Writer<Cursor<Vec<u8>>>,
}

impl<'a> Output<'a> {
    pub fn new(path: &'a Path) -> Result<Self, DataError> {
        let options = WriteOptions::new()
            .profile("ros2")
            .library(crate::MADE_BY)
            .compression(None);
        let writer = options.create(Cursor::new(Vec::new()));
        let writer = writer.map_err(|e| wrong(path, e.to_string()))?;
        Ok(Self { path, writer })
    }

    pub fn attach(&mut self, name: String, stamp: i64, data: Vec<u8>) -> Result<(), DataError> {
        let attachment = Attachment {
            log_time: stamp as u64,
            create_time: stamp as u64,
            name,
            media_type: "application/octet-stream".to_owned(),
            data: Cow::Owned(data),
        };
        let attached = self.writer.attach(&attachment);
        attached.map_err(|e| wrong(self.path, e.to_string()))
    }

    /// Adds a topic of ROS 2 messages, for [`message`](Self::message).
    pub fn topic(&mut self, name: &str, of: &Definition) -> Result<u16, DataError> {
        let schema = self
            .writer
            .add_schema(of.name, "ros2msg", of.text.as_bytes());
        let none = BTreeMap::new();
        let topic = schema.and_then(|s| self.writer.add_channel(s, name, "cdr", &none));
        topic.map_err(|e| wrong(self.path, e.to_string()))
    }

    /// Adds a CDR message, published and logged at its stamp \[ns\].
    pub fn message(
        &mut self,
        topic: u16,
        number: u32,
        stamp: i64,
        data: &[u8],
    ) -> Result<(), DataError> {
        let header = MessageHeader {
            channel_id: topic,
            sequence: number,
            log_time: stamp as u64,
            publish_time: stamp as u64,
        };
        let written = self.writer.write_to_known_channel(&header, data);
        written.map_err(|e| wrong(self.path, e.to_string()))
    }

    /// Returns the bytes of the file.
    pub fn finish(mut self) -> Result<Vec<u8>, DataError> {
        let finished = self.writer.finish();
        finished.map_err(|e| wrong(self.path, e.to_string()))?;
        Ok(self.writer.into_inner().into_inner())
    }
}

/// An error of the file as a whole.
pub(crate) fn wrong(path: &Path, problem: impl Into<String>) -> DataError {
    DataError::Mcap {
        path: path.to_owned(),
        problem: problem.into(),
    }
}
