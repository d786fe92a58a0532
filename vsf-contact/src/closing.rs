use crate::lattice::Lattice;
use crate::mesh_distance::Triangle;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// A sheet of triangles that closes the openings of a mesh where the winding number is 1/2.
///
/// Surface nets: every edge of the lattice that leads from inside to outside without meeting the
/// mesh gets a quad, whose corners are the mean crossings of the four cells around the edge.
/// `winding` and the unsigned `distance` to the mesh are given at the nodes. Openings narrower
/// than the spacing of the lattice are missed.
///
/// # Reference
/// Gibson: Constrained elastic surface nets, 1998, doi:10.1007/BFb0056277 (without relaxation).
pub(crate) fn closing_sheet(lattice: &Lattice, winding: &[f64], distance: &[f64]) -> Vec<Triangle> {
    let mut cells: BTreeMap<usize, (Vector3<f64>, f64)> = BTreeMap::new();
    let mut quads: Vec<[usize; 4]> = Vec::new();
    for_inner_edges(lattice, |node, axis| {
        let mut end = node;
        end[axis] += 1;
        let (i, j) = (lattice.index(node), lattice.index(end));
        let inside = [winding[i] > 0.5, winding[j] > 0.5];
        // A straight way through the mesh is at least as long as the distances of its ends, and
        // just as long through a face at right angles, where rounding decides.
        let through_mesh = distance[i] + distance[j] <= lattice.spacing * (1.0 + 1e-6);
        if inside[0] == inside[1] || through_mesh {
            return;
        }
        let t = (0.5 - winding[i]) / (winding[j] - winding[i]);
        let crossing =
            lattice.node(node[0], node[1], node[2]) + lattice.spacing * t * Vector3::ith(axis, 1.0);
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let quad = [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(db, dc)| {
            let mut cell = node;
            cell[b] -= db;
            cell[c] -= dc;
            lattice.index(cell)
        });
        for cell in quad {
            let (sum, count) = cells.entry(cell).or_insert((Vector3::zeros(), 0.0));
            *sum += crossing.coords;
            *count += 1.0;
        }
        quads.push(quad);
    });
    let corner = |cell: usize| {
        let (sum, count) = cells[&cell];
        Point3::from(sum / count)
    };
    quads
        .iter()
        .flat_map(|quad| {
            let [a, b, c, d] = quad.map(corner);
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

/// Visits the edges that have four cells around them.
fn for_inner_edges(lattice: &Lattice, mut visit: impl FnMut([usize; 3], usize)) {
    for axis in 0..3 {
        let from = |a: usize| usize::from(a != axis);
        let range = |a: usize| from(a)..lattice.dims[a] - 1;
        for k in range(2) {
            for j in range(1) {
                for i in range(0) {
                    visit([i, j, k], axis);
                }
            }
        }
    }
}
