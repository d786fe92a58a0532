use crate::{PipelineError, Scene, external_torques};
use nalgebra::{DMatrix, Point3};
use std::ops::Range;
use vsf_core::CoreError;
use vsf_data::Sequence;
use vsf_robots::RobotModel;
use vsf_vision::Features;

/// What a baseline learns from: the train samples, one sequence after the other.
pub struct Known {
    /// One row per sample.
    pub features: Features,
    /// One column per sample, one row per joint.
    pub torques: DMatrix<f64>,
    /// Samples of each touch, in order.
    pub touches: Vec<Range<usize>>,
}

impl Known {
    pub fn new(scene: &Scene, of: &[&Sequence]) -> Result<Self, PipelineError> {
        let mut readings = Vec::new();
        let mut touches = Vec::new();
        let mut start = 0;
        for sequence in of {
            readings.extend_from_slice(external_torques(scene, sequence)?.data());
            touches.extend(sequence.touches().map(|t| start + t.start..start + t.end));
            start += sequence.len();
        }
        let joints = scene.robot.joint_count();
        CoreError::check_len("train readings", readings.len(), joints * start)?;
        Ok(Self {
            features: features(&scene.robot, of)?,
            torques: DMatrix::from_vec(joints, start, readings),
            touches,
        })
    }
}

/// The features of the paper's baselines (section IV-C), `(q, r, k)`, of every sample: joint
/// positions, the place of the end effector and its axis. See [`super::Baseline`].
pub fn features(robot: &RobotModel, sequences: &[&Sequence]) -> Result<Features, PipelineError> {
    let chains = robot.chains();
    // Of several, the last one.
    let hand = (0..robot.link_count()).max_by_key(|&l| chains.chain(l).len());
    let hand = hand.unwrap_or(0);
    let wrist = chains.chain(hand).last().map_or(0, |j| *j as usize);
    let mut posture = robot.posture();
    let mut columns = vec![Vec::new(); robot.joint_count() + 3];
    let mut places = Vec::new();
    for sequence in sequences {
        for (row, q) in sequence.angles.iter().enumerate() {
            let placed = robot.update_posture(q, &mut posture);
            placed.map_err(|e| PipelineError::Sequence {
                id: sequence.id.clone(),
                row,
                source: CoreError::Other(e.to_string()),
            })?;
            let screw = posture.screws()[wrist];
            let slides = screw.angular.norm_squared() == 0.0;
            let axis = if slides { screw.linear } else { screw.angular };
            let numbers = q.iter().chain(axis.iter());
            columns
                .iter_mut()
                .zip(numbers)
                .for_each(|(c, v)| c.push(*v));
            places.push(Point3::from(posture.link_poses()[hand].translation.vector));
        }
    }
    let (positions, axes) = columns.split_at(robot.joint_count());
    let names = robot
        .joints()
        .iter()
        .map(|j| format!("position of {}", j.name()));
    let mut features = Features::new(places.len());
    for (name, column) in names.zip(positions) {
        features = features.with_column(&name, column)?;
    }
    features = features.with_positions(&places)?;
    for (name, column) in ["axis_x", "axis_y", "axis_z"].into_iter().zip(axes) {
        features = features.with_column(name, column)?;
    }
    Ok(features)
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
        Sequence {
            id: "0".to_owned(),
            time: (0..rows.len()).map(|i| i as f64).collect(),
            angles: table.clone(),
            velocities: None,
            torques: table,
            touch_starts: vec![0],
            tags: Vec::new(),
        }
    }

    /// Upright, the Gen3's hand is 1.187 m above the base (its user guide) and its axis vertical;
    /// the second joint at 90 degrees lays arm and axis flat.
    #[test]
    fn hand_of_a_gen3() {
        let robot = kinova_gen3().unwrap();
        let bent = [0.0, FRAC_PI_2, 0.0, 0.0, 0.0, 0.0, 0.0];
        let found = features(&robot, &[&at(&[&[0.0; 7], &bent])]).unwrap();
        assert_eq!(found.width(), 13);
        let (upright, flat) = (found.row(0), found.row(1));
        assert!((upright[9] - 1.187).abs() < 2e-3, "{upright:?}");
        assert!((upright[12].abs() - 1.0).abs() < 1e-9, "{upright:?}");
        assert_eq!(&flat[..7], &bent);
        assert!((flat[7].abs() - (1.187 - 0.2848)).abs() < 2e-3, "{flat:?}");
        assert!((flat[10].abs() - 1.0).abs() < 1e-9, "{flat:?}");
    }

    #[test]
    fn axis_of_a_slide() {
        let robot = cartesian_stage(0.01).unwrap();
        let found = features(&robot, &[&at(&[&[0.01, 0.02, 0.03]])]).unwrap();
        let axis: f64 = found.row(0)[6..].iter().map(|v| v * v).sum();
        assert!((axis - 1.0).abs() < 1e-12);
    }
}
