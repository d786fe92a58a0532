use super::body::{RigidMotion, add_force};
use crate::GapError;
use crate::contact::centre;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch, check};

/// The object moves along with the robot and resists by its mass and the drag of the air: a force
/// `-(m a + c v)` on the robot at the middle of the contact, which moves with `v` and `a`.
///
/// Parameters `m` (kg) and `c` (N s/m), the part of the object's mass and drag that is felt there.
/// Tell-tale: proportional to the acceleration of the contact; dampers in the object are proportional
/// to the speed of the indentation.
///
/// # Reference
/// N. Hogan, "Impedance control: an approach to manipulation, part I", J. Dynamic Systems,
/// Measurement, and Control 107(1), 1985, doi:10.1115/1.3140702.
#[derive(Debug, Clone, Copy)]
pub struct InertiaDrag;

struct Moved {
    mass: f64,
    drag: f64,
}

impl Effect for InertiaDrag {
    fn name(&self) -> &str {
        "inertia_drag"
    }

    fn summary(&self) -> &str {
        "the object resists moving along by its mass `m` and drag `c`"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![
            Parameter::amplitude("m", "kg", [0.0, 50.0], 0.2),
            Parameter::amplitude("c", "N s/m", [0.0, 500.0], 2.0),
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
        let Some((link, p)) = centre(touch) else {
            return;
        };
        let motion = RigidMotion::of(touch.posture, link, sample.qd, sample.qdd);
        let force = motion.acceleration(&p) * -self.mass - motion.velocity(&p) * self.drag;
        add_force(touch.posture, link, &p, &force, tau);
    }
}
