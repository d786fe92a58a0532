//! Smooth stiffness fields: linear interpolation between the nodes of a lattice.

use nalgebra::Point3;
use std::collections::BTreeMap;

/// Edge of the cells (m), over which stiffness varies smoothly.
const CELL: f64 = 0.04;

pub(super) struct Hats {
    pub(super) nodes: usize,
    /// Point, node and weight.
    pub(super) weights: Vec<(usize, usize, f64)>,
}

/// Trilinear interpolation of the points between the nodes of a lattice, scaled so that every point has unit variance if
/// the nodes have.
pub(super) fn hats(points: &[u32], rest: &[Point3<f64>]) -> Hats {
    let mut nodes = BTreeMap::new();
    let mut weights = Vec::with_capacity(8 * points.len());
    for (k, &p) in points.iter().enumerate() {
        let x = rest[p as usize].coords / CELL;
        let base = x.map(f64::floor);
        let t = x - base;
        let own: Vec<_> = (0..8)
            .map(|corner| {
                let bit = |axis: usize| (corner >> axis) & 1;
                let along = |axis: usize| {
                    if bit(axis) == 1 {
                        t[axis]
                    } else {
                        1.0 - t[axis]
                    }
                };
                let key: [i64; 3] =
                    std::array::from_fn(|axis| base[axis] as i64 + bit(axis) as i64);
                (key, along(0) * along(1) * along(2))
            })
            .collect();
        let norm = own.iter().map(|(_, w)| w * w).sum::<f64>().sqrt();
        for (key, weight) in own {
            let fresh = nodes.len();
            let node = *nodes.entry(key).or_insert(fresh);
            weights.push((k, node, weight / norm));
        }
    }
    Hats {
        nodes: nodes.len(),
        weights,
    }
}
