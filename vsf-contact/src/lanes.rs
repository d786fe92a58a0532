//! Numbers of many points side by side, in vector registers whose width is found at run time. Every
//! operation rounds as its scalar twin does: a point's result depends neither on the width nor on
//! its neighbors.

use nalgebra::Vector3;
use pulp::{Arch, Simd, WithSimd};
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

/// Number of points processed side by side: enough to hide the latency of a division, few enough
/// that their state stays in the first-level cache.
pub(crate) const LANES: usize = 64;

/// One number per point.
pub(crate) type Row = [f64; LANES];

/// Runs `work` with the widest vectors of this machine. Everything it calls must be
/// `#[inline(always)]`: code that is not inlined is compiled for the baseline target.
pub(crate) fn dispatch<W: WithSimd>(work: W) -> W::Output {
    Arch::new().dispatch(work)
}

/// How many vectors hold `len` lanes.
#[inline(always)]
pub(crate) fn vectors<S: Simd>(len: usize) -> usize {
    len.div_ceil(S::F64_LANES)
}

/// One number in each lane.
#[derive(Clone, Copy)]
pub(crate) struct Number<S: Simd> {
    simd: S,
    value: S::f64s,
}

/// Yes or no in each lane.
#[derive(Clone, Copy)]
pub(crate) struct Mask<S: Simd> {
    simd: S,
    value: S::m64s,
}

/// One vector of space in each lane.
#[derive(Clone, Copy)]
pub(crate) struct Triple<S: Simd> {
    pub x: Number<S>,
    pub y: Number<S>,
    pub z: Number<S>,
}

impl<S: Simd> Number<S> {
    #[inline(always)]
    pub fn new(simd: S, value: S::f64s) -> Self {
        Self { simd, value }
    }

    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        Self::new(simd, simd.splat_f64s(value))
    }

    /// The same number in each lane, with the width of `self`.
    #[inline(always)]
    pub fn all(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }

    #[inline(always)]
    pub fn value(self) -> S::f64s {
        self.value
    }

    #[inline(always)]
    pub fn load(simd: S, row: &Row, vector: usize) -> Self {
        Self::new(simd, S::as_simd_f64s(row).0[vector])
    }

    #[inline(always)]
    pub fn store(self, row: &mut Row, vector: usize) {
        S::as_mut_simd_f64s(row).0[vector] = self.value;
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self::new(self.simd, self.simd.sqrt_f64s(self.value))
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        // `abs_f64s` and `select_f64s` are not always inlined.
        let simd = self.simd;
        let but_sign = simd.splat_u64s(u64::MAX >> 1);
        Self::from_bits(simd, simd.and_u64s(self.bits(), but_sign))
    }

    #[inline(always)]
    fn bits(self) -> S::u64s {
        pulp::cast(self.value)
    }

    #[inline(always)]
    fn from_bits(simd: S, bits: S::u64s) -> Self {
        Self::new(simd, pulp::cast(bits))
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        self.above(other).pick(self, other)
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.below(other).pick(self, other)
    }

    /// `1` with the sign of `self`: -1 below zero.
    #[inline(always)]
    pub fn sign(self) -> Self {
        self.below(self.all(0.0))
            .pick(self.all(-1.0), self.all(1.0))
    }

    /// The largest whole number not above, of numbers smaller than 2^51.
    #[inline(always)]
    pub fn floor(self) -> Self {
        // Where the spacing of the numbers is 1 a sum is rounded to a whole one.
        let shift = self.all(1.5 * (1u64 << 52) as f64);
        let near = self + shift - shift;
        near.above(self).pick(near - self.all(1.0), near)
    }

    /// The least whole number not below, of numbers smaller than 2^51.
    #[inline(always)]
    pub fn ceil(self) -> Self {
        let zero = self.all(0.0);
        zero - (zero - self).floor()
    }

    #[inline(always)]
    pub fn above(self, other: Self) -> Mask<S> {
        Mask::new(
            self.simd,
            self.simd.greater_than_f64s(self.value, other.value),
        )
    }

    #[inline(always)]
    pub fn below(self, other: Self) -> Mask<S> {
        Mask::new(self.simd, self.simd.less_than_f64s(self.value, other.value))
    }

    #[inline(always)]
    pub fn at_least(self, other: Self) -> Mask<S> {
        let mask = self
            .simd
            .greater_than_or_equal_f64s(self.value, other.value);
        Mask::new(self.simd, mask)
    }

    #[inline(always)]
    pub fn at_most(self, other: Self) -> Mask<S> {
        let mask = self.simd.less_than_or_equal_f64s(self.value, other.value);
        Mask::new(self.simd, mask)
    }
}

