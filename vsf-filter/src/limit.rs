use vsf_core::CoreError;

/// Most numbers in a matrix (8.6 GB in `f64`): 32768 points squared.
const MAX_ENTRIES: usize = 1 << 30;

/// Such matrices that a fit holds at once, at least.
const COPIES: usize = 3;

/// Refuses a matrix of `n` points by as many numbers `each` that is too large, or for which there is no memory: later
/// nothing could be done but to abort.
pub(crate) fn check_entries(n: usize, each: usize, what: &'static str) -> Result<(), CoreError> {
    if n.saturating_mul(each) > MAX_ENTRIES {
        return Err(CoreError::TooMany {
            what,
            got: n,
            max: if each == n {
                MAX_ENTRIES.isqrt()
            } else {
                MAX_ENTRIES / each
            },
        });
    }
    let bytes = COPIES * n * each * size_of::<f64>();
    let room = Vec::<u8>::new().try_reserve_exact(bytes);
    room.map_err(|_| CoreError::OutOfMemory {
        what,
        got: n,
        bytes,
    })
}
