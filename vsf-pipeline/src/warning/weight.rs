//! Signs and columns of readings of the actuators: those under which weight and motion of the arm explain them best
//! where nothing is touched.

use super::PipelineWarning;
use super::order::{Columns, as_given, orders, with_signs};
use crate::reading_unit;
use nalgebra::DMatrix;
use vsf_robots::Joint;

/// Another convention has to leave less than this share of the squared differences of the joints that it changes.
const MOST_LEFT: f64 = 0.25;
/// Joints whose torques change by less than this share of the most that those of a unit do say nothing: friction or a
/// payload may turn them round.
const LEAST_WEIGHT: f64 = 0.02;

/// How readings vary where nothing is touched, beside the torques of the arm alone. What is constant does not count: it
/// may be an offset.
pub struct Weighed {
    count: usize,
    /// Sums of the readings, by column, and of their squares; and of the torques, by joint.
    readings: [Vec<f64>; 2],
    rigid: [Vec<f64>; 2],
    /// Sums of products, a row for every joint.
    both: DMatrix<f64>,
}

impl Weighed {
    pub fn new(joints: usize) -> Self {
        let zeros = || [vec![0.0; joints], vec![0.0; joints]];
        Self {
            count: 0,
            readings: zeros(),
            rigid: zeros(),
            both: DMatrix::zeros(joints, joints),
        }
    }

    /// Takes one sample in.
    pub fn add(&mut self, readings: &[f64], rigid: &[f64]) {
        self.count += 1;
        for (j, torque) in rigid.iter().enumerate() {
            self.rigid[0][j] += torque;
            self.rigid[1][j] += torque * torque;
            for (k, reading) in readings.iter().enumerate() {
                self.both[(j, k)] += torque * reading;
            }
        }
        for (k, reading) in readings.iter().enumerate() {
            self.readings[0][k] += reading;
            self.readings[1][k] += reading * reading;
        }
    }

    /// How many samples.
    pub fn count(&self) -> usize {
        self.count
    }

    fn variance(&self, [sum, squares]: &[Vec<f64>; 2], k: usize) -> f64 {
        squares[k] - sum[k] * sum[k] / self.count as f64
    }

    /// Squared differences at a joint that takes a column with a sign.
    fn left(&self, joint: usize, (column, sign): (usize, f64)) -> f64 {
        let means = self.rigid[0][joint] * self.readings[0][column] / self.count as f64;
        let covariance = self.both[(joint, column)] - means;
        let own = self.variance(&self.readings, column) + self.variance(&self.rigid, joint);
        own - 2.0 * sign * covariance
    }

    /// Some joints' torques of the wrong sign, not those of all that tell; or columns in the wrong order.
    pub fn warning(&self, joints: &[Joint]) -> Option<PipelineWarning> {
        let rigid = |j: usize| self.variance(&self.rigid, j);
        let alike = |j: usize, k: &usize| reading_unit(&joints[j]) == reading_unit(&joints[*k]);
        // Of all joints of its unit the most.
        let scales: Vec<f64> = (0..joints.len())
            .map(|j| {
                (0..joints.len())
                    .filter(|k| alike(j, k))
                    .map(rigid)
                    .fold(0.0, f64::max)
            })
            .collect();
        let tells = |j: &usize| rigid(*j) > LEAST_WEIGHT * LEAST_WEIGHT * scales[*j];
        let telling: Vec<usize> = (0..joints.len()).filter(tells).collect();
        let left = |columns: &Columns, of: &dyn Fn(usize) -> bool| {
            let of = (0..joints.len()).filter(|j| of(*j) && scales[*j] > 0.0);
            of.map(|j| self.left(j, columns[j]) / scales[j])
                .sum::<f64>()
        };
        let given = as_given(joints.len());
        // A joint that tells nothing counts, too: no column is better for being taken away. Where nothing is read, shares
        // are no numbers.
        let share_left = |columns: &Columns| {
            let changed = |j: usize| columns[j] != given[j];
            left(columns, &changed) / left(&given, &changed)
        };
        let mut signs = vec![1.0; joints.len()];
        for &j in &telling {
            if self.left(j, (j, -1.0)) / self.left(j, (j, 1.0)) < MOST_LEFT {
                signs[j] = -1.0;
            }
        }
        if telling.iter().all(|&j| signs[j] < 0.0) {
            return None;
        }
        let by_signs = with_signs(&signs);
        let evident = |(_, columns): &(_, Columns)| share_left(columns) < MOST_LEFT;
        let best = (orders(joints.len()).filter(evident))
            .map(|(order, columns)| (left(&columns, &|_| true), order, columns))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, order, columns)) = best.filter(|b| b.0 < left(&by_signs, &|_| true)) {
            return Some(PipelineWarning::MixedActuators {
                order: order.in_words(joints),
                left: share_left(&columns),
            });
        }
        let opposite = joints.iter().zip(&signs).filter(|(_, s)| **s < 0.0);
        let opposite: Vec<&str> = opposite.map(|(joint, _)| joint.name()).collect();
        (!opposite.is_empty()).then(|| PipelineWarning::OppositeActuators {
            joints: opposite.join(", "),
            left: share_left(&by_signs),
        })
    }
}
