mod features;
mod mlp;
mod per_joint;

use crate::{PipelineError, Scene, SequencePrediction};
use features::Known;
pub use mlp::MlpConfig;
use vsf_data::Sequence;
use vsf_vision::{GaussianProcess, GpConfig, KnnConfig, KnnRegressor, Width};

/// Predictors that know nothing of contact, to stand beside a field: the baselines of Yao & Hauser
/// (section IV-C). They learn from the train samples once.
///
/// All but [`Baseline::Zero`] are regressions of the joint torques on `(q, r, k)`: the joint
/// positions, the place of the end effector and its axis of rotation, `d + 6` numbers (13 for an arm
/// of 7 joints). The end effector is the link that most joints move (of several the last one), `r`
/// the origin of its frame (m) and `k` the axis of the last joint that moves it, both in world; the
/// paper says "center position" and "rotation axis" and nothing more.
///
/// Each is scaled to mean 0 and standard deviation 1 over the train samples. Those that hardly change
/// there are left out, with less than 1 % of the deviation (rad, m or 1) of the one that changes
/// most: a hand that keeps its direction has an axis of rounding errors, which scaling would make as
/// large as all else.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Baseline {
    /// No torque at all.
    Zero,
    /// For each joint a [`KnnRegressor`]: the mean of the `k` nearest train samples with RBF weights.
    /// The width of the RBF is the median distance of the train samples to their neighbors; the
    /// paper gives none.
    Knn {
        /// Number of neighbors, at least 1, 50 in the paper; fewer samples than that are all used.
        k: usize,
    },
    /// A multilayer perceptron, by default of the size among the paper's that does best.
    Mlp(MlpConfig),
    /// For each joint a [`GaussianProcess`] with a Matérn 3/2 kernel, at which the paper's search
    /// among kernels ended, and parameters of greatest marginal likelihood.
    Gp {
        /// Most train samples that are used, at least 2; of more an even choice is taken. 1500 keeps
        /// the `O(n³)` within seconds.
        max_samples: usize,
    },
}

/// Predicted rows of all test samples.
struct Predicted {
    mean: Vec<Vec<f64>>,
    /// Empty without deviations.
    sd: Vec<Vec<f64>>,
}

impl Baseline {
    /// Predicts the readings of `test` from those of `train`, with standard deviations by
    /// [`Baseline::Knn`] and [`Baseline::Gp`]. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// No train sequence, but for [`Baseline::Zero`]; fewer than 2 train samples; parameters out of
    /// range; positions or torques that cannot be taken.
    pub fn predict(
        &self,
        scene: &Scene,
        train: &[&Sequence],
        test: &[&Sequence],
    ) -> Result<Vec<SequencePrediction>, PipelineError> {
        let learn = || {
            let known = Known::new(scene, train)?;
            let queries = known.features_of(scene.robot(), test)?;
            Ok::<_, PipelineError>((known, queries))
        };
        let all = match self {
            Self::Zero => {
                let samples = test.iter().map(|s| s.len()).sum();
                Predicted {
                    mean: vec![vec![0.0; scene.robot().joint_count()]; samples],
                    sd: Vec::new(),
                }
            }
            Self::Knn { k } => {
                let config = KnnConfig {
                    neighbors: *k,
                    width: Width::Median,
                    shrink: false,
                };
                let (known, queries) = learn()?;
                per_joint::predict(|| KnnRegressor::new(config), &known, &queries)?
            }
            Self::Gp { max_samples } => {
                let config = GpConfig {
                    max_samples: *max_samples,
                };
                let (known, queries) = learn()?;
                per_joint::predict(|| GaussianProcess::new(config), &known, &queries)?
            }
            Self::Mlp(config) => {
                let (known, queries) = learn()?;
                mlp::predict(config, &known, &queries)?
            }
        };
        let (mut mean, mut sd) = (all.mean.into_iter(), all.sd.into_iter());
        let of_sequence = |sequence: &&Sequence| SequencePrediction {
            id: sequence.id.clone(),
            mean: mean.by_ref().take(sequence.len()).collect(),
            sd: sd.by_ref().take(sequence.len()).collect(),
        };
        Ok(test.iter().map(of_sequence).collect())
    }
}
