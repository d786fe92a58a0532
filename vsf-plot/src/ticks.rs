/// Round numbers that divide an axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ticks {
    step: f64,
    pub(crate) values: Vec<f64>,
}

impl Ticks {
    /// Multiples of 1, 2 or 5 times a power of ten within `lo ..= hi`, at most about `count`.
    pub(crate) fn new(lo: f64, hi: f64, count: usize) -> Self {
        let raw = (hi - lo) / count.max(1) as f64;
        let power = 10f64.powf(raw.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|m| m * power)
            .into_iter()
            .find(|&s| s >= raw * (1.0 - 1e-9))
            .unwrap_or(raw);
        if !(step.is_finite() && step > 0.0) {
            return Self {
                step: 1.0,
                values: vec![lo],
            };
        }
        let slack = 1e-9 * (hi - lo);
        let first = ((lo - slack) / step).ceil();
        let values = (0..=2 * count)
            .map(|i| (first + i as f64) * step)
            .take_while(|&v| v <= hi + slack)
            .collect();
        Self { step, values }
    }

    /// As many ticks, up to about 7, as have room for their numbers side by side.
    pub(crate) fn fitting(lo: f64, hi: f64, pixels: f64) -> Self {
        const PIXELS_PER_CHARACTER: f64 = 12.0;
        let room = |t: &Self| {
            let widest = t
                .values
                .iter()
                .map(|&v| t.label(v).len() + 2)
                .max()
                .unwrap_or(0);
            (t.values.len() * widest) as f64 * PIXELS_PER_CHARACTER <= pixels
        };
        let all = (2..=7).rev().map(|count| Self::new(lo, hi, count));
        all.into_iter()
            .find(room)
            .unwrap_or_else(|| Self::new(lo, hi, 1))
    }

    /// A tick's number.
    pub(crate) fn label(&self, value: f64) -> String {
        let largest = self.values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        tick_label(value, self.step, largest)
    }
}

/// A number on an axis whose numbers lie `step` apart and reach to `largest`: with as many
/// decimals as the step needs, or with an exponent where all are huge or tiny.
pub(crate) fn tick_label(value: f64, step: f64, largest: f64) -> String {
    let coarse = step >= 0.99e-2 * largest;
    if coarse && !(1e-3..1e6).contains(&largest) && largest > 0.0 {
        return significant(if value.abs() < 0.5 * step { 0.0 } else { value });
    }
    let decimals = (-step.log10()).ceil().clamp(0.0, 12.0) as usize;
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|c| c == '0' || c == '.') => digits.to_owned(),
        _ => text,
    }
}

/// Values and numbers of a logarithmic axis from `lo > 0` to `hi`: powers of ten, and over a few of
/// them 2 and 5 times each as well.
pub(crate) fn log_ticks(lo: f64, hi: f64) -> Vec<(f64, String)> {
    const FEW: f64 = 3.0;
    let (first, last) = (lo.log10().floor() as i32, hi.log10().ceil() as i32);
    let factors: &[f64] = if hi.log10() - lo.log10() <= FEW {
        &[1.0, 2.0, 5.0]
    } else {
        &[1.0]
    };
    let tick = |power: i32| {
        let decimals = (-power).clamp(0, 12) as usize;
        let labeled = move |factor: &f64| {
            let value = factor * 10f64.powi(power);
            (value, format!("{value:.decimals$}"))
        };
        factors.iter().map(labeled)
    };
    let all = (first..=last).flat_map(tick);
    all.filter(|(v, _)| (lo..=hi).contains(v)).collect()
}

/// A number with three significant digits.
pub(crate) fn significant(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".into()
    } else if !(1e-3..1e6).contains(&size) {
        format!("{value:.2e}")
    } else {
        let decimals = (2.0 - size.log10().floor()).max(0.0) as usize;
        format!("{value:.decimals$}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_numbers_inside_the_range() {
        let t = Ticks::new(-0.13, 0.42, 5);
        assert_eq!(t.values.len(), 3);
        let labels: Vec<_> = t.values.iter().map(|&v| t.label(v)).collect();
        assert_eq!(labels, ["0.0", "0.2", "0.4"]);
    }

    #[test]
    fn extreme_ranges_give_few_ticks() {
        for (lo, hi) in [
            (0.0, 1e300),
            (0.0, 5e-324),
            (1e6, 1e6 + 1e-3),
            (3.0, 3.0),
            (-1e9, 1e9),
        ] {
            let t = Ticks::new(lo, hi, 5);
            assert!(t.values.len() <= 11, "{lo} {hi}: {:?}", t.values);
            for &v in &t.values {
                assert!(t.label(v).len() < 24);
            }
        }
    }

    #[test]
    fn logarithmic_axes() {
        let labels = |lo, hi| {
            log_ticks(lo, hi)
                .into_iter()
                .map(|t| t.1)
                .collect::<Vec<_>>()
        };
        assert_eq!(labels(0.03, 3.0), ["0.05", "0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(labels(0.5, 1e4), ["1", "10", "100", "1000", "10000"]);
    }

    #[test]
    fn no_negative_zero() {
        assert_eq!(tick_label(-1e-17, 0.1, 1.0), "0.0");
        assert_eq!(tick_label(-0.1, 0.1, 1.0), "-0.1");
        assert_eq!(tick_label(1e-9, 1e8, 1e9), "0");
        assert_eq!(tick_label(-20.0, 10.0, 100.0), "-20");
    }

    #[test]
    fn three_digits() {
        assert_eq!(significant(0.0), "0");
        assert_eq!(significant(812.34), "812");
        assert_eq!(significant(0.012345), "0.0123");
        assert_eq!(significant(1.5e9), "1.50e9");
    }
}
