//! What a model is worth to users who estimate fields with it.

use crate::campaign::FREE;
use crate::closure::{Closure, Residuals, closure, noise_norm};
use crate::report::{Gap, MeanErrors};
use crate::trial::{Judgment, Trial};
use crate::{Campaign, GapError, Model, Motion};
use vsf_pipeline::{
    EstimatorSpec, HyperMethod, PriorShape, Trace, choose_hyper, estimate, predict,
};

/// A model that closes this share of the gap leaves nothing that calls for another one, even if its residuals persist.
pub(crate) const NEARLY: f64 = 0.9;
/// A model whose error is more than this many times that of a perfect model is far from it.
pub(crate) const FAR: f64 = 3.0;
/// A model whose error is at most this many times that of a perfect model has reached the noise.
const NEAR: f64 = 1.2;

/// A field that was estimated under a model, and the residuals of both on the test sequences.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Estimated {
    /// Mean stiffness per rest point (N/m).
    pub field: Vec<f64>,
    /// Residuals of the test sequences, in the order of [`Campaign::test`].
    pub residuals: Residuals,
}

impl Estimated {
    /// Mean error (N m or N).
    pub(crate) fn error(&self) -> f64 {
        self.residuals.mean_error()
    }
}

impl Campaign {
    /// For every sample of the sequences in turn, whether the nominal model touches anything.
    ///
    /// # Errors
    /// Rows that contact cannot take.
    pub(crate) fn touches(&self, sequences: &[Motion]) -> Result<Vec<bool>, GapError> {
        let all: Vec<&Motion> = sequences.iter().collect();
        let logs = self.contact_logs(&Model::default(), &all)?;
        let contacts = logs.iter().flat_map(|log| &log.contacts);
        Ok(contacts.map(|c| !c.is_empty()).collect())
    }

