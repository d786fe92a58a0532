use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch, check};
use nalgebra::Vector3;

/// Springs with dampers beside them (Kelvin-Voigt): `K (u + eta du/dt)`.
///
/// One parameter, `eta` (s). Tell-tale: proportional to the speed of the indentation, nothing while
/// the robot holds still. A late reading (latency) lags, this leads.
///
/// # Reference
/// Y. C. Fung, *Biomechanics: Mechanical Properties of Living Tissues*, 2nd ed., 1993, section 2.11,
/// doi:10.1007/978-1-4757-2257-4.
#[derive(Debug, Clone, Copy)]
pub struct Viscoelastic;

struct Dampers {
    eta: f64,
    /// Displacement of every rest point at the previous sample (m).
    last: Vec<Vector3<f64>>,
    touched: Vec<u32>,
    /// Points touched at the previous sample.
    before: Vec<u32>,
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
        vec![Parameter::amplitude("eta", "s", [0.0, 2.0], 0.05)]
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 1)?;
        Ok(Box::new(Dampers {
            eta: theta[0],
            last: vec![Vector3::zeros(); site.rest.len()],
            touched: Vec::new(),
            before: Vec::new(),
        }))
    }
}

impl Dampers {
    fn forget(&mut self) {
        for p in self.before.drain(..) {
            self.last[p as usize] = Vector3::zeros();
        }
    }
}

impl Compensator for Dampers {
    fn begin_sequence(&mut self, _: &str) {
        self.forget();
    }

    fn begin_touch(&mut self) {
        self.forget();
    }

    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        let contacts = touch.contacts;
        self.touched.clear();
        self.touched.extend_from_slice(contacts.points());
        // Points that were let go are at rest again.
        for (k, &p) in contacts.points().iter().enumerate() {
            let u = contacts.displacements()[k];
            if sample.dt > 0.0 {
                springs[k] += (u - self.last[p as usize]) * (self.eta / sample.dt);
                // A damper cannot pull: the point would leave the link.
                if springs[k].dot(&u) < 0.0 {
                    springs[k] = Vector3::zeros();
                }
            }
        }
        self.forget();
        for (&p, u) in contacts.points().iter().zip(contacts.displacements()) {
            self.last[p as usize] = *u;
        }
        std::mem::swap(&mut self.before, &mut self.touched);
    }
}
