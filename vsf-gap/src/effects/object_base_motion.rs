use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, check};
use nalgebra::Vector3;

/// An object that gives way as a whole: its base moves by `c F` under the force `F` of the robot.
///
/// Parameters `c_x`, `c_y`, `c_z` (m/N), compliances along the world axes. The force is the one behind the reading of the
/// previous sample. Tell-tale: all contacts shift with the load, also those of touches far away. Elastic gears, in
/// contrast, move the arm by amounts that depend on the posture.
///
/// # Reference
/// S. A. Neild, C. J. Wood, "Estimating stem and root-anchorage flexibility in trees", Tree Physiology
/// 19(3), 1999, doi:10.1093/treephys/19.3.141.
#[derive(Debug, Clone, Copy)]
pub struct ObjectBaseMotion;

#[derive(Clone)]
struct Base(Vector3<f64>);

impl Effect for ObjectBaseMotion {
    fn name(&self) -> &str {
        "object_base_motion"
    }

    fn summary(&self) -> &str {
        "the object gives way as a whole, by `c_x`, `c_y`, `c_z` times the force"
    }

    fn acts(&self) -> Acts {
        Acts::Contact
    }

    fn null_gain(&self) -> f64 {
        20.0
    }

    fn chooses_contacts(&self) -> bool {
        true
    }

    fn follows_reading(&self) -> bool {
        true
    }

    fn needs(&self) -> &[Need] {
        &[Need::Contact]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(
            probe,
            Probe::TouchDeeper | Probe::TouchInOtherPosture | Probe::TouchAlongOtherAxis
        )
        .then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        ["c_x", "c_y", "c_z"]
            .map(|name| Parameter::amplitude(name, "m/N", [0.0, 0.02], 3e-4))
            .to_vec()
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 3)?;
        Ok(Box::new(Base(Vector3::from_column_slice(theta))))
    }
}

impl Compensator for Base {
    fn object_shift(&mut self, sample: &Sample<'_>) -> Vector3<f64> {
        // The object feels the reverse of what the robot feels.
        -self.0.component_mul(&sample.force_W)
    }
}
