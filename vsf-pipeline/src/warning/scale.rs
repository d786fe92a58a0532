//! Compares scale and sign of the readings in contact between sequences, by the single stiffness that
//! explains each sequence best.

use super::PipelineWarning;
use super::springs::{Likeness, Springs};
use crate::Trace;

/// Stiffnesses further apart than this come from units: of places on one soft object they are not.
const MOST_TIMES: f64 = 100.0;
/// Samples in contact, and correlation with the torques of springs, from which on a stiffness tells.
const LEAST_CONTACT: usize = 8;
const ALIKE: f64 = 0.5;

/// Reports the first sequence whose readings in contact have another unit or sign than those of most.
pub fn warning(traces: &[Trace], springs: &[Springs]) -> Option<PipelineWarning> {
    let told: Vec<Told> = traces.iter().zip(springs).filter_map(Told::of).collect();
    let mut by_size: Vec<&Told> = told.iter().collect();
    by_size.sort_by(|a, b| a.stiffness.abs().total_cmp(&b.stiffness.abs()));
    let middle = by_size.get(by_size.len() / 2)?;
    let times = |t: &Told| (t.stiffness / middle.stiffness).abs();
    let is_scaled = |t: &&Told| !(1.0 / MOST_TIMES..=MOST_TIMES).contains(&times(t));
    let mut scaled = told.iter().filter(is_scaled);
    if let Some(first) = scaled.next() {
        return Some(PipelineWarning::ScaledTorques {
            sequence: first.trace.id.clone(),
            factor: times(first),
            than: middle.trace.id.clone(),
            others: scaled.count(),
        });
    }
    let is_opposite = |t: &&Told| t.stiffness < 0.0;
    // Of most sequences it is the sign of all.
    if 2 * told.iter().filter(is_opposite).count() > told.len() {
        return None;
    }
    let opposite = told.iter().find(is_opposite)?;
    let warning = PipelineWarning::OppositeTorques {
        correlation: opposite.correlation,
    };
    Some(warning.in_sequence(&opposite.trace.id))
}

/// A sequence that tells of its scale.
struct Told<'a> {
    trace: &'a Trace,
    /// The one stiffness that explains its readings in contact best (N/m), and their correlation with what that gives.
    stiffness: f64,
    correlation: f64,
}

impl<'a> Told<'a> {
    fn of((trace, springs): (&'a Trace, &Springs)) -> Option<Self> {
        let rows = || trace.observations.iter().zip(springs);
        let touching = || rows().filter(|(o, _)| !o.is_empty());
        let mut likeness = Likeness::default();
        for (observation, springs) in touching() {
            let pairs = observation.reading().iter().zip(springs);
            pairs.for_each(|(reading, spring)| likeness.add(*reading, *spring));
        }
        let correlation = likeness.correlation();
        let tells = touching().count() >= LEAST_CONTACT && correlation.abs() >= ALIKE;
        tells.then_some(Self {
            trace,
            stiffness: likeness.slope(),
            correlation,
        })
    }
}
