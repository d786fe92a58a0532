use super::body::{Body, RigidMotion, masses_untestable};
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use crate::{Campaign, GapError};
use nalgebra::Vector3;
use vsf_data::TorqueKind;

/// A payload at the last link: a mass `m` with its center at `c` in the frame of that link.
///
/// Parameters `m` (kg) and first moments `mx`, `my`, `mz` (kg m), that is, `m c`; torques are linear in them. Its weight
/// loads the joints. If the readings are those of the actuators, so does its inertia, except that about the link's origin.
/// Moments without mass mean that the link's own center of mass lies elsewhere than in the model. Tell-tale: it depends on
/// posture, in free motion too. A bias does not depend on posture; a tilt acts on all links.
///
/// # Reference
/// C. G. Atkeson, C. H. An, J. M. Hollerbach, "Estimation of inertial parameters of manipulator loads
/// and links", Int. J. Robotics Research 5(3), 1986, doi:10.1177/027836498600500306.
#[derive(Debug, Clone, Copy)]
pub struct Payload;

#[derive(Clone)]
struct Carried {
    body: Body,
    link: usize,
    gravity: Vector3<f64>,
    torque_kind: TorqueKind,
}

impl Effect for Payload {
    fn name(&self) -> &str {
        "payload"
    }

    fn summary(&self) -> &str {
        "the link of the last joint carries a mass `m` with first moments `mx`, `my`, `mz` (mass times place in its frame)"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn untestable(&self, campaign: &Campaign) -> Option<String> {
        masses_untestable(campaign)
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::TouchInOtherPosture | Probe::CarryPayload).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        let moment = |name| Parameter::amplitude(name, "kg m", [-5.0, 5.0], 0.02);
        let mass = Parameter::amplitude("m", "kg", [0.0, 20.0], 0.1);
        vec![mass, moment("mx"), moment("my"), moment("mz")]
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 4)?;
        Ok(Box::new(Carried {
            body: Body::new(theta),
            link: site.robot.last_link(),
            gravity: site.gravity,
            torque_kind: site.torque_kind,
        }))
    }
}

impl Compensator for Carried {
    fn torques(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        let (posture, link) = (touch.posture, self.link);
        let motion = RigidMotion::in_readings(self.torque_kind, posture, link, sample);
        self.body.load(posture, link, &self.gravity, &motion, tau);
    }
}
