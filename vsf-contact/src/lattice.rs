use crate::ContactError;
use nalgebra::{Point3, Vector3};

/// The nodes of a regular grid, x fastest; at least two along each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lattice {
    pub origin: Point3<f64>,
    pub spacing: f64,
    pub dims: [usize; 3],
}

impl Lattice {
    /// Covers the box from `lower` to `upper`.
    pub fn covering(
        lower: &Point3<f64>,
        upper: &Point3<f64>,
        spacing: f64,
        max_nodes: usize,
    ) -> Result<Self, ContactError> {
        let steps = (upper - lower).map(|e| (e / spacing).ceil().max(1.0));
        // In floating point, where nothing overflows.
        let nodes = steps.add_scalar(1.0).product();
        if nodes.is_nan() || nodes > max_nodes as f64 {
            let nodes = nodes as u64;
            return Err(ContactError::GridTooLarge {
                resolution: spacing,
                nodes,
                max: max_nodes,
            });
        }
        // Centered, so that both ends keep the same margin.
        let origin = nalgebra::center(lower, upper) - 0.5 * spacing * steps;
        Ok(Self {
            origin,
            spacing,
            dims: [0, 1, 2].map(|a| steps[a] as usize + 1),
        })
    }

    pub fn len(&self) -> usize {
        self.dims.iter().product()
    }

    pub fn node(&self, i: usize, j: usize, k: usize) -> Point3<f64> {
        self.origin + self.spacing * Vector3::new(i as f64, j as f64, k as f64)
    }

    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    pub fn upper(&self) -> Point3<f64> {
        let [nx, ny, nz] = self.dims;
        self.node(nx - 1, ny - 1, nz - 1)
    }
}
