use super::joint::{unit, where_sliding};
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site};
use crate::effect::{check, per_joint};

/// Joint encoders with a constant offset: the links are at `q_j + o_j`.
///
/// Parameters `o_<joint>` (rad or m). Tell-tale: contacts shift and torques act about other axes, by amounts that depend on
/// the posture.
///
/// In readings without the arm's weight (`torque_kind: external`), it changes only what contact contributes: the weight is
/// assumed to have been subtracted at the true angles.
///
/// # Reference
/// J. M. Hollerbach, C. W. Wampler, "The calibration index and taxonomy for robot kinematic
/// calibration methods", Int. J. Robotics Research 15(6), 1996, doi:10.1177/027836499601500604.
#[derive(Debug, Clone, Copy)]
pub struct EncoderOffset;

#[derive(Clone)]
struct Offset(Vec<f64>);

impl Effect for EncoderOffset {
    fn name(&self) -> &str {
        "encoder_offset"
    }

    fn summary(&self) -> &str {
        "links are ahead of their encoders by the constants `o_<joint>`, behind by negative ones"
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

    fn may_prevent_touch(&self) -> bool {
        true
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        match probe {
            Probe::TouchInOtherPosture => Some(self.name()),
            // Where links that slide are is where the object is not.
            Probe::TouchAlongOtherAxis => Some("registration_offset"),
            _ => None,
        }
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let parameters = per_joint(site, "o", unit(site, "rad", "m"), [-0.2, 0.2], 0.01);
        where_sliding(site, parameters, [-0.05, 0.05], 1e-3)
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, site.joints())?;
        Ok(Box::new(Offset(theta.to_vec())))
    }
}

impl Compensator for Offset {
    fn joints(&mut self, _: &Sample<'_>, q: &mut [f64]) {
        q.iter_mut().zip(&self.0).for_each(|(q, o)| *q += o);
    }
}
