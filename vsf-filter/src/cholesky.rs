use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, cholesky_in_place, cholesky_in_place_scratch};
use faer::{Mat, Par, Spec};
use vsf_core::CoreError;

/// Replaces the lower triangle of `a = L L^T`, named `what` in errors, by `L`; what is above it stays, and is not read.
pub(crate) fn cholesky(what: &'static str, a: &mut Mat<f64>, par: Par) -> Result<(), CoreError> {
    let scratch = cholesky_in_place_scratch::<f64>(a.nrows(), par, Spec::default());
    let mut memory = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut memory);
    match cholesky_in_place(a.as_mut(), Default::default(), par, stack, Spec::default()) {
        Ok(_) => Ok(()),
        Err(LltError::NonPositivePivot { index }) => Err(CoreError::NotPositiveDefinite {
            what,
            pivot: index,
            value: a[(index, index)],
        }),
    }
}
