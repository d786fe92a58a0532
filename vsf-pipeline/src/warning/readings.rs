use super::joints::InAir;
use super::springs::springs;
use super::{
    PipelineWarning, actuators, air, arm, conventions, gravity, lag, lost, malformed, misread,
    motion_warnings, scale, sensors, spikes, tare, uncovered,
};
use crate::readings::check_sequence;
use crate::{Scene, Trace, derivatives_of, rigid_body_torques};
use vsf_core::CoreError;
use vsf_data::{Derivatives, Sequence, Table};

/// The finest joint torque sensors resolve a thousand times this (N m or N).
const LEAST_READING: f64 = 1e-6;

/// Checks the readings. `traces` are those of `sequences`, in their order.
///
/// Reports torques of another unit, of the other sign, in another order, or of another gravity, gravity or
/// offsets left in them, single outliers, sensors that are stuck, dead, frozen or saturated, and tare
/// samples that are not at rest. If all readings are zero, as for planned motions, only what does not
/// depend on them is reported. If [`Sequence::check`] refuses a sequence, if it has other joints than the
/// robot, or if [`Trace::check`] refuses a trace, only that is reported.
pub fn reading_warnings(
    scene: &Scene,
    sequences: &[&Sequence],
    traces: &[Trace],
) -> Vec<PipelineWarning> {
    let (points, channels) = (scene.rest().len(), scene.robot().joint_count());
    let of_sequence = |(k, s): (usize, &&Sequence)| {
        let observed = traces.get(k).map_or(0, |t| t.observations.len());
        let paired = CoreError::check_len("trace", observed, s.len());
        let checked = check_sequence(scene.robot(), s);
        (s.id.clone(), checked.and(paired.map_err(Into::into)))
    };
    let of_trace = |t: &Trace| (t.id.clone(), t.check(points, channels));
    let checked = sequences.iter().enumerate().map(of_sequence);
    let checked = checked.chain(traces.iter().map(of_trace));
    let malformed = malformed(checked);
    if !malformed.is_empty() {
        return malformed;
    }
    let motions: Vec<Option<Derivatives>> = (sequences.iter())
        .map(|s| derivatives_of(scene.robot(), s).ok())
        .collect();
    // Angles that traces were made of can be taken.
    let pairs = sequences.iter().zip(&motions);
    let rigid = pairs.map(|(s, motion)| rigid(scene, s, motion.as_ref()));
    let rigid: Option<Vec<Table>> = rigid.collect();
    let rigid = rigid.unwrap_or_default();
    let mut warnings = arm::warnings(scene, sequences, &rigid);
    warnings.extend(tare::warnings(scene, traces));
    let readings = sequences.iter().flat_map(|s| s.torques.data());
    let largest = readings.fold(0.0, |largest: f64, v| largest.max(v.abs()));
    // Of planned motions, and of motors that are off.
    if largest == 0.0 {
        return warnings;
    }
    if largest < LEAST_READING {
        let unit = scene.error_unit();
        warnings.push(PipelineWarning::TinyReadings { largest, unit });
        return warnings;
    }
    let springs = springs(traces);
    let spike = spikes::warning(scene, sequences, traces);
    let mut sensors = sensors::warnings(scene, sequences, traces, &springs);
    let lost = lost::zeros(sequences);
    // Readings that come late stay at their largest while the touch goes on, as those of a saturated sensor do.
    let at_end = |w: &PipelineWarning| matches!(w, PipelineWarning::SaturatedReadings { .. });
    let late = if spike.is_none() && lost.is_none() && sensors.iter().all(at_end) {
        lag::warning(traces, &springs)
    } else {
        None
    };
    if late.is_some() {
        sensors.clear();
    }
    let is_sick = spike.is_some() || lost.is_some() || !sensors.is_empty();
    warnings.extend(spike.into_iter().chain(lost));
    warnings.extend(lost::repeated(sequences));
    let told = |w: &PipelineWarning| {
        use PipelineWarning::{StuckReadings, ZeroReadings};
        matches!(w, StuckReadings { .. } | ZeroReadings { .. })
    };
    if !sensors.iter().any(told) {
        warnings.extend(actuators::warning(scene, sequences, &rigid));
    }
    warnings.extend(sensors);
    // Gravity that is left, and other offsets, may turn readings round; without one joint's, columns mean little.
    let gravity = gravity::warning(scene, sequences, &motions, &rigid, traces);
    let rigid = tared(scene, rigid).unwrap_or_default();
    let well = |of: &dyn Fn() -> Option<PipelineWarning>| if is_sick { None } else { of() };
    let all = well(&|| misread::all(scene, &rigid, traces));
    let (first, second) = misread::less_left(all, gravity);
    let air = InAir::new(scene, sequences, &motions, traces);
    let other_order = || air.as_ref()?.other_order();
    let unexplained = || air.as_ref()?.unexplained();
    let of_arm = || {
        first
            .or_else(|| misread::gravity_left(scene, &rigid, traces))
            .or(second)
            .or_else(|| well(&other_order))
            .or_else(|| well(&|| misread::one(scene, &rigid, traces)))
            .or_else(|| well(&unexplained))
    };
    // What the arm itself needs is not known with angles or velocities of another unit.
    use PipelineWarning::{Degrees, Velocities};
    let moves_oddly = || {
        let mut motions = motion_warnings(scene.robot(), sequences).into_iter();
        motions.any(|w| matches!(w, Degrees(_) | Velocities { .. }))
    };
    // What comes late is read where nothing is touched any more, and against where it pushes.
    let is_timely = late.is_none();
    let of_readings = || air::not_tared(scene, traces).or_else(|| air::felt_in_air(scene, traces));
    let in_air = of_arm()
        .filter(|_| !moves_oddly())
        .or_else(|| if is_timely { of_readings() } else { None });
    let is_well = !is_sick && is_timely && in_air.is_none();
    warnings.extend(late.into_iter().chain(in_air));
    if is_well {
        // Points that are missing turn columns round.
        let in_contact = uncovered::warning(scene, traces)
            .or_else(|| scale::warning(traces, &springs))
            .or_else(|| conventions::warning(scene, traces, &springs));
        warnings.extend(in_contact);
    }
    warnings
}

/// The torques of the arm alone; where its motion is not known, its weight, which is nearly all.
fn rigid(scene: &Scene, sequence: &Sequence, motion: Option<&Derivatives>) -> Option<Table> {
    let torques = |motion: &Derivatives| {
        rigid_body_torques(scene.robot(), &scene.gravity(), sequence, motion).ok()
    };
    let Some(motion) = motion else {
        let mut still = sequence.angles.clone();
        still.data_mut().fill(0.0);
        return torques(&Derivatives {
            velocities: still.clone(),
            accelerations: still,
        });
    };
    torques(motion)
}

/// Torques of the arm alone, tared as readings are; `None` of sequences with too few samples.
fn tared(scene: &Scene, rigid: Vec<Table>) -> Option<Vec<Table>> {
    match scene.tare_samples() {
        0 => Some(rigid),
        samples => rigid
            .iter()
            .map(|r| vsf_data::tare(r, samples).ok())
            .collect(),
    }
}
