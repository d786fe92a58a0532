use super::joint::{unit, where_sliding};
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site};
use crate::effect::{check, per_joint};
use vsf_data::TorqueKind;

/// Elastic gears: a link turns ahead of its encoder by `c_j tau_j`, where `tau_j` is the load of the environment on the
/// joint. With readings of the actuators, it lags by `c_j` times the reading.
///
/// Parameters `c_<joint>`, compliances (rad/(N m) or m/N). Tell-tale: the arm gives way in proportion to the load of each
/// joint. If all joints give way alike, it looks like a softer object. In readings without the arm's weight
/// (`torque_kind: external`), it changes only what contact contributes.
///
/// # Reference
/// M. W. Spong, "Modeling and control of elastic joint robots", J. Dynamic Systems, Measurement, and
/// Control 109(4), 1987, doi:10.1115/1.3143860.
#[derive(Debug, Clone, Copy)]
pub struct JointElasticity;

#[derive(Clone)]
struct Gears {
    compliance: Vec<f64>,
    measured: bool,
}

impl Effect for JointElasticity {
    fn name(&self) -> &str {
        "joint_elasticity"
    }

    fn summary(&self) -> &str {
        "gears give way under load by the compliances `c_<joint>`"
    }

    fn acts(&self) -> Acts {
        Acts::Contact
    }

    fn null_gain(&self) -> f64 {
        20.0
    }

    fn chooses_contacts(&self) -> bool {
        true
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn follows_reading(&self) -> bool {
        true
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(
            probe,
            Probe::TouchDeeper | Probe::TouchInOtherPosture | Probe::TouchAlongOtherAxis
        )
        .then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let unit = unit(site, "rad/(N m)", "m/N");
        let parameters = per_joint(site, "c", unit, [0.0, 0.02], 1e-3);
        where_sliding(site, parameters, [0.0, 5e-3], 1e-4)
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, site.joints())?;
        Ok(Box::new(Gears {
            compliance: theta.to_vec(),
            measured: site.torque_kind == TorqueKind::Measured,
        }))
    }
}

impl Compensator for Gears {
    fn joints(&mut self, sample: &Sample<'_>, q: &mut [f64]) {
        for (j, q) in q.iter_mut().enumerate() {
            // The environment's load less what the arm itself needs: minus the actuator's torque.
            let own = if self.measured { sample.load[j] } else { 0.0 };
            *q += self.compliance[j] * (sample.reading[j] - own);
        }
    }
}