    /// A field as one would estimate it outside of a diagnosis, under a model: the batch optimum over the train sequences,
    /// with every parameter chosen from them.
    ///
    /// `None` without test sequences or without train sequences that touch. (Without a test split, the last train sequence
    /// is the test sequence and does not train.)
    ///
    /// A diagnosis compares models by fields of its own, which are estimated in the same way for all of them but are not
    /// the best. This tells what a model is worth to users who estimate with it.
    ///
    /// # Errors
    /// Rows that contact cannot take; parameters that an effect cannot take; readings that no field can be fitted to.
    pub fn estimated(&self, model: &Model) -> Result<Option<Estimated>, GapError> {
        if self.test.is_empty() {
            return Ok(None);
        }
        let (all, session) = (self.corrected(model)?, self.session());
        let of = |m: &Motion| Some(&all[session.iter().position(|own| own.is(m))?]);
        let train: Vec<Trace> = (self.train.iter().filter_map(of))
            .map(|c| c.trace.clone())
            .collect();
        if train.iter().all(|t| t.contact_samples() == 0) {
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

/// Fields of the nominal model and of the named one, on the checked sequences.
pub(crate) struct Extent {
    /// The field of the nominal model, as one estimates it without another model.
    nominal: Estimated,
    /// Contact threshold of the nominal model's field (m); `None` in free air.
    threshold: Option<f64>,
    /// For every sample in turn, whether it touches anything there.
    touches: Vec<bool>,
    /// Results of the named model.
    named: Option<Compared>,
    /// Whether fields are estimated as outside of a diagnosis.
    pub(crate) estimated: bool,
}

/// A model compared with the nominal one.
pub(crate) struct Compared {
    pub(crate) before: Estimated,
    pub(crate) after: Estimated,
    pub(crate) closed: Closure,
    /// Contact thresholds (m) before and after; `None` in free air.
    pub(crate) thresholds: Option<[f64; 2]>,
    /// For every sample in turn, whether it touches anything under either model.
    pub(crate) touches: Vec<bool>,
}

impl Compared {
    /// Whether a sample is in contact (`touching`) or in the air.
    fn is_one(&self, touching: bool) -> impl Fn(usize) -> bool {
        move |k| self.touches.get(k) == Some(&touching)
    }

    /// Number of such samples.
    fn samples(&self, touching: bool) -> usize {
        self.touches.iter().filter(|t| **t == touching).count()
    }

    /// Whether the residuals of the model are far above the noise. With contact, only those in the air count, since in
    /// contact they have many reasons. Without contact, closing less than [`NEARLY`] of the gap counts as well.
    pub(crate) fn is_far(&self, noise: f64, touches: bool) -> bool {
        let in_air = |k: usize| self.touches.get(k) != Some(&true);
        let tells = !touches || self.samples(false) >= FREE;
        let open = !touches && self.closed.fraction < NEARLY;
        open || tells && self.after.residuals.mean_error_of(in_air) > FAR * noise
    }

    /// Whether the model reduces residuals in the air from far above the noise down to it. There, stiffness has no part in
    /// the explanation.
    pub(crate) fn is_shown_in_air(&self, noise: f64) -> bool {
        let error = |of: &Estimated| of.residuals.mean_error_of(self.is_one(false));
        let (before, after) = (error(&self.before), error(&self.after));
        self.samples(false) >= FREE && before > FAR * noise && after < NEAR * noise
    }

    /// Whether residuals are much larger in contact than in the air.
    pub(crate) fn is_worse_in_contact(&self) -> bool {
        let error = |touching| self.after.residuals.mean_error_of(self.is_one(touching));
        self.samples(false) >= FREE && error(true) > FAR * error(false)
    }

    /// Errors on the checked sequences.
    pub(crate) fn gap(&self, campaign: &Campaign, model: &Model, estimated: bool) -> Gap {
        let (before, after) = (&self.before.residuals, &self.after.residuals);
        let errors = |touching: bool| {
            let samples = self.samples(touching);
            (samples > 0).then(|| MeanErrors {
                nominal: before.mean_error_of(self.is_one(touching)),
                corrected: after.mean_error_of(self.is_one(touching)),
                samples,
            })
        };
        Gap {
            test_error_nominal: before.mean_error(),
            test_error_corrected: after.mean_error(),
            noise_floor: noise_norm(&campaign.noise),
            noise_floor_is_bound: campaign.noise_is_bound,
            closed_fraction: self.closed.fraction,
            closed_interval: self.closed.interval,
            unit: campaign.scene.error_unit().to_owned(),
            corrected_by: (model.parts.iter())
                .map(|(effect, _)| effect.name().to_owned())
                .collect(),
            free: errors(false),
            contact: errors(true),
            estimated,
            in_sample: campaign.test.is_empty(),
            threshold: self.thresholds.map(|[_, after]| after),
            threshold_nominal: self.thresholds.map(|[before, _]| before),
        }
    }
}

impl Extent {
    /// Compares fields that are estimated as outside of a diagnosis; `None` if none can be estimated.
    ///
    /// The contact is that in which one estimates fields. Models that follow the contact keep the one that they were found
    /// in; beside them, the nominal model has whichever of the two it does better in.
    ///
    /// # Errors
    /// As [`Campaign::estimated`].
    pub(crate) fn outside(
        campaign: &Campaign,
        judgment: &Judgment<'_>,
        seed: u64,
    ) -> Result<Option<Self>, GapError> {
        if campaign.scene.rest().is_empty() {
            return Ok(None);
        }
        let other = campaign.suited();
        let suited = other.as_ref().unwrap_or(campaign);
        let Some(nominal) = suited.estimated(&Model::default())? else {
            return Ok(None);
        };
        let mut named = None;
        if let Some(tried) = &judgment.named {
            let model = &tried.refined.model;
            let there = if model.follows_contact() {
                campaign
            } else {
                suited
            };
            let Some(after) = there.estimated(model)? else {
                return Ok(None);
            };
            let (mut before, mut here) = (nominal.clone(), suited);
            if other.is_some() && model.follows_contact() {
                let own = campaign.estimated(&Model::default())?;
                if let Some(own) = own.filter(|own| own.error() < before.error()) {
                    (before, here) = (own, campaign);
                }
            }
            let (noise, checked) = (&campaign.noise, &campaign.test);
            let touches = there.touches(checked)?.into_iter();
            named = Some(Compared {
                closed: closure(&before.residuals, &after.residuals, noise, checked, seed),
                thresholds: Some([here, there].map(|c| c.scene.contact().threshold)),
                touches: (touches.zip(here.touches(checked)?))
                    .map(|(a, b)| a || b)
                    .collect(),
                before,
                after,
            });
        }
        Ok(Some(Self {
            nominal,
            threshold: Some(suited.scene.contact().threshold),
            touches: suited.touches(&campaign.test)?,
            named,
            estimated: true,
        }))
    }

    /// Compares the fields of the diagnosis; `field` is that of the nominal model.
    ///
    /// # Errors
    /// Rows that contact cannot take.
    pub(crate) fn inside(
        campaign: &Campaign,
        trial: &Trial<'_>,
        judgment: &Judgment<'_>,
        field: &[f64],
    ) -> Result<Self, GapError> {
        let nominal = Estimated {
            field: field.to_vec(),
            residuals: trial.before.clone(),
        };
        let has_points = !campaign.scene.rest().is_empty();
        let threshold = has_points.then_some(campaign.scene.contact().threshold);
        let touches = campaign.touches(trial.sequences)?;
        let named = judgment.named.as_ref().map(|t| Compared {
            before: nominal.clone(),
            after: Estimated {
                field: t.checked.field.clone(),
                residuals: t.checked.residuals.clone(),
            },
            closed: t.checked.closure,
            thresholds: threshold.map(|t| [t; 2]),
            touches: touches.clone(),
        });
        Ok(Self {
            nominal,
            threshold,
            touches,
            named,
            estimated: false,
        })
    }

    /// The share of the gap that the named model closes.
    pub(crate) fn closed(&self) -> f64 {
        self.named.as_ref().map_or(0.0, |c| c.closed.fraction)
    }

    /// The mean errors of the named model and of the nominal one, if the former is larger.
    pub(crate) fn worse(&self) -> Option<[f64; 2]> {
        let named = self.named.as_ref()?;
        let [after, before] = [&named.after, &named.before].map(Estimated::error);
        (after > before).then_some([after, before])
    }

    /// The comparison to report: the named model if it is what is `corrected`, otherwise the nominal model with itself.
    pub(crate) fn told(self, corrected: bool) -> Compared {
        self.named.filter(|_| corrected).unwrap_or(Compared {
            before: self.nominal.clone(),
            after: self.nominal,
            closed: Closure {
                fraction: 0.0,
                interval: [0.0; 2],
                least: 0.0,
            },
            thresholds: self.threshold.map(|t| [t; 2]),
            touches: self.touches,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With contact, only what is left in the air counts, and where there is enough of it.
    #[test]
    fn what_is_left_far_from_the_noise_is_left_in_the_air() {
        let compared = |in_air: usize, left: [f64; 2], closed: f64| {
            let rows = [vec![left[0]; in_air], vec![left[1]; 30]].concat();
            let estimated = Estimated {
                field: Vec::new(),
                residuals: Residuals {
                    joints: 1,
                    predicted: vec![vec![0.0; rows.len()]],
                    rows: vec![rows],
                },
            };
            Compared {
                before: estimated.clone(),
                after: estimated,
                closed: Closure {
                    fraction: closed,
                    interval: [closed; 2],
                    least: closed,
                },
                thresholds: None,
                touches: [vec![false; in_air], vec![true; 30]].concat(),
            }
        };
        let far = |in_air, left, closed| compared(in_air, left, closed).is_far(0.1, true);
        assert!(far(16, [0.5, 0.1], 0.99));
        assert!(!far(15, [0.5, 0.1], 0.99) && !far(16, [0.2, 5.0], 0.1));
        // A cause is shown where no field has a part.
        let shown = |in_air, before: f64, after: f64| {
            let residuals = |left: f64| compared(in_air, [left, 0.5], 0.2).after;
            let all = Compared {
                before: residuals(before),
                after: residuals(after),
                ..compared(in_air, [0.0; 2], 0.2)
            };
            all.is_shown_in_air(0.1)
        };
        assert!(shown(16, 0.5, 0.1));
        assert!(!shown(15, 0.5, 0.1) && !shown(16, 0.2, 0.1) && !shown(16, 0.5, 0.15));
        // In free air, so does a gap that stays open.
        let in_air = |left, closed| {
            let all = Compared {
                touches: vec![false; 46],
                ..compared(16, [left; 2], closed)
            };
            all.is_far(0.1, false)
        };
        assert!(in_air(0.5, 0.99) && in_air(0.1, 0.5) && !in_air(0.1, 0.99));
    }
}
