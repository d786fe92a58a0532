//! Numbers as the page's script reads them: little-endian, in base64, a third of the size of text.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use vsf::core::RestPoints;
use vsf::core::nalgebra::Point3;

/// An array of numbers of one type.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Numbers(String);

impl Numbers {
    /// As f32, which is enough for pixels.
    pub fn f32(values: impl IntoIterator<Item = f64>) -> Self {
        Self::of(values.into_iter().map(|v| (v as f32).to_le_bytes()))
    }

    pub fn u32(values: impl IntoIterator<Item = u32>) -> Self {
        Self::of(values.into_iter().map(u32::to_le_bytes))
    }

    pub fn flags(values: impl IntoIterator<Item = bool>) -> Self {
        Self::of(values.into_iter().map(|v| [u8::from(v)]))
    }

    fn of<const N: usize>(bytes: impl Iterator<Item = [u8; N]>) -> Self {
        Self(STANDARD.encode(bytes.flatten().collect::<Vec<u8>>()))
    }
}

/// Refuses places that cannot be drawn; `what` is said of the point.
pub fn check_near(p_W: &Point3<f64>, what: impl FnOnce() -> String) -> anyhow::Result<()> {
    if p_W.iter().all(|v| v.abs() <= RestPoints::FARTHEST) {
        Ok(())
    } else {
        anyhow::bail!("{} is at {p_W:?} m, beyond 1e6 m; check units", what())
    }
}

#[cfg(test)]
pub mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    pub fn bytes(numbers: &Numbers) -> Vec<u8> {
        STANDARD.decode(&numbers.0).unwrap()
    }

    #[test]
    fn numbers_come_back() {
        let values = [0.1, -3.5, 1e6, 0.0];
        let read = bytes(&Numbers::f32(values));
        let read = read
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()));
        assert!(read.eq(values.map(|v| v as f32)));
        assert_eq!(
            bytes(&Numbers::u32([1, u32::MAX])),
            [1, 0, 0, 0, 255, 255, 255, 255]
        );
        assert_eq!(bytes(&Numbers::flags([true, false])), [1, 0]);
        assert!(bytes(&Numbers::f32([])).is_empty());
    }

    #[test]
    fn far_is_refused() {
        let at = |x: f64| check_near(&Point3::new(0.0, x, 0.0), || "row 7".to_owned());
        assert!(at(-1e6).is_ok());
        for x in [1.1e6, -1e300, f64::INFINITY, f64::NAN] {
            let error = at(x).unwrap_err().to_string();
            assert!(error.starts_with("row 7 is at"), "{error}");
        }
    }
}
