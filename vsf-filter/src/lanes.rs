//! Sums of products of rows, in vector registers. The width of the vectors is detected at run time. Sums
//! run over fixed lanes, with every product rounded, so that results do not depend on the width.

use pulp::{Arch, Scalar128b, Simd, WithSimd};
use vsf_core::Scalar;

/// Bytes of a group of lanes: the widest vector there is.
const GROUP: usize = 64;
/// Vectors in a group, at most.
const VECTORS: usize = 4;
/// Lanes of the narrowest number.
const LANES: usize = GROUP / size_of::<f32>();

/// `f32` and `f64`, with the names that `pulp` has for each.
pub(crate) trait Lanes: Scalar {
    type Vector<S: Simd>: Copy;
    /// The slice in vectors, without what is left over.
    fn vectors<S: Simd>(values: &[Self]) -> &[Self::Vector<S>];
    fn vectors_mut<S: Simd>(values: &mut [Self]) -> &mut [Self::Vector<S>];
    fn splat<S: Simd>(simd: S, value: Self) -> Self::Vector<S>;
    fn multiply<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    fn plus<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
}

macro_rules! lanes {
    ($t:ty, $vector:ident, $split:ident, $split_mut:ident, $splat:ident, $mul:ident, $add:ident) => {
        impl Lanes for $t {
            type Vector<S: Simd> = S::$vector;
            #[inline(always)]
            fn vectors<S: Simd>(values: &[Self]) -> &[S::$vector] {
                S::$split(values).0
            }
            #[inline(always)]
            fn vectors_mut<S: Simd>(values: &mut [Self]) -> &mut [S::$vector] {
                S::$split_mut(values).0
            }
            #[inline(always)]
            fn splat<S: Simd>(simd: S, value: Self) -> S::$vector {
                simd.$splat(value)
            }
            #[inline(always)]
            fn multiply<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$mul(a, b)
            }
            #[inline(always)]
            fn plus<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$add(a, b)
            }
        }
    };
}
lanes!(
    f32,
    f32s,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    mul_f32s,
    add_f32s
);
lanes!(
    f64,
    f64s,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    mul_f64s,
    add_f64s
);

/// Runs `work` with the vectors of this machine, of 32 bytes at most: rows begin anywhere, and loads of
/// 64 bytes would nearly all cross a cache line. Everything it calls must be `#[inline(always)]`: what is
/// not inlined is compiled for any machine.
pub(crate) fn dispatch<W: WithSimd>(work: W) -> W::Output {
    struct Wide<W>(W);
    impl<W: WithSimd> WithSimd for Wide<W> {
        type Output = W::Output;
        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> W::Output {
            if S::IS_SCALAR {
                self.0.with_simd(Scalar128b)
            } else {
                self.0.with_simd(simd)
            }
        }
    }
    arch().dispatch(Wide(work))
}

fn arch() -> Arch {
    match Arch::new() {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Arch::V4(widest) => Arch::V3(*widest),
        arch => arch,
    }
}

/// Numbers of a row that fill whole groups.
#[inline(always)]
fn whole<T>(len: usize) -> usize {
    len - len % (GROUP / size_of::<T>())
}

/// A sum over a row, lane by lane. A machine with wide vectors needs the first ones only.
struct Sum<S: Simd, T: Lanes>([T::Vector<S>; VECTORS]);

impl<S: Simd, T: Lanes> Clone for Sum<S, T> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<S: Simd, T: Lanes> Copy for Sum<S, T> {}

impl<S: Simd, T: Lanes> Sum<S, T> {
    const USED: usize = GROUP / size_of::<T::Vector<S>>();

    #[inline(always)]
    fn zero(simd: S) -> Self {
        Self([T::splat(simd, T::ZERO); VECTORS])
    }

    #[inline(always)]
    fn add_product(&mut self, simd: S, v: usize, a: T::Vector<S>, b: T::Vector<S>) {
        self.0[v] = T::plus(simd, self.0[v], T::multiply(simd, a, b));
    }

