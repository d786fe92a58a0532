//! Point clouds in the PCD format of the Point Cloud Library.

use crate::{ColoredPoint, DataError, DataWarning, files};
use nalgebra::Point3;
use pcd_rs::{DynReader, DynRecord, Field, PcdMeta, ValueKind};
use std::path::Path;

/// Best compression of LZF: 264 bytes in 3.
const MOST_PACKED: u64 = 88;

/// The points `x y z`.
pub(crate) fn points_of(path: &Path) -> Result<(Vec<Point3<f64>>, Vec<DataWarning>), DataError> {
    let (cloud, warnings) = read(path, false)?;
    Ok((cloud.iter().map(|p| p.position).collect(), warnings))
}

/// Points and their colors: the field `rgb` or `rgba`, a 4-byte number with 8 bits each for red, green and blue.
pub(crate) fn cloud_of(path: &Path) -> Result<(Vec<ColoredPoint>, Vec<DataWarning>), DataError> {
    read(path, true)
}

/// Places of the fields in a record, without padding.
struct Places {
    xyz: [usize; 3],
    color: Option<usize>,
}

/// The points with at least one coordinate that is a number. The others, which the Point Cloud Library writes for pixels
/// without a return, are left out with a warning.
fn read(path: &Path, with_color: bool) -> Result<(Vec<ColoredPoint>, Vec<DataWarning>), DataError> {
    let wrong = |problem: String| DataError::Pcd {
        path: path.to_owned(),
        problem,
    };
    let damaged = |e: pcd_rs::Error| wrong(format!("damaged PCD: {e}"));
    let bytes = files::read(path)?;
    let (header, kind, data) =
        split(&bytes).ok_or_else(|| wrong("no PCD file: it has no line DATA".to_owned()))?;
    // The kind of data does not matter to the rest of the header, but how much there may be does.
    let plain = [header, b"DATA binary\n"].concat();
    let meta = DynReader::from_bytes(&plain).map_err(damaged)?;
    check_size(meta.meta(), kind, data).map_err(wrong)?;
    let places = places(meta.meta(), with_color).map_err(wrong)?;

    let mut cloud = Vec::new();
    let mut left_out = 0;
    for (row, record) in DynReader::from_bytes(&bytes).map_err(damaged)?.enumerate() {
        let DynRecord(fields) = record.map_err(damaged)?;
        let number = |k: usize| fields.get(k).and_then(number).unwrap_or(f64::NAN);
        let position = Point3::from(places.xyz.map(number));
        if position.iter().all(|c| c.is_nan()) {
            left_out += 1;
            continue;
        }
        files::check_point(path, row, &position)?;
        let color = places.color.and_then(|k| color(fields.get(k)?));
        cloud.push(ColoredPoint {
            position,
            color: color.unwrap_or_default(),
        });
    }
    if cloud.is_empty() && left_out > 0 {
        let problem = format!("no points: the coordinates of all {left_out} are NaN");
        return Err(wrong(problem));
    }
    if cloud.is_empty() {
        return Err(files::no_points(path));
    }
    let without_return = (left_out > 0).then(|| DataWarning::WithoutReturn {
        path: path.to_owned(),
        count: left_out,
        total: left_out + cloud.len(),
    });
    let open_ended = (kind == "ascii").then(|| files::open_ended(path, &bytes));
    let view = &meta.meta().viewpoint;
    let pose = [
        view.tx, view.ty, view.tz, view.qw, view.qx, view.qy, view.qz,
    ];
    let moved = (pose != [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]).then(|| DataWarning::Viewpoint {
        path: path.to_owned(),
        pose,
    });
    let warnings = without_return.into_iter().chain(open_ended.flatten());
    Ok((cloud, warnings.chain(moved).collect()))
}

/// Splits a file into the header without its last line, the kind of data that this line names, and the data.
fn split(bytes: &[u8]) -> Option<(&[u8], &str, &[u8])> {
    let mut start = 0;
    for line in bytes.split_inclusive(|b| *b == b'\n') {
        let mut words = std::str::from_utf8(line).ok()?.split_ascii_whitespace();
        if words.next().is_some_and(|w| w.eq_ignore_ascii_case("DATA")) {
            let data = &bytes[start + line.len()..];
            return Some((&bytes[..start], words.next().unwrap_or_default(), data));
        }
        start += line.len();
    }
    None
}

