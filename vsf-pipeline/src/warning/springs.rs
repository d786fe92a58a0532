//! Springs of equal stiffness at all points, to compare readings in contact with.

use crate::Trace;
use vsf_core::Observation;

/// The torques of springs of 1 N/m at every touched point: one row per sample, one column per joint.
pub type Springs = Vec<Vec<f64>>;

/// Computes these torques for each trace.
pub fn springs(traces: &[Trace]) -> Vec<Springs> {
    let of_joint = |o: &Observation<f64>, j| o.row(j).iter().sum();
    let of = |o: &Observation<f64>| (0..o.dim()).map(|j| of_joint(o, j)).collect();
    let of_trace = |t: &Trace| t.observations.iter().map(of).collect();
    traces.iter().map(of_trace).collect()
}

/// Inner products of readings and what they are compared with.
#[derive(Default)]
pub struct Likeness {
    readings: f64,
    both: f64,
    others: f64,
}

impl Likeness {
    pub fn add(&mut self, reading: f64, other: f64) {
        self.readings += reading * reading;
        self.both += reading * other;
        self.others += other * other;
    }

    /// Slope of the readings against the other quantity, by least squares.
    pub fn slope(&self) -> f64 {
        self.both / self.others
    }

    /// Cosine of the angle between both; NaN if one is zero.
    pub fn correlation(&self) -> f64 {
        self.both / (self.readings * self.others).sqrt()
    }
}
