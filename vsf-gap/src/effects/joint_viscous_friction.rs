use super::joint::unit;
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch};
use crate::effect::{check, per_joint};

/// Friction in the joints that grows with speed: `-d_j qd_j`.
///
/// Parameters `d_<joint>` (N m s/rad or N s/m). Tell-tale: proportional to the velocity of its own joint, in free motion
/// too. If joints move at one speed only, it looks like dry friction.
///
/// # Reference
/// B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, "A survey of models, analysis tools and
/// compensation methods for the control of machines with friction", Automatica 30(7), 1994,
/// doi:10.1016/0005-1098(94)90209-7.
#[derive(Debug, Clone, Copy)]
pub struct JointViscousFriction;

#[derive(Clone)]
struct Damping(Vec<f64>);

impl Effect for JointViscousFriction {
    fn name(&self) -> &str {
        "joint_viscous_friction"
    }

    fn summary(&self) -> &str {
        "friction `d_<joint>` in proportion to the speed of the joint"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::TouchFaster | Probe::MoveInAir).then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let unit = unit(site, "N m s/rad", "N s/m");
        per_joint(site, "d", unit, [0.0, 200.0], 2.0)
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, site.joints())?;
        Ok(Box::new(Damping(theta.to_vec())))
    }
}

impl Compensator for Damping {
    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        for ((t, d), v) in tau.iter_mut().zip(&self.0).zip(sample.qd) {
            *t -= d * v;
        }
    }
}
