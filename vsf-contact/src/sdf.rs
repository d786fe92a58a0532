use crate::{Batch, UnionSdf};
use nalgebra::{Point3, Vector3};
use std::sync::Arc;

/// Signed distance and outward normal of a body's surface at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SdfSample {
    /// Signed distance \[m\], negative inside.
    pub distance: f64,
    /// Outward unit normal: the gradient of the distance. Where the gradient does not exist (the
    /// center of a ball, an edge seen from inside) it is the normal of one of the nearest faces.
    pub normal: Vector3<f64>,
}

/// A signed distance field: the shape of a body for contact models.
///
/// The distance is 1-Lipschitz: `|distance(p) - distance(q)| <= |p - q|`. The broad phase of
/// contact relies on this to skip points until a link may have come near. An interpolated field
/// may exceed the bound by its [`slack`](Sdf::slack).
///
/// For a finite point every returned number is finite and the normal has unit length. For a point
/// with NaN or infinite coordinates the result is unspecified, but there is no panic. `check_sdf` of
/// `vsf-testkit` tests all of this.
pub trait Sdf: Send + Sync {
    /// Signed distance and outward unit normal at a point in the body frame.
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample;

    /// Signed distance \[m\] alone, which may be cheaper than [`sample`](Sdf::sample).
    fn distance(&self, p_B: &Point3<f64>) -> f64 {
        self.sample(p_B).distance
    }

    /// Takes the [`sample`](Sdf::sample) of every place in a batch, and keeps it where it is nearer
    /// than that of all surfaces before ([`Batch::offer`]).
    ///
    /// Contact models take most samples in this way. The default processes one place at a time.
    fn unite(&self, batch: &mut Batch) {
        for i in 0..batch.len() {
            batch.offer(i, &self.sample(&batch.place(i)));
        }
    }

    /// Updates a batch with all parts of a union, like [`unite`](Sdf::unite) for each part in turn.
    ///
    /// The default skips a part at places that are already nearer to another part than to its bounding
    /// box. Bodies that can process all parts together at less cost override this.
    fn unite_all(union: &UnionSdf<Self>, batch: &mut Batch)
    where
        Self: Sized,
    {
        union.show_parts(batch);
    }

    /// Lower and upper corner of an axis-aligned box in the body frame that contains the body and its
    /// surface.
    fn bounds(&self) -> (Point3<f64>, Point3<f64>);

    /// By how much the distance may exceed the 1-Lipschitz bound \[m\], >= 0, default 0:
    /// `|distance(p) - distance(q)| <= |p - q| + slack` for all points.
    fn slack(&self) -> f64 {
        0.0
    }
}

/// Thickness of a body: an estimate of the greatest depth below its surface (m).
///
/// It is the largest depth at the centers of the 9 x 9 x 9 cells of its bounding box, so it may be too small by about the
/// size of a cell.
pub fn thickness(sdf: &dyn Sdf) -> f64 {
    const CELLS: usize = 9;
    let (low, high) = sdf.bounds();
    let middle = |k: usize| (k as f64 + 0.5) / CELLS as f64;
    let place = |k: usize| {
        let along = [k % CELLS, k / CELLS % CELLS, k / CELLS / CELLS].map(middle);
        low + (high - low).component_mul(&Vector3::from(along))
    };
    let depths = (0..CELLS.pow(3)).map(|k| -sdf.distance(&place(k)));
    depths.fold(0.0, f64::max)
}

impl std::fmt::Debug for dyn Sdf {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (lower, upper) = self.bounds();
        let mut shape = f.debug_struct("Sdf");
        shape.field("lower", &lower).field("upper", &upper);
        shape.finish_non_exhaustive()
    }
}

macro_rules! forward {
    ($($pointer:ty),*) => {$(
        impl<S: Sdf + ?Sized> Sdf for $pointer {
            fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
                (**self).sample(p_B)
            }
            fn distance(&self, p_B: &Point3<f64>) -> f64 {
                (**self).distance(p_B)
            }
            fn unite(&self, batch: &mut Batch) {
                (**self).unite(batch);
            }
            fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
                (**self).bounds()
            }
            fn slack(&self) -> f64 {
                (**self).slack()
            }
        }
    )*};
}
forward!(Box<S>, Arc<S>, &S);
