use crate::estimate::{batch_map, run, touched_points};
use crate::evaluate::mean_error;
use crate::trace::{MOST_FOLDS, check_traces, split, touched_alone};
use crate::{Estimate, EstimatorSpec, Hyper, PipelineError, PriorShape, Trace};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;
use vsf_core::{Belief, CoreError, Noise, RestPoints};
use vsf_data::CameraView;
use vsf_filter::FieldPrior;
use vsf_vision::{
    Camera, Extrapolation, LearnedPrior, RegressorSpec, RgbdView, Seen, VisionError, fit_level,
};

/// How the stiffness of points is predicted from a camera image.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub enum VisionSpec {
    /// One stiffness for all that is seen, fading behind the surface, at the level that fits the readings
    /// ([`fit_level`]); the default.
    #[default]
    Level,
    /// Regression of the touched points' stiffness on position and color ([`Extrapolation`], section
    /// III-D).
    Regression(RegressorSpec),
    /// A prior learned from fields of other objects ([`LearnedPrior::stiffness`]). The touches of this
    /// object are not used.
    Learned(Arc<LearnedPrior>),
}

/// A field whose prior was predicted from a camera image and the touches.
#[derive(Debug, Clone)]
pub struct VisionEstimate {
    /// The field. Its prior means are the predicted ones, times `share`.
    pub estimate: Estimate,
    /// Share of the predicted means that the prior adopts, 0 to 1.
    pub share: f64,
    /// Shares that were tried; empty with a single touch.
    pub candidates: Vec<VisionCandidate>,
}

/// One share that was tried.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct VisionCandidate {
    /// Share of the predicted means.
    pub share: f64,
    /// Mean error norm on held-out touches.
    pub error: f64,
}

/// Shares that are tried, and the one that stands without evidence.
const SHARES: [f64; 3] = [0.0, 0.5, 1.0];
const RULE: f64 = 0.5;
/// Least number of points that are touched and seen, to guess the others from.
const LEAST_SEEN: usize = 2;

/// Converts the camera view of a recording.
///
/// # Errors
/// Images or a camera that are invalid.
pub fn rgbd_view(view: &CameraView) -> Result<RgbdView, PipelineError> {
    let camera = Camera {
        fx: view.fx,
        fy: view.fy,
        cx: view.cx,
        cy: view.cy,
        X_WC: view.X_WC,
    };
    let size = (view.width as usize, view.height as usize);
    let depth_scale = view.depth_scale;
    Ok(RgbdView::new(
        camera,
        size,
        &view.color,
        &view.depth,
        depth_scale,
    )?)
}

/// Runs an estimator over sequences, from a prior whose means are predicted for all points, touched or not.
/// The prediction uses one view and these sequences.
///
/// First touches may be unlike the rest of the object (section IV-D). Therefore the prior adopts none, half
/// or all of the predicted means, whichever is best on held-out touches. To find out, the touches are dealt
/// to at most ten parts, and each part is predicted by the constrained optimum of the others. With a single
/// touch the share is half.
///
/// The readings determine first the prediction and then the field. They count twice, the more so the finer
/// the prediction. Held-out touches, which are used in neither, show whether that does harm.
///
/// # Errors
/// As [`estimate`](crate::estimate) and [`Extrapolation::fit`].
pub fn estimate_with_vision(
    rest: &RestPoints,
    view: &RgbdView,
    traces: &[Trace],
    spec: &EstimatorSpec,
    hyper: &Hyper,
    vision: &VisionSpec,
    progress: impl FnMut(usize),
) -> Result<VisionEstimate, PipelineError> {
    check_traces(traces, rest.len(), hyper.noise_sd.len())?;
    let noise = Noise::per_channel(&hyper.noise_sd)?;
    let all: Vec<&Trace> = traces.iter().collect();
    let guess = Guess {
        rest,
        noise: &noise,
        seen: Seen::new(view, rest.positions(), 0.5 * rest.spacing())?,
        hyper,
        vision,
    };
    let seen = guess.touched_and_seen(&all)?;
    if seen < LEAST_SEEN {
        let touched = touched_points(traces, rest.len());
        let touched = touched.iter().filter(|t| **t).count();
        return Err(VisionError::Unseen { touched, seen }.into());
    }
    let candidates = guess.candidates(traces)?;
    let from_rule = |c: &VisionCandidate| (c.share - RULE).abs();
    let best = candidates.iter().min_by(|a, b| {
        let by_error = a.error.total_cmp(&b.error);
        by_error.then(from_rule(a).total_cmp(&from_rule(b)))
    });
    let share = best.map_or(RULE, |c| c.share);
    let prior = guess.prior(&guess.means(&all)?, share)?;
    Ok(VisionEstimate {
        estimate: run(spec, prior, &all, &noise, progress)?,
        share,
        candidates,
    })
}

