//! What a model is worth to those who estimate fields with it.

use crate::closure::{Closure, Residuals, closure};
use crate::trial::{Judgement, Trial};
use crate::{Campaign, GapError, Model, Motion};
use vsf_pipeline::{
    EstimatorSpec, HyperMethod, PriorShape, Trace, choose_hyper, estimate, predict,
};

/// A field that was estimated under a model, and what both together leave on the test sequences.
#[derive(Debug, Clone)]
pub struct Estimated {
    /// Mean stiffness per rest point (N/m).
    pub field: Vec<f64>,
    /// Residuals of the test sequences, in the order of [`Campaign::test`].
    pub residuals: Residuals,
}

impl Campaign {
    /// A field as one would estimate it outside of a diagnosis, under a model: the batch optimum over the train sequences
    /// with every parameter chosen from them. `None` without test sequences (without a test split it is the last train
    /// sequence that checks, and does not train) or train sequences that touch.
    ///
    /// A diagnosis compares models by fields of its own, which are the same for all of them but not the best; this
    /// tells what a model is worth to those who estimate with it.
    ///
    /// # Errors
    /// Rows that contact cannot take, parameters that an effect cannot take, readings that no field can be fitted to.
    pub fn estimated(&self, model: &Model) -> Result<Option<Estimated>, GapError> {
        let all = self.corrected(model)?;
        let of = |m: &Motion| all.iter().find(|c| c.trace.id == m.id);
        let train: Vec<Trace> = (self.train.iter().filter_map(of))
            .map(|c| c.trace.clone())
            .collect();
        if self.test.is_empty() || train.iter().all(|t| t.contact_samples() == 0) {
            return Ok(None);
        }
        let (scene, shapes) = (&self.scene, PriorShape::default().or_independent());
        let rest = scene.rest();
        let hyper = choose_hyper(rest, &train, &shapes, HyperMethod::HeldOut)?.hyper;
        let belief = estimate(rest, &train, &EstimatorSpec::Batch, &hyper, |_| {})?.belief;
        let (mut predicted, mut rows) = (Vec::new(), Vec::new());
        let tested = self.test.iter().filter_map(|m| Some((m, of(m)?)));
        for (motion, corrected) in tested {
            let field = predict(scene, &belief, &hyper.noise_sd, &corrected.trace)?;
            let torques = corrected.complete(field).mean.concat();
            let measured = motion.reading.data().iter();
            rows.push(measured.zip(&torques).map(|(y, p)| y - p).collect());
            predicted.push(torques);
        }
        Ok(Some(Estimated {
            field: belief.mean().to_vec(),
            residuals: Residuals {
                joints: self.site.joints(),
                rows,
                predicted,
            },
        }))
    }
}

/// What the nominal model and the one that was named leave on the checked sequences, and how far the latter closes the
/// gap. Without a named one, both are the same.
pub(crate) struct Extent {
    pub(crate) before: Estimated,
    pub(crate) after: Estimated,
    pub(crate) closed: Closure,
    /// From where on points are touched (m); none in free air.
    pub(crate) threshold: Option<f64>,
    /// Whether fields are estimated as outside of a diagnosis.
    pub(crate) estimated: bool,
}

impl Extent {
    /// With fields that are estimated as outside of the diagnosis; `None` where nothing is estimated. Both are in the contact
    /// in which one estimates fields, or, if the model follows it, in the one that it was found in; unless fields of the
    /// nominal model in the former are better than that.
    ///
    /// # Errors
    /// As [`Campaign::estimated`].
    pub(crate) fn outside(
        campaign: &Campaign,
        judgement: &Judgement<'_>,
        seed: u64,
    ) -> Result<Option<Self>, GapError> {
        if campaign.scene.rest().is_empty() {
            return Ok(None);
        }
        let (nominal, other) = (Model::default(), campaign.suited());
        let suited = other.as_ref().unwrap_or(campaign);
        let Some(mut before) = suited.estimated(&nominal)? else {
            return Ok(None);
        };
        let model = judgement.named.as_ref().map(|t| &t.refined.model);
        let follows = model.is_some_and(Model::follows_contact);
        let there = if follows { campaign } else { suited };
        let after = match model {
            Some(model) => there.estimated(model)?,
            None => None,
        };
        let after = after.unwrap_or_else(|| before.clone());
        let pays = after.residuals.mean_error() <= before.residuals.mean_error();
        if let (true, true, Some(_)) = (follows, pays, &other) {
            before = campaign.estimated(&nominal)?.unwrap_or(before);
        }
        let (noise, checked) = (&campaign.noise, &campaign.test);
        let closed = closure(&before.residuals, &after.residuals, noise, checked, seed);
        Ok(Some(Self {
            before,
            after,
            closed,
            threshold: Some(if pays { there } else { suited }.scene.contact().threshold),
            estimated: true,
        }))
    }

    /// With the fields of the diagnosis; `field` is that of the nominal model.
    pub(crate) fn inside(
        campaign: &Campaign,
        trial: &Trial<'_>,
        judgement: &Judgement<'_>,
        field: &[f64],
    ) -> Self {
        let before = Estimated {
            field: field.to_vec(),
            residuals: trial.before.clone(),
        };
        let (after, closed) = match &judgement.named {
            Some(t) => (
                Estimated {
                    field: t.checked.field.clone(),
                    residuals: t.checked.residuals.clone(),
                },
                t.checked.closure,
            ),
            None => (before.clone(), trial.closure(&trial.before)),
        };
        let touches = !campaign.scene.rest().is_empty();
        Self {
            before,
            after,
            closed,
            threshold: touches.then_some(campaign.scene.contact().threshold),
            estimated: false,
        }
    }

    /// Whether the named model predicts worse than the nominal one.
    pub(crate) fn worse(&self) -> bool {
        self.after.residuals.mean_error() > self.before.residuals.mean_error()
    }

    /// The same where nothing is corrected.
    pub(crate) fn uncorrected(self) -> Self {
        Self {
            after: self.before.clone(),
            closed: Closure {
                fraction: 0.0,
                interval: [0.0; 2],
            },
            ..self
        }
    }
}
