//! The `.npy` format of NumPy, versions 1 to 3. No length in a file is trusted.

use thiserror::Error;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Largest number of dimensions; NumPy itself stops at 64.
const MAX_RANK: usize = 32;
/// Integers up to this one are exact as doubles.
const MAX_EXACT: u64 = 1 << 53;

/// What is wrong with the bytes of a `.npy` file.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum NpyError {
    /// The file does not start with the magic bytes of a `.npy` file.
    #[error("not a .npy file")]
    Magic,
    /// An unknown version of the format, not 1.0, 2.0 or 3.0.
    #[error(".npy version {major}.{minor} is unknown, expected 1.0, 2.0 or 3.0")]
    Version {
        /// Major version.
        major: u8,
        /// Minor version.
        minor: u8,
    },
    /// The header is not the required Python dictionary.
    #[error("malformed .npy header: {0}")]
    Header(&'static str),
    /// Pickled Python objects. They are never unpickled.
    #[error(
        "object dtype (pickled Python objects) is never read; save numbers, for example \
         np.save(f, np.asarray(a, dtype=float))"
    )]
    Object,
    /// Numbers in big-endian byte order.
    #[error("big-endian dtype {0:?}; save a.astype(a.dtype.newbyteorder('<'))")]
    BigEndian(String),
    /// A dtype that is not a float or integer of at most 8 bytes (for features, nor boolean).
    #[error(
        "dtype {0:?} is not supported, expected float (f2, f4, f8) or integer (i1 to i8, u1 to u8)"
    )]
    Dtype(String),
    /// Not a single text, where one is expected.
    #[error("dtype {dtype:?} with shape {shape:?}, expected one text (U), such as np.array(\"a\")")]
    Text {
        /// The dtype.
        dtype: String,
        /// The shape; that of a single text is `[]`.
        shape: Vec<usize>,
    },
    /// A shape that no memory could hold, or one with too many dimensions.
    #[error("absurd shape {0:?}")]
    Shape(Vec<usize>),
    /// The file ends early.
    #[error("truncated: {got} bytes of data, the shape needs {expected}")]
    Truncated {
        /// Number of bytes that the shape needs.
        expected: usize,
        /// Number of bytes in the file.
        got: usize,
    },
    /// The file has more bytes than its data.
    #[error("{extra} bytes after the data")]
    Trailing {
        /// Number of excess bytes.
        extra: usize,
    },
    /// An integer beyond 2^53, which a double cannot hold exactly.
    #[error("element {index} is an integer beyond 2^53, which has no exact double")]
    Inexact {
        /// Position of the element in the file.
        index: usize,
    },
}

/// An array of any rank, in C order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NpyArray {
    pub shape: Vec<usize>,
    pub data: Vec<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Dtype {
    Float(usize),
    Signed(usize),
    Unsigned(usize),
    /// One byte; anything but 0 is read as 1.
    Bool,
    /// Text of this many UCS-4 characters.
    Text(usize),
}

struct Header<'a> {
    dtype: Dtype,
    descr: String,
    fortran_order: bool,
    shape: Vec<usize>,
    /// Bytes of one element.
    size: usize,
    /// The data, exactly as many bytes as the shape needs.
    data: &'a [u8],
}

/// Reads an array of numbers, converted to `f64`.
pub(crate) fn parse(bytes: &[u8]) -> Result<NpyArray, NpyError> {
    let header = parse_header(bytes)?;
    match header.dtype {
        Dtype::Bool => Err(NpyError::Dtype(header.descr)),
        _ => read(header),
    }
}

/// Reads an array of numbers, or of booleans as zeros and ones.
pub(crate) fn parse_with_bools(bytes: &[u8]) -> Result<NpyArray, NpyError> {
    read(parse_header(bytes)?)
}

fn read(header: Header<'_>) -> Result<NpyArray, NpyError> {
    if let Dtype::Text(_) = header.dtype {
        return Err(NpyError::Dtype(header.descr));
    }
    let data: Vec<f64> = header
        .data
        .chunks_exact(header.size)
        .enumerate()
        .map(|(index, raw)| number(header.dtype, raw).ok_or(NpyError::Inexact { index }))
        .collect::<Result<_, _>>()?;
    let data = if header.fortran_order {
        c_order(&header.shape, &data)
    } else {
        data
    };
    Ok(NpyArray {
        shape: header.shape,
        data,
    })
}

/// Reads a single string, such as `np.array("isotropic")`.
pub(crate) fn parse_text(bytes: &[u8]) -> Result<String, NpyError> {
    let header = parse_header(bytes)?;
    if !matches!(header.dtype, Dtype::Text(_)) || header.shape.iter().product::<usize>() != 1 {
        return Err(NpyError::Text {
            dtype: header.descr,
            shape: header.shape,
        });
    }
    let codes = header.data.chunks_exact(4).map(|c| little_endian(c) as u32);
    let text: String = codes
        .map(|c| char::from_u32(c).ok_or(NpyError::Header("text is not Unicode")))
        .collect::<Result<_, _>>()?;
    // NumPy fills up with zeros.
    Ok(text.trim_end_matches('\0').to_owned())
}

