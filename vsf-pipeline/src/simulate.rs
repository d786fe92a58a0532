use crate::readings::check_sequence;
use crate::{PipelineError, Scene, Trace, derivatives_of, rigid_body_torques};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use vsf_core::CoreError;
use vsf_data::{Sequence, Table, TorqueKind};

/// Returns the `sequences` with the readings that the field `stiffness` (N/m per rest point) gives, without
/// noise ([`add_noise`]).
///
/// `traces` are the contacts of the sequences ([`Scene::traces`]). Torques are external. For a scene of
/// measured torques they are the torques that the arm needs to move ([`crate::rigid_body_torques`]) minus
/// the external ones.
///
/// # Errors
/// A field of another size, stiffness that is negative or not finite, sequences that [`Sequence::check`]
/// refuses, traces that [`Trace::check`] refuses or whose lengths are not those of the sequences, or
/// measured torques whose velocities and accelerations cannot be determined ([`derivatives_of`]).
pub fn simulate(
    scene: &Scene,
    stiffness: &[f64],
    sequences: &[&Sequence],
    traces: &[Trace],
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
    CoreError::check_len("traces", traces.len(), sequences.len())?;
    let joints = scene.robot().joint_count();
    let mut simulated = Vec::with_capacity(sequences.len());
    for (sequence, trace) in sequences.iter().zip(traces) {
        check_sequence(scene.robot(), sequence)?;
        trace.check(stiffness.len(), joints)?;
        CoreError::check_len("trace", trace.observations.len(), sequence.len())?;
        let mut torques = Vec::with_capacity(sequence.torques.data().len());
        let mut tau = vec![0.0; joints];
        for obs in &trace.observations {
            obs.apply(stiffness, &mut tau);
            torques.extend_from_slice(&tau);
        }
        if scene.torque_kind() == TorqueKind::Measured {
            let derivatives = derivatives_of(scene.robot(), sequence)?;
            let rigid =
                rigid_body_torques(scene.robot(), &scene.gravity(), sequence, &derivatives)?;
            let pairs = torques.iter_mut().zip(rigid.data());
            pairs.for_each(|(tau, r)| *tau = r - *tau);
        }
        simulated.push(Sequence {
            torques: Table::new(joints, torques)?,
            ..(*sequence).clone()
        });
    }
    Ok(simulated)
}

/// Adds independent noise of standard deviation `noise_sd` to every reading. The same seed gives the same
/// bits.
///
/// # Errors
/// A noise that is negative, not finite, or so large that readings are not finite. The sequences are then
/// unchanged.
pub fn add_noise(
    sequences: &mut [Sequence],
    noise_sd: f64,
    seed: u64,
) -> Result<(), PipelineError> {
    let noise = gaussian(noise_sd)?;
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut noisy: Vec<Table> = sequences.iter().map(|s| s.torques.clone()).collect();
    for torques in &mut noisy {
        let readings = torques.data_mut();
        readings
            .iter_mut()
            .for_each(|t| *t += noise.sample(&mut rng));
        CoreError::check_finite("noisy reading", readings)?;
    }
    for (sequence, torques) in sequences.iter_mut().zip(noisy) {
        sequence.torques = torques;
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
