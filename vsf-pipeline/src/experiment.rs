use crate::trace::check_traces;
use crate::{
    Estimate, EstimatorSpec, Hyper, HyperMethod, PipelineError, Scene, Trace, VisionSpec,
    choose_hyper, estimate, estimate_with_vision, rgbd_view,
};
use std::fmt;
use std::sync::OnceLock;
use vsf_data::{CameraView, Dataset, Sequence};

/// A recording prepared for experiments: sequences to learn from and sequences to predict.
#[derive(Clone)]
pub struct Experiment<'a> {
    pub(crate) name: &'a str,
    pub(crate) scene: &'a Scene,
    pub(crate) camera: Option<&'a CameraView>,
    pub(crate) train: Vec<&'a Sequence>,
    pub(crate) test: Vec<&'a Sequence>,
    /// Of the train, then of the test sequences.
    traces: &'a [Trace],
    hyper: OnceLock<Hyper>,
}

impl fmt::Debug for Experiment<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Experiment")
            .field("name", &self.name)
            .field("train", &self.train.len())
            .field("test", &self.test.len())
            .finish_non_exhaustive()
    }
}

impl<'a> Experiment<'a> {
    /// Combines a recording with the traces of its train sequences, followed by those of its test
    /// sequences.
    ///
    /// # Errors
    /// What [`Dataset::check`], [`Scene::check_recording`] or [`Trace::check`] refuses, no train or no test
    /// sequence, or another number of traces.
    pub fn new(
        dataset: &'a Dataset,
        scene: &'a Scene,
        traces: &'a [Trace],
    ) -> Result<Self, PipelineError> {
        dataset.check()?;
        scene.check_recording(dataset)?;
        check_traces(traces, scene.rest().len(), scene.robot().joint_count())?;
        let (train, test): (Vec<_>, Vec<_>) = (dataset.train().collect(), dataset.test().collect());
        for (what, split) in [("train", &train), ("test", &test)] {
            if split.is_empty() {
                return Err(PipelineError::NoSequences {
                    what,
                    hint: "an experiment needs a recording whose `splits` name train and test sequences",
                });
            }
        }
        vsf_core::CoreError::check_len("traces", traces.len(), train.len() + test.len())?;
        Ok(Self {
            name: &dataset.name,
            scene,
            camera: dataset.camera.as_ref(),
            train,
            test,
            traces,
            hyper: OnceLock::new(),
        })
    }

    /// Robot, link shapes and rest points.
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    pub(crate) fn train_traces(&self) -> &[Trace] {
        &self.traces[..self.train.len()]
    }

    pub(crate) fn test_traces(&self) -> &[Trace] {
        &self.traces[self.train.len()..]
    }

    /// Traces of all sequences, those to learn from first.
    pub(crate) fn traces(&self) -> &[Trace] {
        self.traces
    }

    /// Prior and noise, chosen by held-out touches of the train sequences. Computed once.
    ///
    /// # Errors
    /// Train sequences that touch nothing, or failures of an estimator.
    pub fn hyper(&self) -> Result<&Hyper, PipelineError> {
        if let Some(hyper) = self.hyper.get() {
            return Ok(hyper);
        }
        let (rest, train) = (self.scene.rest(), self.train_traces());
        let shapes = EstimatorSpec::Batch.shapes();
        let choice = choose_hyper(rest, train, &shapes, HyperMethod::HeldOut)?;
        Ok(self.hyper.get_or_init(|| choice.hyper))
    }

    /// The field estimated from the train sequences by touch alone.
    ///
    /// # Errors
    /// As [`Experiment::hyper`].
    pub fn blind_field(&self) -> Result<Estimate, PipelineError> {
        let (rest, spec) = (self.scene.rest(), EstimatorSpec::Batch);
        estimate(rest, self.train_traces(), &spec, self.hyper()?, |_| {})
    }

    /// The field estimated from the train sequences, with untouched points predicted from the camera image.
    ///
    /// `None` without a camera, or if the touched points in sight say too little.
    ///
    /// # Errors
    /// As [`Experiment::hyper`]; also invalid images.
    pub fn vision_field(&self, vision: &VisionSpec) -> Result<Option<Estimate>, PipelineError> {
        let Some(camera) = self.camera else {
            return Ok(None);
        };
        let (rest, spec) = (self.scene.rest(), EstimatorSpec::Batch);
        let (view, hyper) = (rgbd_view(camera)?, self.hyper()?);
        let traces = self.train_traces();
        match estimate_with_vision(rest, &view, traces, &spec, hyper, vision, |_| {}) {
            Ok(found) => Ok(Some(found.estimate)),
            Err(PipelineError::Vision(e)) if e.is_blind() => Ok(None),
            Err(other) => Err(other),
        }
    }
}
