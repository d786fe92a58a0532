use crate::DataError;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Their name in files.
const KEY: &str = "contact_parameters";

/// Parameters of contact that a field was estimated, or a corrected model found, with. A field makes up for the contact
/// that it was learned through: predicted through another, torques err by its share of the difference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object of parameters")]
pub struct ContactParameters {
    /// Contact threshold delta \[m\], > 0. Lengths of this struct are 1 m at most, positive ones 1e-9 m at least.
    pub threshold: f64,
    /// Friction coefficient, >= 0.
    pub friction: f64,
    /// Slip of one iteration \[m\], > 0.
    pub slip_step: f64,
    /// Most slip iterations of a point in one step.
    pub max_slip_iterations: u32,
    /// Offset of every link's surface \[m\], > `-threshold`.
    pub padding: f64,
    /// How far a point follows a link that leaves it \[m\], >= 0.
    pub adhesion: f64,
    /// Sub-points per edge of the cube that a rest point stands for, 1 to 8; 1 are the points alone.
    pub subdivision: usize,
    /// Names of the links that may touch, each once and one at least; `None`, and no such key in a file, for all with collision shapes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<Vec<String>>,
}

impl ContactParameters {
    /// Checks the ranges of all parameters.
    ///
    /// # Errors
    /// [`DataError::Argument`], which names the first that is out of its range.
    pub fn check(&self) -> Result<(), DataError> {
        match self.problem() {
            Some(problem) => Err(DataError::Argument { what: KEY, problem }),
            None => Ok(()),
        }
    }

    /// [`check`](Self::check) that names the file.
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

    /// The first parameter that is out of its range, and what that is.
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
