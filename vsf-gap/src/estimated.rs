use crate::{Campaign, Corrected, GapError, Model};
use vsf_pipeline::{
    EstimatorSpec, HyperMethod, PipelineError, PriorShape, Trace, choose_hyper, estimate, predict,
    score,
};

impl Campaign {
    /// Mean error (N m or N) of the test sequences with a field that is estimated under a model as one would outside
    /// of a diagnosis: the batch optimum over the train sequences with every parameter chosen from them. `None` without
    /// test sequences (without a test split it is the last train sequence that checks, and does not train) or train
    /// sequences that touch.
    ///
    /// A diagnosis compares models by fields of its own, which are the same for all of them but not the best; this
    /// tells what a model is worth to those who estimate with it.
    ///
    /// # Errors
    /// Rows that contact cannot take, parameters that an effect cannot take, readings that no field can be fitted to.
    pub fn estimated_error(&self, model: &Model) -> Result<Option<f64>, GapError> {
        let all = self.corrected(model)?;
        let is_train = |c: &Corrected| self.train.iter().any(|m| m.id == c.trace.id);
        let (train, test): (Vec<_>, Vec<_>) = all.into_iter().partition(is_train);
        let train: Vec<Trace> = train.into_iter().map(|c| c.trace).collect();
        if test.is_empty() || train.iter().all(|t| t.contact_samples() == 0) {
            return Ok(None);
        }
        let (scene, shapes) = (&self.scene, PriorShape::default().or_independent());
        let rest = scene.rest();
        let hyper = choose_hyper(rest, &train, &shapes, HyperMethod::HeldOut)?.hyper;
        let field = estimate(rest, &train, &EstimatorSpec::Batch, &hyper, |_| {})?;
        let predictions = (test.iter())
            .map(|c| Ok(c.complete(predict(scene, &field.belief, &hyper.noise_sd, &c.trace)?)))
            .collect::<Result<Vec<_>, PipelineError>>()?;
        let recorded: Vec<Trace> = test
            .iter()
            .map(Corrected::recorded)
            .collect::<Result<_, _>>()?;
        Ok(Some(score(scene, &recorded, &predictions)?.mean_error))
    }
}
