use super::body::add_force;
use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use nalgebra::Vector3;
use vsf_core::RestPoints;

/// Springs between neighboring points: besides the force of its own spring, a touched point `i` exerts
/// `-kappa sum_j (u_i - u_j)` on the robot, summed over its neighbors `j`.
///
/// One parameter, `kappa` (N/m). Neighbors are pairs of points at most 1.5 times the typical distance of neighbors apart.
/// Neighbors that are not touched stay at rest. Tell-tale: the force of two places pressed together is not the sum of their
/// single forces.
///
/// # Reference
/// A. D. Kerr, "Elastic and viscoelastic foundation models", J. Applied Mechanics 31(3), 1964,
/// doi:10.1115/1.3629667.
#[derive(Debug, Clone, Copy)]
pub struct SpatialCoupling;

/// How far apart neighbors are at most, in typical distances: the faces and edges of a cubic grid.
const REACH: f64 = 1.5;
/// Points nearer than this share of the reach are in one place, as invalid pixels are. There is no spring
/// between them: thousands of such points would all be each other's neighbors.
const SAME_PLACE: f64 = 1e-3;

#[derive(Clone)]
struct Lattice {
    kappa: f64,
    /// Neighbors of all points, one after the other, and where those of each point begin.
    neighbors: Vec<u32>,
    starts: Vec<u32>,
    /// Displacements of all points (m).
    u: Vec<Vector3<f64>>,
}

impl Effect for SpatialCoupling {
    fn name(&self) -> &str {
        "spatial_coupling"
    }

    fn summary(&self) -> &str {
        "neighboring points hold each other by springs `kappa`"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::TouchDeeper).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![Parameter::amplitude("kappa", "N/m", [0.0, 500.0], 0.5)]
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 1)?;
        let (neighbors, starts) = neighbors(&site.rest);
        Ok(Box::new(Lattice {
            kappa: theta[0],
            neighbors,
            starts,
            u: vec![Vector3::zeros(); site.rest.len()],
        }))
    }
}

fn neighbors(rest: &RestPoints) -> (Vec<u32>, Vec<u32>) {
    let reach = REACH * rest.spacing();
    let half = Vector3::repeat(reach);
    let mut neighbors = Vec::new();
    let mut starts = vec![0];
    for (i, p) in rest.positions().iter().enumerate() {
        rest.for_cells_in(&(p - half), &(p + half), |cell| {
            let near = |j: &&u32| {
                let j = **j as usize;
                let distance = (rest.positions()[j] - p).norm();
                j != i && SAME_PLACE * reach < distance && distance <= reach
            };
            neighbors.extend(cell.points.iter().filter(near));
        });
        starts.push(neighbors.len() as u32);
    }
    (neighbors, starts)
}

impl Compensator for Lattice {
    fn torques(&mut self, _: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        let contacts = touch.contacts;
        let touched = || contacts.points().iter().zip(contacts.displacements());
        for (&p, u) in touched() {
            self.u[p as usize] = *u;
        }
        for ((&p, u), &link) in touched().zip(contacts.links()) {
            let p = p as usize;
            let of_p = self.starts[p] as usize..self.starts[p + 1] as usize;
            let apart = |j: &u32| u - self.u[*j as usize];
            let force: Vector3<f64> = self.neighbors[of_p].iter().map(apart).sum();
            let place = touch.rest.positions()[p] + u;
            let force = force * -self.kappa;
            add_force(touch.posture, link as usize, &place, &force, tau);
        }
        for &p in contacts.points() {
            self.u[p as usize] = Vector3::zeros();
        }
    }
}