/// Writes doubles in C order as version 1.0. `data` must fill `shape`.
pub(crate) fn encode(shape: &[usize], data: &[f64]) -> Vec<u8> {
    let mut out = header_bytes("<f8", shape);
    out.extend(data.iter().flat_map(|v| v.to_le_bytes()));
    out
}

/// Writes a single string as version 1.0.
pub(crate) fn encode_text(text: &str) -> Vec<u8> {
    let mut out = header_bytes(&format!("<U{}", text.chars().count()), &[]);
    out.extend(text.chars().flat_map(|c| u32::from(c).to_le_bytes()));
    out
}

fn header_bytes(descr: &str, shape: &[usize]) -> Vec<u8> {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    // Python reads "(3, )" as a tuple of one.
    let mut dict = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    let used = MAGIC.len() + 4 + dict.len() + 1;
    dict.push_str(&" ".repeat(used.next_multiple_of(64) - used));
    dict.push('\n');
    let mut out = MAGIC.to_vec();
    out.extend([1, 0]);
    out.extend((dict.len() as u16).to_le_bytes());
    out.extend(dict.bytes());
    out
}

fn parse_header(bytes: &[u8]) -> Result<Header<'_>, NpyError> {
    let rest = bytes.strip_prefix(MAGIC).ok_or(NpyError::Magic)?;
    let (&[major, minor], rest) = rest.split_first_chunk().ok_or(NpyError::Magic)?;
    let width = match (major, minor) {
        (1, 0) => 2,
        (2 | 3, 0) => 4,
        _ => return Err(NpyError::Version { major, minor }),
    };
    const SHORT: NpyError = NpyError::Header("the file ends inside the header");
    let (length, rest) = rest.split_at_checked(width).ok_or(SHORT)?;
    let length = little_endian(length) as usize;
    let (dict, data) = rest.split_at_checked(length).ok_or(SHORT)?;
    let dict = std::str::from_utf8(dict).map_err(|_| NpyError::Header("not text"))?;
    let (descr, fortran_order, shape) = Cursor(dict).dict()?;
    let dtype = parse_dtype(&descr)?;
    let size = match dtype {
        Dtype::Float(n) | Dtype::Signed(n) | Dtype::Unsigned(n) => Some(n),
        Dtype::Bool => Some(1),
        Dtype::Text(n) => n.checked_mul(4),
    };
    let expected = shape
        .iter()
        .try_fold(1usize, |a, &n| a.checked_mul(n))
        .and_then(|n| n.checked_mul(size?))
        .filter(|_| shape.len() <= MAX_RANK);
    let (Some(size), Some(expected)) = (size, expected) else {
        return Err(NpyError::Shape(shape));
    };
    if data.len() < expected {
        return Err(NpyError::Truncated {
            expected,
            got: data.len(),
        });
    }
    if data.len() > expected {
        return Err(NpyError::Trailing {
            extra: data.len() - expected,
        });
    }
    Ok(Header {
        dtype,
        descr,
        fortran_order,
        shape,
        size,
        data,
    })
}

fn parse_dtype(descr: &str) -> Result<Dtype, NpyError> {
    let unsupported = || NpyError::Dtype(descr.to_owned());
    let mut chars = descr.chars();
    let (order, kind) = (chars.next(), chars.next());
    if kind == Some('O') || descr == "O" {
        return Err(NpyError::Object);
    }
    let size: usize = chars.as_str().parse().map_err(|_| unsupported())?;
    let dtype = match (kind, size) {
        (Some('f'), 2 | 4 | 8) => Dtype::Float(size),
        (Some('i'), 1 | 2 | 4 | 8) => Dtype::Signed(size),
        (Some('u'), 1 | 2 | 4 | 8) => Dtype::Unsigned(size),
        (Some('b'), 1) => Dtype::Bool,
        (Some('U'), _) => Dtype::Text(size),
        _ => return Err(unsupported()),
    };
    match (order, size) {
        (Some('<'), _) | (Some('|'), 1) => Ok(dtype),
        (Some('>'), _) => Err(NpyError::BigEndian(descr.to_owned())),
        _ => Err(unsupported()),
    }
}

/// At most 8 bytes, zero-extended.
fn little_endian(raw: &[u8]) -> u64 {
    raw.iter().rev().fold(0, |a, &b| (a << 8) | u64::from(b))
}

