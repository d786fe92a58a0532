use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, check};
use nalgebra::Vector3;

/// An object that is not where the recording has it, by one offset for the whole session and a further one for each
/// sequence.
///
/// Parameters `dx`, `dy`, `dz` (m, world), the offset of all sequences, and `dx_<sequence>`, ..., what a sequence adds. An
/// unknown sequence has the common offset alone. Tell-tale: where and when contact begins. A dense field absorbs a common
/// offset, but not one that changes between sequences.
///
/// # Reference
/// P. J. Besl, N. D. McKay, "A method for registration of 3-D shapes", IEEE Trans. Pattern Analysis
/// and Machine Intelligence 14(2), 1992, doi:10.1109/34.121791.
#[derive(Debug, Clone, Copy)]
pub struct RegistrationOffset;

#[derive(Clone)]
struct Offset {
    common: Vector3<f64>,
    own: Vec<(String, Vector3<f64>)>,
    now: Vector3<f64>,
}

impl Effect for RegistrationOffset {
    fn name(&self) -> &str {
        "registration_offset"
    }

    fn summary(&self) -> &str {
        "the object lies elsewhere, by `dx`, `dy`, `dz`, and in a sequence by `dx_<sequence>`, ... more"
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
            Probe::TouchAgain | Probe::TouchInOtherPosture | Probe::TouchAlongOtherAxis
        )
        .then_some(self.name())
    }

    fn parameters(&self, site: &Site) -> Vec<Parameter> {
        let axis = |name, scale| Parameter::amplitude(name, "m", [-0.05, 0.05], scale);
        let common = ["dx", "dy", "dz"].map(|d| axis(d.to_owned(), 4e-3));
        let own = |(s, id): (usize, &String)| {
            ["dx", "dy", "dz"].map(|d| axis(format!("{d}_{id}"), 2e-3).of_sequence(s))
        };
        let own = site.sequences.iter().enumerate().flat_map(own);
        common.into_iter().chain(own).collect()
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 3 + 3 * site.sequences.len())?;
        let own = theta[3..].chunks_exact(3).map(Vector3::from_column_slice);
        let common = Vector3::from_column_slice(&theta[..3]);
        Ok(Box::new(Offset {
            common,
            own: site.sequences.iter().cloned().zip(own).collect(),
            now: common,
        }))
    }
}

impl Compensator for Offset {
    fn begin_sequence(&mut self, sequence: &str) {
        let own = self.own.iter().find(|(id, _)| id == sequence);
        self.now = self.common + own.map_or_else(Vector3::zeros, |(_, offset)| *offset);
    }

    fn object_shift(&mut self, _: &Sample<'_>) -> Vector3<f64> {
        self.now
    }
}
