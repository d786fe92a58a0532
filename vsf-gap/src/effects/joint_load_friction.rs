use super::joint::{sign, speed_unit};
use crate::GapError;
use crate::contact::center;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch};
use crate::effect::{check, per_joint};
use vsf_data::TorqueKind;

/// Dry friction in the joints that is proportional to the load of the gears: `-m_j |tau_j| sign(qd_j)`.
///
/// Parameters `m_<joint>` (1) and the shape `eps` (rad/s or m/s), the speed at which friction reaches three quarters of its
/// size (nearly all at twice that speed).
///
/// The load is that of the contact. Friction fades where the load is so small that its sign is noise:
/// `-m_j tau_j tanh(l_j / 0.1) sign(qd_j)`, with the contact load `l_j` by the readings of all joints; it has three quarters of
/// its size at 0.1 N m (or N). For readings of the actuators, the load is
/// that of the arm's weight and motion, unless the motor is off: then friction alone balances these, and they would explain
/// themselves.
///
/// Tell-tale: nothing in free motion without weight, and a hysteresis loop between pressing and letting go that each joint
/// has for itself. Friction on the object's surface acts on all joints at once.
///
/// # Reference
/// A. C. Bittencourt, S. Gunnarsson, "Static friction in a robot joint: modeling and identification of
/// load and temperature effects", J. Dynamic Systems, Measurement, and Control 134(5), 2012,
/// doi:10.1115/1.4006589.
#[derive(Debug, Clone, Copy)]
pub struct JointLoadFriction;

/// Loads (N m or N) below which the sign of the load is noise.
const FAINT: f64 = 0.1;

/// A motor is off if its torque is a smaller share of the arm's torque. Readings are averaged over a few samples.
const OFF: f64 = 0.1;

#[derive(Clone)]
struct Friction {
    m: Vec<f64>,
    eps: f64,
    /// Load of the contact (N m or N). Its sign is that of the force behind the readings of all joints; that of the single
    /// reading is wrong where friction is larger than the load.
    load: Vec<f64>,
    /// Whether the gears carry the arm, not only the contact.
    measured: bool,
}

impl Effect for JointLoadFriction {
    fn name(&self) -> &str {
        "joint_load_friction"
    }

    fn summary(&self) -> &str {
        "dry friction in proportion to the load, by the shares `m_<joint>`, nearly full from twice the speed `eps` on"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn follows_reading(&self) -> bool {
        true
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::Unload).then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let mut parameters = per_joint(site, "m", |_| "1", [0.0, 3.0], 0.1);
        parameters.push(Parameter::shape("eps", speed_unit(site), [1e-3, 0.2], 0.01));
        parameters
    }

    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let start = |eps| [vec![0.0; site.joints()], vec![eps]].concat();
        [0.005, 0.03].map(start).to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let d = site.joints();
        check(self.name(), theta, d + 1)?;
        Ok(Box::new(Friction {
            m: theta[..d].to_vec(),
            eps: theta[d],
            load: vec![0.0; d],
            measured: site.torque_kind == TorqueKind::Measured,
        }))
    }

    fn untestable(&self, campaign: &crate::Campaign) -> Option<String> {
        match campaign.site.torque_kind {
            TorqueKind::Measured => None,
            TorqueKind::External => campaign.lacks(Need::Contact),
        }
    }
}

impl Compensator for Friction {
    fn gains(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, gains: &mut [f64]) {
        if self.measured {
            return;
        }
        let Some((link, p)) = center(touch) else {
            return;
        };
        let load = &mut self.load;
        touch.posture.joint_torques(link, &p, &sample.force_W, load);
        for (j, gain) in gains.iter_mut().enumerate() {
            let against = sign(load[j], FAINT) * sign(sample.qd[j], self.eps);
            *gain *= 1.0 - self.m[j] * against;
        }
    }

    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        if self.measured {
            for (j, t) in tau.iter_mut().enumerate() {
                let (arm, motor) = (sample.load[j], sample.load[j] - sample.reading[j]);
                if motor.abs() > OFF * arm.abs() {
                    *t -= self.m[j] * arm.abs() * sign(sample.qd[j], self.eps);
                }
            }
        }
    }
}
