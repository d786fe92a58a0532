use crate::{PipelineError, Scene, Spread, external_torques, unwound};
use nalgebra::DMatrix;
use std::ops::Range;
use vsf_core::CoreError;
use vsf_data::Sequence;
use vsf_robots::RobotModel;
use vsf_vision::Features;

/// Training data of a baseline: the train samples, one sequence after the other.
pub struct Known {
    /// One row per sample.
    pub features: Features,
    /// One column per sample, one row per joint.
    pub torques: DMatrix<f64>,
    /// Sample ranges of the touches, in order.
    pub touches: Vec<Range<usize>>,
    /// Which of `(q, r, k)` are features.
    chosen: Vec<bool>,
}

/// Features with less than this share of the greatest deviation are left out.
const LEAST_DEVIATION: f64 = 0.01;

impl Known {
    pub fn new(scene: &Scene, train: &[&Sequence]) -> Result<Self, PipelineError> {
        if train.is_empty() {
            return Err(PipelineError::NoSequences {
                what: "train",
                hint: "a baseline needs some to learn from",
            });
        }
        let mut readings = Vec::new();
        let mut touches = Vec::new();
        let mut start = 0;
        for sequence in train {
            readings.extend_from_slice(external_torques(scene, sequence)?.data());
            touches.extend(sequence.touches().map(|t| start + t.start..start + t.end));
            start += sequence.len();
        }
        let joints = scene.robot().joint_count();
        CoreError::check_len("train readings", readings.len(), joints * start)?;
        let columns = columns(scene.robot(), train)?;
        let deviations: Vec<f64> = (columns.iter())
            .map(|c| Spread::of(c.iter().copied()).sd)
            .collect();
        let greatest = deviations.iter().copied().fold(0.0, f64::max);
        let moves = |sd: &f64| *sd >= LEAST_DEVIATION * greatest;
        let chosen: Vec<bool> = deviations.iter().map(moves).collect();
        Ok(Self {
            features: table(&columns, &chosen)?,
            torques: DMatrix::from_vec(joints, start, readings),
            touches,
            chosen,
        })
    }

    /// The same features of other samples.
    pub fn features_of(
        &self,
        robot: &RobotModel,
        sequences: &[&Sequence],
    ) -> Result<Features, PipelineError> {
        table(&columns(robot, sequences)?, &self.chosen)
    }
}

fn table(columns: &[Vec<f64>], chosen: &[bool]) -> Result<Features, PipelineError> {
    let mut features = Features::new(columns.first().map_or(0, Vec::len));
    for (k, column) in columns.iter().enumerate().filter(|(k, _)| chosen[*k]) {
        features = features.with_column(&format!("column {} of (q, r, k)", k + 1), column)?;
    }
    Ok(features)
}

/// The features of the paper's baselines (section IV-C), `(q, r, k)`, of every sample: a column per
/// joint position, then place and axis of the end effector. See [`super::Baseline`]. Continuous
/// joints go on over the end of a turn; the turn in which a sequence begins is the recording's.
fn columns(robot: &RobotModel, sequences: &[&Sequence]) -> Result<Vec<Vec<f64>>, PipelineError> {
    let hand = robot.end_effector();
    let wrist = robot.last_joint().unwrap_or(0);
    let mut posture = robot.posture();
    let mut columns = vec![Vec::new(); robot.joint_count() + 6];
    for sequence in sequences {
        let sequence = unwound(robot, sequence);
        for (row, q) in sequence.angles.iter().enumerate() {
            let placed = robot.update_posture(q, &mut posture);
            placed.map_err(|source| PipelineError::Sequence {
                id: sequence.id.clone(),
                row,
                source,
            })?;
            let place = &posture.link_poses()[hand].translation.vector;
            let screw = &posture.screws()[wrist];
            let slides = screw.angular.norm_squared() == 0.0;
            let axis = if slides {
                &screw.linear
            } else {
                &screw.angular
            };
            let numbers = q.iter().chain(place.iter()).chain(axis.iter());
            columns
                .iter_mut()
                .zip(numbers)
                .for_each(|(c, v)| c.push(*v));
        }
    }
    Ok(columns)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;
    use vsf_data::Table;
    use vsf_robots::{cartesian_stage, kinova_gen3};

    fn at(rows: &[&[f64]]) -> Sequence {
        let table = Table::new(rows[0].len(), rows.concat()).unwrap();
        let time = (0..rows.len()).map(|i| i as f64).collect();
        Sequence::new("0", time, table.clone(), table)
    }

    fn rows(robot: &RobotModel, sequence: &Sequence) -> Vec<Vec<f64>> {
        let columns = columns(robot, &[sequence]).unwrap();
        let row = |i: usize| columns.iter().map(|c| c[i]).collect();
        (0..sequence.len()).map(row).collect()
    }

    /// Upright, the Gen3's hand is 1.187 m above the base (its user guide) and its axis vertical;
    /// the second joint at 90 degrees lays arm and axis flat.
    #[test]
    fn hand_of_a_gen3() {
        let robot = kinova_gen3().unwrap();
        let bent = [0.0, FRAC_PI_2, 0.0, 0.0, 0.0, 0.0, 0.0];
        let found = rows(&robot, &at(&[&[0.0; 7], &bent]));
        let (upright, flat) = (&found[0], &found[1]);
        assert_eq!(upright.len(), 13);
        assert!((upright[9] - 1.187).abs() < 2e-3, "{upright:?}");
        assert!((upright[12].abs() - 1.0).abs() < 1e-9, "{upright:?}");
        assert_eq!(&flat[..7], &bent);
        assert!((flat[7].abs() - (1.187 - 0.2848)).abs() < 2e-3, "{flat:?}");
        assert!((flat[10].abs() - 1.0).abs() < 1e-9, "{flat:?}");
    }

    /// Encoders of joints that turn on begin anew after a turn: the arm has moved by 0.02 rad.
    #[test]
    fn ends_of_a_turn_are_no_jumps() {
        let robot = kinova_gen3().unwrap();
        let turned = |q: f64| [q, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let found = rows(&robot, &at(&[&turned(3.13), &turned(-3.133_185)]));
        assert!((found[1][0] - 3.15).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn axis_of_a_slide() {
        let robot = cartesian_stage(0.01).unwrap();
        let found = rows(&robot, &at(&[&[0.01, 0.02, 0.03]]));
        let axis: f64 = found[0][6..].iter().map(|v| v * v).sum();
        assert!((axis - 1.0).abs() < 1e-12);
    }
}
