use super::joint::{sign, speed_unit, unit};
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch};
use crate::effect::{check, per_joint};

/// Dry friction in the joints: `-c_j (w_j + s_j |w_j|)`, with `w_j = tanh(qd_j / eps)`.
///
/// Parameters `c_<joint>` (N m or N), the mean of both directions; the shapes `s_<joint>` (1, -0.5 to 0.5), the share by
/// which it is larger forward and smaller backward; and the shape `eps` (rad/s or m/s), the speed at which friction reaches
/// three quarters of its size (nearly all at twice that speed). Tell-tale: it reverses with the direction of motion, is the
/// same at all speeds and loads, and shows in free motion too. If joints move in one direction only, it looks like a bias.
///
/// # Reference
/// B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, "A survey of models, analysis tools and
/// compensation methods for the control of machines with friction", Automatica 30(7), 1994,
/// doi:10.1016/0005-1098(94)90209-7.
#[derive(Debug, Clone, Copy)]
pub struct JointCoulombFriction;

#[derive(Clone)]
struct Friction {
    c: Vec<f64>,
    skew: Vec<f64>,
    eps: f64,
}

impl Effect for JointCoulombFriction {
    fn name(&self) -> &str {
        "joint_coulomb_friction"
    }

    fn summary(&self) -> &str {
        "dry friction `c_<joint>` against the motion, larger forward by the share `s_<joint>`, nearly full from twice the speed `eps` on"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::Unload | Probe::MoveInAir).then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let mut parameters = per_joint(site, "c", unit(site, "N m", "N"), [0.0, 50.0], 0.3);
        let skew = |j| Parameter::shape(format!("s_{}", j + 1), "1", [-0.5, 0.5], 0.1).of_joint(j);
        parameters.extend((0..site.joints()).map(skew));
        parameters.push(Parameter::shape("eps", speed_unit(site), [1e-3, 0.2], 0.01));
        parameters
    }

    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let start = |eps| [vec![0.0; 2 * site.joints()], vec![eps]].concat();
        [0.005, 0.03].map(start).to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let d = site.joints();
        check(self.name(), theta, 2 * d + 1)?;
        Ok(Box::new(Friction {
            c: theta[..d].to_vec(),
            skew: theta[d..2 * d].to_vec(),
            eps: theta[2 * d],
        }))
    }
}

impl Compensator for Friction {
    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        for (j, t) in tau.iter_mut().enumerate() {
            let way = sign(sample.qd[j], self.eps);
            *t -= self.c[j] * (way + self.skew[j] * way.abs());
        }
    }
}
