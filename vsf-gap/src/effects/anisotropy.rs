use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch, check};
use nalgebra::Vector3;

/// Springs whose stiffness depends on the direction: `K (u + a_t (u - n (n . u)) + a_x u_x + a_y u_y)`,
/// with `n` the normal of the touching surface and `u_x`, `u_y` the parts along world x and y.
///
/// Parameters `a_t`, `a_x`, `a_y` (1): what the stiffness is larger by along the surface, and along x
/// and y compared to z. Tell-tale: the force is not along the displacement, also where nothing slips.
///
/// # Reference
/// G. Picinbono, H. Delingette, N. Ayache, "Non-linear anisotropic elasticity for real-time surgery
/// simulation", Graphical Models 65(5), 2003, doi:10.1016/S1524-0703(03)00045-6.
#[derive(Debug, Clone, Copy)]
pub struct Anisotropy;

struct Directions {
    tangential: f64,
    axes: Vector3<f64>,
}

impl Effect for Anisotropy {
    fn name(&self) -> &str {
        "anisotropy"
    }

    fn acts(&self) -> Acts {
        Acts::Springs
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        ["a_t", "a_x", "a_y"]
            .map(|name| Parameter::amplitude(name, "1", [-0.95, 10.0], 0.2))
            .to_vec()
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 3)?;
        Ok(Box::new(Directions {
            tangential: theta[0],
            axes: Vector3::new(theta[1], theta[2], 0.0),
        }))
    }
}

impl Compensator for Directions {
    fn springs(&mut self, _: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        for (s, n) in springs.iter_mut().zip(touch.contacts.normals()) {
            let along = *s - n * n.dot(s);
            *s += along * self.tangential + self.axes.component_mul(s);
        }
    }
}
