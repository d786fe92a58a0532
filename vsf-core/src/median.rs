/// The median, of an even number the upper one of the middle two; `None` of nothing. NaN counts as beyond all numbers. Linear
/// in their number.
///
/// ```
/// # use vsf_core::median;
/// assert_eq!(median(vec![3.0, 1.0, 2.0, 9.0]), Some(3.0));
/// assert_eq!(median(Vec::new()), None);
/// assert_eq!(median(vec![-f64::NAN, 1.0, 2.0]), Some(2.0));
/// ```
#[must_use]
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    median_of(&mut values)
}

/// The same in place: values are left in another order, and nothing is allocated.
#[must_use]
pub fn median_of(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    // The sign of NaN differs from machine to machine.
    let order = |a: &f64, b: &f64| a.is_nan().cmp(&b.is_nan()).then(a.total_cmp(b));
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, order).1)
}