/// `None` for an integer that a double cannot hold.
fn number(dtype: Dtype, raw: &[u8]) -> Option<f64> {
    let bits = little_endian(raw);
    match dtype {
        Dtype::Float(2) => Some(half(bits as u16)),
        Dtype::Float(4) => Some(f64::from(f32::from_bits(bits as u32))),
        Dtype::Float(_) => Some(f64::from_bits(bits)),
        Dtype::Unsigned(_) => (bits <= MAX_EXACT).then_some(bits as f64),
        Dtype::Signed(size) => {
            let unused = 64 - 8 * size as u32;
            let value = ((bits << unused) as i64) >> unused;
            (value.unsigned_abs() <= MAX_EXACT).then_some(value as f64)
        }
        Dtype::Bool => Some(f64::from(bits != 0)),
        Dtype::Text(_) => None,
    }
}

/// IEEE 754 binary16.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = (i32::from((bits >> 10) & 0x1f), f64::from(bits & 0x3ff));
    sign * match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2f64.powi(exponent - 25),
    }
}

/// Reorders from Fortran (first index fastest) to C order (last index fastest).
fn c_order(shape: &[usize], fortran: &[f64]) -> Vec<f64> {
    let mut index = vec![0; shape.len()];
    let mut out = Vec::with_capacity(fortran.len());
    while out.len() < fortran.len() {
        let offset = index
            .iter()
            .zip(shape)
            .rev()
            .fold(0, |offset, (i, n)| offset * n + i);
        out.push(fortran[offset]);
        for (i, &n) in index.iter_mut().zip(shape).rev() {
            *i += 1;
            if *i < n {
                break;
            }
            *i = 0;
        }
    }
    out
}

/// Parser for the Python dictionary of a header: three keys, hardly any nesting.
struct Cursor<'a>(&'a str);

impl<'a> Cursor<'a> {
    fn eat(&mut self, token: char) -> bool {
        match self.0.trim_start().strip_prefix(token) {
            Some(rest) => {
                self.0 = rest;
                true
            }
            None => false,
        }
    }

    fn text(&mut self) -> Result<&'a str, NpyError> {
        let quote = if self.eat('\'') {
            '\''
        } else if self.eat('"') {
            '"'
        } else {
            return Err(NpyError::Header("expected a quoted string"));
        };
        let (text, rest) = self
            .0
            .split_once(quote)
            .ok_or(NpyError::Header("a string does not end"))?;
        self.0 = rest;
        Ok(text)
    }

    fn bool(&mut self) -> Result<bool, NpyError> {
        for (word, value) in [("True", true), ("False", false)] {
            if let Some(rest) = self.0.trim_start().strip_prefix(word) {
                self.0 = rest;
                return Ok(value);
            }
        }
        Err(NpyError::Header("fortran_order must be True or False"))
    }

    fn shape(&mut self) -> Result<Vec<usize>, NpyError> {
        const BAD: NpyError = NpyError::Header("shape must be a tuple of whole numbers");
        let mut shape = Vec::new();
        if !self.eat('(') {
            return Err(BAD);
        }
        while !self.eat(')') {
            let text = self.0.trim_start();
            let end = text.find(|c: char| !c.is_ascii_digit()).ok_or(BAD)?;
            shape.push(text[..end].parse().map_err(|_| BAD)?);
            self.0 = &text[end..];
            // "(3)" is a number in Python, not a tuple; everything else may end without a comma.
            if !self.eat(',') && (shape.len() == 1 || !self.0.trim_start().starts_with(')')) {
                return Err(BAD);
            }
        }
        Ok(shape)
    }

    fn dict(mut self) -> Result<(String, bool, Vec<usize>), NpyError> {
        let (mut descr, mut fortran, mut shape) = (None, None, None);
        if !self.eat('{') {
            return Err(NpyError::Header("not a dictionary"));
        }
        while !self.eat('}') {
            let key = self.text()?;
            if !self.eat(':') {
                return Err(NpyError::Header("a key has no value"));
            }
            let repeated = match key {
                "descr" if self.0.trim_start().starts_with('[') => {
                    return Err(NpyError::Dtype("structured".to_owned()));
                }
                "descr" => descr.replace(self.text()?.to_owned()).is_some(),
                "fortran_order" => fortran.replace(self.bool()?).is_some(),
                "shape" => shape.replace(self.shape()?).is_some(),
                _ => return Err(NpyError::Header("unknown key")),
            };
            if repeated {
                return Err(NpyError::Header("a key occurs twice"));
            }
            if !self.eat(',') && !self.0.trim_start().starts_with('}') {
                return Err(NpyError::Header("expected , or }"));
            }
        }
        if !self.0.trim().is_empty() {
            return Err(NpyError::Header("text after the dictionary"));
        }
        match (descr, fortran, shape) {
            (Some(descr), Some(fortran), Some(shape)) => Ok((descr, fortran, shape)),
            _ => Err(NpyError::Header(
                "one of descr, fortran_order, shape is missing",
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts() {
        assert_eq!(parse_text(&encode_text("\u{fc}")), Ok("\u{fc}".to_owned()));
        let error = parse_text(&encode(&[2], &[1.0, 2.0])).unwrap_err();
        let text = "dtype \"<f8\" with shape [2], expected one text";
        assert!(error.to_string().starts_with(text), "{error}");
    }
}
