use crate::DataError;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Parameters of contact that a field was estimated with. A field makes up for the contact that it was learned
/// through: predicted through another, torques err by its share of the difference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object of numbers")]
pub struct FieldContact {
    /// Contact threshold delta \[m\], > 0. Numbers of this struct are 1e100 at most, positive ones 1e-100 at least.
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
}

impl FieldContact {
    pub(crate) fn check(&self, path: &Path) -> Result<(), DataError> {
        let positive = |v: f64| (1e-100..=1e100).contains(&v);
        let not_negative = |v: f64| (0.0..=1e100).contains(&v);
        let problem = if !positive(self.threshold) {
            format!("threshold {:?} must be 1e-100 to 1e100 m", self.threshold)
        } else if !not_negative(self.friction) {
            format!("friction {:?} must be 0 to 1e100", self.friction)
        } else if !positive(self.slip_step) {
            format!("slip_step {:?} must be 1e-100 to 1e100 m", self.slip_step)
        } else if !positive(self.threshold + self.padding) {
            format!("padding {:?} must be more than -threshold", self.padding)
        } else if !not_negative(self.adhesion) {
            format!("adhesion {:?} must be 0 to 1e100 m", self.adhesion)
        } else if !(1..=8).contains(&self.subdivision) {
            format!("subdivision {} must be 1 to 8", self.subdivision)
        } else {
            return Ok(());
        };
        Err(DataError::Metadata {
            path: path.to_owned(),
            key: "contact_parameters",
            problem,
        })
    }
}
