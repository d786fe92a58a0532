use super::joint::unit;
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch};
use crate::effect::{check, per_joint};

/// An error of the torque sensors that grows over the session: joint `j` reads `r_j T (1 - exp(-t / T))` more than
/// its torque at clock `t`.
///
/// Parameters `r_<joint>` (N m/s or N/s), the drift per time at the begin of the session, and the shape
/// `T` (s): a warm-up if it is shorter than the session, linear in the clock if it is longer. Tell-tale:
/// it follows the clock and nothing else, so that a posture visited twice reads differently; a bias does
/// not.
///
/// # Reference
/// J. Fraden, *Handbook of Modern Sensors*, 5th ed., 2016, chapter 3,
/// doi:10.1007/978-3-319-19303-8.
#[derive(Debug, Clone, Copy)]
pub struct TorqueDrift;

/// Time constants that the search starts from, in lengths of the session: as good as linear, and a warm-up.
const STARTS: [f64; 2] = [10.0, 0.4];

/// A drift per length of the session (N m or N) that is looked for, with room for those that are over early.
const TYPICAL: f64 = 3.0;
/// Longest time constant (s) that is told from a line, if the session is not longer still.
const LONGEST: f64 = 1e6;

struct Drift {
    /// Per joint, on the load of the environment per time (N m/s or N/s).
    rate: Vec<f64>,
    /// Time constant (s).
    T: f64,
}

impl Effect for TorqueDrift {
    fn name(&self) -> &str {
        "torque_drift"
    }

    fn summary(&self) -> &str {
        "torque sensors drift at the rates `r_<joint>`, which fade over the time `T`"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn extends(&self) -> Option<&str> {
        Some("torque_bias")
    }

    fn needs(&self) -> &[Need] {
        &[Need::FreeMotion]
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let units = unit(site, "N m/s", "N/s");
        let mut parameters = per_joint(site, "r", units, [-50.0, 50.0], TYPICAL / site.duration);
        let longest = LONGEST.max(100.0 * site.duration);
        parameters.push(Parameter::shape(
            "T",
            "s",
            [0.1, longest],
            0.3 * site.duration,
        ));
        parameters
    }

    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let start = |T: f64| [vec![0.0; site.joints()], vec![T * site.duration]].concat();
        STARTS.map(start).to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let d = site.joints();
        check(self.name(), theta, d + 1)?;
        Ok(Box::new(Drift {
            rate: theta[..d].iter().map(|r| site.sensor_sign() * r).collect(),
            T: theta[d],
        }))
    }
}

impl Compensator for Drift {
    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        let grown = -self.T * (-sample.clock / self.T).exp_m1();
        tau.iter_mut()
            .zip(&self.rate)
            .for_each(|(t, r)| *t += r * grown);
    }
}