/// Refuses a header that promises more than the file holds, before memory is reserved for it.
fn check_size(meta: &PcdMeta, kind: &str, data: &[u8]) -> Result<(), String> {
    let length = data.len() as u64;
    let fields = || meta.field_defs.iter();
    let values = fields().try_fold(0u64, |sum, f| sum.checked_add(f.count));
    let record = fields().try_fold(0u64, |sum, f| {
        sum.checked_add(f.count.checked_mul(f.kind.byte_size() as u64)?)
    });
    // A number as text is a byte at least.
    let record = if kind == "ascii" { values } else { record };
    let needed = record.and_then(|r| r.checked_mul(meta.num_points));
    let word = |at: usize| {
        let word = data.get(at..at + 4).and_then(|w| w.try_into().ok());
        word.map(u32::from_le_bytes).map_or(0, u64::from)
    };
    let fits = match (kind, needed) {
        (_, None) => false,
        ("binary_compressed", Some(needed)) => {
            let (packed, whole) = (word(0), word(4));
            packed <= length.saturating_sub(8)
                && whole == needed
                && whole <= MOST_PACKED.saturating_mul(packed)
        }
        (_, Some(needed)) => needed <= length,
    };
    let points = meta.num_points;
    let (width, height) = (meta.width, meta.height);
    if width.checked_mul(height) != Some(points) {
        return Err(format!(
            "its header says WIDTH {width}, HEIGHT {height} and POINTS {points}; correct the one that is wrong"
        ));
    }
    if !fits {
        return Err(format!(
            "{points} points do not fit into {length} bytes of data"
        ));
    }
    let is_row = |line: &&[u8]| !line.trim_ascii().is_empty();
    let held = match (kind, needed) {
        ("ascii", _) => data.split(|b| *b == b'\n').filter(is_row).count() as u64,
        // Some writers end the data with a line break.
        ("binary", Some(needed)) => points + (length - needed) / record.unwrap_or(1).max(1),
        _ => points,
    };
    if held > points {
        Err(format!(
            "{held} points, but its header says POINTS {points}; correct the one that is wrong"
        ))
    } else {
        Ok(())
    }
}

fn places(meta: &PcdMeta, with_color: bool) -> Result<Places, String> {
    let kept = || meta.field_defs.iter().filter(|f| f.name != "_");
    let find = |name: &str| kept().position(|f| f.name == name && f.count == 1);
    let needed = |name| find(name).ok_or_else(|| format!("no field {name} with one value a point"));
    let color = find("rgb").or_else(|| find("rgba"));
    let packed = |k: &usize| {
        let kind = kept().nth(*k).map(|f| f.kind);
        matches!(kind, Some(ValueKind::F32 | ValueKind::U32 | ValueKind::I32))
    };
    if with_color && !color.as_ref().is_some_and(packed) {
        return Err("no field rgb or rgba of 4 bytes".to_owned());
    }
    Ok(Places {
        xyz: [needed("x")?, needed("y")?, needed("z")?],
        color: color.filter(packed),
    })
}

fn number(field: &Field) -> Option<f64> {
    Some(match field {
        Field::I8(v) => f64::from(*v.first()?),
        Field::I16(v) => f64::from(*v.first()?),
        Field::I32(v) => f64::from(*v.first()?),
        Field::I64(v) => *v.first()? as f64,
        Field::U8(v) => f64::from(*v.first()?),
        Field::U16(v) => f64::from(*v.first()?),
        Field::U32(v) => f64::from(*v.first()?),
        Field::U64(v) => *v.first()? as f64,
        Field::F32(v) => f64::from(*v.first()?),
        Field::F64(v) => *v.first()?,
    })
}

/// Red, green and blue from one number, whatever the type of its bits.
fn color(field: &Field) -> Option<[u8; 3]> {
    let bits = match field {
        Field::F32(v) => v.first()?.to_bits(),
        Field::U32(v) => *v.first()?,
        Field::I32(v) => v.first()?.cast_unsigned(),
        _ => return None,
    };
    let [_, red, green, blue] = bits.to_be_bytes();
    Some([red, green, blue])
}
