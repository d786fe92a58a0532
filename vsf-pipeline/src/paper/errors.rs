use crate::evaluate::mean_prediction;
use crate::{
    Baseline, EstimatorSpec, Evaluation, Experiment, HyperMethod, MlpConfig, PipelineError,
    SequencePrediction, Trace, VisionSpec, choose_hyper, estimate, estimate_with_vision, rgbd_view,
    score,
};
use rayon::prelude::*;
use serde::Serialize;
use vsf_data::Sequence;
use vsf_vision::RgbdView;

/// Methods of torque prediction in Tables III to V.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The stiffness field with untouched points predicted from the camera image. If no touched point is
    /// seen, it is the field of touch alone.
    Vision,
    /// The stiffness field of touch alone: the constrained optimum over the train samples.
    Blind,
    /// The stiffness field of touch alone by the online filter: the diagonal Kalman filter with memory
    /// replay, with prior and noise chosen for it.
    BlindOnline,
    /// Multilayer perceptron with two layers of 128 units, as in the paper.
    Mlp,
    /// Gaussian process.
    Gp,
    /// Regression on the 50 nearest samples.
    Knn,
    /// Zero torque.
    Zero,
}

impl Method {
    /// All methods, in the order of the paper's tables.
    pub const ALL: [Self; 7] = [
        Self::Vision,
        Self::Blind,
        Self::BlindOnline,
        Self::Mlp,
        Self::Gp,
        Self::Knn,
        Self::Zero,
    ];

    /// Name of the method in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vision => "VSF with vision",
            Self::Blind => "VSF blind",
            Self::BlindOnline => "VSF blind, online",
            Self::Mlp => "MLP",
            Self::Gp => "GP",
            Self::Knn => "k-NN",
            Self::Zero => "zero torque",
        }
    }
}

/// Errors of one method.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct MethodErrors {
    /// The method.
    pub method: Method,
    /// Its errors over all test sequences.
    #[serde(flatten)]
    pub evaluation: Evaluation,
}

/// Errors after a given number of train sequences: a position of Fig. 7.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainedOn {
    /// Number of train sequences.
    pub sequences: usize,
    /// One entry per method.
    pub errors: Vec<MethodErrors>,
}

/// Positions of train and test sequences among all.
struct Fold {
    train: Vec<usize>,
    test: Vec<usize>,
}

