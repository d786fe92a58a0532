use super::body::{Body, RigidMotion, masses_untestable};
use super::joint::unit;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch};
use crate::effect::{check, per_joint};
use crate::{Campaign, GapError};
use nalgebra::Vector3;
use std::sync::Arc;
use vsf_data::TorqueKind;
use vsf_robots::RobotModel;

/// Wrong masses of the arm: every link has additional mass with first moments, and every joint a rotor inertia that the
/// model leaves out.
///
/// Parameters per joint `j`, for the link that it moves: `m_j` (kg), the first moments `mx_j`, `my_j`, `mz_j` in the frame
/// of the link (kg m), and, if the readings are those of the actuators, `I_j` (kg m² or kg), the inertia of the rotor seen
/// from the link. In `external` readings, from which the assumed weight of the arm was subtracted, the weight error
/// remains; inertia is left out. Masses are wrong by 40 % at most. Moments of inertia of the links are left out. Some
/// combinations never show, such as the mass of a link that turns about a vertical axis: only base parameters are
/// identifiable. Tell-tale: it depends on posture and acceleration, in free motion. A payload is at the last link only.
///
/// # Reference
/// M. Gautier, W. Khalil, "Direct calculation of minimum set of inertial parameters of serial robots",
/// IEEE Trans. Robotics and Automation 6(3), 1990, doi:10.1109/70.56655.
#[derive(Debug, Clone, Copy)]
pub struct InertialError;

/// Largest error as a share of a link's mass, and mass (kg) and arm (m) of links that have none.
const MOST_WRONG: f64 = 0.4;
const LEAST_MASS: f64 = 0.1;
const LEAST_ARM: f64 = 0.05;

/// Prefix of the names of rotor inertias. One is beyond doubt if it exceeds this many of its standard deviations, and these
/// are below this share of the prior's.
const ROTOR: &str = "I_";
const SURE: f64 = 10.0;
const TOLD: f64 = 0.5;

#[derive(Clone)]
struct Masses {
    robot: Arc<RobotModel>,
    gravity: Vector3<f64>,
    links: Vec<Body>,
    rotors: Vec<f64>,
    torque_kind: TorqueKind,
}

impl Effect for InertialError {
    fn name(&self) -> &str {
        "inertial_error"
    }

    fn summary(&self) -> &str {
        "links have more mass, by `m_<joint>` with first moments `mx_`, `my_`, `mz_`, and, in torques at the actuators, joints the rotor inertia `I_`"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    /// Its many parameters fit anything that changes slowly with posture.
    fn null_gain(&self) -> f64 {
        25.0
    }

    fn extends(&self) -> Option<&str> {
        Some("payload")
    }

    /// Whether there is a rotor inertia, which no payload has.
    fn exceeds(
        &self,
        parameters: &[Parameter],
        theta: &[f64],
        sd: &[f64],
        prior_sd: &[f64],
    ) -> bool {
        let estimates = theta.iter().zip(sd.iter().zip(prior_sd));
        (parameters.iter().zip(estimates)).any(|(p, (inertia, (sd, prior_sd)))| {
            p.name.starts_with(ROTOR) && *inertia > SURE * sd && *sd < TOLD * prior_sd
        })
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::MoveInAir | Probe::CarryPayload).then_some(self.name())
    }

    fn untestable(&self, campaign: &Campaign) -> Option<String> {
        masses_untestable(campaign)
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        // A description of the arm is wrong by a part of what it says, not by all of it.
        let of_link = |j: usize| {
            let link = &site.robot.links()[site.robot.joints()[j].child()];
            let mass = MOST_WRONG * link.mass().max(LEAST_MASS);
            let moment = mass * link.com_L().coords.norm().max(LEAST_ARM);
            let of = |name: &str, unit, most: f64| {
                Parameter::amplitude(format!("{name}_{}", j + 1), unit, [-most, most], 0.3 * most)
                    .of_joint(j)
            };
            [
                of("m", "kg", mass),
                of("mx", "kg m", moment),
                of("my", "kg m", moment),
                of("mz", "kg m", moment),
            ]
        };
        let mut parameters: Vec<Parameter> = (0..site.joints()).flat_map(of_link).collect();
        if site.torque_kind == TorqueKind::Measured {
            let unit = unit(site, "kg m^2", "kg");
            parameters.extend(per_joint(site, "I", unit, [0.0, 10.0], 0.02));
        }
        parameters
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, self.parameters(site).len())?;
        let (links, rotors) = theta.split_at(4 * site.joints());
        Ok(Box::new(Masses {
            robot: site.robot.clone(),
            gravity: site.gravity,
            links: links.chunks_exact(4).map(Body::new).collect(),
            rotors: rotors.to_vec(),
            torque_kind: site.torque_kind,
        }))
    }
}

impl Compensator for Masses {
    fn torques(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        let posture = touch.posture;
        for (joint, body) in self.robot.joints().iter().zip(&self.links) {
            let link = joint.child();
            let motion = RigidMotion::in_readings(self.torque_kind, posture, link, sample);
            body.load(posture, link, &self.gravity, &motion, tau);
        }
        for ((t, rotor), a) in tau.iter_mut().zip(&self.rotors).zip(sample.qdd) {
            *t -= rotor * a;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotor_is_no_payload() {
        let named = |name: &str| Parameter::amplitude(name, "", [-1.0, 1.0], 0.1);
        let parameters = [named("m_1"), named("I_1")];
        let exceeds = |m: f64, inertia: f64, prior: f64| {
            InertialError.exceeds(&parameters, &[m, inertia], &[0.01, 0.01], &[1.0, prior])
        };
        assert!(!exceeds(0.9, 0.05, 1.0), "a mass, or not sure");
        assert!(!exceeds(0.0, 0.2, 0.015), "not told by the data");
        assert!(exceeds(0.0, 0.2, 1.0));
        assert!(!InertialError.exceeds(&[], &[], &[], &[]));
    }
}