    /// The lanes together, and the products of what was left over of both rows.
    #[inline(always)]
    fn total(&self, a: &[T], b: &[T]) -> f64 {
        let mut lanes = [T::ZERO; LANES];
        let vectors = T::vectors_mut::<S>(&mut lanes);
        vectors[..Self::USED].copy_from_slice(&self.0[..Self::USED]);
        for half in [8, 4, 2, 1] {
            for l in 0..half {
                lanes[l] += lanes[l + half];
            }
        }
        let mut total = lanes[0];
        for k in whole::<T>(a.len())..a.len() {
            total += a[k] * b[k];
        }
        total.to_f64()
    }
}

/// `sum_k left[i]_k right[j]_k` at `[i][j]`, of rows of one length. Few rows at a time: a number
/// loaded once then serves several products, whose sums stay in registers.
#[inline(always)]
pub(crate) fn products<S: Simd, T: Lanes, const I: usize, const J: usize>(
    simd: S,
    left: [&[T]; I],
    right: [&[T]; J],
) -> [[f64; J]; I] {
    let whole = whole::<T>(left[0].len());
    let (mut l, mut r) = ([[].as_slice(); I], [[].as_slice(); J]);
    for i in 0..I {
        l[i] = T::vectors::<S>(&left[i][..whole]);
    }
    for j in 0..J {
        r[j] = T::vectors::<S>(&right[j][..whole]);
    }
    let mut sums = [[Sum::<S, T>::zero(simd); J]; I];
    for first in (0..l[0].len()).step_by(Sum::<S, T>::USED) {
        for v in 0..Sum::<S, T>::USED {
            for i in 0..I {
                for j in 0..J {
                    sums[i][j].add_product(simd, v, l[i][first + v], r[j][first + v]);
                }
            }
        }
    }
    let mut totals = [[0.0; J]; I];
    for i in 0..I {
        for j in 0..J {
            totals[i][j] = sums[i][j].total(left[i], right[j]);
        }
    }
    totals
}

/// Writes `rows[i] scale` to `scaled[i]`. Returns the products of these with `rows` (lower
/// triangle) and those of `rows` with `x`, in one pass.
#[inline(always)]
pub(crate) fn scale<S: Simd, T: Lanes, const I: usize, const N: usize>(
    simd: S,
    rows: [&[T]; I],
    scale: &[T],
    x: &[T],
    scaled: &mut [[T; N]; I],
) -> ([[f64; I]; I], [f64; I]) {
    let len = scale.len();
    let whole = whole::<T>(len);
    let mut r = [[].as_slice(); I];
    for i in 0..I {
        r[i] = T::vectors::<S>(&rows[i][..whole]);
    }
    let scales = T::vectors::<S>(&scale[..whole]);
    let xs = T::vectors::<S>(&x[..whole]);
    let (mut squares, mut readings) = (
        [[Sum::<S, T>::zero(simd); I]; I],
        [Sum::<S, T>::zero(simd); I],
    );
    for first in (0..scales.len()).step_by(Sum::<S, T>::USED) {
        for v in 0..Sum::<S, T>::USED {
            let k = first + v;
            for i in 0..I {
                let product = T::multiply(simd, r[i][k], scales[k]);
                T::vectors_mut::<S>(&mut scaled[i][..whole])[k] = product;
                for j in 0..=i {
                    squares[i][j].add_product(simd, v, product, r[j][k]);
                }
                readings[i].add_product(simd, v, r[i][k], xs[k]);
            }
        }
    }
    let (mut square_totals, mut reading_totals) = ([[0.0; I]; I], [0.0; I]);
    for i in 0..I {
        for k in whole..len {
            scaled[i][k] = rows[i][k] * scale[k];
        }
        for j in 0..=i {
            square_totals[i][j] = squares[i][j].total(&scaled[i][..len], rows[j]);
        }
        reading_totals[i] = readings[i].total(rows[i], x);
    }
    (square_totals, reading_totals)
}
