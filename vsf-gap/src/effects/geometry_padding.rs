use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Site, check};
use vsf_contact::ContactConfig;
use vsf_pipeline::LEAST_THRESHOLD;

/// Links that are thicker or thinner than their model: surfaces lie `padding` further out.
///
/// One parameter, `padding` (m). Surfaces never shrink so far that less than 0.1 mm of the contact threshold is left.
/// Tell-tale: contact begins early, or late, from all sides; with a misplaced object it is early on one side and late on
/// the other.
///
/// # Reference
/// S. Osher, R. Fedkiw, *Level Set Methods and Dynamic Implicit Surfaces*, 2003, chapter 2 (offsets
/// of signed distances), doi:10.1007/b98879.
#[derive(Debug, Clone, Copy)]
pub struct GeometryPadding;

#[derive(Clone)]
struct Padding(f64);

impl Effect for GeometryPadding {
    fn name(&self) -> &str {
        "geometry_padding"
    }

    fn summary(&self) -> &str {
        "links are thicker than their model by `padding`, thinner where it is negative"
    }

    fn acts(&self) -> Acts {
        Acts::Contact
    }

    fn null_gain(&self) -> f64 {
        25.0
    }

    fn chooses_contacts(&self) -> bool {
        true
    }

    fn may_prevent_touch(&self) -> bool {
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
        vec![Parameter::amplitude("padding", "m", [-1.5e-3, 8e-3], 1e-3)]
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 1)?;
        Ok(Box::new(Padding(theta[0])))
    }
}

impl Compensator for Padding {
    fn contact(&self, config: &mut ContactConfig) {
        let least = (LEAST_THRESHOLD - config.threshold).min(config.padding);
        config.padding = (config.padding + self.0).max(least);
    }
}
