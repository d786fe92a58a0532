use crate::DataError;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Their name in files.
const KEY: &str = "contact_parameters";

/// Contact parameters with which a field was estimated or a corrected model found.
///
/// A field compensates for errors of the contact that it was learned with. Predicted with another contact, torques err by
/// the field's share of the difference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object of parameters")]
pub struct ContactParameters {
    /// Contact threshold delta \[m\], > 0. All lengths of this struct are at most 1 m, and positive ones at least 1e-9 m.
    pub threshold: f64,
    /// Friction coefficient, >= 0.
    pub friction: f64,
    /// Slip per iteration \[m\], > 0.
    pub slip_step: f64,
    /// Most slip iterations per point and step.
    pub max_slip_iterations: u32,
    /// Offset of every link's surface \[m\], > `-threshold`.
    pub padding: f64,
    /// How far a point follows a link that leaves it \[m\], >= 0.
    pub adhesion: f64,
    /// Sub-points per edge of the cube around a rest point, 1 to 8; with 1, only the points themselves.
    pub subdivision: usize,
    /// Names of the links that may touch, at least one and each once. `None` means all links with collision shapes; a file
    /// then has no such key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<Vec<String>>,
}

impl ContactParameters {
    /// Checks the ranges of all parameters.
    ///
    /// # Errors
    /// [`DataError::Argument`] with the first parameter that is out of range.
    pub fn check(&self) -> Result<(), DataError> {
        match self.problem() {
            Some(problem) => Err(DataError::Argument { what: KEY, problem }),
            None => Ok(()),
        }
    }

    /// [`check`](Self::check), with the file named.
    pub(crate) fn check_in(&self, path: &Path) -> Result<(), DataError> {
        match self.problem() {
            Some(problem) => Err(DataError::Metadata {
                path: path.to_owned(),
                key: KEY,
                problem,
            }),
            None => Ok(()),
        }
    }

    /// The first parameter that is out of range, and the range.
    fn problem(&self) -> Option<String> {
        let length = |v: f64| (1e-9..=1.0).contains(&v);
        Some(if !length(self.threshold) {
            format!("threshold {:?} must be 1e-9 to 1 m", self.threshold)
        } else if !(self.friction >= 0.0 && self.friction.is_finite()) {
            format!("friction {:?} must be >= 0 and finite", self.friction)
        } else if !length(self.slip_step) {
            format!("slip_step {:?} must be 1e-9 to 1 m", self.slip_step)
        } else if !(self.padding <= 1.0 && self.threshold + self.padding > 0.0) {
            format!(
                "padding {:?} must be more than -threshold and at most 1 m",
                self.padding
            )
        } else if !(0.0..=1.0).contains(&self.adhesion) {
            format!("adhesion {:?} must be 0 to 1 m", self.adhesion)
        } else if !(1..=8).contains(&self.subdivision) {
            format!("subdivision {} must be 1 to 8", self.subdivision)
        } else if let Some(links) = self.links.as_ref().filter(|l| has_none_or_twice(l)) {
            format!("links {links:?} must name one link at least, and none twice")
        } else {
            return None;
        })
    }
}

fn has_none_or_twice(names: &[String]) -> bool {
    names.is_empty() || (1..names.len()).any(|k| names[..k].contains(&names[k]))
}
