use super::name_of;
use super::vision::{Vision, VisionKind, vision};
use crate::exit::usage;
use crate::range::{deviation, positive, replays, seed, share};
use clap::{Args, ValueEnum};
use std::path::Path;
use vsf::filter::{DualConfig, Projection, ReplayConfig, ReplayVariance, RobustLoss};
use vsf::pipeline::{EstimatorSpec, FilterSpec, HyperMethod, PriorShape, VisionSpec};

/// The estimator, prior and noise.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Estimator")]
pub struct EstimatorSettings {
    /// Estimator to use; default: batch (`vsf live`: replay)
    #[arg(long)]
    estimator: Option<EstimatorKind>,
    /// How an exact filter treats means below zero: it takes the optimum within K >= 0 (constrained; default of
    /// `exact`), reports them as zero (output-only; default of `information`), or reports them as zero and
    /// continues from zero (fed-back, eq. 5)
    #[arg(long)]
    projection: Option<ProjectionKind>,
    /// Weight of outlying readings, such as spikes or those of a stuck sensor: full (none; default), with bounded
    /// influence (huber), or the less the farther out (student-t); not with `batch`
    #[arg(long)]
    robust: Option<RobustKind>,
    /// Number of past observations replayed after every update; default: 20, or 0 with `diagonal`
    #[arg(long, value_parser = replays)]
    replay: Option<usize>,
    /// Whether replays leave the variances unchanged (keep; default) or shrink them again (shrink)
    #[arg(long)]
    replay_variance: Option<VarianceKind>,
    /// Empty the replay buffer at the start of each sequence; default: false
    #[arg(long, num_args = 0..=1, default_missing_value = "true")]
    clear_replay: Option<bool>,
    /// Seed for drawing replays; default: 0
    #[arg(long, value_parser = seed)]
    seed: Option<u64>,
    /// Prior standard deviation of every point's own stiffness [N/m]; default: chosen from the sequences. If only
    /// this is given, the noise keeps its chosen ratio to it
    #[arg(long, value_parser = deviation)]
    pub prior_sd: Option<f64>,
    /// Standard deviation of the readings, model error included [N m or N]: one for all channels or one per
    /// channel; default: chosen from the sequences
    #[arg(long, value_delimiter = ',', value_parser = deviation)]
    pub noise_sd: Option<Vec<f64>>,
    /// Standard deviation of the smooth part of the prior, relative to that of a point's own part; 0 for
    /// independent points; default: 0.25 or 0
    ///
    /// The default is whichever of the two suits the sequences better. With --hyper held-out it is 0.25 if more
    /// than 1500 points are touched. It is 0.25 if both prior and noise are given, and 0 for estimators that keep no
    /// correlations.
    #[arg(long, value_parser = share)]
    smooth_share: Option<f64>,
    /// Length scale of the smooth part of the prior [m]; default: 0.04
    #[arg(long, value_parser = positive)]
    smooth_length: Option<f64>,
    /// Standard deviation of a level common to all points, relative to that of a point's own part; default: 0
    #[arg(long, value_parser = share)]
    level_share: Option<f64>,
    /// How to choose prior and noise where they are not given; default: held-out
    #[arg(long)]
    hyper: Option<HyperKind>,
    /// Prior mean of all points, touched or not, from what the recording's camera/ sees; held-out touches decide
    /// how much of it to use. One of none (default; touch alone), level (one stiffness, fading behind the visible
    /// surface), knn, ridge or gp (regression of the touched points' stiffness on color and position), or a FILE
    /// written by `vsf learn`
    #[arg(long, value_name = "METHOD|FILE", value_parser = vision)]
    vision: Option<Vision>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum HyperKind {
    /// By the prediction of held-out touches, or of held-out parts of touches that lie apart
    HeldOut,
    /// By the marginal likelihood of the readings, as if their errors were independent
    Likelihood,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum EstimatorKind {
    /// Constrained optimum over all samples at once, offline
    Batch,
    /// Exact posterior, sample by sample
    Exact,
    /// The same posterior from the precision matrix (eq. 5), slow
    Information,
    /// Replays that converge to the constrained optimum of independent points, for 1 kHz loops
    Dual,
    /// Diagonal Kalman filter with memory replay (Alg. 1), as in the paper
    Replay,
    /// Diagonal Kalman filter without replay
    Diagonal,
    /// Eq. 7 as printed, with memory replay; may diverge with priors other than the paper's
    Printed,
    /// Gain from the variances after the update, with memory replay
    Updated,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum RobustKind {
    None,
    Huber,
    StudentT,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum VarianceKind {
    Keep,
    Shrink,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ProjectionKind {
    Constrained,
    OutputOnly,
    FedBack,
}

impl EstimatorSettings {
    /// The same for a stream, of which not all readings are there at once.
    pub fn online(&self) -> Self {
        Self {
            estimator: Some(self.estimator.unwrap_or(EstimatorKind::Replay)),
            ..self.clone()
        }
    }

    /// The estimator.
    pub fn spec(&self) -> anyhow::Result<EstimatorSpec> {
        use EstimatorKind::{Batch, Dual, Exact, Information, Printed, Replay, Updated};
        let kind = self.kind();
        let replays = self.replay.is_some_and(|r| r > 0);
        if replays && !matches!(kind, Dual | Replay | Printed | Updated) {
            return Err(self.without("--replay", "replay", "dual"));
        }
        if self.seed.is_some() && !matches!(kind, Dual | Replay | Printed | Updated) {
            return Err(self.without("--seed", "random draws", "dual"));
        }
        let replays_variance = matches!(kind, Replay | Printed | Updated);
        if !replays_variance && self.replay_variance.is_some() {
            return Err(self.without("--replay-variance", "replay of variances", "replay"));
        }
        if !replays_variance && self.clear_replay.is_some() {
            let what = "buffer that a sequence empties";
            return Err(self.without("--clear-replay", what, "replay"));
        }
        if self.shape().smooth_share == 0.0 && self.smooth_length.is_some() {
            return Err(usage(format!(
                "--smooth-length (or smooth_length of a configuration): the prior of `{}` has no smooth part without a share above \
                 0; give such a --smooth-share, or leave out the length",
                self.name()
            )));
        }
        if !matches!(kind, Exact | Information) && self.projection.is_some() {
            return Err(self.without("--projection", "projection", "exact"));
        }
        let projection = match self.projection {
            Some(ProjectionKind::Constrained) if kind == Information => {
                return Err(self.without("--projection", "constrained projection", "exact"));
            }
            None => None,
            Some(ProjectionKind::Constrained) => Some(Projection::Constrained),
            Some(ProjectionKind::OutputOnly) => Some(Projection::OutputOnly),
            Some(ProjectionKind::FedBack) => Some(Projection::FedBack),
        };
        let loss = match self.robust {
            None | Some(RobustKind::None) => None,
            Some(_) if kind == Batch => {
                return Err(self.without("--robust", "robust noise", "exact"));
            }
            Some(RobustKind::Huber) => Some(RobustLoss::HUBER),
            Some(RobustKind::StudentT) => Some(RobustLoss::STUDENT_T),
        };
        let mut spec: EstimatorSpec = self.name().parse()?;
        if let EstimatorSpec::Online { filter, robust } = &mut spec {
            *robust = loss;
            match filter {
                FilterSpec::Exact(own) | FilterSpec::Information(own) => {
                    *own = projection.unwrap_or(*own);
                }
                FilterSpec::Dual(config) => self.tune_dual(config),
                FilterSpec::Replay { config, .. } => self.tune_replay(config),
                _ => {}
            }
        }
        Ok(spec)
    }

    fn without(&self, flag: &str, feature: &str, other: &str) -> anyhow::Error {
        let name = self.name();
        usage(format!(
            "{flag}: the estimator `{name}` has no {feature}; choose `{other}`"
        ))
    }

    fn tune_dual(&self, config: &mut DualConfig) {
        config.replays = self.replay.unwrap_or(config.replays);
        config.seed = self.seed.unwrap_or(config.seed);
    }

    fn tune_replay(&self, config: &mut ReplayConfig) {
        config.replays = self.replay.unwrap_or(config.replays);
        config.variance = match self.replay_variance {
            Some(VarianceKind::Shrink) => ReplayVariance::Shrink,
            Some(VarianceKind::Keep) => ReplayVariance::Keep,
            None => config.variance,
        };
        config.seed = self.seed.unwrap_or(config.seed);
        config.clear_on_sequence = self.clear_replay.unwrap_or(config.clear_on_sequence);
    }

    /// The smooth part of the prior.
    pub fn shape(&self) -> PriorShape {
        let spec = self.name().parse::<EstimatorSpec>();
        let defaults = spec.map(|s| s.shapes()[0]).unwrap_or_default();
        PriorShape {
            smooth_share: self.smooth_share.unwrap_or(defaults.smooth_share),
            length: self.smooth_length.unwrap_or(defaults.length),
            level_share: self.level_share.unwrap_or(defaults.level_share),
        }
    }

    /// Those to choose from: without the smooth part too, unless its share is given.
    pub fn shapes(&self) -> Vec<PriorShape> {
        match self.smooth_share {
            Some(_) => vec![self.shape()],
            None => self.shape().or_independent(),
        }
    }

    /// The first flag that says what the prior is, or how it is chosen, if there is any.
    pub fn flag_of_prior(&self) -> Option<&'static str> {
        let flags = [
            ("--prior-sd", self.prior_sd.is_some()),
            ("--smooth-share", self.smooth_share.is_some()),
            ("--smooth-length", self.smooth_length.is_some()),
            ("--level-share", self.level_share.is_some()),
            ("--hyper", self.hyper.is_some()),
        ];
        flags
            .into_iter()
            .find(|(_, given)| *given)
            .map(|(flag, _)| flag)
    }

    /// How prior and noise are chosen.
    pub fn method(&self) -> HyperMethod {
        match self.hyper {
            None | Some(HyperKind::HeldOut) => HyperMethod::HeldOut,
            Some(HyperKind::Likelihood) => HyperMethod::Likelihood,
        }
    }

    /// Whether prior or noise are chosen by the prediction of held-out touches.
    pub fn chooses_on_held_out(&self) -> bool {
        let given = self.prior_sd.is_some() && self.noise_sd.is_some();
        !given && self.method() == HyperMethod::HeldOut
    }

    /// How untouched points are guessed by what the camera sees, if they are.
    pub fn vision(&self) -> anyhow::Result<Option<VisionSpec>> {
        self.vision.as_ref().map_or(Ok(None), Vision::spec)
    }

    /// The file that says how untouched points are guessed.
    pub fn vision_file(&self) -> Option<&Path> {
        self.vision.as_ref()?.file()
    }

    /// Name of what guesses untouched points, for reports.
    pub fn vision_name(&self) -> String {
        let none = || VisionKind::None.name();
        self.vision.as_ref().map_or_else(none, Vision::name)
    }

    /// Name of how outliers count, for reports.
    pub fn robust_name(&self) -> String {
        name_of(&self.robust.unwrap_or(RobustKind::None))
    }

    fn kind(&self) -> EstimatorKind {
        self.estimator.unwrap_or(EstimatorKind::Batch)
    }

    /// Name of the estimator, for reports.
    pub fn name(&self) -> String {
        name_of(&self.kind())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The library knows every estimator by the name that the command has for it, and no other.
    #[test]
    fn estimators_are_named_as_in_the_library() {
        let names = EstimatorKind::value_variants().iter().map(name_of);
        assert_eq!(names.collect::<Vec<_>>(), EstimatorSpec::NAMES);
    }
}
