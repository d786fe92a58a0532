use crate::{PipelineError, Scene, motion_of, rigid_body_torques};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use vsf_core::CoreError;
use vsf_data::{Sequence, Table, TorqueKind};

/// Replaces the readings of `sequences` by those of the field `stiffness` (N/m per rest point),
/// with independent noise of `noise_sd` per channel, seeded: same seed, same bits.
///
/// Torques are external; for a scene of measured torques they are what the arm needs to
/// move ([`crate::rigid_body_torques`]) less that.
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
    if stiffness.len() != scene.rest().len() {
        return Err(PipelineError::FieldSize {
            field: stiffness.len(),
            recording: scene.rest().len(),
        });
    }
    CoreError::check_finite("stiffness", stiffness)?;
    if let Some(&k) = stiffness.iter().find(|k| **k < 0.0) {
        return Err(below_zero("stiffness", k).into());
    }
    gaussian(noise_sd)?;
    let mut simulated = Vec::with_capacity(sequences.len());
    for sequence in sequences {
        let trace = scene.trace(sequence)?;
        let mut torques = Vec::with_capacity(sequence.torques.data().len());
        let mut tau = vec![0.0; scene.robot().joint_count()];
        for obs in &trace.observations {
            obs.apply(stiffness, &mut tau);
            torques.extend_from_slice(&tau);
        }
        if scene.torque_kind() == TorqueKind::Measured {
            let motion = motion_of(sequence)?;
            let rigid = rigid_body_torques(scene.robot(), &scene.gravity(), sequence, &motion)?;
            let pairs = torques.iter_mut().zip(rigid.data());
            pairs.for_each(|(tau, r)| *tau = r - *tau);
        }
        simulated.push(Sequence {
            torques: Table::new(scene.robot().joint_count(), torques)?,
            ..sequence.clone()
        });
    }
    add_noise(&mut simulated, noise_sd, seed)?;
    Ok(simulated)
}

/// Adds independent noise of `noise_sd` to every reading, seeded: same seed, same bits.
///
/// # Errors
/// A noise that is negative or not finite; the sequences are then as they were.
pub fn add_noise(
    sequences: &mut [Sequence],
    noise_sd: f64,
    seed: u64,
) -> Result<(), PipelineError> {
    let noise = gaussian(noise_sd)?;
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    for t in sequences.iter_mut().flat_map(|s| s.torques.data_mut()) {
        *t += noise.sample(&mut rng);
    }
    Ok(())
}

fn gaussian(sd: f64) -> Result<Normal<f64>, PipelineError> {
    let noise = Normal::new(0.0, sd).ok().filter(|_| sd >= 0.0);
    Ok(noise.ok_or(below_zero("noise sd", sd))?)
}

fn below_zero(name: &'static str, value: f64) -> CoreError {
    CoreError::Parameter {
        name,
        value,
        range: ">= 0",
    }
}
