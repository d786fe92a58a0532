use super::body::add_force;
use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Sample, Site, Touch, check};
use nalgebra::Point3;

/// Points that stick to the robot when it lets them go: each pulls with `f (1 - s / range)` while the
/// place where it stuck is at a distance `s < range` from its rest position.
///
/// Parameters `f` (N), per point, and the shape `range` (m). While a point is pressed, its spring has
/// the whole force of the contact, and adhesion none. Tell-tale: the torque has the other sign as
/// contact is lost, and none of it is seen on approach. A plastic set ends early instead.
///
/// # Reference
/// D. Maugis, "Adhesion of spheres: the JKR-DMT transition using a Dugdale model", J. Colloid and
/// Interface Science 150(1), 1992, doi:10.1016/0021-9797(92)90285-T.
#[derive(Debug, Clone, Copy)]
pub struct Adhesion;

/// Where a rest point touched, or still sticks to, a link.
#[derive(Clone, Copy)]
struct Bond {
    point: u32,
    link: u32,
    place_L: Point3<f64>,
}

struct Bonds {
    force: f64,
    range: f64,
    /// Points touched at the last sample.
    touched: Vec<Bond>,
    /// Points that were let go and still stick.
    stuck: Vec<Bond>,
}

impl Effect for Adhesion {
    fn name(&self) -> &str {
        "adhesion"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![
            Parameter::amplitude("f", "N", [0.0, 20.0], 0.05),
            Parameter::shape("range", "m", [1e-3, 0.05], 2e-3),
        ]
    }

    fn starts(&self, _: &Site) -> Vec<Vec<f64>> {
        [0.004, 0.015].map(|range| vec![0.0, range]).to_vec()
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 2)?;
        Ok(Box::new(Bonds {
            force: theta[0],
            range: theta[1],
            touched: Vec::new(),
            stuck: Vec::new(),
        }))
    }
}

impl Compensator for Bonds {
    fn begin_touch(&mut self) {
        self.touched.clear();
        self.stuck.clear();
    }

    fn torques(&mut self, _: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        let (contacts, posture) = (touch.contacts, touch.posture);
        let (poses, rest) = (posture.link_poses(), touch.rest.positions());
        self.stuck.append(&mut self.touched);
        self.stuck.retain(|bond| {
            let place = poses[bond.link as usize] * bond.place_L;
            let pulled = place - rest[bond.point as usize];
            let s = pulled.norm();
            let holds = s < self.range && contacts.points().binary_search(&bond.point).is_err();
            if holds && s > 0.0 {
                let pull = pulled * (-self.force * (1.0 - s / self.range) / s);
                add_force(posture, bond.link as usize, &place, &pull, tau);
            }
            holds
        });
        for (k, &point) in contacts.points().iter().enumerate() {
            let link = contacts.links()[k];
            let place_W = rest[point as usize] + contacts.displacements()[k];
            self.touched.push(Bond {
                point,
                link,
                place_L: poses[link as usize].inverse_transform_point(&place_W),
            });
        }
    }
}
