use super::joint::unit;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch};
use crate::effect::{check, per_joint};
use crate::{Campaign, GapError};

/// A constant error of the torque sensors: joint `j` reads `b_j` more than its torque, also in free motion.
///
/// Parameters `b_<joint>` (N m or N), of all joints or of one alone. Tell-tale: it depends neither on posture nor on
/// motion. An unmodeled weight changes with the posture.
///
/// # Reference
/// A. De Luca, A. Albu-Schaffer, S. Haddadin, G. Hirzinger, "Collision detection and safe reaction
/// with the DLR-III lightweight manipulator arm", IROS 2006, doi:10.1109/IROS.2006.282053.
#[derive(Debug, Clone, Copy)]
pub struct TorqueBias;

/// Per joint, on the load of the environment (N m or N).
#[derive(Clone)]
struct Bias(Vec<f64>);

impl Effect for TorqueBias {
    fn name(&self) -> &str {
        "torque_bias"
    }

    fn summary(&self) -> &str {
        "torque sensors are off by the constants `b_<joint>`"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[Need::FreeMotion]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(
            probe,
            Probe::TouchInOtherPosture
                | Probe::TouchAlongOtherAxis
                | Probe::MoveInAir
                | Probe::Wait
        )
        .then_some(self.name())
    }

    fn untestable(&self, campaign: &Campaign) -> Option<String> {
        let tared = campaign.session().iter().all(|m| m.tare > 0);
        let lost = "the readings are relative to their mean at the start of every sequence";
        (tared.then(|| lost.to_owned())).or_else(|| campaign.lacks(Need::FreeMotion))
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        per_joint(site, "b", unit(site, "N m", "N"), [-100.0, 100.0], 0.5)
    }

    /// One start for all joints, and one for each joint alone. Otherwise a bias of one joint pays for those of all others,
    /// and loses to what imitates it with fewer parameters, such as dry coupling to a joint that moves in one direction.
    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let alone = if site.joints() > 1 { site.joints() } else { 0 };
        vec![vec![0.0; site.joints()]; 1 + alone]
    }

    fn acting(&self, site: &Site, start: usize) -> Vec<usize> {
        match start.checked_sub(1) {
            Some(alone) => vec![alone],
            None => (0..site.joints()).collect(),
        }
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, site.joints())?;
        let sign = site.sensor_sign();
        Ok(Box::new(Bias(theta.iter().map(|b| sign * b).collect())))
    }
}

impl Compensator for Bias {
    fn torques(&mut self, _: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        tau.iter_mut().zip(&self.0).for_each(|(t, b)| *t += b);
    }
}
