use thiserror::Error;

/// What can be wrong with the data of a picture.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum PlotError {
    /// There is nothing to draw.
    #[error("{what} is empty; a picture needs at least one element")]
    Empty {
        /// The array, by the name of its field.
        what: String,
    },
    /// A number that must be finite is NaN or infinite.
    #[error("{what}[{index}] is {value}; every value must be finite")]
    NotFinite {
        /// The array, by the name of its field.
        what: String,
        /// Position in the array.
        index: usize,
        /// The offending value.
        value: f64,
    },
    /// A number lies outside the range that can be drawn.
    #[error("{what}[{index}] is {value:e}; it must lie in {min:e} ..= {max:e}")]
    OutOfRange {
        /// The array, by the name of its field.
        what: String,
        /// Position in the array.
        index: usize,
        /// The offending value.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// Two arrays that belong together differ in length.
    #[error("{what} has length {got}, expected {expected}")]
    Length {
        /// The array, by the name of its field.
        what: String,
        /// Its length.
        got: usize,
        /// The length that fits the rest of the data.
        expected: usize,
    },
    /// Time runs backward.
    #[error("time[{index}] = {value:?} s is earlier than the sample before it, {previous:?} s")]
    TimeOrder {
        /// Position of the earlier time.
        index: usize,
        /// The time there.
        value: f64,
        /// The time one sample before.
        previous: f64,
    },
    /// More panels than one picture holds.
    #[error("{what}: {got} are more than the {max} that fit; split the data over several pictures")]
    TooMany {
        /// The collection, by the name of its field.
        what: String,
        /// Its size.
        got: usize,
        /// The largest size that fits.
        max: usize,
    },
    /// An option lies outside its range.
    #[error("{name} = {value:?} is out of range: {range}")]
    Parameter {
        /// Name of the option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The allowed range, in words.
        range: &'static str,
    },
    /// The encoder of the file format failed.
    #[error("cannot write the {format}: {reason}")]
    Encode {
        /// `PNG` or `SVG`.
        format: &'static str,
        /// The encoder's own words.
        reason: String,
    },
}

/// Checks that every value is finite and within `min ..= max`.
pub(crate) fn check_values(
    what: &str,
    values: impl IntoIterator<Item = f64>,
    min: f64,
    max: f64,
) -> Result<(), PlotError> {
    for (index, value) in values.into_iter().enumerate() {
        let what = || what.to_owned();
        if !value.is_finite() {
            return Err(PlotError::NotFinite {
                what: what(),
                index,
                value,
            });
        }
        if !(min..=max).contains(&value) {
            return Err(PlotError::OutOfRange {
                what: what(),
                index,
                value,
                min,
                max,
            });
        }
    }
    Ok(())
}

/// Checks the length of an array that belongs to another one.
pub(crate) fn check_len(what: &str, got: usize, expected: usize) -> Result<(), PlotError> {
    if got == expected {
        return Ok(());
    }
    Err(PlotError::Length {
        what: what.to_owned(),
        got,
        expected,
    })
}
