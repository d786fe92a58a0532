use crate::{PipelineError, Scene};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use vsf_data::{Sequence, Table, TorqueKind};

/// Replaces the readings of `sequences` by those of the field `stiffness` (N/m per rest point),
/// with independent noise of `noise_sd` per channel, seeded: same seed, same bits.
///
/// Torques are external; for a scene of measured torques they are `g(q) - tau_ext`.
///
/// # Errors
/// A field of another size, stiffness that is negative or not finite, a noise that is negative
/// or not finite, rows that contact cannot take.
pub fn simulate(
    scene: &Scene,
    stiffness: &[f64],
    sequences: &[Sequence],
    noise_sd: f64,
    seed: u64,
) -> Result<Vec<Sequence>, PipelineError> {
    if stiffness.len() != scene.rest.len() {
        return Err(PipelineError::FieldSize {
            field: stiffness.len(),
            recording: scene.rest.len(),
        });
    }
    vsf_core::CoreError::check_finite("stiffness", stiffness)?;
    let range = |name, value: f64| vsf_core::CoreError::Parameter {
        name,
        value,
        range: ">= 0",
    };
    if let Some(&k) = stiffness.iter().find(|k| **k < 0.0) {
        return Err(range("stiffness", k).into());
    }
    let noise = Normal::new(0.0, noise_sd).ok().filter(|_| noise_sd >= 0.0);
    let noise = noise.ok_or(range("noise sd", noise_sd))?;
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut workspace = scene.robot.dynamics_workspace();
    let mut simulated = Vec::with_capacity(sequences.len());
    for sequence in sequences {
        let trace = scene.trace(sequence)?;
        let mut torques = Vec::with_capacity(sequence.torques.data().len());
        let mut tau = vec![0.0; scene.robot.joint_count()];
        for (obs, q) in trace.observations.iter().zip(sequence.angles.iter()) {
            obs.apply(stiffness, &mut tau);
            if scene.torque_kind == TorqueKind::Measured {
                let gravity = scene
                    .robot
                    .gravity_torques(q, &scene.gravity, &mut workspace)?;
                tau.iter_mut().zip(gravity).for_each(|(t, g)| *t = g - *t);
            }
            torques.extend(tau.iter().map(|t| t + noise.sample(&mut rng)));
        }
        simulated.push(Sequence {
            torques: Table::new(scene.robot.joint_count(), torques)?,
            ..sequence.clone()
        });
    }
    Ok(simulated)
}
