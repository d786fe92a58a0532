use super::{PipelineWarning, malformed};
use crate::Trace;
use vsf_core::{Belief, FilterHealth, Observation};

/// NIS per channel beyond which a filter knows nothing of its errors: diagonal filters reach 3 on good data.
const MOST_NIS: f64 = 30.0;
/// Share of the energy of the readings in contact below which a field explains nothing of them.
const LEAST_EXPLAINED: f64 = 0.02;
/// Share of the mean energy of sequences, of readings in contact, that one has at least to be judged on its own.
const LEAST_ENERGY: f64 = 0.1;

/// Checks an online estimation: reports errors far beyond those it expects.
pub fn health_warnings(health: &FilterHealth) -> Vec<PipelineWarning> {
    let ratio = health.nis_ratio().filter(|ratio| *ratio > MOST_NIS);
    let warning = |ratio| PipelineWarning::Overconfident { ratio };
    ratio.map(warning).into_iter().collect()
}

/// Checks a field that was fitted to all readings at once: reports errors far beyond their noise.
///
/// `traces` are those that the field was learned from. If [`Trace::check`] refuses one, only that is
/// reported.
pub fn fit_warnings(
    field: &Belief<f64>,
    noise_sd: &[f64],
    traces: &[Trace],
) -> Vec<PipelineWarning> {
    let of_trace = |t: &Trace| (t.id.clone(), t.check(field.len(), noise_sd.len()));
    let malformed = malformed(traces.iter().map(of_trace));
    if !malformed.is_empty() {
        return malformed;
    }
    let (mut squares, mut count) = (0.0, 0);
    in_contact(field, traces, |reading, predicted| {
        let errors = reading.iter().zip(predicted).zip(noise_sd);
        squares += errors
            .map(|((y, p), sd)| ((y - p) / sd).powi(2))
            .sum::<f64>();
        count += reading.len();
    });
    let ratio = squares / count.max(1) as f64;
    let misfit = (ratio > MOST_NIS).then_some(PipelineWarning::Misfit { ratio });
    misfit.into_iter().collect()
}

/// Checks any estimate: reports a field that explains none of the readings it was learned from, or none of
/// some sequences.
///
/// `traces` are those that the field was learned from. If [`Trace::check`] refuses one, only that is
/// reported.
pub fn field_warnings(field: &Belief<f64>, traces: &[Trace]) -> Vec<PipelineWarning> {
    let first = traces.iter().find_map(|t| t.observations.first());
    let channels = first.map_or(0, Observation::dim);
    let of_trace = |t: &Trace| (t.id.clone(), t.check(field.len(), channels));
    let malformed = malformed(traces.iter().map(of_trace));
    if !malformed.is_empty() {
        return malformed;
    }
    // What is left of each, and what it reads.
    let of_trace = |trace: &Trace| {
        let (mut left, mut all) = (0.0, 0.0);
        in_contact(field, std::slice::from_ref(trace), |reading, predicted| {
            let pairs = reading.iter().zip(predicted);
            left += pairs.map(|(y, p)| (y - p).powi(2)).sum::<f64>();
            all += reading.iter().map(|y| y * y).sum::<f64>();
        });
        (left, all)
    };
    let sums: Vec<(f64, f64)> = traces.iter().map(of_trace).collect();
    let total: f64 = sums.iter().map(|(_, all)| all).sum();
    let share = 1.0 - sums.iter().map(|(left, _)| left).sum::<f64>() / total;
    if share < LEAST_EXPLAINED {
        return vec![PipelineWarning::ExplainsNothing { share }];
    }
    let count = sums.iter().filter(|(_, all)| *all > 0.0).count() as f64;
    let judged = traces.iter().zip(&sums).filter_map(|(trace, (left, all))| {
        let share = 1.0 - left / all;
        (share < LEAST_EXPLAINED && *all * count >= LEAST_ENERGY * total).then_some((trace, share))
    });
    let missed: Vec<(&Trace, f64)> = judged.collect();
    let warning = missed
        .first()
        .map(|(trace, share)| PipelineWarning::ExplainsNothingOf {
            sequence: trace.id.clone(),
            share: *share,
            others: missed.len() - 1,
        });
    warning.into_iter().collect()
}

/// Shows `visit` every reading in contact, and what a field predicts of it.
fn in_contact(field: &Belief<f64>, traces: &[Trace], mut visit: impl FnMut(&[f64], &[f64])) {
    let mut predicted = Vec::new();
    let observations = traces.iter().flat_map(|t| &t.observations);
    for obs in observations.filter(|o| !o.is_empty()) {
        predicted.resize(obs.dim(), 0.0);
        obs.apply(field.mean(), &mut predicted);
        visit(obs.reading(), &predicted);
    }
}
