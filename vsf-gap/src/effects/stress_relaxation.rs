use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch, check};
use nalgebra::Vector3;

/// A branch that relaxes within less (s) is a damper: `viscoelastic`.
const SHORTEST: f64 = 0.5;

/// Springs with a spring and a damper in series beside them (standard linear solid, one Maxwell
/// branch): `K (u + g h)` with `dh/dt = du/dt - h / tau`.
///
/// Parameters `g` (1), the stiffness of the branch over that of the spring, and the shape `tau` (s).
/// The branch is integrated exactly for displacements that are linear between samples. A point that is
/// let go starts afresh, and the object never pulls. Tell-tale: the force decays while the robot holds
/// still; a damper alone (viscoelastic) drops at once.
///
/// # Reference
/// J. C. Simo, "On a fully three-dimensional finite-strain viscoelastic damage model: formulation and
/// computational aspects", Computer Methods in Applied Mechanics and Engineering 60(2), 1987,
/// doi:10.1016/0045-7825(87)90107-1.
#[derive(Debug, Clone, Copy)]
pub struct StressRelaxation;

struct Branches {
    g: f64,
    tau: f64,
    /// Displacement `u` and that of the branch, `h`, of every rest point at the last sample (m).
    state: Vec<[Vector3<f64>; 2]>,
    /// Points touched at the last sample, and a buffer.
    before: Vec<u32>,
    now: Vec<([Vector3<f64>; 2], u32)>,
}

impl Effect for StressRelaxation {
    fn name(&self) -> &str {
        "stress_relaxation"
    }

    fn acts(&self) -> Acts {
        Acts::Springs
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
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
            state: vec![[Vector3::zeros(); 2]; site.rest.len()],
            before: Vec::new(),
            now: Vec::new(),
        }))
    }
}

impl Branches {
    fn forget(&mut self) {
        for p in self.before.drain(..) {
            self.state[p as usize] = [Vector3::zeros(); 2];
        }
    }
}

impl Compensator for Branches {
    fn begin_touch(&mut self) {
        self.forget();
    }

    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        let contacts = touch.contacts;
        let touched = contacts.points().iter().zip(contacts.displacements());
        let steps = sample.dt / self.tau;
        let decay = (-steps).exp();
        // Mean of the decay over the sample.
        let mean = if steps > 0.0 {
            -(-steps).exp_m1() / steps
        } else {
            1.0
        };
        self.now.clear();
        for (s, (&p, u)) in springs.iter_mut().zip(touched) {
            let [last, h] = self.state[p as usize];
            let h = h * decay + (u - last) * mean;
            self.now.push(([*u, h], p));
            *s += h * self.g;
            if s.dot(u) < 0.0 {
                *s = Vector3::zeros();
            }
        }
        self.forget();
        for (state, p) in &self.now {
            self.state[*p as usize] = *state;
            self.before.push(*p);
        }
    }
}
