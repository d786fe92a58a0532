use super::joint::unit;
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch};
use crate::effect::{check, per_joint};

/// An error of the torque sensors that grows over the session:
/// `tau_j + r_j (1 - exp(-t / T)) / (1 - exp(-D / T))` at clock `t` in a session of length `D`.
///
/// Parameters `r_<joint>` (N m or N), the drift at the end of the session, and the shape `tau = T / D`
/// (1): a warm-up while it is small, linear in the clock when it is large. Tell-tale: it follows the
/// clock and nothing else, so that a posture visited twice reads differently; a bias does not.
///
/// # Reference
/// J. Fraden, *Handbook of Modern Sensors*, 5th ed., 2016, chapter 3,
/// doi:10.1007/978-3-319-19303-8.
#[derive(Debug, Clone, Copy)]
pub struct TorqueDrift;

/// Time constants that the search starts from: as good as linear, and a warm-up.
const STARTS: [f64; 2] = [10.0, 0.4];

struct Drift {
    at_end: Vec<f64>,
    /// Time constant (s).
    T: f64,
    duration: f64,
}

impl Effect for TorqueDrift {
    fn name(&self) -> &str {
        "torque_drift"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let mut parameters = per_joint(site, "r", unit(site, "N m", "N"), [-50.0, 50.0], 0.3);
        parameters.push(Parameter::shape("tau", "1", [0.05, 20.0], 0.3));
        parameters
    }

    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let start = |tau| [vec![0.0; site.joints()], vec![tau]].concat();
        STARTS.map(start).to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let d = site.joints();
        check(self.name(), theta, d + 1)?;
        Ok(Box::new(Drift {
            at_end: theta[..d].to_vec(),
            T: theta[d] * site.duration,
            duration: site.duration,
        }))
    }
}

impl Compensator for Drift {
    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        let grown = |t: f64| -(-t / self.T).exp_m1();
        let share = grown(sample.clock) / grown(self.duration);
        tau.iter_mut()
            .zip(&self.at_end)
            .for_each(|(t, r)| *t += r * share);
    }
}
