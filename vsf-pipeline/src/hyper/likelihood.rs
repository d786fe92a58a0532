use super::{Candidate, HyperChoice, POWERS, PriorShape, Problem};
use crate::PipelineError;
use vsf_filter::BatchMap;

/// Chooses prior and noise by [`super::HyperMethod::Likelihood`].
pub fn choose(problem: &Problem, shapes: &[PriorShape]) -> Result<HyperChoice, PipelineError> {
    let readings = problem.touches.iter().map(|t| t.observations.as_slice());
    let batch = BatchMap::new(problem.rest.len(), readings)?;
    let mut tried = Vec::new();
    let mut best: Option<((PriorShape, f64), f64, f64)> = None;
    let ratios = |shape: &PriorShape| POWERS.map(|power| (*shape, power));
    for candidate in shapes.iter().flat_map(ratios) {
        let (scale, log_evidence) = batch.best_scale(&problem.prior(&candidate)?, 1.0)?;
        let (shape, power) = candidate;
        tried.push(Candidate {
            shape,
            signal_to_noise: problem.signal_to_noise(power),
            error: None,
            log_evidence: Some(log_evidence),
        });
        if best.is_none_or(|(_, _, greatest)| log_evidence > greatest) {
            best = Some((candidate, scale, log_evidence));
        }
    }
    let (chosen, scale, _) = best.ok_or(PipelineError::NoContact {
        what: "train",
        points: problem.rest.len(),
        nearest: None,
    })?;
    Ok(HyperChoice {
        hyper: problem.hyper(chosen, scale),
        candidates: tried,
    })
}
