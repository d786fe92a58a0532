//! Signs and columns of readings of the actuators: those under which weight and motion of the arm explain them best
//! where nothing is touched.

use super::PipelineWarning;
use super::order::{Columns, as_given, orders, with_signs};
use nalgebra::DMatrix;
use vsf_robots::Joint;

/// Another convention has to leave less than this share of the squared differences of the joints that it changes: so
/// many times too heavy or too light, a payload or friction leave more.
const MOST_LEFT: f64 = 0.25;

/// Readings where nothing is touched, beside the torques of the arm alone.
pub struct Weighed {
    /// Sums of squares of the readings, by column, and of the torques, by joint.
    readings: Vec<f64>,
    rigid: Vec<f64>,
    /// Sums of products, a row for every joint.
    both: DMatrix<f64>,
}

impl Weighed {
    pub fn new(joints: usize) -> Self {
        Self {
            readings: vec![0.0; joints],
            rigid: vec![0.0; joints],
            both: DMatrix::zeros(joints, joints),
        }
    }

    /// Takes one sample in.
    pub fn add(&mut self, readings: &[f64], rigid: &[f64]) {
        for (j, torque) in rigid.iter().enumerate() {
            self.rigid[j] += torque * torque;
            for (k, reading) in readings.iter().enumerate() {
                self.both[(j, k)] += torque * reading;
            }
        }
        (self.readings.iter_mut().zip(readings)).for_each(|(sum, r)| *sum += r * r);
    }

    /// Squared differences at a joint that takes a column with a sign.
    fn left(&self, joint: usize, (column, sign): (usize, f64)) -> f64 {
        self.readings[column] + self.rigid[joint] - 2.0 * sign * self.both[(joint, column)]
    }

    /// What a convention leaves, squared, of all joints (N m and N, as they come).
    fn left_of_all(&self, columns: &Columns) -> f64 {
        let joints = columns.iter().enumerate();
        joints.map(|(j, taken)| self.left(j, *taken)).sum()
    }

    /// The share that a convention leaves of what readings as given leave, of the joints that it changes.
    fn share_left(&self, columns: &Columns) -> f64 {
        let (mut before, mut after) = (0.0, 0.0);
        for (j, taken) in columns.iter().enumerate() {
            if *taken != (j, 1.0) {
                before += self.left(j, (j, 1.0));
                after += self.left(j, *taken);
            }
        }
        after / before
    }

    /// Some joints' torques of the wrong sign, or columns in the wrong order.
    pub fn warning(&self, joints: &[Joint]) -> Option<PipelineWarning> {
        let turned = |j: usize| {
            let mut columns = as_given(joints.len());
            columns[j].1 = -1.0;
            self.share_left(&columns) < MOST_LEFT
        };
        let signs: Vec<f64> = (0..joints.len())
            .map(|j| if turned(j) { -1.0 } else { 1.0 })
            .collect();
        let by_signs = with_signs(&signs);
        // Where nothing is read, shares are no numbers.
        let evident = |(_, columns): &(_, Columns)| self.share_left(columns) < MOST_LEFT;
        let by_order = orders(joints.len()).filter(evident);
        let by_order =
            by_order.map(|(order, c)| (order, self.left_of_all(&c), self.share_left(&c)));
        let best = by_order.min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((order, _, left)) = best.filter(|b| b.1 < self.left_of_all(&by_signs)) {
            let order = order.in_words(joints);
            return Some(PipelineWarning::MixedActuators { order, left });
        }
        let opposite = joints.iter().zip(&signs).filter(|(_, s)| **s < 0.0);
        let opposite: Vec<&str> = opposite.map(|(joint, _)| joint.name()).collect();
        (!opposite.is_empty()).then(|| PipelineWarning::OppositeActuators {
            joints: opposite.join(", "),
            left: self.share_left(&by_signs),
        })
    }
}
