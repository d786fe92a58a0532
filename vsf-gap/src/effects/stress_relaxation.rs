use super::memory::Memory;
use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use nalgebra::Vector3;

/// A branch with a shorter relaxation time (s) is a damper: `viscoelastic`.
const SHORTEST: f64 = 0.5;

/// Springs with a spring and a damper in series beside them (standard linear solid, one Maxwell branch): `K (u + g h)` with
/// `dh/dt = du/dt - h / tau`.
///
/// Parameters `g` (1), the stiffness of the branch relative to that of the spring, and the shape `tau` (s). The branch is
/// integrated exactly for displacements that are linear between samples. A point that was let go starts afresh, and the
/// object never pulls. Tell-tale: the force decays while the robot holds still; with a damper alone (viscoelastic) it drops
/// at once.
///
/// # Reference
/// J. C. Simo, "On a fully three-dimensional finite-strain viscoelastic damage model: formulation and
/// computational aspects", Computer Methods in Applied Mechanics and Engineering 60(2), 1987,
/// doi:10.1016/0045-7825(87)90107-1.
#[derive(Debug, Clone, Copy)]
pub struct StressRelaxation;

#[derive(Clone)]
struct Branches {
    g: f64,
    tau: f64,
    /// The extension `h` of every branch (m).
    memory: Memory,
}

impl Effect for StressRelaxation {
    fn name(&self) -> &str {
        "stress_relaxation"
    }

    fn summary(&self) -> &str {
        "beside each spring is a branch of `g` times its stiffness that relaxes within the time `tau`"
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
            Parameter::amplitude("g", "1", [0.0, 10.0], 0.2),
            Parameter::shape("tau", "s", [SHORTEST, 30.0], 0.2),
        ]
    }

    fn starts(&self, _: &Site) -> Vec<Vec<f64>> {
        [0.6, 1.5, 4.0].map(|tau| vec![0.0, tau]).to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 2)?;
        Ok(Box::new(Branches {
            g: theta[0],
            tau: theta[1],
            memory: Memory::new(site.rest.len()),
        }))
    }
}

impl Compensator for Branches {
    fn begin_touch(&mut self) {
        self.memory.forget();
    }

    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        let steps = sample.dt / self.tau;
        let decay = (-steps).exp();
        // Mean of the decay over the sample.
        let mean = if steps > 0.0 {
            -(-steps).exp_m1() / steps
        } else {
            1.0
        };
        self.memory
            .advance(touch.contacts, springs, self.g, |last, h, u| {
                h * decay + (u - last) * mean
            });
    }
}
