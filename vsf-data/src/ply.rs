//! Point clouds in the PLY format.

use crate::colormap::Scale;
use crate::{DataError, DataWarning, MADE_BY, StiffnessField, files, write_file};
use nalgebra::Point3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyDef,
    PropertyType, ScalarType,
};
use std::io::Cursor;
use std::path::Path;

pub(crate) fn write(path: &Path, field: &StiffnessField, scale: Scale) -> Result<(), DataError> {
    let sd = match field.sd {
        Some(_) => "property double sd\n",
        None => "",
    };
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\n\
         comment {MADE_BY}\n\
         comment stiffness in N/m; color from 0 to {} N/m\n\
         element vertex {}\n\
         property double x\nproperty double y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         property double stiffness\n{sd}end_header\n",
        scale.full,
        field.points.len()
    )
    .into_bytes();
    for (i, (p, &stiffness)) in field.points.iter().zip(&field.stiffness).enumerate() {
        bytes.extend([p.x, p.y, p.z].iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(scale.color(stiffness));
        bytes.extend(stiffness.to_le_bytes());
        if let Some(sd) = &field.sd {
            bytes.extend(sd[i].to_le_bytes());
        }
    }
    write_file(path, &bytes)
}

/// The points `x y z` of the element `vertex`.
pub(crate) fn points_of(path: &Path) -> Result<(Vec<Point3<f64>>, Vec<DataWarning>), DataError> {
    let (vertices, warning) = read_vertices(path, &["x", "y", "z"])?;
    let points = vertices.iter().map(|v| v.0.position).collect();
    Ok((points, warning.into_iter().collect()))
}

/// Vertices and their colors, `red green blue` of 8 bits.
pub(crate) fn cloud_of(path: &Path) -> Result<(Vec<ColoredPoint>, Vec<DataWarning>), DataError> {
    let (vertices, warning) = read_vertices(path, &["x", "y", "z", "red", "green", "blue"])?;
    let cloud = vertices.into_iter().map(|v| v.0).collect();
    Ok((cloud, warning.into_iter().collect()))
}

fn read_vertices(
    path: &Path,
    needed: &[&str],
) -> Result<(Vec<Vertex>, Option<DataWarning>), DataError> {
    let wrong = |problem: String| DataError::Ply {
        path: path.to_owned(),
        problem,
    };
    let damaged = |e: ply_rs_bw::parser::ParseError| {
        // What follows is of the parser's insides.
        let text = e.to_string();
        let place = text.split("Error:").next().unwrap_or_default();
        let words: Vec<&str> = place.split_whitespace().collect();
        wrong(format!("damaged PLY: {}", words.join(" ")))
    };
    let bytes = files::read(path)?;
    let length = bytes.len();
    let mut reader = Reader::new(Cursor::new(&bytes[..]));
    let parser = Parser::<Vertex>::new();
    let header = parser.read_header(&mut reader).map_err(damaged)?;
    if let Some(problem) = repeated(&bytes, &header).or_else(|| too_long(&bytes, &header)) {
        return Err(wrong(problem));
    }
    for (name, element) in &header.elements {
        // Every element takes a byte at least, so larger counts are not worth starting on.
        if element.count > length || (element.properties.is_empty() && element.count > 0) {
            let problem = format!("{} elements {name:?} in {length} bytes", element.count);
            return Err(wrong(problem));
        }
    }
    let vertex = header.elements.get("vertex");
    if !vertex.is_some_and(|v| needed.iter().all(|k| v.properties.contains_key(*k))) {
        let names = needed.join(", ");
        return Err(wrong(format!("no element vertex with {names}")));
    }
    let byte = PropertyType::Scalar(ScalarType::UChar);
    let colors = needed.iter().filter(|k| !["x", "y", "z"].contains(k));
    let kind = |k: &str| Some(&vertex?.properties.get(k)?.data_type);
    let typed = |k: &&str| kind(k) == Some(&byte);
    if let Some(odd) = colors.filter(|k| !typed(k)).copied().next() {
        return Err(wrong(format!("{odd} is not of type uchar")));
    }
    let others = Parser::<Skipped>::new();
    let mut vertices = Vec::new();
    for element in header.elements.values() {
        let read = if element.name == "vertex" {
            let read = parser.read_payload_for_element(&mut reader, element, &header);
            read.map(|all| vertices = all)
        } else {
            let read = others.read_payload_for_element(&mut reader, element, &header);
            read.map(drop)
        };
        read.map_err(|e| not_finite(path, &bytes, &header).unwrap_or(damaged(e)))?;
    }
    let end = usize::try_from(reader.get_ref().position()).unwrap_or(length);
    let left = bytes[end..].trim_ascii().len();
    if left > 0 {
        return Err(wrong(format!(
            "{left} bytes are left behind the elements that the header counts"
        )));
    }
    let points: Vec<_> = vertices.iter().map(|v| v.0.position).collect();
    files::check_points(path, &points)?;
    let open_ended = match header.encoding {
        Encoding::Ascii => files::open_ended(path, &bytes),
        _ => None,
    };
    Ok((vertices, open_ended))
}

