//! Values of points: gather and scatter those of touched points, check them, clamp them at zero.

use vsf_core::Scalar;

/// Neighboring points that are copied at once.
const RUN: usize = 4;

/// Copies `from[i][points[k]]` to `to[i][k]`. Points increase, and many are neighbors.
#[inline(always)]
pub(crate) fn gather<T: Scalar, const N: usize>(
    points: &[u32],
    from: [&[T]; N],
    to: [&mut [T]; N],
) {
    let (runs, rest) = points.as_chunks::<RUN>();
    let mut start = 0;
    for points in runs {
        let run = run(points);
        for i in 0..N {
            let to = &mut to[i][start..start + RUN];
            if let Some(first) = run {
                to.copy_from_slice(&from[i][first..first + RUN]);
            } else {
                for (x, &p) in to.iter_mut().zip(points) {
                    *x = from[i][p as usize];
                }
            }
        }
        start += RUN;
    }
    for i in 0..N {
        for (x, &p) in to[i][start..].iter_mut().zip(rest) {
            *x = from[i][p as usize];
        }
    }
}

/// Copies `from[k]` to `to[points[k]]`.
pub(crate) fn scatter<T: Scalar>(points: &[u32], from: &[T], to: &mut [T]) {
    let (runs, rest) = points.as_chunks::<RUN>();
    let (from_runs, from_rest) = from.as_chunks::<RUN>();
    for (points, from) in runs.iter().zip(from_runs) {
        if let Some(first) = run(points) {
            to[first..first + RUN].copy_from_slice(from);
        } else {
            for (&p, &x) in points.iter().zip(from) {
                to[p as usize] = x;
            }
        }
    }
    for (&p, &x) in rest.iter().zip(from_rest) {
        to[p as usize] = x;
    }
}

/// The first of points that increase, if they are neighbors.
#[inline(always)]
fn run(points: &[u32; RUN]) -> Option<usize> {
    let [first, .., last] = *points;
    (last - first == RUN as u32 - 1).then_some(first as usize)
}

/// Whether all values are finite.
pub(crate) fn all_finite<T: Scalar>(values: &[T]) -> bool {
    // No early exit, which would keep the loop from vectorizing.
    values.iter().fold(true, |ok, x| ok & x.is_finite())
}

/// Whether all values are finite and positive.
pub(crate) fn all_positive<T: Scalar>(values: &[T]) -> bool {
    values
        .iter()
        .fold(true, |ok, x| ok & x.is_finite() & (*x > T::ZERO))
}

/// Sets negative values to zero and returns their number.
pub(crate) fn project<T: Scalar>(values: &mut [T]) -> usize {
    let mut moved = 0u32;
    for x in values {
        moved += u32::from(*x < T::ZERO);
        *x = if *x < T::ZERO { T::ZERO } else { *x };
    }
    moved as usize
}

/// [`project`] of the values at `points`.
pub(crate) fn project_at<T: Scalar>(points: &[u32], values: &mut [T]) -> usize {
    let mut moved = 0;
    for &p in points {
        let x = &mut values[p as usize];
        if *x < T::ZERO {
            *x = T::ZERO;
            moved += 1;
        }
    }
    moved
}
