use super::joint::{sign, speed_unit, unit};
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch};
use crate::effect::{check, per_joint};

/// Dry friction in the joints that is larger in slow motion (Stribeck):
/// `-(c_j + e_j exp(-(qd_j / vs)^2)) tanh(qd_j / eps)`.
///
/// Parameters `c_<joint>` (N m or N), friction in fast motion; `e_<joint>` (N m or N), the excess in slow motion; the
/// shapes `vs` (rad/s or m/s), the speed at which the excess fades, and `eps`, the speed at which friction sets in.
/// Tell-tale: friction that falls with speed. Without both slow and fast motion, it is Coulomb friction.
///
/// # Reference
/// H. Olsson, K. J. Astrom, C. Canudas de Wit, M. Gafvert, P. Lischinsky, "Friction models and
/// friction compensation", European J. Control 4(3), 1998, doi:10.1016/S0947-3580(98)70113-X.
#[derive(Debug, Clone, Copy)]
pub struct JointStribeckFriction;

/// Smallest excess of slow motion that is no error in the form of Coulomb friction: relative to friction in fast motion
/// and, in standard deviations, to its own.
const LARGE: f64 = 1.0 / 3.0;
const SURE: f64 = 4.0;
/// Largest posterior standard deviation, relative to that of the prior, of an excess that the data determine.
const TOLD: f64 = 0.5;

#[derive(Clone)]
struct Friction {
    c: Vec<f64>,
    excess: Vec<f64>,
    vs: f64,
    eps: f64,
}

impl Effect for JointStribeckFriction {
    fn name(&self) -> &str {
        "joint_stribeck_friction"
    }

    fn summary(&self) -> &str {
        "dry friction `c_<joint>` that is larger by `e_<joint>` in motion slower than `vs`, and sets in at the speed `eps`"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn extends(&self) -> Option<&str> {
        Some("joint_coulomb_friction")
    }

    /// Whether there is a joint in which slow motion adds more than a third, beyond doubt. If all motion is slow, the data
    /// cannot tell the excess from the rest, and its deviation stays near that of the prior.
    fn exceeds(&self, _: &[Parameter], theta: &[f64], sd: &[f64], prior_sd: &[f64]) -> bool {
        let d = (theta.len() / 2).saturating_sub(1);
        let excess = theta.iter().zip(sd.iter().zip(prior_sd)).skip(d);
        theta
            .iter()
            .zip(excess)
            .take(d)
            .any(|(c, (excess, (sd, prior)))| {
                *excess > LARGE * c && *excess > SURE * sd && *sd < TOLD * prior
            })
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::TouchFaster | Probe::MoveInAir).then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let unit = unit(site, "N m", "N");
        let mut parameters = per_joint(site, "c", &unit, [0.0, 50.0], 0.3);
        parameters.extend(per_joint(site, "e", &unit, [0.0, 50.0], 0.3));
        parameters.push(Parameter::shape("vs", speed_unit(site), [5e-3, 0.5], 0.02));
        parameters.push(Parameter::shape("eps", speed_unit(site), [1e-3, 0.1], 5e-3));
        parameters
    }

    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let start = |vs| [vec![0.0; 2 * site.joints()], vec![vs, 0.2 * vs]].concat();
        [0.015, 0.05, 0.15].map(start).to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let d = site.joints();
        check(self.name(), theta, 2 * d + 2)?;
        Ok(Box::new(Friction {
            c: theta[..d].to_vec(),
            excess: theta[d..2 * d].to_vec(),
            vs: theta[2 * d],
            eps: theta[2 * d + 1],
        }))
    }
}

impl Compensator for Friction {
    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        for (j, t) in tau.iter_mut().enumerate() {
            let v = sample.qd[j];
            let slow = (-(v / self.vs).powi(2)).exp();
            *t -= (self.c[j] + self.excess[j] * slow) * sign(v, self.eps);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_coulomb_friction() {
        // c of two joints, e of two joints, vs, eps.
        let sd = [0.1, 0.1, 0.1, 0.1, 0.01, 0.001];
        let exceeds = |e: [f64; 2], prior: f64| {
            let theta = [0.0, 2.0, e[0], e[1], 0.05, 0.005];
            JointStribeckFriction.exceeds(&[], &theta, &sd, &[prior; 6])
        };
        assert!(!exceeds([0.0, 0.0], 1.0));
        assert!(!exceeds([0.3, 0.0], 1.0), "not sure");
        assert!(!exceeds([0.0, 0.6], 1.0), "not large");
        assert!(!exceeds([0.0, 0.8], 0.15), "not told by the data");
        assert!(exceeds([0.0, 0.8], 1.0));
        assert!(exceeds([0.5, 0.0], 1.0));
        assert!(!JointStribeckFriction.exceeds(&[], &[], &[], &[]));
    }
}
