//! Checks the samples that tare the readings: they should be at rest and in free air.

use super::{PipelineWarning, energy};
use crate::{Scene, Trace};

/// Tare samples that spread by more than this share of the touch itself are no rest.
const MOST_SPREAD: f64 = 0.25;

/// Reports what looks wrong with them: for each kind the first sequence, and how many others there are.
pub fn warnings(scene: &Scene, traces: &[Trace]) -> Vec<PipelineWarning> {
    [in_contact, spread]
        .into_iter()
        .filter_map(|of| {
            let mut found = traces.iter().filter_map(|t| of(scene, t));
            let first = found.next();
            first.map(|w| w.and_others(found.count()))
        })
        .collect()
}

fn in_contact(scene: &Scene, trace: &Trace) -> Option<PipelineWarning> {
    let tare_samples = scene.tare_samples();
    let tare = trace.observations.iter().take(tare_samples);
    let mut touching = tare.enumerate().filter(|(_, o)| !o.is_empty());
    let (row, _) = touching.next()?;
    Some(PipelineWarning::TareInContact {
        sequence: trace.id.clone(),
        count: 1 + touching.count(),
        tare_samples,
        row,
        others: 0,
    })
}

fn spread(scene: &Scene, trace: &Trace) -> Option<PipelineWarning> {
    // Readings are tared: their mean over these samples is zero.
    let rms = |squares: f64, count: usize| (squares / count.max(1) as f64).sqrt();
    let tare = || trace.observations.iter().take(scene.tare_samples());
    let touch = || trace.observations.iter().filter(|o| !o.is_empty());
    let spread = rms(tare().map(energy).sum(), tare().count());
    let touch = rms(touch().map(energy).sum(), touch().count());
    (touch > 0.0 && spread > MOST_SPREAD * touch).then(|| PipelineWarning::TareSpread {
        sequence: trace.id.clone(),
        spread,
        touch,
        unit: scene.error_unit(),
        others: 0,
    })
}