macro_rules! operators {
    ($($trait:ident $method:ident $simd:ident),*) => {$(
        impl<S: Simd> $trait for Number<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self::new(self.simd, self.simd.$simd(self.value, other.value))
            }
        }
    )*};
}
operators!(Add add add_f64s, Sub sub sub_f64s, Mul mul mul_f64s, Div div div_f64s);

impl<S: Simd> Mask<S> {
    #[inline(always)]
    fn new(simd: S, value: S::m64s) -> Self {
        Self { simd, value }
    }

    /// Lane by lane, one number or the other.
    #[inline(always)]
    pub fn pick(self, yes: Number<S>, no: Number<S>) -> Number<S> {
        let bits = self.simd.select_u64s(self.value, yes.bits(), no.bits());
        Number::from_bits(self.simd, bits)
    }

    #[inline(always)]
    pub fn pick3(self, yes: Triple<S>, no: Triple<S>) -> Triple<S> {
        Triple {
            x: self.pick(yes.x, no.x),
            y: self.pick(yes.y, no.y),
            z: self.pick(yes.z, no.z),
        }
    }

    /// Whether it is yes in some lane.
    #[inline(always)]
    pub fn any(self) -> bool {
        self.simd.first_true_m64s(self.value) < S::F64_LANES
    }
}

impl<S: Simd> BitAnd for Mask<S> {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self::new(self.simd, self.simd.and_m64s(self.value, other.value))
    }
}

impl<S: Simd> BitOr for Mask<S> {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self::new(self.simd, self.simd.or_m64s(self.value, other.value))
    }
}

impl<S: Simd> Not for Mask<S> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self::new(self.simd, self.simd.not_m64s(self.value))
    }
}

impl<S: Simd> Triple<S> {
    #[inline(always)]
    pub fn splat(simd: S, vector: Vector3<f64>) -> Self {
        let [x, y, z] = vector.into();
        Self {
            x: Number::splat(simd, x),
            y: Number::splat(simd, y),
            z: Number::splat(simd, z),
        }
    }

    /// The same vector in each lane, with the width of `self`.
    #[inline(always)]
    pub fn all(self, vector: Vector3<f64>) -> Self {
        Self::splat(self.x.simd, vector)
    }

    #[inline(always)]
    pub fn load(simd: S, rows: &[Row; 3], vector: usize) -> Self {
        Self {
            x: Number::load(simd, &rows[0], vector),
            y: Number::load(simd, &rows[1], vector),
            z: Number::load(simd, &rows[2], vector),
        }
    }

    #[inline(always)]
    pub fn store(self, rows: &mut [Row; 3], vector: usize) {
        self.x.store(&mut rows[0], vector);
        self.y.store(&mut rows[1], vector);
        self.z.store(&mut rows[2], vector);
    }

    #[inline(always)]
    pub fn map(self, f: impl Fn(Number<S>) -> Number<S>) -> Self {
        Self {
            x: f(self.x),
            y: f(self.y),
            z: f(self.z),
        }
    }

    #[inline(always)]
    pub fn zip(self, other: Self, f: impl Fn(Number<S>, Number<S>) -> Number<S>) -> Self {
        Self {
            x: f(self.x, other.x),
            y: f(self.y, other.y),
            z: f(self.z, other.z),
        }
    }

    #[inline(always)]
    pub fn dot(self, other: Self) -> Number<S> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub fn norm(self) -> Number<S> {
        self.dot(self).sqrt()
    }
}

impl<S: Simd> Add for Triple<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, Add::add)
    }
}

impl<S: Simd> Sub for Triple<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, Sub::sub)
    }
}

impl<S: Simd> Mul<Number<S>> for Triple<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: Number<S>) -> Self {
        self.map(|a| a * factor)
    }
}
