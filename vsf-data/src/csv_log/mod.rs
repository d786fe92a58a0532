//! Joint states in text files: one line per sample, with the titles of the columns in the first line.

mod columns;

pub(crate) use columns::{Columns, Quantity, numbered};

use crate::ros::SECOND;
use crate::{DataError, files};
use csv::{ErrorKind, Position, Reader, ReaderBuilder, StringRecord, Trim};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Longer files are refused, since a text without line ends is read as a whole.
const MOST: u64 = 4 << 30;

/// Largest time, before and after 0 \[ns\]. The difference of two such times does not overflow.
const FAR: i64 = i64::MAX / 2;

/// A line, with one number for each joint in [`Columns::names`]; NaN if a cell is empty.
pub(crate) struct Line {
    /// Line number, from 1; the first line has the titles.
    pub number: u64,
    /// Time stamp \[ns\].
    pub stamp: i64,
    pub position: Vec<f64>,
    /// Empty if no joint has a velocity.
    pub velocity: Vec<f64>,
    pub effort: Vec<f64>,
}

/// A file whose first line has been read.
pub(crate) struct CsvLog<'a> {
    path: &'a Path,
    reader: Reader<File>,
    pub columns: Columns,
}

/// The separator of the columns if the file is of this kind by its name.
fn separator(path: &Path) -> Option<u8> {
    let end = path.extension()?.to_ascii_lowercase();
    match end.to_str()? {
        "csv" => Some(b','),
        "tsv" => Some(b'\t'),
        _ => None,
    }
}

/// Whether a file is called `.csv` or `.tsv`.
pub(crate) fn is_csv(path: &Path) -> bool {
    separator(path).is_some()
}

impl<'a> CsvLog<'a> {
    pub fn open(path: &'a Path) -> Result<Self, DataError> {
        let (file, length) = files::open(path)?;
        if length > MOST {
            return Err(wrong(path, "longer than 4 GiB; import a part of it"));
        }
        let mut reader = ReaderBuilder::new()
            .delimiter(separator(path).unwrap_or(b','))
            .trim(Trim::All)
            .flexible(true)
            .from_reader(file);
        let titles = reader.headers().map_err(|e| damaged(path, e))?;
        check_cells(path, titles, titles.len())?;
        if titles.is_empty() {
            return Err(DataError::Empty {
                path: path.to_owned(),
                what: "the file",
            });
        }
        let columns = Columns::new(titles.iter()).map_err(|problem| wrong(path, problem))?;
        Ok(Self {
            path,
            reader,
            columns,
        })
    }

    /// Calls `visit` for every line below the titles. Returns the columns, and whether the last line is terminated.
    pub fn read(
        mut self,
        mut visit: impl FnMut(Line) -> Result<(), DataError>,
    ) -> Result<(Columns, bool), DataError> {
        let mut record = StringRecord::new();
        let mut is_empty = true;
        while (self.reader.read_record(&mut record)).map_err(|e| damaged(self.path, e))? {
            check_cells(self.path, &record, self.columns.count())?;
            visit(self.line(&record)?)?;
            is_empty = false;
        }
        if is_empty {
            Err(wrong(self.path, "no samples below the titles"))
        } else {
            let ends = self
                .ends()
                .map_err(|e| DataError::io("read", self.path, e))?;
            Ok((self.columns, ends))
        }
    }

    /// Whether the file ends with a line end.
    fn ends(&mut self) -> std::io::Result<bool> {
        let file = self.reader.get_mut();
        file.seek(SeekFrom::End(-1))?;
        let mut last = [0];
        file.read_exact(&mut last)?;
        Ok(matches!(last[0], b'\n' | b'\r'))
    }

    fn line(&self, record: &StringRecord) -> Result<Line, DataError> {
        let place = record.position().map_or(0, Position::line);
        let cell = |column: usize| record.get(column).unwrap_or_default();
        let refused = |column: usize, problem| DataError::CsvCell {
            path: self.path.to_owned(),
            line: place,
            column: self.columns.title(column).to_owned(),
            problem,
        };
        let time = self.columns.time();
        let stamp = nanoseconds(cell(time)).map_err(|problem| refused(time, problem))?;
        let numbers = |quantity| {
            let columns = self.columns.of(quantity);
            let number = |column: Option<usize>| match column {
                Some(k) => number(cell(k)).map_err(|problem| refused(k, problem)),
                None => Ok(f64::NAN),
            };
            columns.map(number).collect::<Result<Vec<_>, _>>()
        };
        Ok(Line {
            number: place,
            stamp,
            position: numbers(Quantity::Position)?,
            velocity: if self.columns.of(Quantity::Velocity).all(|c| c.is_none()) {
                Vec::new()
            } else {
                numbers(Quantity::Velocity)?
            },
            effort: numbers(Quantity::Effort)?,
        })
    }
}