impl Experiment<'_> {
    /// Whether each sequence is the test sequence in turn.
    ///
    /// This is so if the recording's test split has a single sequence, as in the PARTIAL and NO datasets of
    /// the paper: one touch says little of a method.
    pub fn leave_one_out(&self) -> bool {
        self.test.len() == 1
    }

    /// Number of train sequences for each prediction.
    pub fn train_len(&self) -> usize {
        self.train.len()
    }

    /// Number of test sequences over which errors are averaged.
    pub fn test_len(&self) -> usize {
        self.folds(self.train.len())
            .iter()
            .map(|f| f.test.len())
            .sum()
    }

    /// The numbers of train sequences in [`Experiment::curve`]: 1, 2, 3, 5, 8 and so on, and all.
    pub fn curve_lens(&self) -> Vec<usize> {
        let all = self.train.len();
        let mut lens: Vec<usize> = std::iter::successors(Some((1, 2)), |&(a, b)| Some((b, a + b)))
            .map(|(a, _)| a)
            .take_while(|&n| n < all)
            .collect();
        lens.push(all);
        lens
    }

    /// Errors of all methods (Tables III to V). [`Method::Vision`] is included if `vision` is given and
    /// there is a camera. Prior and noise are chosen from the train sequences of each prediction.
    ///
    /// # Errors
    /// Train sequences that touch nothing, or failures of a method.
    pub fn errors(&self, vision: Option<&VisionSpec>) -> Result<Vec<MethodErrors>, PipelineError> {
        self.errors_after(self.train.len(), vision)
    }

    /// Like [`errors`](Self::errors), but learned from the first `train_len` train sequences only. If
    /// [one sequence is left out](Self::leave_one_out) in turn, from the `train_len` sequences that follow it.
    ///
    /// # Errors
    /// As [`Experiment::errors`].
    pub fn errors_after(
        &self,
        train_len: usize,
        vision: Option<&VisionSpec>,
    ) -> Result<Vec<MethodErrors>, PipelineError> {
        let view = match (self.camera, vision) {
            (Some(camera), Some(vision)) => Some((rgbd_view(camera)?, vision)),
            _ => None,
        };
        let view = view.as_ref().map(|(view, vision)| (view, *vision));
        let folds = self.folds(train_len.clamp(1, self.train.len()));
        let by_fold: Vec<_> = (folds.par_iter())
            .map(|fold| self.predictions(fold, view))
            .collect::<Result<_, _>>()?;
        let tested = folds.iter().flat_map(|f| &f.test);
        let traces: Vec<Trace> = tested.map(|&k| self.traces()[k].clone()).collect();
        let shown = |method: &Method| view.is_some() || *method != Method::Vision;
        let of_method = |method: Method| {
            let mine = |fold: &Vec<(Method, Vec<SequencePrediction>)>| {
                let own = fold.iter().filter(|(m, _)| *m == method);
                own.flat_map(|(_, p)| p.clone()).collect::<Vec<_>>()
            };
            let predictions: Vec<_> = by_fold.iter().flat_map(mine).collect();
            Ok(MethodErrors {
                method,
                evaluation: score(self.scene, &traces, &predictions)?,
            })
        };
        Method::ALL
            .into_iter()
            .filter(shown)
            .map(of_method)
            .collect()
    }

    /// Errors against the number of train sequences (Fig. 7), one entry per number in
    /// [`Experiment::curve_lens`]. `done` is called after each entry.
    ///
    /// # Errors
    /// As [`Experiment::errors`].
    pub fn curve(
        &self,
        vision: Option<&VisionSpec>,
        done: impl Fn(),
    ) -> Result<Vec<TrainedOn>, PipelineError> {
        let trained_on = |sequences: usize| {
            let errors = self.errors_after(sequences, vision)?;
            done();
            Ok(TrainedOn { sequences, errors })
        };
        self.curve_lens().into_iter().map(trained_on).collect()
    }

    fn folds(&self, train_len: usize) -> Vec<Fold> {
        let all = self.train.len() + self.test.len();
        if self.leave_one_out() {
            let fold = |test: usize| Fold {
                train: (1..=train_len).map(|k| (test + k) % all).collect(),
                test: vec![test],
            };
            return (0..all).map(fold).collect();
        }
        vec![Fold {
            train: (0..train_len).collect(),
            test: (self.train.len()..all).collect(),
        }]
    }

    fn predictions(
        &self,
        fold: &Fold,
        view: Option<(&RgbdView, &VisionSpec)>,
    ) -> Result<Vec<(Method, Vec<SequencePrediction>)>, PipelineError> {
        let (scene, rest) = (self.scene, self.scene.rest());
        let traces = |of: &[usize]| of.iter().map(|&k| self.traces()[k].clone()).collect();
        let (train, test): (Vec<Trace>, Vec<Trace>) = (traces(&fold.train), traces(&fold.test));
        let sequences =
            |of: &[usize]| -> Vec<&Sequence> { of.iter().map(|&k| self.sequence(k)).collect() };
        let (learned, asked) = (sequences(&fold.train), sequences(&fold.test));
        let by_field = |mean: &[f64]| -> Vec<SequencePrediction> {
            test.iter().map(|t| mean_prediction(mean, t)).collect()
        };
        let by_regression = |baseline: Baseline| baseline.predict(scene, &learned, &asked);

        // Each estimator with the prior and noise that are chosen for it.
        let of = |spec: &EstimatorSpec| {
            let hyper = choose_hyper(rest, &train, &spec.shapes(), HyperMethod::HeldOut)?.hyper;
            let found = estimate(rest, &train, spec, &hyper, |_| {})?;
            Ok::<_, PipelineError>((by_field(found.belief.mean()), hyper))
        };
        let (blind, hyper) = of(&EstimatorSpec::Batch)?;
        let mut found = Vec::new();
        if let Some((view, vision)) = view {
            let batch = &EstimatorSpec::Batch;
            let seen = estimate_with_vision(rest, view, &train, batch, &hyper, vision, |_| {});
            found.push((
                Method::Vision,
                match seen {
                    Ok(seen) => by_field(seen.estimate.belief.mean()),
                    Err(PipelineError::Vision(e)) if e.is_blind() => blind.clone(),
                    Err(other) => return Err(other),
                },
            ));
        }
        let mlp = MlpConfig {
            hidden: Some(vec![128, 128]),
            ..MlpConfig::default()
        };
        found.extend([
            (Method::Blind, blind),
            (Method::BlindOnline, of(&EstimatorSpec::replay())?.0),
            (Method::Mlp, by_regression(Baseline::Mlp(mlp))?),
            (
                Method::Gp,
                by_regression(Baseline::Gp { max_samples: 1500 })?,
            ),
            (Method::Knn, by_regression(Baseline::Knn { k: 50 })?),
            (Method::Zero, by_regression(Baseline::Zero)?),
        ]);
        Ok(found)
    }

    fn sequence(&self, k: usize) -> &Sequence {
        let train = self.train.len();
        if k < train {
            self.train[k]
        } else {
            self.test[k - train]
        }
    }
}
