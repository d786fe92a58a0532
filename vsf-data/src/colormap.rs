use crate::DataError;

/// Anchors of matplotlib's "viridis" (CC0), dark violet to yellow: brighter means higher.
const ANCHORS: [[f64; 3]; 10] = [
    [68.0, 1.0, 84.0],
    [72.0, 40.0, 120.0],
    [62.0, 73.0, 137.0],
    [49.0, 104.0, 142.0],
    [38.0, 130.0, 142.0],
    [31.0, 158.0, 137.0],
    [53.0, 183.0, 121.0],
    [110.0, 206.0, 88.0],
    [181.0, 222.0, 43.0],
    [253.0, 231.0, 37.0],
];

/// The color of a value on a scale from 0 (dark violet) to 1 (yellow), as red, green, blue.
///
/// Interpolates linearly between ten colors of the perceptually uniform map "viridis", which stays readable in gray and for
/// the color-blind. Values outside the scale take the color of the nearer end, NaN that of 0.
///
/// Stiff points are bright, since viewers show PLY and MCAP clouds on a dark background. In pictures and pages, on white
/// paper, `vsf_plot::stiffness_color` makes them dark.
///
/// ```
/// assert_eq!(vsf_data::color(0.0), [68, 1, 84]);
/// assert_eq!(vsf_data::color(1.0), [253, 231, 37]);
/// ```
pub fn color(value: f64) -> [u8; 3] {
    let last = ANCHORS.len() - 1;
    // NaN is not above 0 either.
    let unit = if value > 0.0 { value.min(1.0) } else { 0.0 };
    let x = unit * last as f64;
    let i = (x as usize).min(last - 1);
    let mix = |k: usize| ANCHORS[i][k] + (x - i as f64) * (ANCHORS[i + 1][k] - ANCHORS[i][k]);
    [0, 1, 2].map(|k| mix(k).round() as u8)
}

/// Color scale of a field.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scale {
    /// Stiffness of the brightest color [N/m]; 0 if there is no stiffness anywhere.
    pub full: f64,
}

impl Scale {
    /// Up to the given stiffness; by default up to the largest one.
    pub fn new(stiffness: &[f64], given: Option<f64>) -> Result<Self, DataError> {
        if let Some(value) = given.filter(|v| !(v.is_finite() && *v > 0.0)) {
            return Err(DataError::Argument {
                what: "full_scale",
                problem: format!("{value:?} must be positive and finite"),
            });
        }
        let largest = stiffness.iter().copied().fold(0.0, f64::max);
        Ok(Self {
            full: given.unwrap_or(largest),
        })
    }

    /// A field without stiffness anywhere is all dark.
    pub fn color(self, stiffness: f64) -> [u8; 3] {
        color(if self.full > 0.0 {
            stiffness / self.full
        } else {
            0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::color;

    #[test]
    fn brightness_rises_and_ends_hold() {
        let brightness = |value: f64| {
            let [r, g, b] = color(value).map(f64::from);
            0.30 * r + 0.59 * g + 0.11 * b
        };
        let scale: Vec<f64> = (0..=100)
            .map(|k| brightness(f64::from(k) / 100.0))
            .collect();
        assert!(scale.windows(2).all(|w| w[1] >= w[0] - 0.5), "{scale:?}");
        assert_eq!(color(-3.0), color(0.0));
        assert_eq!(color(f64::NAN), color(0.0));
        assert_eq!(color(f64::INFINITY), color(1.0));
    }
}
