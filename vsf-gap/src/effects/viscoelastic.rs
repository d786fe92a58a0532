use super::memory::Memory;
use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use nalgebra::Vector3;

/// Springs with dampers beside them (Kelvin-Voigt): `K (u + eta v)`. Here `v` is the rate of `u` or, where a stiff spring
/// holds the damper, its mean over the past `lag`: `lag dv/dt = du/dt - v`.
///
/// Parameters `eta` (s) and the shape `lag` (s); a longer lag is that of `stress_relaxation`. A point is never pulled.
/// Tell-tale: proportional to the speed of the indentation, and zero while the robot holds still. The force leads; with
/// late readings (latency) it lags.
///
/// # Reference
/// Y. C. Fung, *Biomechanics: Mechanical Properties of Living Tissues*, 2nd ed., 1993, section 2.11,
/// doi:10.1007/978-1-4757-2257-4.
#[derive(Debug, Clone, Copy)]
pub struct Viscoelastic;

/// Longest lag (s).
const LONGEST: f64 = 0.3;

#[derive(Clone)]
struct Dampers {
    eta: f64,
    lag: f64,
    /// The lagged rate `v` of every point (m/s).
    memory: Memory,
}

impl Effect for Viscoelastic {
    fn name(&self) -> &str {
        "viscoelastic"
    }

    fn summary(&self) -> &str {
        "springs resist the speed of indentation, by the time `eta`, smoothed over `lag`"
    }

    fn acts(&self) -> Acts {
        Acts::Springs
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::Hold | Probe::TouchFaster).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![
            Parameter::amplitude("eta", "s", [0.0, 2.0], 0.05),
            Parameter::shape("lag", "s", [0.0, LONGEST], 0.05),
        ]
    }

    fn starts(&self, _: &Site) -> Vec<Vec<f64>> {
        [0.0, 0.15].map(|lag| vec![0.0, lag]).to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 2)?;
        Ok(Box::new(Dampers {
            eta: theta[0],
            lag: theta[1],
            memory: Memory::new(site.rest.len()),
        }))
    }
}

impl Compensator for Dampers {
    fn begin_touch(&mut self) {
        self.memory.forget();
    }

    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        // Without a lag the exponential is zero, and the rate that of this sample.
        let kept = if self.lag > 0.0 {
            (-sample.dt / self.lag).exp()
        } else {
            0.0
        };
        self.memory
            .advance(touch.contacts, springs, self.eta, |last, v, u| {
                if sample.dt > 0.0 {
                    v * kept + (u - last) * ((1.0 - kept) / sample.dt)
                } else {
                    *v
                }
            });
    }
}
