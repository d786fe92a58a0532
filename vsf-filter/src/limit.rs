use vsf_core::CoreError;

/// Most numbers in a matrix (8.6 GB in `f64`): 32768 points squared.
const MAX_ENTRIES: usize = 1 << 30;

/// Refuses a matrix of `n` points by as many numbers `each` that is too large.
pub(crate) fn check_entries(n: usize, each: usize, what: &'static str) -> Result<(), CoreError> {
    match n.saturating_mul(each) > MAX_ENTRIES {
        true => Err(CoreError::TooMany {
            what,
            got: n,
            max: match each == n {
                true => MAX_ENTRIES.isqrt(),
                false => MAX_ENTRIES / each,
            },
        }),
        false => Ok(()),
    }
}
