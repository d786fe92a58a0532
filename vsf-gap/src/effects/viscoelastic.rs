use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch, check};
use nalgebra::Vector3;

/// Springs with dampers beside them (Kelvin-Voigt): `K (u + eta v)`, with `v` the rate of `u` or, where
/// a stiff spring holds the damper, its mean over the past `lag`: `lag dv/dt = du/dt - v`.
///
/// Parameters `eta` (s) and the shape `lag` (s); a longer lag is that of `stress_relaxation`. A point is
/// never pulled. Tell-tale: proportional to the speed of the indentation, nothing while the robot holds
/// still. A late reading (latency) lags, this leads.
///
/// # Reference
/// Y. C. Fung, *Biomechanics: Mechanical Properties of Living Tissues*, 2nd ed., 1993, section 2.11,
/// doi:10.1007/978-1-4757-2257-4.
#[derive(Debug, Clone, Copy)]
pub struct Viscoelastic;

/// Longest lag (s).
const LONGEST: f64 = 0.3;

/// A rest point at the previous sample.
#[derive(Clone, Copy)]
struct Damper {
    /// Displacement (m).
    u: Vector3<f64>,
    /// Lagged rate (m/s).
    v: Vector3<f64>,
}

const AT_REST: Damper = Damper {
    u: Vector3::new(0.0, 0.0, 0.0),
    v: Vector3::new(0.0, 0.0, 0.0),
};

struct Dampers {
    eta: f64,
    lag: f64,
    state: Vec<Damper>,
    /// Points touched at the previous sample.
    before: Vec<u32>,
    /// States of the points touched now.
    now: Vec<(u32, Damper)>,
}

impl Effect for Viscoelastic {
    fn name(&self) -> &str {
        "viscoelastic"
    }

    fn acts(&self) -> Acts {
        Acts::Springs
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
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
            state: vec![AT_REST; site.rest.len()],
            before: Vec::new(),
            now: Vec::new(),
        }))
    }
}

impl Dampers {
    fn forget(&mut self) {
        for p in self.before.drain(..) {
            self.state[p as usize] = AT_REST;
        }
    }
}

impl Compensator for Dampers {
    fn begin_touch(&mut self) {
        self.forget();
    }

    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        let contacts = touch.contacts;
        let touched = contacts.points().iter().zip(contacts.displacements());
        // Without a lag the exponential is zero, and the rate that of this sample.
        let kept = match self.lag > 0.0 {
            true => (-sample.dt / self.lag).exp(),
            false => 0.0,
        };
        self.now.clear();
        for (s, (&p, u)) in springs.iter_mut().zip(touched) {
            let Damper { u: last, mut v } = self.state[p as usize];
            if sample.dt > 0.0 {
                v = v * kept + (u - last) * ((1.0 - kept) / sample.dt);
            }
            *s += v * self.eta;
            // A damper cannot pull: the point would leave the link.
            if s.dot(u) < 0.0 {
                *s = Vector3::zeros();
            }
            self.now.push((p, Damper { u: *u, v }));
        }
        self.forget();
        for (p, damper) in &self.now {
            self.state[*p as usize] = *damper;
            self.before.push(*p);
        }
    }
}
