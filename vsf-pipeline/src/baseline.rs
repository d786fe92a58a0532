mod features;
mod mlp;
mod per_joint;

use crate::{PipelineError, Scene, SequencePrediction};
use features::Known;
pub use mlp::MlpConfig;
use vsf_data::Sequence;
use vsf_vision::{GaussianProcess, GpConfig, KnnConfig, KnnRegressor, Width};

/// Baseline predictors that know nothing of contact, to compare a field with (Yao & Hauser, section IV-C).
/// They learn from the train samples once.
///
/// All but [`Baseline::Zero`] are regressions of the joint torques on the features `(q, r, k)`: `d + 6`
/// numbers for `d` joints (13 for an arm of 7 joints).
/// - `q`: the joint positions.
/// - `r`: the origin of the end effector's frame (m), in the world frame. The end effector is the link that
///   most joints move (of several the last one).
/// - `k`: the axis of the last joint that moves it, in the world frame.
///
/// The paper says "center position" and "rotation axis" and nothing more.
///
/// Each feature is scaled to mean 0 and standard deviation 1 over the train samples. Features whose
/// deviation is less than 1 % of the largest one (in rad, m or 1) are left out. The axis of a hand that
/// keeps its direction, for example, consists of rounding errors, which scaling would make as large as all
/// else.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Baseline {
    /// Predicts zero torque.
    Zero,
    /// One [`KnnRegressor`] per joint: the mean of the `k` nearest train samples with RBF weights.
    ///
    /// The width of the RBF is the median distance of the train samples to their neighbors, since the paper
    /// gives none.
    Knn {
        /// Number of neighbors, at least 1, 50 in the paper. If there are fewer samples, all are used.
        k: usize,
    },
    /// A multilayer perceptron. By default its size is the best of those in the paper.
    Mlp(MlpConfig),
    /// One [`GaussianProcess`] per joint, with a Matérn 3/2 kernel (the result of the paper's kernel
    /// search) and parameters of maximum marginal likelihood.
    Gp {
        /// Largest number of train samples that are used, at least 2. Of more, an even selection is used.
        /// With 1500 the `O(n³)` time stays within seconds.
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
    /// Predicts the readings of `test` from those of `train`. [`Baseline::Knn`] and [`Baseline::Gp`] also
    /// give standard deviations. The result does not depend on the number of threads.
    ///
    /// # Errors
    /// No train sequence (except for [`Baseline::Zero`]), fewer than 2 train samples, parameters out of
    /// range, or positions or torques that cannot be used.
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
