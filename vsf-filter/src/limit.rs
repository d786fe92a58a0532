use vsf_core::CoreError;

/// Most numbers in a matrix (8.6 GB in `f64`): 32768 points squared.
const MAX_ENTRIES: usize = 1 << 30;

/// What a factorization in `f64` holds of an entry, at least: the matrix, its factor, and one more of their size (bytes).
pub(crate) const FACTORIZED: usize = 3 * size_of::<f64>();

/// Refuses a matrix of `n` points by as many numbers `each` that is too large, or for which there is no memory, by how many
/// bytes are held of an entry: later nothing could be done but to abort.
pub(crate) fn check_entries(
    n: usize,
    each: usize,
    held: usize,
    what: &'static str,
) -> Result<(), CoreError> {
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
    let bytes = held * n * each;
    let room = Vec::<u8>::new().try_reserve_exact(bytes);
    room.map_err(|_| CoreError::OutOfMemory {
        what,
        got: n,
        bytes,
    })
}
