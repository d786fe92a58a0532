use std::fmt::{Debug, Display};
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// The number type of beliefs, observations and estimators: `f32` or `f64`.
///
/// The trait is sealed: a third implementation would have to guarantee the IEEE semantics that estimators rely on.
pub trait Scalar:
    sealed::Sealed
    + Copy
    + Default
    + Debug
    + Display
    + PartialEq
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + Sum
    + Send
    + Sync
    + 'static
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// Distance from 1 to the next larger number.
    const EPSILON: Self;
    /// Name as NumPy spells it: `float32` or `float64`.
    const NAME: &'static str;
    /// Rounds an `f64` to this type; values beyond its range become infinite.
    fn from_f64(value: f64) -> Self;
    /// Widens to `f64`, exactly.
    fn to_f64(self) -> f64;
    /// False for NaN and infinities.
    fn is_finite(self) -> bool;
    /// The larger of two numbers; if one is NaN, the other.
    fn max(self, other: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// `self * a + b`, rounded once. Fast only if the processor has a fused multiply-add instruction.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Runs the implementation of `W` for this type.
    fn run<W: PerScalar>(input: W::Input<'_, Self>) -> W::Output;
}

/// A computation with separate implementations for `f32` and `f64`, such as vector instructions.
///
/// Generic code calls it through [`Scalar::run`].
///
/// ```
/// use vsf_core::{PerScalar, Scalar};
///
/// struct Ones;
/// impl PerScalar for Ones {
///     type Input<'a, T: Scalar> = &'a [T];
///     type Output = u32;
///     fn f32(x: &[f32]) -> u32 {
///         x.iter().map(|x| x.to_bits().count_ones()).sum()
///     }
///     fn f64(x: &[f64]) -> u32 {
///         x.iter().map(|x| x.to_bits().count_ones()).sum()
///     }
/// }
/// fn ones<T: Scalar>(x: &[T]) -> u32 {
///     T::run::<Ones>(x)
/// }
/// assert_eq!((ones(&[1.0f32]), ones(&[1.0f64])), (7, 10));
/// ```
pub trait PerScalar {
    /// The input, for number type `T`.
    type Input<'a, T: Scalar>;
    /// The result.
    type Output;
    /// The implementation for `f32`.
    fn f32(input: Self::Input<'_, f32>) -> Self::Output;
    /// The implementation for `f64`.
    fn f64(input: Self::Input<'_, f64>) -> Self::Output;
}

macro_rules! scalar {
    ($t:ident, $name:literal) => {
        impl Scalar for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const EPSILON: Self = $t::EPSILON;
            const NAME: &'static str = $name;
            #[inline]
            fn from_f64(value: f64) -> Self {
                value as $t
            }
            #[inline]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline]
            fn is_finite(self) -> bool {
                $t::is_finite(self)
            }
            #[inline]
            fn max(self, other: Self) -> Self {
                $t::max(self, other)
            }
            #[inline]
            fn sqrt(self) -> Self {
                $t::sqrt(self)
            }
            #[inline]
            fn mul_add(self, a: Self, b: Self) -> Self {
                $t::mul_add(self, a, b)
            }
            #[inline]
            fn run<W: PerScalar>(input: W::Input<'_, Self>) -> W::Output {
                W::$t(input)
            }
        }
    };
}
scalar!(f32, "float32");
scalar!(f64, "float64");
