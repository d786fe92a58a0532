use super::body::{RigidMotion, add_force};
use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};

/// Mass and drag of the object: every touched point resists its motion by `-(m a + c v)`. This is a force on the robot at
/// the point, with the velocity `v` and the acceleration `a` of the robot there.
///
/// Parameters `m` (kg) and `c` (N s/m), each per rest point, so they depend on the spacing of the points as stiffness does.
/// They are the same for stiff and soft points. Tell-tale: proportional to the acceleration of the contact. The dampers of
/// `viscoelastic`, in contrast, are proportional to the stiffness.
///
/// # Reference
/// N. Hogan, "Impedance control: an approach to manipulation, part I", J. Dynamic Systems,
/// Measurement, and Control 107(1), 1985, doi:10.1115/1.3140702.
#[derive(Debug, Clone, Copy)]
pub struct InertiaDrag;

#[derive(Clone)]
struct Moved {
    mass: f64,
    drag: f64,
}

impl Effect for InertiaDrag {
    fn name(&self) -> &str {
        "inertia_drag"
    }

    fn summary(&self) -> &str {
        "touched points, soft ones too, resist moving along by a mass `m` and a drag `c` each"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    /// It bends to whatever lags in contact, such as friction that grows with the load.
    fn null_gain(&self) -> f64 {
        40.0
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::TouchFaster).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![
            Parameter::amplitude("m", "kg", [0.0, 10.0], 0.02),
            Parameter::amplitude("c", "N s/m", [0.0, 100.0], 0.2),
        ]
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 2)?;
        Ok(Box::new(Moved {
            mass: theta[0],
            drag: theta[1],
        }))
    }
}

impl Compensator for Moved {
    fn torques(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        let contacts = touch.contacts;
        let touched = contacts.points().iter().zip(contacts.displacements());
        let mut of_link = None;
        for ((&point, u), &link) in touched.zip(contacts.links()) {
            let link = link as usize;
            let motion = match &of_link {
                Some((of, motion)) if *of == link => motion,
                _ => {
                    let motion = RigidMotion::of(touch.posture, link, sample.qd, sample.qdd);
                    &of_link.insert((link, motion)).1
                }
            };
            let p = touch.rest.positions()[point as usize] + u;
            let force = motion.acceleration(&p) * -self.mass - motion.velocity(&p) * self.drag;
            add_force(touch.posture, link, &p, &force, tau);
        }
    }
}
