//! Touches that are felt where the object has no points: whole sequences, and parts of them.

use super::PipelineWarning;
use crate::{Scene, Trace};
use vsf_core::{Observation, median};
use vsf_data::TorqueKind;

/// Fewest samples of a sequence that tell.
const LEAST: usize = 16;
/// Share of what touches change readings by from which on readings are as of touches.
const ALIKE: f64 = 0.3;
/// Share of samples that are farther from the median than what a sequence changes by.
const FAR: f64 = 0.05;

/// Share of the energy of what touches change readings by that samples without contact hold at most.
const MOST_OUTSIDE: f64 = 0.05;

pub fn warning(scene: &Scene, traces: &[Trace]) -> Option<PipelineWarning> {
    sequences(scene, traces).or_else(|| parts(traces))
}

/// Sequences that touch no points, though they feel as much as those that do. Of readings of the environment alone: friction
/// of joints changes those of actuators as touches do.
fn sequences(scene: &Scene, traces: &[Trace]) -> Option<PipelineWarning> {
    if scene.torque_kind() != TorqueKind::External {
        return None;
    }
    let changes = |touches: bool| {
        let of = traces
            .iter()
            .filter(move |t| (t.contact_samples() > 0) == touches && t.observations.len() >= LEAST);
        of.filter_map(|t| Some((t, change(t)?)))
    };
    let touch = median(changes(true).map(|(_, c)| c).collect())?;
    let mut alike = changes(false).filter(|(_, c)| *c > ALIKE * touch && touch > 0.0);
    let (first, change) = alike.next()?;
    Some(PipelineWarning::NothingTouched {
        sequence: first.id.clone(),
        others: alike.count(),
        change,
        touch,
        unit: scene.error_unit(),
    })
}

/// Parts of touches that are felt where no points are.
fn parts(traces: &[Trace]) -> Option<PipelineWarning> {
    let of_trace = |t| Some((t, energies(t)?));
    let found: Vec<(&Trace, [f64; 2])> = traces.iter().filter_map(of_trace).collect();
    let sum = |of: usize| found.iter().map(|(_, energy)| energy[of]).sum::<f64>();
    let share = |[outside, inside]: [f64; 2]| outside / (outside + inside);
    let all = share([sum(0), sum(1)]);
    if all.is_nan() || all <= MOST_OUTSIDE {
        return None;
    }
    let most = found
        .iter()
        .max_by(|(_, a), (_, b)| a[0].total_cmp(&b[0]))?;
    Some(PipelineWarning::FeltOutside {
        share: all,
        sequence: most.0.id.clone(),
        of_sequence: share(most.1),
    })
}

/// Energy of the readings of a sequence that touches, about their median in the air and beyond their noise: of samples without
/// contact, and with.
fn energies(trace: &Trace) -> Option<[f64; 2]> {
    let free = || trace.observations.iter().filter(|o| o.is_empty());
    if free().count() < LEAST || trace.contact_samples() < LEAST {
        return None;
    }
    let zero = middle(free().map(Observation::reading))?;
    // What changes from one sample to the next is noise, twice, but where a touch begins.
    let pairs = trace.observations.windows(2);
    let steps = pairs.filter(|pair| pair.iter().all(Observation::is_empty));
    let steps = steps.map(|pair| square(pair[0].reading(), pair[1].reading()));
    let noise = median(steps.collect())? / 2.0;
    let energy = |touches: bool| {
        let of = trace.observations.iter();
        let of = of.filter(|o| o.is_empty() != touches);
        let beyond = of.map(|o| square(o.reading(), &zero) - noise);
        beyond.sum::<f64>().max(0.0)
    };
    Some([energy(false), energy(true)])
}

/// How far the readings of a sequence get from their median, all joints together, but for a few samples.
fn change(trace: &Trace) -> Option<f64> {
    let middle = middle(trace.observations.iter().map(Observation::reading))?;
    let norm = |r: &[f64]| square(r, &middle).sqrt();
    let mut norms: Vec<f64> = trace.readings().map(norm).collect();
    norms.sort_by(f64::total_cmp);
    let few = (FAR * norms.len() as f64).ceil() as usize;
    norms.iter().rev().nth(few).copied()
}

/// The median of every joint.
fn middle<'a>(readings: impl Iterator<Item = &'a [f64]> + Clone) -> Option<Vec<f64>> {
    let joints = 0..readings.clone().next()?.len();
    let of_joint = |j: usize| median(readings.clone().map(|r| r[j]).collect());
    joints.map(of_joint).collect()
}

/// Square of the distance of two readings.
fn square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}
