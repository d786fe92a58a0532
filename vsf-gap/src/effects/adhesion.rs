use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Site, check};
use vsf_contact::ContactConfig;

/// Points that stick to the robot when it leaves them. Each follows the link, its spring in tension, and lets go when it is
/// pulled further than `reach` from its rest position.
///
/// One parameter, `reach` (m): the tension at which a point lets go is `K reach`. Tell-tale: the torque changes sign as
/// contact is lost, which is not seen on approach. With a plastic set, the force ends early instead.
///
/// # Reference
/// D. Maugis, "Adhesion of spheres: the JKR-DMT transition using a Dugdale model", J. Colloid and
/// Interface Science 150(1), 1992, doi:10.1016/0021-9797(92)90285-T.
#[derive(Debug, Clone, Copy)]
pub struct Adhesion;

#[derive(Clone)]
struct Bond(f64);

impl Effect for Adhesion {
    fn name(&self) -> &str {
        "adhesion"
    }

    fn summary(&self) -> &str {
        "points stick to the robot as it leaves, until pulled by `reach`"
    }

    fn acts(&self) -> Acts {
        Acts::Contact
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::Unload).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![Parameter::amplitude("reach", "m", [0.0, 0.05], 4e-3)]
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 1)?;
        Ok(Box::new(Bond(theta[0])))
    }
}

impl Compensator for Bond {
    fn contact(&self, config: &mut ContactConfig) {
        config.adhesion += self.0;
    }
}
