//! Signs, columns and scales of actuator readings: finds those under which weight and motion of the arm
//! explain the readings best where nothing is touched.

use super::PipelineWarning;
use super::misread::GRAVITY_CORRELATION;
use super::order::{Columns, as_given, orders, with_signs};
use crate::reading_unit;
use nalgebra::{DMatrix, DVector};
use vsf_robots::Joint;

/// Another convention has to leave less than this share of the squared differences of the joints that it changes.
const MOST_LEFT: f64 = 0.25;
/// Joints whose torques change by less than this share of the most that those of a unit do say nothing: friction or a
/// payload may turn them round.
const LEAST_WEIGHT: f64 = 0.02;
/// Readings of so many times what is needed, or of that part of it, are of another unit; less is a gain of the sensor.
const MOST_SCALE: f64 = 3.0;

/// Squared differences below this share of the squares that they are of are rounding.
const ROUNDING: f64 = 1e-12;

/// Variation of readings and of the arm's rigid-body torques where nothing is touched. What is constant in
/// a sequence is ignored: it may be an offset, and an arm at rest says nothing about signs.
pub struct Weighed {
    count: usize,
    /// Sums of squares of the readings, by column, and of the torques, by joint, about their means.
    readings: DVector<f64>,
    rigid: DVector<f64>,
    /// Sums of products alike, a row for every joint.
    both: DMatrix<f64>,
}

impl Weighed {
    pub fn new(joints: usize) -> Self {
        Self {
            count: 0,
            readings: DVector::zeros(joints),
            rigid: DVector::zeros(joints),
            both: DMatrix::zeros(joints, joints),
        }
    }

    /// Adds a sequence: readings and rigid-body torques, one row per sample.
    pub fn add(&mut self, readings: &DMatrix<f64>, rigid: &DMatrix<f64>) {
        if readings.nrows() == 0 {
            return;
        }
        let centered = |rows: &DMatrix<f64>| {
            let means = rows.row_mean();
            DMatrix::from_fn(rows.nrows(), rows.ncols(), |i, j| rows[(i, j)] - means[j])
        };
        let (readings, rigid) = (centered(readings), centered(rigid));
        self.count += readings.nrows();
        self.readings += readings.map(|v| v * v).row_sum_tr();
        self.rigid += rigid.map(|v| v * v).row_sum_tr();
        self.both += rigid.transpose() * readings;
    }

    /// Number of samples.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Squared differences at a joint that takes a column with a sign.
    fn left(&self, joint: usize, (column, sign): (usize, f64)) -> f64 {
        let squares = self.readings[column] + self.rigid[joint];
        (squares - 2.0 * sign * self.both[(joint, column)]).max(ROUNDING * squares)
    }

    /// The most that the torques of a joint of its unit vary.
    fn largest_alike(&self, joints: &[Joint], j: usize) -> f64 {
        let alike = |k: &usize| reading_unit(&joints[j]) == reading_unit(&joints[*k]);
        let of_unit = (0..joints.len()).filter(alike);
        of_unit.map(|k| self.rigid[k]).fold(0.0, f64::max)
    }

    /// Whether the torques of a joint vary enough to say something.
    fn tells(&self, joints: &[Joint], j: usize) -> bool {
        self.rigid[j] > LEAST_WEIGHT * LEAST_WEIGHT * self.largest_alike(joints, j)
    }

    /// Reports joints whose torques have another scale.
    pub fn scaled(&self, joints: &[Joint]) -> Option<PipelineWarning> {
        let of_joint = |j: usize| {
            let both = self.both[(j, j)];
            let correlation = both / (self.readings[j] * self.rigid[j]).sqrt();
            (j, both / self.rigid[j], correlation)
        };
        let odd = |(_, factor, correlation): &(usize, f64, f64)| {
            *correlation > GRAVITY_CORRELATION && !(1.0 / MOST_SCALE..=MOST_SCALE).contains(factor)
        };
        let telling = (0..joints.len()).filter(|&j| self.tells(joints, j));
        let found: Vec<(usize, f64, f64)> = telling.map(of_joint).filter(odd).collect();
        let &(clearest, factor, correlation) = found.iter().max_by(|a, b| a.2.total_cmp(&b.2))?;
        let over = |of: &dyn Fn(usize) -> f64| {
            let each = found
                .iter()
                .map(|&(j, ..)| of(j) / self.largest_alike(joints, j));
            each.sum::<f64>()
        };
        let scaled = over(&|j| self.readings[j] - self.both[(j, j)].powi(2) / self.rigid[j]);
        Some(PipelineWarning::ScaledActuators {
            joint: joints[clearest].name().to_owned(),
            factor,
            correlation,
            left: scaled / over(&|j| self.left(j, (j, 1.0))),
            others: found.len() - 1,
        })
    }

    /// Reports torques of the wrong sign, of some of the joints that show it but not of all; or columns in
    /// the wrong order.
    pub fn warning(&self, joints: &[Joint]) -> Option<PipelineWarning> {
        let scales: Vec<f64> = (0..joints.len())
            .map(|j| self.largest_alike(joints, j))
            .collect();
        let telling: Vec<usize> = (0..joints.len())
            .filter(|&j| self.tells(joints, j))
            .collect();
        let left_of = |columns: &Columns, j: usize| {
            if scales[j] > 0.0 {
                self.left(j, columns[j]) / scales[j]
            } else {
                0.0
            }
        };
        let left = |columns: &Columns| {
            let each = (0..joints.len()).map(|j| left_of(columns, j));
            each.sum::<f64>()
        };
        let given = as_given(joints.len());
        // Also of joints that tell nothing: else a column that fits none would be exchanged with theirs. Where nothing is
        // read, shares are no numbers.
        let share_left = |columns: &Columns| {
            let changed = || (0..joints.len()).filter(|&j| columns[j] != given[j]);
            let of = |columns: &Columns| changed().map(|j| left_of(columns, j)).sum::<f64>();
            of(columns) / of(&given)
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
            .map(|(order, columns)| (left(&columns), order, columns))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, order, columns)) = best.filter(|b| b.0 < left(&by_signs)) {
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Of readings without noise rounding is left, which says nothing of columns.
    #[test]
    fn readings_of_the_arm_alone_are_in_order() {
        let joints = vsf_robots::planar_arm(3, 0.3, 0.03).unwrap();
        let torque = |i: usize, j: usize| (0.37 * i as f64 + j as f64).sin() * 3.7 / (j + 1) as f64;
        let rigid = DMatrix::from_fn(500, 3, torque);
        let mut weighed = Weighed::new(3);
        weighed.add(&rigid, &rigid);
        assert_eq!(
            weighed.warning(joints.joints()).map(|w| w.to_string()),
            None
        );
        // Exchanged columns of readings are still told.
        let mut exchanged = rigid.clone();
        exchanged.swap_columns(0, 2);
        let mut weighed = Weighed::new(3);
        weighed.add(&exchanged, &rigid);
        let told = weighed.warning(joints.joints()).unwrap().to_string();
        assert!(told.contains("(0 %"), "{told}");
    }
}