/// The points and what is seen of them.
struct Guess<'a> {
    rest: &'a RestPoints,
    /// Of all readings.
    noise: &'a Noise,
    seen: Seen,
    hyper: &'a Hyper,
    vision: &'a VisionSpec,
}

impl Guess<'_> {
    /// Stiffness of all points as traces suggest it.
    fn means(&self, traces: &[&Trace]) -> Result<Vec<f64>, PipelineError> {
        match self.vision {
            VisionSpec::Level => {
                let shape = self.seen.occupancy(Extrapolation::FADE)?;
                let observations = traces.iter().flat_map(|t| &t.observations);
                let level = fit_level(&shape, observations, Some(self.noise))?;
                Ok(shape.iter().map(|s| level * s).collect())
            }
            VisionSpec::Learned(learned) => Ok(learned.stiffness(&self.seen)?),
            VisionSpec::Regression(spec) => {
                let sd = self.hyper.prior_sd;
                // Each point speaks for itself: what neighbors share is for the regressor to find.
                let prior = PriorShape::independent().prior(self.rest, sd)?;
                let field = run(&EstimatorSpec::Batch, prior, traces, self.noise, |_| {})?;
                let mut extrapolation = Extrapolation::new(spec.build()?, spec.build()?);
                let points = self.rest.positions();
                let known = (&field.belief, field.touched.as_slice());
                extrapolation.fit(points, &self.seen, known.0, known.1, sd * sd)?;
                let belief: Belief<f64> = extrapolation.predict(points, &self.seen)?;
                Ok(belief.mean().to_vec())
            }
        }
    }

    fn prior(&self, means: &[f64], share: f64) -> Result<FieldPrior, PipelineError> {
        let means = means.iter().map(|m| share * m).collect();
        let Hyper {
            shape, prior_sd, ..
        } = self.hyper;
        shape.prior_about(self.rest, *prior_sd, means)
    }

    /// Errors of all shares on held-out touches; none with a single touch.
    fn candidates(&self, traces: &[Trace]) -> Result<Vec<VisionCandidate>, PipelineError> {
        let (rest, touches) = touched_alone(self.rest, traces, self.noise)?;
        if touches.len() < 2 {
            return Ok(Vec::new());
        }
        let touched = touched_points(traces, self.rest.len());
        let touched: Vec<usize> = (0..touched.len()).filter(|&i| touched[i]).collect();
        // They look as they do among all points.
        let alone = Guess {
            rest: &rest,
            seen: self.seen.select(&touched)?,
            ..*self
        };
        let folds = touches.len().min(MOST_FOLDS);
        let of_fold = |fold| alone.held_out(&touches, fold, folds);
        let errors: Vec<Option<[f64; SHARES.len()]>> = (0..folds)
            .into_par_iter()
            .map(of_fold)
            .collect::<Result<_, PipelineError>>()?;
        let errors: Vec<_> = errors.into_iter().flatten().collect();
        if errors.is_empty() {
            return Ok(Vec::new());
        }
        let mean = |k: usize| errors.iter().map(|e| e[k]).sum::<f64>() / errors.len() as f64;
        let shares = SHARES.iter().enumerate();
        Ok(shares
            .map(|(k, &share)| VisionCandidate {
                share,
                error: mean(k),
            })
            .collect())
    }

    /// Mean error norm for each share on every `folds`-th trace from the `fold`-th on; `None` where
    /// the other traces touch too little of what is seen to guess from.
    fn held_out(
        &self,
        traces: &[Trace],
        fold: usize,
        folds: usize,
    ) -> Result<Option<[f64; SHARES.len()]>, PipelineError> {
        let (kept, held) = split(traces, fold, folds);
        let mut errors = [0.0; SHARES.len()];
        if self.touched_and_seen(&kept)? < LEAST_SEEN {
            return Ok(None);
        }
        let means = match self.means(&kept) {
            Err(PipelineError::Vision(e)) if e.is_blind() => return Ok(None),
            means => means?,
        };
        let batch = batch_map(kept.iter().copied(), self.rest.len(), self.noise)?;
        for (error, share) in errors.iter_mut().zip(SHARES) {
            let fit = batch.solve(&self.prior(&means, share)?, 1.0)?.mean();
            *error = mean_error(&fit, held.iter().copied());
        }
        CoreError::check_finite("held-out errors", &errors)?;
        Ok(Some(errors))
    }

    /// How many points are touched and likely to be there, by what is seen.
    fn touched_and_seen(&self, traces: &[&Trace]) -> Result<usize, PipelineError> {
        let occupancy = self.seen.occupancy(Extrapolation::FADE)?;
        let touched = touched_points(traces.iter().copied(), self.rest.len());
        let both = touched.iter().zip(occupancy);
        Ok(both
            .filter(|(t, o)| **t && *o >= Extrapolation::LEAST_OCCUPANCY)
            .count())
    }
}
