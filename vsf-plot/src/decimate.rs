/// A curve with at most four points per pixel column, in which every extreme survives.
///
/// `time` is non-decreasing and spans `span`; both slices have the same length.
pub(crate) fn thin_curve(
    time: &[f64],
    values: &[f64],
    span: (f64, f64),
    columns: usize,
) -> Vec<(f64, f64)> {
    if time.len() <= 4 * columns {
        return time.iter().copied().zip(values.iter().copied()).collect();
    }
    let mut curve = Vec::with_capacity(4 * columns);
    for run in by_column(time, span, columns) {
        let extreme = |better: fn(f64, f64) -> bool| {
            run.clone()
                .reduce(|a, b| if better(values[b], values[a]) { b } else { a })
        };
        let mut kept: Vec<usize> = [
            Some(run.start),
            extreme(|new, old| new < old),
            extreme(|new, old| new > old),
            Some(run.end - 1),
        ]
        .into_iter()
        .flatten()
        .collect();
        kept.sort_unstable();
        kept.dedup();
        curve.extend(kept.into_iter().map(|i| (time[i], values[i])));
    }
    curve
}

/// The outline of a band: along its upper edge and back along the lower one.
pub(crate) fn band(
    time: &[f64],
    low: &[f64],
    high: &[f64],
    span: (f64, f64),
    columns: usize,
) -> Vec<(f64, f64)> {
    let (mut upper, mut lower) = (Vec::new(), Vec::new());
    if time.len() <= 2 * columns {
        upper.extend(time.iter().copied().zip(high.iter().copied()));
        lower.extend(time.iter().copied().zip(low.iter().copied()));
    } else {
        for run in by_column(time, span, columns) {
            let top = high[run.clone()]
                .iter()
                .copied()
                .fold(f64::NEG_INFINITY, f64::max);
            let bottom = low[run.clone()]
                .iter()
                .copied()
                .fold(f64::INFINITY, f64::min);
            for t in [time[run.start], time[run.end - 1]] {
                upper.push((t, top));
                lower.push((t, bottom));
            }
        }
    }
    upper.extend(lower.into_iter().rev());
    upper
}

/// The intervals in which a flag is set, from the first such sample to the one after the last;
/// gaps narrower than a pixel column are closed.
pub(crate) fn phases(
    time: &[f64],
    flags: &[bool],
    span: (f64, f64),
    columns: usize,
) -> Vec<(f64, f64)> {
    let pixel = (span.1 - span.0) / columns as f64;
    let mut phases: Vec<(f64, f64)> = Vec::new();
    for i in (0..flags.len()).filter(|&i| flags[i]) {
        let end = time[(i + 1).min(time.len() - 1)];
        match phases.last_mut() {
            Some(last) if time[i] - last.1 < pixel => last.1 = end,
            _ => phases.push((time[i], end)),
        }
    }
    phases
}

/// Ranges of samples that fall into the same pixel column.
fn by_column(
    time: &[f64],
    span: (f64, f64),
    columns: usize,
) -> impl Iterator<Item = std::ops::Range<usize>> {
    let width = (span.1 - span.0) / columns as f64;
    let column = move |i: usize| ((time[i] - span.0) / width) as usize;
    let mut start = 0;
    std::iter::from_fn(move || {
        (start < time.len()).then(|| {
            let first = start;
            let here = column(first);
            start += 1;
            while start < time.len() && column(start) == here {
                start += 1;
            }
            first..start
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noisy(n: usize) -> (Vec<f64>, Vec<f64>) {
        let time: Vec<f64> = (0..n).map(|i| i as f64 * 1e-3).collect();
        let values = (0..n).map(|i| ((i * 7919) % 1013) as f64).collect();
        (time, values)
    }

    #[test]
    fn extremes_of_every_column_survive() {
        let (time, mut values) = noisy(100_000);
        values[54_321] = 5000.0;
        values[54_322] = -5000.0;
        let curve = thin_curve(&time, &values, (0.0, 100.0), 500);
        assert!(curve.len() <= 4 * 502, "{}", curve.len());
        assert!(curve.contains(&(54.321, 5000.0)) && curve.contains(&(54.322, -5000.0)));
        assert!(curve.windows(2).all(|w| w[0].0 <= w[1].0));
        assert_eq!(curve[0], (0.0, values[0]));
        assert_eq!(curve.last(), Some(&(time[99_999], values[99_999])));
    }

    #[test]
    fn short_curves_are_kept_as_they_are() {
        let (time, values) = noisy(10);
        assert_eq!(thin_curve(&time, &values, (0.0, 0.009), 500).len(), 10);
    }

    #[test]
    fn a_thinned_band_contains_the_band() {
        let (time, low) = noisy(10_000);
        let high: Vec<f64> = low.iter().map(|v| v + 3.0).collect();
        let outline = band(&time, &low, &high, (0.0, 10.0), 100);
        assert_eq!(outline.len() % 2, 0);
        let (upper, lower) = outline.split_at(outline.len() / 2);
        for i in 0..time.len() {
            let at = upper.iter().rposition(|p| p.0 <= time[i]).unwrap();
            assert!(upper[at].1 >= high[i] && lower[lower.len() - 1 - at].1 <= low[i]);
        }
    }

    #[test]
    fn phases_close_gaps_narrower_than_a_pixel() {
        let time: Vec<f64> = (0..10).map(f64::from).collect();
        let flags = [0, 1, 1, 0, 1, 0, 0, 0, 0, 1].map(|v| v == 1);
        let fine = phases(&time, &flags, (0.0, 9.0), 9);
        assert_eq!(fine, [(1.0, 3.0), (4.0, 5.0), (9.0, 9.0)]);
        let coarse = phases(&time, &flags, (0.0, 9.0), 4);
        assert_eq!(coarse, [(1.0, 5.0), (9.0, 9.0)]);
    }
}
