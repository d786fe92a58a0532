use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use nalgebra::Vector3;

/// Springs that stiffen as they are compressed: `K (1 + beta |u|^2)`, more generally `K (1 + beta |u|^n L^(2 - n))` with
/// `L` = 3 cm.
///
/// Parameters `beta` (1/m²) and the shape `n` (1). Tell-tale: a convex force that depends on the displacement alone, not on
/// its rate or history. Stiff points deep in the object look alike.
///
/// # Reference
/// Y. C. Fung, "Elasticity of soft tissues in simple elongation", American J. Physiology 213(6), 1967,
/// doi:10.1152/ajplegacy.1967.213.6.1532.
#[derive(Debug, Clone, Copy)]
pub struct StrainStiffening;

/// Displacement (m) at which all exponents agree.
const LENGTH: f64 = 0.03;

#[derive(Clone)]
struct Stiffening {
    beta: f64,
    exponent: f64,
}

impl Effect for StrainStiffening {
    fn name(&self) -> &str {
        "strain_stiffening"
    }

    fn summary(&self) -> &str {
        "springs stiffen as they are compressed by u, by the share `beta` u^2; powers `n` other than 2 agree with it at u = 3 cm"
    }

    fn acts(&self) -> Acts {
        Acts::Springs
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::TouchDeeper).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![
            Parameter::amplitude("beta", "1/m^2", [0.0, 1e5], 200.0),
            Parameter::shape("n", "1", [1.0, 4.0], 0.3),
        ]
    }

    fn starts(&self, _: &Site) -> Vec<Vec<f64>> {
        [2.0, 1.0, 4.0].map(|n| vec![0.0, n]).to_vec()
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 2)?;
        Ok(Box::new(Stiffening {
            beta: theta[0],
            exponent: theta[1],
        }))
    }
}

impl Compensator for Stiffening {
    fn springs(&mut self, _: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        for (s, u) in springs.iter_mut().zip(touch.contacts.displacements()) {
            let strain = (u.norm() / LENGTH).powf(self.exponent);
            *s *= 1.0 + self.beta * LENGTH * LENGTH * strain;
        }
    }
}
