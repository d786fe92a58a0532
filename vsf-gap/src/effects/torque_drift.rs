use super::joint::unit;
use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, RandomWalk, Sample, Site, Touch,
};
use crate::effect::{check, per_joint};

/// A growing error of the torque sensors: joint `j` reads `r_j T (1 - exp(-t / T))` more than its torque at clock `t` of
/// the session. If the sensors are zeroed before each sequence, it reads `s_j T (1 - exp(-t / T))` more at time `t` of the
/// sequence.
///
/// Parameters `r_<joint>` and `s_<joint>` (N m/s or N/s), the drift rate at the start of the session and of each sequence,
/// of which either all `r` or all `s` act; and the shape `T` (s). The drift is a warm-up if `T` is shorter than the
/// session, and linear in the clock if it is longer. Tell-tale: it follows the clock and nothing else, so a posture visited
/// twice reads differently; with a bias it does not. Drifts wander: beside that curve, a random walk of up to about a third
/// of the final drift counts as part of it.
///
/// # Reference
/// J. Fraden, *Handbook of Modern Sensors*, 5th ed., 2016, chapter 3,
/// doi:10.1007/978-3-319-19303-8.
#[derive(Debug, Clone, Copy)]
pub struct TorqueDrift;

/// Time constants that the search starts from, in lengths of the session: practically linear, and a warm-up. A drift that
/// begins anew with every sequence starts from the first alone.
const STARTS: [f64; 2] = [10.0, 0.4];

/// Typical drift (N m or N) over the length of the session, or of a sequence, that is looked for, with room for drifts that
/// end early.
const TYPICAL: f64 = 3.0;
/// Longest time constant (s) that is told from a straight line, unless the session is longer still.
const LONGEST: f64 = 1e6;

#[derive(Clone)]
struct Drift {
    /// Per joint, the rates for the time of the session and of the sequence, on the load of the environment (N m/s or N/s).
    rates: [Vec<f64>; 2],
    /// Time constant (s).
    T: f64,
    /// Clock at which the sequence began (s), from its first sample on.
    began: Option<f64>,
}

/// Drift at time `t` (s) for a rate of 1.
fn grown(t: f64, T: f64) -> f64 {
    -T * (-t / T).exp_m1()
}

impl Effect for TorqueDrift {
    fn name(&self) -> &str {
        "torque_drift"
    }

    fn summary(&self) -> &str {
        "torque sensors drift at the rates `r_<joint>` from the start of the session on, or `s_<joint>` from that of each sequence on, which fade over the time `T`"
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

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::Hold | Probe::TouchAgain | Probe::Wait).then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let units = unit(site, "N m/s", "N/s");
        let of = |prefix, units, over: f64| {
            per_joint(site, prefix, units, [-50.0, 50.0], TYPICAL / over)
        };
        let mut parameters = of("r", &units, site.duration);
        parameters.extend(of("s", &units, site.sequence_duration));
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
        let start = |T: f64| [vec![0.0; 2 * site.joints()], vec![T * site.duration]].concat();
        let [line, warm_up] = STARTS.map(start);
        vec![line.clone(), warm_up, line]
    }

    fn acting(&self, site: &Site, start: usize) -> Vec<usize> {
        let d = site.joints();
        if start < STARTS.len() {
            (0..d).collect()
        } else {
            (d..2 * d).collect()
        }
    }

    fn random_walk(&self, site: &Site, theta: &[f64]) -> Option<RandomWalk> {
        let d = site.joints();
        let of = |rates: &[f64], length: f64| {
            let size = grown(length, theta[2 * d]) / length.sqrt();
            rates.iter().map(|r| size * r.abs()).collect()
        };
        Some(RandomWalk {
            of_session: of(&theta[..d], site.duration),
            of_sequence: of(&theta[d..2 * d], site.sequence_duration),
        })
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let d = site.joints();
        check(self.name(), theta, 2 * d + 1)?;
        let rates = |of: &[f64]| of.iter().map(|r| site.sensor_sign() * r).collect();
        Ok(Box::new(Drift {
            rates: [rates(&theta[..d]), rates(&theta[d..2 * d])],
            T: theta[2 * d],
            began: None,
        }))
    }
}

impl Compensator for Drift {
    fn begin_sequence(&mut self, _: &str) {
        self.began = None;
    }

    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        let began = *self.began.get_or_insert(sample.clock);
        let times = [sample.clock, sample.clock - began];
        let [of_session, of_sequence] = times.map(|t| grown(t, self.T));
        let [session, sequence] = &self.rates;
        for ((t, r), s) in tau.iter_mut().zip(session).zip(sequence) {
            *t += r * of_session + s * of_sequence;
        }
    }
}
