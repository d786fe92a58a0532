/// The median of some values, in linear time; `None` if there are none.
///
/// For an even number of values it is the upper of the two middle ones. NaN sorts after all numbers.
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

/// Like [`median`], but in place: reorders the values and does not allocate.
#[must_use]
pub fn median_of(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    // The sign of NaN differs from machine to machine.
    let order = |a: &f64, b: &f64| a.is_nan().cmp(&b.is_nan()).then(a.total_cmp(b));
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, order).1)
}
