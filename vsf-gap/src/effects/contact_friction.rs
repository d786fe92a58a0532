use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Site, check};
use vsf_contact::ContactConfig;

/// A friction coefficient between robot and object that differs from the nominal one.
///
/// One parameter, `d_mu` (1), the difference to the nominal coefficient. Tell-tale: tangential forces, and a hysteresis
/// loop when the tangential motion reverses.
///
/// # Reference
/// K. L. Johnson, *Contact Mechanics*, 1985, chapter 7, doi:10.1017/CBO9781139171731.
#[derive(Debug, Clone, Copy)]
pub struct ContactFriction;

/// The largest coefficient that is looked for, where the nominal one is not near it.
const MOST: f64 = 1.5;

#[derive(Clone)]
struct Coefficient(f64);

impl Effect for ContactFriction {
    fn name(&self) -> &str {
        "contact_friction"
    }

    fn summary(&self) -> &str {
        "friction between robot and object is larger by `d_mu` than assumed, smaller where it is negative"
    }

    fn acts(&self) -> Acts {
        Acts::Contact
    }

    fn null_gain(&self) -> f64 {
        25.0
    }

    fn chooses_contacts(&self) -> bool {
        true
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::Unload).then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let bounds = [-site.friction, (MOST - site.friction).max(MOST / 3.0)];
        vec![Parameter::amplitude("d_mu", "1", bounds, 0.1).ending_low()]
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 1)?;
        Ok(Box::new(Coefficient(theta[0])))
    }
}

impl Compensator for Coefficient {
    fn contact(&self, config: &mut ContactConfig) {
        config.friction = (config.friction + self.0).max(0.0);
    }
}
