use crate::{PipelineError, Scene};
use std::fmt;
use vsf_data::Sequence;

/// At most so many rows, and so many points, are looked at.
const ROWS: usize = 100;
const POINTS: usize = 2000;

/// Where a robot comes nearest to the rest points.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Approach {
    /// Name of the link.
    pub link: String,
    /// How far its surface is from the nearest point (m).
    pub distance: f64,
    /// The sequence.
    pub sequence: String,
    /// Its row, from 0.
    pub row: usize,
}

impl fmt::Display for Approach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            link,
            distance,
            sequence,
            row,
        } = self;
        write!(
            f,
            "its link {link:?} comes as near as some {distance:.3} m, in sequence {sequence} row {row}"
        )
    }
}

impl Approach {
    /// Among some rows of the sequences and some of the rest points, evenly spread; `None` without any, or without shapes.
    ///
    /// # Errors
    /// Sequences with other joints than the robot's.
    pub fn nearest(scene: &Scene, sequences: &[&Sequence]) -> Result<Option<Self>, PipelineError> {
        let positions = scene.rest().positions();
        let rows: usize = sequences.iter().map(|s| s.len()).sum();
        let every = |count: usize, most: usize| count.div_ceil(most).max(1);
        let (every_row, every_point) = (every(rows, ROWS), every(positions.len(), POINTS));
        let mut posture = scene.robot().posture();
        let mut nearest: Option<Self> = None;
        for sequence in sequences {
            for row in (0..sequence.len()).step_by(every_row) {
                scene
                    .robot()
                    .update_posture(&sequence.angles[row], &mut posture)?;
                for shape in scene.link_shapes() {
                    let X_WL = &posture.link_poses()[shape.link];
                    let distance = (positions.iter().step_by(every_point))
                        .map(|p_W| shape.sdf.distance(&X_WL.inverse_transform_point(p_W)))
                        .fold(f64::INFINITY, f64::min);
                    if nearest
                        .as_ref()
                        .map_or(distance.is_finite(), |n| distance < n.distance)
                    {
                        nearest = Some(Self {
                            link: scene.robot().links()[shape.link].name().to_owned(),
                            distance,
                            sequence: sequence.id.clone(),
                            row,
                        });
                    }
                }
            }
        }
        Ok(nearest)
    }
}
