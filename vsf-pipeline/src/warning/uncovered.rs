//! Sequences of an object that touch none of its points, though they feel as much as those that do.

use super::PipelineWarning;
use crate::{Scene, Trace};
use vsf_core::median;
use vsf_data::TorqueKind;

/// Fewest samples of a sequence that tell.
const LEAST: usize = 16;
/// Share of what touches change readings by from which on readings are as of touches.
const ALIKE: f64 = 0.3;
/// Share of samples that are farther from the median than what a sequence changes by.
const FAR: f64 = 0.05;

/// Where readings are those of the environment: friction of joints changes those of actuators as touches do.
pub fn warning(scene: &Scene, traces: &[Trace]) -> Option<PipelineWarning> {
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

/// How far the readings of a sequence get from their median, all joints together, but for a few samples.
fn change(trace: &Trace) -> Option<f64> {
    let joints = trace.observations.first()?.dim();
    let medians: Vec<f64> = (0..joints)
        .map(|j| median(trace.readings().map(|r| r[j]).collect()))
        .collect::<Option<_>>()?;
    let norm = |r: &[f64]| {
        let beyond = r.iter().zip(&medians).map(|(r, m)| (r - m).powi(2));
        beyond.sum::<f64>().sqrt()
    };
    let mut norms: Vec<f64> = trace.readings().map(norm).collect();
    norms.sort_by(f64::total_cmp);
    let few = (FAR * norms.len() as f64).ceil() as usize;
    norms.iter().rev().nth(few).copied()
}
