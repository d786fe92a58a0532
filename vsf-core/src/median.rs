/// The median, of an even number the upper one of the middle two; `None` of nothing. NaN counts as beyond all numbers. Linear
/// in their number.
///
/// ```
/// # use vsf_core::median;
/// assert_eq!(median(vec![3.0, 1.0, 2.0, 9.0]), Some(3.0));
/// assert_eq!(median(Vec::new()), None);
/// ```
#[must_use]
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
