//! The nodes of a soft body and their stiffness.

use crate::body::Body;
use nalgebra::{Point3, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// Mean distance between nodes \[m\].
pub(crate) const SPACING: f64 = 0.0085;

/// Nodes of the body, irregular but nowhere much closer than their mean distance.
pub(crate) fn scatter(body: &Body, rng: &mut Pcg64Mcg) -> Vec<Point3<f64>> {
    let [low, high] = body.bounds();
    let size = high - low;
    let count = size.map(|x| (x / SPACING).ceil() as usize);
    let mut nodes = Vec::new();
    for (i, j, k) in triples(count.into()) {
        let mut jitter = || rng.random_range(-0.38..0.38);
        // Every other layer is shifted, so that no direction has rows.
        let shift = if k % 2 == 0 { 0.0 } else { 0.5 };
        let cell = Vector3::new(
            i as f64 + shift + jitter(),
            j as f64 + shift + jitter(),
            k as f64 + jitter(),
        );
        let p = low + cell * SPACING;
        if body.level(&p) < 0.0 {
            nodes.push(p);
        }
    }
    nodes
}

pub(crate) fn triples([nx, ny, nz]: [usize; 3]) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..nx).flat_map(move |i| (0..ny).flat_map(move |j| (0..nz).map(move |k| (i, j, k))))
}

/// A soft background with stiff regions, varying from node to node.
pub(crate) fn stiffness_field(body: &Body, rest: &[Point3<f64>], rng: &mut Pcg64Mcg) -> Vec<f64> {
    let [low, high] = body.bounds();
    let regions: Vec<_> = (0..rng.random_range(3..6))
        .map(|_| {
            let place = Point3::from(
                low.coords
                    .zip_map(&high.coords, |a, b| rng.random_range(a..b)),
            );
            (
                place,
                rng.random_range(0.03..0.06),
                rng.random_range(1.5..4.0),
            )
        })
        .collect();
    rest.iter()
        .map(|p| {
            let region = |(c, width, height): &(Point3<f64>, f64, f64)| {
                height * (-(p - c).norm_squared() / (2.0 * width * width)).exp()
            };
            let smooth = 0.5 + regions.iter().map(region).sum::<f64>();
            smooth * rng.random_range(0.8..1.2)
        })
        .collect()
}
