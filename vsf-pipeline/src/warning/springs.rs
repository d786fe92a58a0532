//! Springs of one stiffness everywhere: what readings in contact are compared with.

use crate::Trace;
use vsf_core::Observation;

/// The torques of springs of 1 N/m at every point that is touched: of each sample a row, of each joint a column.
pub type Springs = Vec<Vec<f64>>;

/// Those of each trace.
pub fn springs(traces: &[Trace]) -> Vec<Springs> {
    let of_joint = |o: &Observation<f64>, j| o.row(j).iter().sum();
    let of = |o: &Observation<f64>| (0..o.dim()).map(|j| of_joint(o, j)).collect();
    let of_trace = |t: &Trace| t.observations.iter().map(of).collect();
    traces.iter().map(of_trace).collect()
}

/// Inner products of readings with what they are compared to.
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

    /// Readings per other, by least squares.
    pub fn slope(&self) -> f64 {
        self.both / self.others
    }

    /// Cosine of the angle between them, NaN where one is zero.
    pub fn correlation(&self) -> f64 {
        self.both / (self.readings * self.others).sqrt()
    }
}
