//! Serialization of ROS messages.
//!
//! ROS 2 uses CDR: four bytes name the encoding; then come numbers aligned to their size, counted from after these four
//! bytes. Strings end with a zero that their length includes (OMG DDS-XTypes 1.3, section 7.4.3, encoding version 1). ROS 1
//! has neither alignment nor terminating zeros. In both, sequences begin with their length, and the contents of an empty
//! one are not aligned.

/// Reads the bytes of a message from the front. Errors are texts with the position in bytes.
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    kind: Kind,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Cdr { big_endian: bool },
    Packed,
}

impl<'a> Reader<'a> {
    /// A CDR message, of either byte order.
    pub fn cdr(bytes: &'a [u8]) -> Result<Self, String> {
        let big_endian = match bytes.first_chunk() {
            Some([0, 0, _, _]) => true,
            Some([0, 1, _, _]) => false,
            Some([a, b, _, _]) => {
                return Err(format!("encoding {a:#04x} {b:#04x} is not plain CDR"));
            }
            None => return Err(format!("{} bytes are no CDR message", bytes.len())),
        };
        Ok(Self {
            bytes: &bytes[4..],
            at: 0,
            kind: Kind::Cdr { big_endian },
        })
    }

    /// Little-endian numbers without gaps, as in ROS 1 and in the records of an MCAP file.
    pub fn packed(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            at: 0,
            kind: Kind::Packed,
        }
    }

    /// Number of bytes left.
    pub fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// The next `count` bytes.
    pub fn bytes(&mut self, count: usize) -> Result<&'a [u8], String> {
        if count > self.left() {
            let (at, left) = (self.at, self.left());
            return Err(format!(
                "{count} bytes are announced at byte {at}, {left} are left"
            ));
        }
        let found = &self.bytes[self.at..][..count];
        self.at += count;
        Ok(found)
    }

    pub fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.number()?))
    }

    pub fn i32(&mut self) -> Result<i32, String> {
        Ok(i32::from_le_bytes(self.number()?))
    }

    pub fn u64(&mut self) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.number()?))
    }

    fn f64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.number()?))
    }

    /// A string, which must be UTF-8.
    pub fn text(&mut self) -> Result<String, String> {
        let length = self.u32()? as usize;
        let at = self.at;
        let mut bytes = self.bytes(length)?;
        if self.kind != Kind::Packed {
            bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        }
        let text = std::str::from_utf8(bytes);
        let text = text.map_err(|_| format!("the text at byte {at} is not UTF-8"))?;
        Ok(text.to_owned())
    }

    /// A sequence of strings.
    pub fn texts(&mut self) -> Result<Vec<String>, String> {
        let count = self.count(4)?;
        let mut texts = Vec::with_capacity(count);
        for _ in 0..count {
            texts.push(self.text()?);
        }
        Ok(texts)
    }

    /// A sequence of `float64`.
    pub fn numbers(&mut self) -> Result<Vec<f64>, String> {
        let count = self.count(8)?;
        let mut numbers = Vec::with_capacity(count);
        for _ in 0..count {
            numbers.push(self.f64()?);
        }
        Ok(numbers)
    }

    /// The length of a sequence whose elements take at least `size` bytes. It never exceeds what the remaining bytes can
    /// hold, so memory may be reserved for it.
    fn count(&mut self, size: usize) -> Result<usize, String> {
        let count = self.u32()? as usize;
        if count <= self.left() / size {
            Ok(count)
        } else {
            Err(format!(
                "a sequence of {count} elements is announced at byte {}, {} bytes are left",
                self.at,
                self.left()
            ))
        }
    }

    /// The next number, as little-endian bytes.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        if self.kind != Kind::Packed {
            self.bytes(self.at.next_multiple_of(N) - self.at)?;
        }
        let mut number = [0; N];
        number.copy_from_slice(self.bytes(N)?);
        if self.kind == (Kind::Cdr { big_endian: true }) {
            number.reverse();
        }
        Ok(number)
    }
}

/// A little-endian CDR message.
pub(crate) struct Writer(Vec<u8>);

/// The bytes in front of a message: little-endian CDR, without options.
const PREFIX: [u8; 4] = [0, 1, 0, 0];

impl Writer {
    pub fn new() -> Self {
        Self(PREFIX.to_vec())
    }

    pub fn done(self) -> Vec<u8> {
        self.0
    }

    pub fn byte(&mut self, value: u8) {
        self.0.push(value);
    }

    pub fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    pub fn i32(&mut self, value: i32) {
        self.number(value.to_le_bytes());
    }

    pub fn f64(&mut self, value: f64) {
        self.number(value.to_le_bytes());
    }

    /// A string of less than 4 GiB.
    pub fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.bytes());
        self.0.push(0);
    }

    /// A sequence of less than 2^32 strings.
    pub fn texts(&mut self, texts: &[String]) {
        self.u32(texts.len() as u32);
        texts.iter().for_each(|text| self.text(text));
    }

    /// A sequence of less than 2^32 `float64`.
    pub fn numbers(&mut self, numbers: &[f64]) {
        self.u32(numbers.len() as u32);
        numbers.iter().for_each(|v| self.f64(*v));
    }

    /// A sequence of less than 2^32 bytes.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.0.extend(bytes);
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        let length = self.0.len() - PREFIX.len();
        self.0.resize(PREFIX.len() + length.next_multiple_of(N), 0);
        self.0.extend(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of the OMG, DDSI-RTPS 2.3, section 10.7: a color and three `int32`.
    #[test]
    fn val_example_of_the_specification() {
        let mut to = Writer::new();
        to.text("BLUE");
        [34, 100, 24].into_iter().for_each(|v| to.i32(v));
        let bytes = to.done();
        let expected = [
            0x00, 0x01, 0x00, 0x00, // little-endian CDR, no options
            0x05, 0x00, 0x00, 0x00, b'B', b'L', b'U', b'E', 0x00, 0x00, 0x00, 0x00, 0x22, 0x00,
            0x00, 0x00, 0x64, 0x00, 0x00, 0x00, 0x18, 0x00, 0x00, 0x00,
        ];
        assert_eq!(bytes, expected);
        let mut from = Reader::cdr(&bytes).unwrap();
        assert_eq!(from.text().unwrap(), "BLUE");
        assert_eq!(
            [from.i32(), from.i32(), from.i32()].map(Result::unwrap),
            [34, 100, 24]
        );
        assert_eq!(from.left(), 0);
    }

    #[test]
    fn lengths_are_checked_before_memory_is_reserved() {
        let bytes = |length: u32| [&[0, 1, 0, 0][..], &length.to_le_bytes(), &[0; 20]].concat();
        for length in [3, 1 << 20, u32::MAX] {
            let bytes = bytes(length);
            let problem = Reader::cdr(&bytes).unwrap().numbers().unwrap_err();
            assert!(problem.contains("20 bytes are left"), "{problem}");
        }
        let bytes = bytes(u32::MAX);
        assert!(Reader::cdr(&bytes).unwrap().texts().is_err());
        assert!(Reader::cdr(&bytes).unwrap().text().is_err());
        for prefix in [&[0, 1, 0][..], &[0, 3, 0, 0], &[7, 1, 0, 0]] {
            assert!(Reader::cdr(prefix).is_err());
        }
    }
}
