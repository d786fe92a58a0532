use super::channels::Channels;
use super::square::{Kernel, OCTET, Square, multiply_square, zero};
use vsf_core::Scalar;

/// Turns `Y = P W^T` into `V = Y L^-T`, and means and variances into `mean + V L^-1 r` and
/// `variance - diag(V V^T)`.
pub(super) struct Gain<'a, T> {
    pub(super) gain: &'a mut Channels<T>,
    pub(super) whitening: &'a [Square<T>],
    pub(super) shift: &'a [T],
    pub(super) mean: &'a mut [T],
    pub(super) variance: &'a mut [T],
}

impl<T: Scalar> Kernel for Gain<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let groups = self.gain.groups();
        let squares = self.gain.squares_mut();
        let bands = squares.len().checked_div(groups).unwrap_or(0);
        let means = self.mean.chunks_mut(OCTET);
        let variances = self.variance.chunks_mut(OCTET);
        for (band, (means, variances)) in (0..bands).zip(means.zip(variances)) {
            // The last group first: it needs all groups before it.
            for to in (0..groups).rev() {
                let mut v = zero();
                for from in 0..=to {
                    let whitening = &self.whitening[to * groups + from];
                    multiply_square::<T, FMA>(&mut v, &squares[from * bands + band], whitening);
                }
                squares[to * bands + band] = v;
                let shift = &self.shift[to * OCTET..(to + 1) * OCTET];
                for ((v, m), s) in v.iter().zip(&mut *means).zip(&mut *variances) {
                    *m += v.0.iter().zip(shift).map(|(&v, &x)| v * x).sum();
                    *s -= v.0.iter().map(|&v| v * v).sum();
                }
            }
        }
    }
}