/// Refuses records with fewer or more cells than titles, and cells of several lines, which are never numbers: a quote that
/// is not closed turns everything after it into one cell.
fn check_cells(path: &Path, record: &StringRecord, titles: usize) -> Result<(), DataError> {
    let problem = if record.iter().any(|cell| cell.contains(['\n', '\r'])) {
        "a cell of several lines; a quote (\") may be opened and not closed".to_owned()
    } else if record.len() != titles {
        format!("{} cells below {titles} titles", record.len())
    } else {
        return Ok(());
    };
    Err(DataError::CsvLine {
        path: path.to_owned(),
        line: record.position().map_or(1, Position::line),
        problem,
    })
}

/// The number in a cell; NaN if it is empty.
fn number(text: &str) -> Result<f64, String> {
    match text {
        "" => Ok(f64::NAN),
        _ => (text.parse()).map_err(|_| format!("{text:?} is not a number")),
    }
}

/// A time \[s\] in nanoseconds. Plain decimals are not rounded to a double first, whose resolution at Unix times is a
/// quarter of a microsecond.
fn nanoseconds(text: &str) -> Result<i64, String> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, "0"));
    let is_plain = [whole, fraction]
        .iter()
        .all(|part| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit()));
    let (whole, part) = match is_plain.then(|| (whole.parse(), format!("0.{fraction}").parse())) {
        Some((Ok(whole), Ok(part))) => (whole, part),
        _ => (0, number(text)?),
    };
    if !f64::is_finite(part) {
        return Err(format!("{text:?} is not a finite number"));
    }
    let part = (part * SECOND as f64).round();
    let exact = (part.abs() <= FAR as f64).then_some(part as i64);
    let stamp = exact.and_then(|part| i64::checked_mul(whole, SECOND)?.checked_add(part));
    let near = stamp.filter(|stamp| stamp.unsigned_abs() <= FAR as u64);
    near.ok_or_else(|| format!("{text} s is beyond 146 years; times are seconds"))
}

fn wrong(path: &Path, problem: impl Into<String>) -> DataError {
    DataError::Csv {
        path: path.to_owned(),
        problem: problem.into(),
    }
}

fn damaged(path: &Path, error: csv::Error) -> DataError {
    let at = error.position().map_or(0, Position::line);
    let problem = match error.into_kind() {
        ErrorKind::Io(source) => return DataError::io("read", path, source),
        ErrorKind::Utf8 { .. } => "not UTF-8 text".to_owned(),
        other => format!("{other:?}"),
    };
    DataError::CsvLine {
        path: path.to_owned(),
        line: at,
        problem,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn times_are_exact_to_the_nanosecond() {
        let cases = [
            ("0", 0),
            ("7.25", 7_250_000_000),
            ("0.1", 100_000_000),
            ("1700000000.123456789", 1_700_000_000_123_456_789),
            ("1700000000.9999999996", 1_700_000_001_000_000_000),
            ("-0.5", -500_000_000),
            ("+2", 2_000_000_000),
            (".5", 500_000_000),
            ("5.", 5_000_000_000),
            ("1.5e-3", 1_500_000),
            ("4611686018.25", 4_611_686_018_250_000_000),
        ];
        for (text, stamp) in cases {
            assert_eq!(nanoseconds(text), Ok(stamp), "{text}");
        }
        for text in [
            "", "nan", "inf", "-inf", "1e400", "x", "1,5", "0x10", "1.2.3",
        ] {
            assert!(nanoseconds(text).unwrap_err().contains("number"), "{text}");
        }
        for text in [
            "1700000000123456789",
            "-5e9",
            "1e300",
            "9999999999",
            "99999999999999999999",
        ] {
            let problem = nanoseconds(text).unwrap_err();
            assert!(problem.contains("times are seconds"), "{text}: {problem}");
        }
    }
}
