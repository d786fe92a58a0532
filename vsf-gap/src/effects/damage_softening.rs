use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use nalgebra::Vector3;

/// Springs that soften permanently with the largest displacement `m` that they have seen:
/// `K (1 - d (1 - exp(-(m - y) / s)))` for `m > y`.
///
/// Parameters `d` (1), the share of the stiffness that can be lost, and the shapes `y` (m), the displacement at which
/// damage begins, and `s` (m), the displacement over which it grows. Damage persists from touch to touch and from sequence
/// to sequence. Tell-tale: the second touch is softer and begins at the same place; a plastic set moves the onset.
///
/// # Reference
/// J. C. Simo, J. W. Ju, "Strain- and stress-based continuum damage models I", Int. J. Solids and
/// Structures 23(7), 1987, doi:10.1016/0020-7683(87)90083-7.
#[derive(Debug, Clone, Copy)]
pub struct DamageSoftening;

#[derive(Clone)]
struct Damage {
    most: f64,
    onset: f64,
    scale: f64,
    /// Largest displacement of every rest point so far (m).
    largest: Vec<f64>,
}

impl Effect for DamageSoftening {
    fn name(&self) -> &str {
        "damage_softening"
    }

    fn summary(&self) -> &str {
        "springs pressed beyond `y` soften for good, by the share `d` over a further `s`"
    }

    fn acts(&self) -> Acts {
        Acts::Springs
    }

    fn null_gain(&self) -> f64 {
        25.0
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact, Need::Retouch]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::Unload | Probe::TouchAgain).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![
            Parameter::amplitude("d", "1", [0.0, 0.8], 0.1),
            Parameter::shape("y", "m", [0.0, 0.02], 2e-3),
            Parameter::shape("s", "m", [8e-3, 0.1], 5e-3),
        ]
    }

    fn starts(&self, _: &Site) -> Vec<Vec<f64>> {
        [[0.005, 0.015], [0.015, 0.02]]
            .map(|[y, s]| vec![0.0, y, s])
            .to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 3)?;
        Ok(Box::new(Damage {
            most: theta[0],
            onset: theta[1],
            scale: theta[2],
            largest: vec![0.0; site.rest.len()],
        }))
    }
}

impl Compensator for Damage {
    fn springs(&mut self, _: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        let contacts = touch.contacts;
        let touched = contacts.points().iter().zip(contacts.displacements());
        for (s, (&p, u)) in springs.iter_mut().zip(touched) {
            let largest = &mut self.largest[p as usize];
            *largest = largest.max(u.norm());
            let beyond = (*largest - self.onset).max(0.0);
            *s *= 1.0 + self.most * (-beyond / self.scale).exp_m1();
        }
    }
}
