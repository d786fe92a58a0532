use crate::PlotError;

/// An sRGB color, 8 bits per channel.
pub type Rgb = [u8; 3];

/// Anchors of the color map inferno at t = 0, 1/16, ..., 1, rounded to 8 bits.
///
/// Reference: N. J. Smith and S. van der Walt, inferno, in matplotlib 1.5 (CC0). Perceptually
/// uniform, monotone in lightness, readable with color vision deficiency and in gray print.
const INFERNO: [Rgb; 17] = [
    [0, 0, 4],
    [11, 7, 36],
    [33, 12, 74],
    [61, 9, 101],
    [87, 16, 110],
    [113, 25, 110],
    [138, 34, 106],
    [163, 44, 97],
    [188, 55, 84],
    [208, 69, 69],
    [227, 89, 51],
    [241, 113, 31],
    [249, 140, 10],
    [252, 170, 15],
    [249, 201, 50],
    [242, 232, 101],
    [252, 255, 164],
];

/// Maps `t` in 0..=1 to a color: from pale yellow for soft, over red, to dark violet for stiff. Values
/// outside take the color of the nearer end.
///
/// This is Inferno reversed, so that on white paper more ink means stiffer. The ends of Inferno are left
/// out, since they are nearly white and nearly black. For viewers with a dark background, `vsf_data::color`
/// colors clouds bright where stiff.
///
/// ```
/// let [soft, stiff] = [0.0, 1.0].map(vsf_plot::stiffness_color);
/// assert!(soft.iter().map(|&c| u32::from(c)).sum::<u32>() > 500);
/// assert!(stiff.iter().map(|&c| u32::from(c)).sum::<u32>() < 100);
/// ```
pub fn stiffness_color(t: f64) -> Rgb {
    let s = (0.95 - 0.87 * t.clamp(0.0, 1.0)) * (INFERNO.len() - 1) as f64;
    let i = (s as usize).min(INFERNO.len() - 2);
    mix(INFERNO[i], INFERNO[i + 1], s - i as f64)
}

/// `a` for `f = 0`, `b` for `f = 1`.
pub(crate) fn mix(a: Rgb, b: Rgb, f: f64) -> Rgb {
    [0, 1, 2].map(|c| (f64::from(a[c]) * (1.0 - f) + f64::from(b[c]) * f).round() as u8)
}

/// The value at the dark end of the color bar; larger values get the same color.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ColorLimit {
    /// The quantile, at this level in (0, 1], of the positive values that are drawn. Robust against a few
    /// runaway points. If the stiff points are fewer than the level leaves out, use a `Value`.
    Quantile(f64),
    /// This value \[N/m\], > 0. For pictures that will be compared with each other.
    Value(f64),
}

impl Default for ColorLimit {
    /// The 99 % quantile.
    fn default() -> Self {
        Self::Quantile(0.99)
    }
}

impl ColorLimit {
    /// The limit \[N/m\] for the given values; 1 if no value is positive.
    ///
    /// # Errors
    /// [`PlotError::Parameter`] for a value or a level outside its range.
    pub fn resolve(self, values: impl Iterator<Item = f64>) -> Result<f64, PlotError> {
        match self {
            Self::Value(v) if v.is_finite() && v > 0.0 => Ok(v),
            Self::Value(value) => Err(PlotError::Parameter {
                name: "limit value",
                value,
                range: "finite and > 0 N/m",
            }),
            Self::Quantile(level) if level > 0.0 && level <= 1.0 => {
                let mut positive: Vec<f64> = values.filter(|&v| v > 0.0).collect();
                if positive.is_empty() {
                    return Ok(1.0);
                }
                let rank = (level * positive.len() as f64).ceil() as usize;
                let rank = rank.clamp(1, positive.len()) - 1;
                Ok(*positive.select_nth_unstable_by(rank, f64::total_cmp).1)
            }
            Self::Quantile(value) => Err(PlotError::Parameter {
                name: "limit quantile",
                value,
                range: "0 < level <= 1",
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lightness_falls_with_stiffness() {
        let luma =
            |c: Rgb| 0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2]);
        let mut last = f64::INFINITY;
        for i in 0..=100 {
            let now = luma(stiffness_color(f64::from(i) / 100.0));
            assert!(now < last + 1.0, "at {i} %: {now} after {last}");
            last = now;
        }
    }

    #[test]
    fn quantile_counts_positive_values_only() {
        let values = (0..200).map(|i| f64::from(i.max(99) - 99));
        let limit = ColorLimit::Quantile(0.9).resolve(values).unwrap();
        assert_eq!(limit, 90.0);
        assert_eq!(
            ColorLimit::default().resolve([0.0].into_iter()).unwrap(),
            1.0
        );
    }

    #[test]
    fn limits_outside_their_range_are_refused() {
        for bad in [
            ColorLimit::Value(0.0),
            ColorLimit::Value(f64::NAN),
            ColorLimit::Value(f64::INFINITY),
            ColorLimit::Quantile(0.0),
            ColorLimit::Quantile(1.5),
            ColorLimit::Quantile(f64::NAN),
        ] {
            let got = bad.resolve([1.0].into_iter());
            assert!(matches!(got, Err(PlotError::Parameter { .. })), "{bad:?}");
        }
    }
}
