//! Measures how much of the actuator readings in the air the weight and motion of the arm explain. It is
//! next to nothing if the arm, its masses or the zeros of its joints are wrong. It is far more in another
//! order if positions and torques were exchanged.

use super::PipelineWarning;
use super::air::LEAST_FREE;
use super::order::{Columns, Order, as_given, orders};
use crate::{Scene, Trace};
use vsf_data::{Derivatives, Sequence, TorqueKind};
use vsf_robots::{JointKind, RobotModel};

/// Another order has to leave less than this share of the squares that the given one leaves, which is at least so much of all.
const MOST_LEFT: f64 = 0.25;
const LEAST_LEFT: f64 = 0.2;
/// Share of the squares that the arm explains at least.
const LEAST_EXPLAINED: f64 = 0.2;
/// Samples that are looked at, from all parts of the recording.
const MOST_SAMPLES: usize = 500;

/// A sample in the air.
struct Sample<'a> {
    sequence: usize,
    /// Positions, velocities and accelerations, and what was read.
    rows: [&'a [f64]; 3],
    reading: &'a [f64],
}

/// Squared actuator readings in the air, and what the weight and motion of the arm leave of them.
pub struct InAir<'a> {
    scene: &'a Scene,
    samples: Vec<Sample<'a>>,
}

impl<'a> InAir<'a> {
    /// Computes the squares. `motions` are those of the sequences where known. `None` for readings that are
    /// not of actuators, or too few.
    pub fn new(
        scene: &'a Scene,
        sequences: &'a [&Sequence],
        motions: &'a [Option<Derivatives>],
        traces: &[Trace],
    ) -> Option<Self> {
        if scene.torque_kind() != TorqueKind::Measured || !turns(scene.robot()) {
            return None;
        }
        let mut samples = Vec::new();
        for (k, (sequence, trace)) in sequences.iter().zip(traces).enumerate() {
            let Some(motion) = &motions[k] else { continue };
            let free = (0..sequence.len()).filter(|row| trace.observations[*row].is_empty());
            samples.extend(free.map(|row| Sample {
                sequence: k,
                rows: [
                    &sequence.angles[row],
                    &motion.velocities[row],
                    &motion.accelerations[row],
                ],
                reading: &sequence.torques[row],
            }));
        }
        let every = samples.len().div_ceil(MOST_SAMPLES).max(1);
        let samples: Vec<_> = samples.into_iter().step_by(every).collect();
        (samples.len() >= LEAST_FREE).then_some(Self { scene, samples })
    }

    /// Reports positions or torques of the joints, or both, that explain far more in another order.
    pub fn other_order(&self) -> Option<PipelineWarning> {
        let joints = self.scene.robot().joints();
        let given = as_given(joints.len());
        let own = self.left(&given, &given)?;
        if own < LEAST_LEFT * self.squares() {
            return None;
        }
        let with = |(order, columns): (Order, Columns)| {
            let cases = [
                ("positions and torques", &columns, &columns),
                ("positions", &columns, &given),
                ("torques", &given, &columns),
            ];
            let left = |(of, positions, readings)| Some((of, self.left(positions, readings)?));
            let best = cases.into_iter().filter_map(left);
            let (of, left) = best.min_by(|a, b| a.1.total_cmp(&b.1))?;
            Some((order, of, left))
        };
        let all = orders(joints.len()).filter_map(with);
        let (order, of, left) = all.min_by(|a, b| a.2.total_cmp(&b.2))?;
        (left < MOST_LEFT * own).then(|| PipelineWarning::MixedJoints {
            of,
            order: order.in_words(joints),
            left: left / own,
        })
    }

    /// Reports that weight and motion explain next to nothing.
    pub fn unexplained(&self) -> Option<PipelineWarning> {
        let given = as_given(self.scene.robot().joint_count());
        let explained = 1.0 - self.left(&given, &given)? / self.squares();
        (explained < LEAST_EXPLAINED).then_some(PipelineWarning::UnexplainedArm {
            explained: explained.max(0.0),
        })
    }

    fn squares(&self) -> f64 {
        let readings = self.samples.iter().map(|s| s.reading.to_vec()).collect();
        self.squares_of(readings)
    }

    /// Squares that are left with columns of positions (and their changes), and of readings, as given.
    fn left(&self, positions: &Columns, readings: &Columns) -> Option<f64> {
        let robot = self.scene.robot();
        let mut workspace = robot.dynamics_workspace();
        let mut left = Vec::with_capacity(self.samples.len());
        for sample in &self.samples {
            let [q, qd, qdd] = sample.rows.map(|row| -> Vec<f64> {
                positions.iter().map(|(column, _)| row[*column]).collect()
            });
            let gravity = self.scene.gravity();
            let rigid = robot.inverse_dynamics(&q, &qd, &qdd, &gravity, &mut workspace);
            let read = readings.iter().map(|(column, _)| sample.reading[*column]);
            left.push(
                rigid
                    .ok()?
                    .iter()
                    .zip(read)
                    .map(|(r, tau)| tau - r)
                    .collect(),
            );
        }
        Some(self.squares_of(left))
    }

    /// The sum of squares, about the mean of every sequence where sensors are tared.
    fn squares_of(&self, mut rows: Vec<Vec<f64>>) -> f64 {
        if self.scene.tare_samples() > 0 {
            let sequences = self.samples.chunk_by(|a, b| a.sequence == b.sequence);
            let mut rest = &mut rows[..];
            for samples in sequences {
                let (own, others) = rest.split_at_mut(samples.len());
                for j in 0..self.scene.robot().joint_count() {
                    let mean = own.iter().map(|row| row[j]).sum::<f64>() / own.len() as f64;
                    own.iter_mut().for_each(|row| row[j] -= mean);
                }
                rest = others;
            }
        }
        rows.iter().flatten().map(|v| v * v).sum()
    }
}

/// Whether an arm has to bear weight by turning: rails and stages may bear none.
fn turns(robot: &RobotModel) -> bool {
    (robot.joints().iter()).any(|joint| joint.kind() != JointKind::Prismatic)
}
