use crate::link_pose::beyond;
use crate::{Batch, Sdf, SdfSample};
use nalgebra::{Point3, Vector3};

/// The union of bodies: the minimum of their signed distances.
///
/// The distance is exact outside of the union. Inside, where parts overlap, its magnitude is a lower
/// bound of the distance to the surface of the union. With a concrete type `S` a sample needs no
/// dynamic call; `UnionSdf<Box<dyn Sdf>>` mixes types.
///
/// A part is skipped when its bounding box is farther away than another part.
///
/// Without parts the distance is `f64::MAX` everywhere and the bounds are the origin.
#[derive(Debug, Clone, PartialEq)]
pub struct UnionSdf<S> {
    parts: Vec<S>,
    /// [`grown_box`] of every part.
    boxes: Vec<(Point3<f64>, Vector3<f64>)>,
}

/// Center and half extents of the bounding box of a body, grown by its slack and by possible rounding: no place is
/// nearer to the body than to that box.
fn grown_box(body: &impl Sdf) -> (Point3<f64>, Vector3<f64>) {
    let (lower, upper) = body.bounds();
    let center = nalgebra::center(&lower, &upper);
    let rounding = 1e-12 * (upper.coords.amax() + lower.coords.amax());
    let half = (0.5 * (upper - lower)).add_scalar(body.slack() + rounding);
    (center, half)
}

impl<S: Sdf> UnionSdf<S> {
    /// The union of `parts`.
    pub fn new(parts: Vec<S>) -> Self {
        Self {
            boxes: parts.iter().map(grown_box).collect(),
            parts,
        }
    }

    /// The parts.
    pub fn parts(&self) -> &[S] {
        &self.parts
    }

    /// Updates a batch with every part whose box is near enough.
    pub(crate) fn show_parts(&self, batch: &mut Batch) {
        for (part, grown) in self.parts.iter().zip(&self.boxes) {
            batch.show(part, grown);
        }
    }

    /// The nearest part, the first of several, and its distance.
    #[inline]
    fn nearest(&self, p_B: &Point3<f64>) -> (Option<&S>, f64) {
        let (mut nearest, mut least) = (None, f64::MAX);
        for (part, (center, half)) in self.parts.iter().zip(&self.boxes) {
            if beyond(p_B, center, half) < least {
                let distance = part.distance(p_B);
                if distance < least {
                    (nearest, least) = (Some(part), distance);
                }
            }
        }
        (nearest, least)
    }
}

impl<S: Sdf> Sdf for UnionSdf<S> {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        match self.nearest(p_B).0 {
            Some(part) => part.sample(p_B),
            None => SdfSample {
                distance: f64::MAX,
                normal: Vector3::x(),
            },
        }
    }

    fn distance(&self, p_B: &Point3<f64>) -> f64 {
        self.nearest(p_B).1
    }

    fn unite(&self, batch: &mut Batch) {
        S::unite_all(self, batch);
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        self.parts
            .iter()
            .map(Sdf::bounds)
            .reduce(|(lower, upper), (l, u)| (lower.inf(&l), upper.sup(&u)))
            .unwrap_or((Point3::origin(), Point3::origin()))
    }

    /// The largest slack of the parts.
    fn slack(&self) -> f64 {
        self.parts.iter().map(Sdf::slack).fold(0.0, f64::max)
    }
}
