use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use nalgebra::Vector3;

/// Springs that stay compressed: the share `a` of the displacement beyond the yield displacement `y` remains,
/// `p = a (|u| - y) u / |u|` at the largest displacement so far.
///
/// Parameters `a` (1) and the shape `y` (m). A spring pushes with `u` minus the part of the set along `u`, and never pulls.
/// The set persists from touch to touch and from sequence to sequence. Tell-tale: the force ends early as the robot
/// withdraws, and begins late at the next touch. Damage has the same onset.
///
/// # Reference
/// J. C. Simo, T. J. R. Hughes, *Computational Inelasticity*, 1998, chapter 1, doi:10.1007/b98904.
#[derive(Debug, Clone, Copy)]
pub struct PlasticSet;

#[derive(Clone)]
struct Set {
    share: f64,
    yield_at: f64,
    /// Largest displacement (m) of every rest point so far.
    largest: Vec<Vector3<f64>>,
}

impl Effect for PlasticSet {
    fn name(&self) -> &str {
        "plastic_set"
    }

    fn summary(&self) -> &str {
        "springs pressed beyond `y` stay compressed by the share `a` of the excess"
    }

    fn acts(&self) -> Acts {
        Acts::Springs
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::Unload | Probe::TouchAgain).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![
            Parameter::amplitude("a", "1", [0.0, 1.0], 0.1),
            Parameter::shape("y", "m", [0.0, 0.08], 2e-3),
        ]
    }

    fn starts(&self, _: &Site) -> Vec<Vec<f64>> {
        [0.005, 0.01, 0.02].map(|y| vec![0.0, y]).to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 2)?;
        Ok(Box::new(Set {
            share: theta[0],
            yield_at: theta[1],
            largest: vec![Vector3::zeros(); site.rest.len()],
        }))
    }
}

impl Compensator for Set {
    fn springs(&mut self, _: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        let contacts = touch.contacts;
        let touched = contacts.points().iter().zip(contacts.displacements());
        for (s, (&p, u)) in springs.iter_mut().zip(touched) {
            let largest = &mut self.largest[p as usize];
            if u.norm_squared() > largest.norm_squared() {
                *largest = *u;
            }
            let excess = largest.norm() - self.yield_at;
            if excess > 0.0 && *u != Vector3::zeros() {
                let set = largest.normalize() * (self.share * excess);
                // What remains of the displacement, along itself.
                let gone = set.dot(u).max(0.0) / u.norm_squared();
                *s *= (1.0 - gone).max(0.0);
            }
        }
    }
}
