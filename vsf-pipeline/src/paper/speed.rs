use super::Spread;
use crate::{Experiment, PipelineError, Scene, SceneContact, external_torques};
use serde::Serialize;
use std::time::Instant;
use vsf_core::{Belief, Noise, Session};
use vsf_data::Sequence;
use vsf_filter::{DiagonalKalman, MemoryReplay, ReplayConfig};
use vsf_robots::JointTorques;

/// Speed of the online estimation on the train sequences (a row of Table II): kinematics, contact, columns
/// and update with 20 replays, in `f32`, on one thread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct UpdateSpeed {
    /// Number of contacts, over the samples in contact.
    pub contacts: Spread,
    /// Updates per second, over the sequences with contact: the number of samples in contact of a sequence
    /// divided by the time they take.
    pub rate_hz: Spread,
}

/// Times the online estimation on the train sequences of an experiment.
///
/// # Errors
/// Train sequences that touch nothing, or rows that robot, contact or filter cannot take.
pub fn update_speed(experiment: &Experiment) -> Result<UpdateSpeed, PipelineError> {
    let scene = experiment.scene();
    // Their values make no difference to the time.
    let prior = Belief::<f32>::uniform(scene.rest().len(), 0.0, 0.1)?;
    let noise = Noise::uniform(scene.robot().joint_count(), 1.0)?;
    let mut session = Session::new(
        scene.robot().chains().clone(),
        scene.rest().clone(),
        scene.contact_model()?,
        JointTorques::new(noise),
        MemoryReplay::new(DiagonalKalman::new(prior), ReplayConfig::default())?,
    )?;
    let mut in_contact: Vec<Vec<Step>> = Vec::new();
    for sequence in &experiment.train {
        session.begin_sequence();
        let mut steps = run(scene, sequence, &mut session)?;
        steps.retain(|s| s.contacts > 0);
        in_contact.push(steps);
    }
    let contacts = in_contact.iter().flatten().map(|s| s.contacts as f64);
    Ok(UpdateSpeed {
        contacts: Spread::of(contacts),
        rate_hz: Spread::of(in_contact.iter().filter_map(|s| rate(s))),
    })
}

/// Steps a second; `None` without any.
fn rate(steps: &[Step]) -> Option<f64> {
    let seconds: f64 = steps.iter().map(|s| s.seconds).sum();
    (!steps.is_empty()).then(|| steps.len() as f64 / seconds.max(1e-9))
}

struct Step {
    contacts: usize,
    seconds: f64,
}

type Online = Session<SceneContact, JointTorques, MemoryReplay<DiagonalKalman<f32>>>;

fn run(
    scene: &Scene,
    sequence: &Sequence,
    session: &mut Online,
) -> Result<Vec<Step>, PipelineError> {
    let mut steps = Vec::new();
    let torques = external_torques(scene, sequence)?;
    let mut posture = scene.robot().posture();
    for touch in sequence.touches() {
        session.begin_touch();
        for row in touch {
            let clock = Instant::now();
            let q = &sequence.angles[row];
            scene.robot().update_posture(q, &mut posture)?;
            let step = session.step(&posture, &torques[row]);
            let seconds = clock.elapsed().as_secs_f64();
            let report = step.map_err(|source| PipelineError::Sequence {
                id: sequence.id.clone(),
                row,
                source,
            })?;
            steps.push(Step {
                contacts: report.contacts,
                seconds,
            });
        }
    }
    Ok(steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One step of 1 ms and one of 99 ms are 20 a second, not the 505 that the mean of their rates is.
    #[test]
    fn long_steps_count_by_their_length() {
        let step = |seconds| Step {
            contacts: 1,
            seconds,
        };
        assert_eq!(rate(&[step(0.001), step(0.099)]), Some(20.0));
        assert_eq!(rate(&[]), None);
    }
}
