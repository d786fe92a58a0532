use crate::{Sdf, SdfSample};
use nalgebra::Point3;

/// The union of bodies: the least of their distances.
///
/// Exact outside of the union. Inside, where parts overlap, the magnitude is a lower bound of the
/// distance to the surface of the union. With `S` a concrete type a sample needs no dynamic call;
/// `UnionSdf<Box<dyn Sdf>>` mixes kinds.
///
/// Without parts the distance is `f64::MAX` everywhere and the bounds are the origin.
#[derive(Debug, Clone, PartialEq)]
pub struct UnionSdf<S> {
    parts: Vec<S>,
}

impl<S: Sdf> UnionSdf<S> {
    /// The union of `parts`.
    pub fn new(parts: Vec<S>) -> Self {
        Self { parts }
    }

    /// The parts.
    pub fn parts(&self) -> &[S] {
        &self.parts
    }
}

impl<S: Sdf> Sdf for UnionSdf<S> {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        let Some((first, others)) = self.parts.split_first() else {
            return SdfSample {
                distance: f64::MAX,
                normal: nalgebra::Vector3::x(),
            };
        };
        let mut nearest = first;
        let mut least = first.distance(p_B);
        for part in others {
            let distance = part.distance(p_B);
            if distance < least {
                least = distance;
                nearest = part;
            }
        }
        nearest.sample(p_B)
    }

    fn distance(&self, p_B: &Point3<f64>) -> f64 {
        self.parts
            .iter()
            .fold(f64::MAX, |least, part| least.min(part.distance(p_B)))
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        self.parts
            .iter()
            .map(Sdf::bounds)
            .reduce(|(lower, upper), (l, u)| (lower.inf(&l), upper.sup(&u)))
            .unwrap_or((Point3::origin(), Point3::origin()))
    }

    /// The largest of the parts.
    fn slack(&self) -> f64 {
        self.parts.iter().map(Sdf::slack).fold(0.0, f64::max)
    }
}
