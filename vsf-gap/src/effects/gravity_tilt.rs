use super::body::add_force;
use crate::GapError;
use crate::effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, Touch, check,
};
use nalgebra::{Rotation3, Vector3};
use std::sync::Arc;
use vsf_robots::RobotModel;

/// A direction of gravity other than assumed: the robot is not level.
///
/// Parameters `tilt_x` and `tilt_y` (rad), a rotation vector about the world axes, with rotation `R`. The arm is tilted by
/// it, so gravity is `R^T g` where the model (and whoever removed the arm's weight from the readings) has `g`. The weight
/// of all links changes by that difference. Tell-tale: it acts on all joints, in proportion to how the weight of the links
/// depends on its direction, in free motion too. A payload acts at the last link only.
///
/// # Reference
/// J. M. Hollerbach, W. Khalil, M. Gautier, "Model identification", *Springer Handbook of Robotics*,
/// 2nd ed., 2016, doi:10.1007/978-3-319-32552-1_6.
#[derive(Debug, Clone, Copy)]
pub struct GravityTilt;

#[derive(Clone)]
struct Tilt {
    /// Change of gravity (m/s²) whose weight is added.
    change: Vector3<f64>,
    robot: Arc<RobotModel>,
}

impl Effect for GravityTilt {
    fn name(&self) -> &str {
        "gravity_tilt"
    }

    fn summary(&self) -> &str {
        "the arm stands tilted by `tilt_x`, `tilt_y` about world axes"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[Need::Weight]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::TouchInOtherPosture | Probe::CarryPayload).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        ["tilt_x", "tilt_y"]
            .map(|name| Parameter::amplitude(name, "rad", [-0.5, 0.5], 0.02))
            .to_vec()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 2)?;
        let R = Rotation3::new(Vector3::new(theta[0], theta[1], 0.0));
        Ok(Box::new(Tilt {
            change: R.inverse() * site.gravity - site.gravity,
            robot: site.robot.clone(),
        }))
    }
}

impl Compensator for Tilt {
    fn torques(&mut self, _: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        let poses = touch.posture.link_poses();
        for (l, (link, X_WL)) in self.robot.links().iter().zip(poses).enumerate() {
            let weight = self.change * link.mass();
            let com_W = X_WL * link.com_L();
            add_force(touch.posture, l, &com_W, &weight, tau);
        }
    }
}