/// Splits a file into its header and its data.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    const END: &[u8] = b"\nend_header";
    let at = bytes.windows(END.len()).position(|w| w == END)?;
    Some((
        std::str::from_utf8(&bytes[..at]).ok()?,
        &bytes[at + END.len()..],
    ))
}

/// An element or property that the header names twice. The parser takes the two for one, and misreads what follows.
fn repeated(bytes: &[u8], header: &Header) -> Option<String> {
    let (text, _) = split(bytes)?;
    let lines = |word: &str| {
        text.lines()
            .filter(|l| l.split_whitespace().next() == Some(word))
            .count()
    };
    let properties: usize = header.elements.values().map(|e| e.properties.len()).sum();
    let named = [
        ("element", "an element", header.elements.len()),
        ("property", "a property", properties),
    ];
    let (_, what, _) = named.into_iter().find(|(word, _, n)| lines(word) != *n)?;
    Some(format!("its header names {what} twice"))
}

/// A line of ASCII vertices with more numbers than properties. The parser ignores the rest.
fn too_long(bytes: &[u8], header: &Header) -> Option<String> {
    if header.encoding != Encoding::Ascii {
        return None;
    }
    let (vertex, mut rows) = vertex_rows(bytes, header)?;
    if !vertex.properties.values().all(|p| is_scalar(&p)) {
        return None;
    }
    let needed = vertex.properties.len();
    let numbers = |line: &str| line.split_ascii_whitespace().count();
    let (row, line) = rows.find(|(_, line)| numbers(line) > needed)?;
    let found = numbers(line);
    Some(format!(
        "vertex {row} has {found} numbers, but its header has {needed} properties"
    ))
}

/// The element `vertex` of an ASCII file, and its lines, counted from 0.
fn vertex_rows<'a>(
    bytes: &'a [u8],
    header: &'a Header,
) -> Option<(&'a ElementDef, impl Iterator<Item = (usize, &'a str)>)> {
    let (_, data) = split(bytes)?;
    let data = std::str::from_utf8(data).ok()?;
    let others = header.elements.values().take_while(|e| e.name != "vertex");
    let before: usize = others.map(|e| e.count).sum();
    let vertex = header.elements.get("vertex")?;
    let rows = data.lines().skip(1 + before).take(vertex.count);
    Some((vertex, rows.enumerate()))
}

fn is_scalar(property: &&PropertyDef) -> bool {
    matches!(property.data_type, PropertyType::Scalar(_))
}

/// The first number of ASCII vertices that is NaN or infinite. The parser would call its line damaged.
fn not_finite(path: &Path, bytes: &[u8], header: &Header) -> Option<DataError> {
    let (vertex, mut rows) = vertex_rows(bytes, header)?;
    rows.find_map(|(row, line)| {
        let names = vertex.properties.values().take_while(is_scalar);
        let values = names.zip(line.split_ascii_whitespace());
        let mut numbers = values.filter_map(|(p, word)| Some((&p.name, word.parse::<f64>().ok()?)));
        let (name, value) = numbers.find(|(_, value)| !value.is_finite())?;
        Some(DataError::NotFinite {
            path: path.to_owned(),
            row,
            column: name.clone(),
            value,
        })
    })
}

/// A point with a color.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColoredPoint {
    /// Position \[m\].
    pub position: Point3<f64>,
    /// Red, green, blue.
    pub color: [u8; 3],
}

/// Any other element; it is skipped.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }

    fn set_property(&mut self, _: &str, _: Property) -> PropertyAccessResult {
        PropertyAccessResult::Ignored
    }
}

/// Position and color of a vertex; all other properties are skipped.
struct Vertex(ColoredPoint);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(ColoredPoint {
            position: Point3::origin(),
            color: [0; 3],
        })
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let k = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            "red" => return self.set_color(0, property),
            "green" => return self.set_color(1, property),
            "blue" => return self.set_color(2, property),
            _ => return PropertyAccessResult::Ignored,
        };
        self.0.position[k] = match property {
            Property::Char(v) => v.into(),
            Property::UChar(v) => v.into(),
            Property::Short(v) => v.into(),
            Property::UShort(v) => v.into(),
            Property::Int(v) => v.into(),
            Property::UInt(v) => v.into(),
            Property::Float(v) => v.into(),
            Property::Double(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

impl Vertex {
    /// Other types only occur if only positions are read.
    fn set_color(&mut self, k: usize, property: Property) -> PropertyAccessResult {
        let Property::UChar(value) = property else {
            return PropertyAccessResult::Ignored;
        };
        self.0.color[k] = value;
        PropertyAccessResult::Set
    }
}
