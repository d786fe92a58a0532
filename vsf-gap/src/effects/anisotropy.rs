use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use nalgebra::{Matrix3, Vector3};

/// Springs whose stiffness depends on the direction: `K (u + a_t (u - n (n . u)) + S u)`, with `n` the normal of the
/// touching surface and `S` a symmetric matrix in world axes, `S_zz = 0`.
///
/// Friction bounds the force along the surface. What exceeds the cone about `n` of the assumed coefficient (without
/// `contact_friction`), or of the displacement itself, is left out. Points that are pulled (`n . u <= 0`) keep `K u`.
///
/// Parameters `a_t`, `s_xx`, `s_yy`, `s_xy`, `s_xz`, `s_yz` (1): the relative excess of the stiffness along the surface,
/// and in directions of the world compared to z. Tell-tale: the force is not along the displacement, even where nothing
/// slips.
///
/// # Reference
/// G. Picinbono, H. Delingette, N. Ayache, "Non-linear anisotropic elasticity for real-time surgery
/// simulation", Graphical Models 65(5), 2003, doi:10.1016/S1524-0703(03)00045-6.
#[derive(Debug, Clone, Copy)]
pub struct Anisotropy;

#[derive(Clone)]
struct Directions {
    tangential: f64,
    friction: f64,
    world: Matrix3<f64>,
}

impl Effect for Anisotropy {
    fn name(&self) -> &str {
        "anisotropy"
    }

    fn summary(&self) -> &str {
        "stiffness depends on the direction: larger by `a_t` along the surface, by `s_..` along world axes compared to z"
    }

    fn acts(&self) -> Acts {
        Acts::Springs
    }

    fn null_gain(&self) -> f64 {
        30.0
    }

    fn chooses_contacts(&self) -> bool {
        true
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(
            probe,
            Probe::TouchInOtherPosture | Probe::TouchAlongOtherAxis
        )
        .then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        let bounded = |name, bounds| Parameter::amplitude(name, "1", bounds, 0.2);
        let along = ["a_t", "s_xx", "s_yy"].map(|name| bounded(name, [-0.95, 10.0]));
        // Those of a direction that is stiffer by 10 and lies between two axes.
        let between = ["s_xy", "s_xz", "s_yz"].map(|name| bounded(name, [-5.0, 5.0]));
        along.into_iter().chain(between).collect()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 6)?;
        let [xx, yy, xy, xz, yz] = [theta[1], theta[2], theta[3], theta[4], theta[5]];
        Ok(Box::new(Directions {
            tangential: theta[0],
            friction: site.friction,
            world: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, 0.0),
        }))
    }
}

impl Directions {
    /// What a point gives per stiffness (m) that is displaced by `u`.
    fn spring(&self, u: &Vector3<f64>, n: &Vector3<f64>) -> Vector3<f64> {
        let (pressed, along) = parts(u, n);
        // What adhesion pulls, or the mean of several sub-points is ahead of, has no cone to stay in.
        if pressed <= 0.0 {
            return *u;
        }
        let (stiffer, mut aside) = parts(&(u + along * self.tangential + self.world * u), n);
        // Where `S` outweighs the rest, nothing is left to push; nothing pulls.
        let stiffer = stiffer.max(0.0);
        // Contact itself may be steeper, where it is the mean of several sub-points.
        let steepest = self.friction.max(along.norm() / pressed);
        let most = steepest * stiffer;
        if aside.norm() > most {
            aside *= most / aside.norm();
        }
        n * stiffer + aside
    }
}

impl Compensator for Directions {
    fn springs(&mut self, _: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        for (s, n) in springs.iter_mut().zip(touch.contacts.normals()) {
            *s = self.spring(s, n);
        }
    }
}

/// A vector's size along `n`, and the rest of it.
fn parts(v: &Vector3<f64>, n: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let along = n.dot(v);
    (along, v - n * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As under adhesion.
    #[test]
    fn what_is_pulled_stays() {
        let n = Vector3::z();
        let u = Vector3::new(0.001, 0.0, -0.002);
        for tangential in [0.0, 3.0] {
            let directions = Directions {
                tangential,
                friction: 0.15,
                world: Matrix3::zeros(),
            };
            assert_eq!(directions.spring(&u, &n), u);
        }
    }

    /// `1 + S` may be indefinite within the bounds of its numbers.
    #[test]
    fn no_direction_pulls() {
        let of = |xy: f64| Directions {
            tangential: 0.0,
            friction: 0.15,
            world: Matrix3::new(0.0, xy, 0.0, xy, 0.0, 0.0, 0.0, 0.0, 0.0),
        };
        let n = Vector3::new(1.0, -1.0, 0.0).normalize();
        let u = n * 0.01;
        assert_eq!(of(5.0).spring(&u, &n), Vector3::zeros());
        assert!((of(-5.0).spring(&u, &n) - u * 6.0).norm() < 1e-12);
    }
}
