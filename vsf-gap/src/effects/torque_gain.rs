use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch};
use crate::effect::{check, per_joint};
use crate::{Campaign, GapError, Motion};
use vsf_data::TorqueKind;

/// Torque sensors or drives with a wrong gain: joint `j` reads `1 + g_j` times its torque.
///
/// Parameters `g_<joint>` (1). In readings of the actuators, the gain also applies to the weight and motion of the arm, but
/// not to what other effects of the same model add: products of two errors are left out. Tell-tale: the error is
/// proportional to the torque of its own joint. Where only contact is read, a gain that all joints share cannot be told
/// from a scale of the stiffness, so gains are relative to the joint that most others agree with
/// ([`Parameter::scales_field`]).
///
/// # Reference
/// M. Gautier, S. Briot, "Global identification of joint drive gains and dynamic parameters of
/// robots", J. Dynamic Systems, Measurement, and Control 136(5), 2014, doi:10.1115/1.4027506.
#[derive(Debug, Clone, Copy)]
pub struct TorqueGain;

#[derive(Clone)]
struct Gain {
    g: Vec<f64>,
    /// Whether the readings include the load of the gears, to which the gain applies too.
    measured: bool,
}

impl Effect for TorqueGain {
    fn name(&self) -> &str {
        "torque_gain"
    }

    fn summary(&self) -> &str {
        "torques are read too large by the shares `g_<joint>`, too small by negative ones"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn scales_contact(&self) -> bool {
        true
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(
            probe,
            Probe::TouchInOtherPosture | Probe::TouchAlongOtherAxis | Probe::CarryPayload
        )
        .then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let gains = per_joint(site, "g", |_| "1", [-0.9, 3.0], 0.1);
        match site.torque_kind {
            TorqueKind::External => gains.into_iter().map(Parameter::of_field).collect(),
            TorqueKind::Measured => gains,
        }
    }

    fn untestable(&self, campaign: &Campaign) -> Option<String> {
        let measured = campaign.site.torque_kind == TorqueKind::Measured;
        if !measured && campaign.site.joints() < 2 && !campaign.site.rest.is_empty() {
            return Some("the gain of a single joint is a scale of the stiffness".to_owned());
        }
        let actuated = |m: &Motion| {
            let pairs = m.load.data().iter().zip(m.reading.data());
            pairs
                .into_iter()
                .any(|(load, reading)| (load - reading).abs() > 1e-9)
        };
        (measured && !campaign.train.iter().any(actuated))
            .then(|| "the actuators never act: all torques are zero".to_owned())
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, site.joints())?;
        Ok(Box::new(Gain {
            g: theta.to_vec(),
            measured: site.torque_kind == TorqueKind::Measured,
        }))
    }
}

impl Compensator for Gain {
    fn gains(&mut self, _: &Sample<'_>, _: &Touch<'_>, gains: &mut [f64]) {
        gains
            .iter_mut()
            .zip(&self.g)
            .for_each(|(k, g)| *k *= 1.0 + g);
    }

    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        if self.measured {
            for ((t, g), load) in tau.iter_mut().zip(&self.g).zip(sample.load) {
                *t -= g * load;
            }
        }
    }
}
