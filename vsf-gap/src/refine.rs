use crate::effect::follows_contact;
use crate::evidence::{Factor, Fit, Normal, Spread};
use crate::fitted::Fitted;
use crate::gauge::{self, Reference};
use crate::screen::{best_of, log_mean_exp};
use crate::{Acts, Campaign, Effect, GapError, Model, Parameter, Role};
use faer::Mat;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Most Gauss-Newton steps, and most halvings of a step.
const MOST_STEPS: usize = 4;
const MOST_HALVINGS: usize = 2;
/// Iteration stops when the evidence grows by less than this (nats).
const ENOUGH: f64 = 0.3;

/// A model whose effects were fitted together with the field.
#[derive(Clone)]
pub(crate) struct Refined {
    /// The model.
    pub(crate) model: Model,
    /// Its parameters, effect by effect.
    pub(crate) theta: Vec<f64>,
    /// Their prior.
    pub(crate) prior: Prior,
    /// Their posterior standard deviations; 0 for amplitudes that may not act, and for the reference.
    pub(crate) sd: Vec<f64>,
    /// Log evidence of the readings, averaged over roughness (nats, without constants).
    pub(crate) log_evidence: f64,
    /// The roughness under which the model does best.
    pub(crate) spread: Spread,
    /// Mean stiffness per rest point, not negative (N/m).
    pub(crate) stiffness: Vec<f64>,
    /// Columns of the derivative of the torques with respect to each parameter; empty for those that may not act.
    pub(crate) tangent: Vec<Vec<f64>>,
    /// Whether anything is touched.
    pub(crate) touches: bool,
    /// What shares that scale the field are relative to.
    pub(crate) reference: Option<Reference>,
}

/// A parameter this near to a bound, relative to the bound, was stopped by it.
const NEAR_BOUND: f64 = 1e-3;
/// A parameter is undetermined if its deviation is more than this share of its prior deviation.
const UNDETERMINED: f64 = 0.9;
/// A parameter this many deviations from zero is wanted by the data.
const WANTED: f64 = 5.0;

impl Refined {
    /// Derivatives of the torques with respect to the parameters that may move.
    pub(crate) fn moving_columns(&self) -> impl Iterator<Item = &[f64]> {
        self.prior.moving().map(|i| self.tangent[i].as_slice())
    }

    /// Derivatives for the parameters that are at no bound.
    pub(crate) fn free_columns(&self) -> impl Iterator<Item = &[f64]> {
        let free = |&i: &usize| !is_stopped(&self.prior.parameters[i], self.theta[i]);
        let moving = self.prior.moving().filter(free);
        moving.map(|i| self.tangent[i].as_slice())
    }

    /// The prior restricted to the parameters that the data could have moved either way. All others are fixed, including
    /// those of sequences that the data do not contain.
    pub(crate) fn open(&self) -> Prior {
        let mut prior = self.prior.clone();
        for (i, p) in self.prior.parameters.iter().enumerate() {
            let shows = self.tangent[i].iter().any(|torque| *torque != 0.0);
            if self.sd[i] == 0.0 || !shows || is_stopped(p, self.theta[i]) {
                prior.sd[i] = 0.0;
            }
        }
        prior
    }

    /// The model without some of its effects, and its prior.
    pub(crate) fn without(&self, dropped: impl Fn(&dyn Effect) -> bool) -> (Model, Prior) {
        let (mut model, mut prior) = (Model::default(), Prior::default());
        for (part, (effect, own)) in self.model.places().enumerate() {
            if !dropped(effect.as_ref()) {
                model.parts.push(self.model.parts[part].clone());
                prior = prior.and(self.prior.of_part(part, own));
            }
        }
        (model, prior)
    }

    /// Names of the amplitudes that the data press against a bound of the plausible range.
    pub(crate) fn at_bounds(&self) -> Vec<&str> {
        self.at_bounds_among(0..self.theta.len())
    }

    /// The same among the parameters at `places`.
    pub(crate) fn at_bounds_among(&self, places: Range<usize>) -> Vec<&str> {
        let stopped = |i: &usize| {
            let p = &self.prior.parameters[*i];
            let wanted = self.theta[*i].abs() > WANTED * self.sd[*i];
            let ends = p.ends_low && self.theta[*i] < 0.0;
            p.role == Role::Amplitude && is_stopped(p, self.theta[*i]) && wanted && !ends
        };
        let own = places.filter(stopped);
        own.map(|i| self.prior.parameters[i].name.as_str())
            .collect()
    }

    /// Whether there are such amplitudes. If the model `touches` anything, those of effects that follow contact do not
    /// count.
    pub(crate) fn is_stopped(&self, touches: bool) -> bool {
        let counts = |effect: &dyn Effect| !(touches && follows_contact(effect));
        let mut places = self.model.places().filter(|(e, _)| counts(e.as_ref()));
        places.any(|(_, own)| !self.at_bounds_among(own).is_empty())
    }

    /// Whether the data say next to nothing about a parameter.
    pub(crate) fn is_undetermined(&self, place: usize) -> bool {
        self.sd[place] > UNDETERMINED * self.prior.sd[place]
    }

    /// Names of the effects none of whose parameters the data determine, for example because an object was moved to where
    /// nothing touches it.
    pub(crate) fn vague(&self) -> Vec<&str> {
        let tells = |place: usize| self.prior.sd[place] > 0.0 && !self.is_undetermined(place);
        let effects = self.model.places();
        let vague = effects.filter(|(_, own)| !own.clone().any(tells));
        vague.map(|(e, _)| e.name()).collect()
    }
}

/// Whether a value lies at a bound of its parameter.
pub(crate) fn is_stopped(p: &Parameter, value: f64) -> bool {
    (p.bounds.iter()).any(|bound| (value - bound).abs() <= NEAR_BOUND * bound.abs())
}

/// Prior of all parameters of a model.
#[derive(Clone, Default)]
pub(crate) struct Prior {
    /// The parameters, effect by effect.
    pub(crate) parameters: Vec<Parameter>,
    /// Means: zero for amplitudes, the start of the search for shapes.
    pub(crate) mean: Vec<f64>,
    /// Standard deviations; 0 for amplitudes that may not act.
    pub(crate) sd: Vec<f64>,
    /// Cost (nats) of the choice between sets of amplitudes, per effect ([`Tangent`](crate::screen::Tangent)).
    pub(crate) choice: Vec<f64>,
    /// Weights of the parameters that scale the field in their mean, which is held at zero ([`gauge`]); 0 for others.
    pub(crate) weights: Vec<f64>,
}

impl Prior {
    /// Indices of the parameters that may move.
    pub(crate) fn moving(&self) -> impl Iterator<Item = usize> {
        (0..self.sd.len()).filter(|&i| self.sd[i] > 0.0)
    }

    /// The prior of one effect, given its index and the places of its parameters.
    fn of_part(&self, part: usize, own: Range<usize>) -> Self {
        let of = |values: &[f64]| values[own.clone()].to_vec();
        Self {
            parameters: self.parameters[own.clone()].to_vec(),
            mean: of(&self.mean),
            sd: of(&self.sd),
            choice: vec![self.choice[part]],
            weights: of(&self.weights),
        }
    }

    /// The prior of a model with one more effect.
    pub(crate) fn and(mut self, next: Self) -> Self {
        self.parameters.extend(next.parameters);
        self.mean.extend(next.mean);
        self.sd.extend(next.sd);
        self.choice.extend(next.choice);
        self.weights.extend(next.weights);
        self
    }

    /// Cost of the parameters (nats): the negative log prior density.
    pub(crate) fn cost(&self, theta: &[f64]) -> f64 {
        let z = |i: usize| (theta[i] - self.mean[i]) / self.sd[i];
        let choice: f64 = self.choice.iter().sum();
        let own: f64 = self.moving().map(|i| 0.5 * z(i) * z(i)).sum();
        choice + own + gauge::cost(self, theta)
    }
}

impl Model {
    /// All parameters, effect by effect.
    pub fn theta(&self) -> Vec<f64> {
        self.parts
            .iter()
            .flat_map(|(_, t)| t.iter().copied())
            .collect()
    }

    /// The effects, and the places of their parameters among all.
    pub(crate) fn places(&self) -> impl Iterator<Item = (&Arc<dyn Effect>, Range<usize>)> {
        let mut next = 0;
        self.parts.iter().map(move |(effect, theta)| {
            let own = next..next + theta.len();
            next = own.end;
            (effect, own)
        })
    }

    /// Whether the model has an effect of this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.parts.iter().any(|(e, _)| e.name() == name)
    }

    /// Whether another model has all effects of this one.
    pub(crate) fn is_part_of(&self, other: &Self) -> bool {
        self.parts.iter().all(|(e, _)| other.has(e.name()))
    }

    /// Whether another model has exactly the effects of this one.
    pub(crate) fn has_effects_of(&self, other: &Self) -> bool {
        self.is_part_of(other) && other.is_part_of(self)
    }

    /// The same effects with other parameters, in the order of [`Model::theta`].
    #[must_use]
    pub(crate) fn at(&self, theta: &[f64]) -> Self {
        let parts = (self.places())
            .map(|(effect, own)| (effect.clone(), theta[own].to_vec()))
            .collect();
        Self { parts }
    }
}

impl Campaign {
    /// Fits the parameters of a model together with the field, starting from their current values.
    ///
    /// In free air, where a fit is fast, it is repeated with the roughness that is left. The roughness of a model that
    /// lacks these effects gives too much weight to quick changes. With contact, see [`Campaign::with_own_spread`].
    ///
    /// # Errors
    /// Rows that contact cannot take; a covariance that is not positive definite.
    pub(crate) fn refine(
        &self,
        start: &Model,
        prior: Prior,
        spread: &Spread,
    ) -> Result<Refined, GapError> {
        let refined = self.refined_at(start, prior, spread)?;
        if refined.touches || refined.spread == *spread {
            return Ok(refined);
        }
        let again = self.refined_at(&refined.model, refined.prior.clone(), &refined.spread)?;
        Ok(if again.log_evidence > refined.log_evidence {
            again
        } else {
            refined
        })
    }

    /// Fits by Gauss-Newton steps on the evidence under this spread.
    pub(crate) fn refined_at(
        &self,
        start: &Model,
        prior: Prior,
        spread: &Spread,
    ) -> Result<Refined, GapError> {
        let (mut theta, scale) = gauge::centered(&prior, start.theta());
        let start = &start.at(&theta);
        let mut fitted = self.fitted(start, self.train.iter())?;
        let spread = &fitted.adapted(&spread.scaled(scale))?;
        let (mut stiffness, mut factor) = self.field(&mut fitted, spread)?;
        let mut value = fitted.log_evidence_of(&factor) - prior.cost(&theta);
        let mut columns = self.columns(start, &fitted, &stiffness, &prior)?;
        let deep = start.acts() == Acts::Contact;
        let mut stale = false;
        for k in 0..MOST_STEPS {
            let (_, fit) = evidence(&fitted, &columns, &theta, &prior, &factor);
            let Some(fit) = fit else { break };
            let mut next = theta.clone();
            for (i, step) in prior.moving().zip(fit.theta.iter()) {
                let [lo, hi] = prior.parameters[i].bounds;
                next[i] = (prior.mean[i] + step).clamp(lo, hi);
            }
            let mut better = None;
            for _ in 0..=MOST_HALVINGS {
                let model = start.at(&next);
                let mut tried = self.fitted(&model, self.train.iter())?;
                let (field, factored) = self.field(&mut tried, spread)?;
                let gained = tried.log_evidence_of(&factored) - prior.cost(&next) - value;
                if gained > 0.0 {
                    better = Some((model, tried, field, factored, gained));
                    break;
                }
                next.iter_mut()
                    .zip(&theta)
                    .for_each(|(n, t)| *n = 0.5 * (*n + t));
            }
            let Some((model, tried, field, factored, gained)) = better else {
                break;
            };
            (theta, fitted, value) = (next, tried, value + gained);
            (stiffness, factor) = (field, factored);
            // Where contact has to be simulated anew for every column, they serve for two steps.
            stale = deep && k % 2 == 0;
            if !stale {
                columns = self.columns(&model, &fitted, &stiffness, &prior)?;
            }
            if gained < ENOUGH {
                break;
            }
        }
        if stale {
            columns = self.columns(&start.at(&theta), &fitted, &stiffness, &prior)?;
        }
        let spreads = fitted.roughness(spread);
        let found: Vec<(f64, Option<Fit>)> = (spreads.par_iter())
            .map(|s| {
                let factor = fitted.parts.factor(s)?;
                Ok(evidence(&fitted, &columns, &theta, &prior, &factor))
            })
            .collect::<Result<_, GapError>>()?;
        let all: Vec<f64> = found.iter().map(|(e, _)| *e).collect();
        let best = best_of(&all);
        let mut refined = Refined {
            model: start.at(&theta),
            sd: prior.sd.clone(),
            theta,
            prior,
            log_evidence: log_mean_exp(&all),
            spread: spreads[best],
            stiffness,
            tangent: columns,
            touches: fitted.touched,
            reference: None,
        };
        if let Some(fit) = &found[best].1 {
            let covariance = gauge::relative(&mut refined, &fit.covariance);
            let moving: Vec<usize> = refined.prior.moving().collect();
            (moving.iter().zip(covariance.diagonal().iter()))
                .for_each(|(&i, v)| refined.sd[i] = v.max(0.0).sqrt());
        }
        Ok(refined)
    }

    /// Fits a model once more under the spread of the stiffness that suits it best, if that does better. The spread of the
    /// nominal model makes up for what that model lacks.
    ///
    /// The fit is also started from where the first one started, since the first spread may have led it astray.
    ///
    /// # Errors
    /// As [`Campaign::refine`].
    pub(crate) fn with_own_spread(
        &self,
        refined: Refined,
        start: &Model,
    ) -> Result<Refined, GapError> {
        if !refined.touches {
            return Ok(refined);
        }
        let fitted = self.fitted(&refined.model, self.train.iter())?;
        let own = fitted.best_stiffness(refined.spread.contact, refined.spread.joint)?;
        let own = fitted.raised(&own)?;
        let mut best = refined;
        let mut from = vec![best.model.clone()];
        // Surfaces were searched for a start, which takes long.
        if start.acts() != Acts::Contact {
            from.push(start.clone());
        }
        for from in from {
            let again = self.refine(&from, best.prior.clone(), &own)?;
            if again.log_evidence > best.log_evidence {
                best = again;
            }
        }
        Ok(best)
    }

    /// Gives a fitted model the parameters that predict the readings best, even if its residuals persist.
    ///
    /// Weights that account for persistent errors emphasize quick changes, where the forms of effects are at their worst.
    /// The evidence of the model stays.
    ///
    /// # Errors
    /// As [`Campaign::refine`].
    pub(crate) fn settle(&self, refined: &mut Refined) -> Result<(), GapError> {
        if refined.spread.joint == 0.0 && refined.spread.walk == 0.0 {
            return Ok(());
        }
        let spread = Spread {
            joint: 0.0,
            white: refined.spread.joint,
            walk: 0.0,
            ..refined.spread
        };
        *refined = Refined {
            log_evidence: refined.log_evidence,
            spread: refined.spread,
            ..self.refined_at(&refined.model, refined.prior.clone(), &spread)?
        };
        Ok(())
    }

    /// The field of a fitted model, without negative stiffness.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn non_negative(
        &self,
        fitted: &Fitted<'_>,
        spread: &Spread,
    ) -> Result<Vec<f64>, GapError> {
        let factor = fitted.parts.factor(spread)?;
        let field = fitted.stiffness(self, spread, &factor);
        Ok(field.into_iter().map(|k| k.max(0.0)).collect())
    }

    /// The derivative of the torques with respect to every parameter that may move; empty for the others.
    pub(crate) fn columns(
        &self,
        model: &Model,
        fitted: &Fitted<'_>,
        stiffness: &[f64],
        prior: &Prior,
    ) -> Result<Vec<Vec<f64>>, GapError> {
        let theta = model.theta();
        let here = fitted.predicted(stiffness);
        let deep = model.acts() == Acts::Contact;
        (prior.parameters.par_iter().enumerate())
            .map(|(i, p)| {
                if prior.sd[i] == 0.0 {
                    return Ok(Vec::new());
                }
                let [lo, hi] = p.bounds;
                let step = 0.5 * p.scale.min(hi - lo);
                let at = |value: f64| {
                    let mut theta = theta.clone();
                    theta[i] = value;
                    self.predicted_near(&model.at(&theta), p, fitted, stiffness, &here)
                };
                // Torques bend with shapes, and what they do to contact with all.
                let central = deep || p.role == Role::Shape;
                let up = (theta[i] + step).min(hi);
                let down = if central || up == theta[i] {
                    (theta[i] - step).max(lo)
                } else {
                    theta[i]
                };
                let ahead = if up > theta[i] { at(up)? } else { here.clone() };
                let behind = if down < theta[i] {
                    at(down)?
                } else {
                    here.clone()
                };
                let width = up - down;
                Ok((ahead.iter().zip(&behind))
                    .map(|(a, b)| (a - b) / width)
                    .collect())
            })
            .collect()
    }
}

/// Log evidence with the parameters integrated out around `theta`, and the next values of those that may move, relative to
/// the prior mean.
fn evidence(
    fitted: &Fitted<'_>,
    columns: &[Vec<f64>],
    theta: &[f64],
    prior: &Prior,
    factor: &Factor,
) -> (f64, Option<Fit>) {
    let rest = fitted.rest();
    let moving: Vec<usize> = prior.moving().collect();
    let columns: Vec<&Vec<f64>> = moving.iter().map(|&i| &columns[i]).collect();
    let sd: Vec<f64> = moving.iter().map(|&i| prior.sd[i]).collect();
    // Readings as they would be were the parameters at their prior mean.
    let mut back = rest.clone();
    for (column, &i) in columns.iter().zip(&moving) {
        let m = theta[i] - prior.mean[i];
        back.iter_mut()
            .zip(column.iter())
            .for_each(|(r, c)| *r += c * m);
    }
    let mut all = Mat::from_fn(rest.len(), columns.len() + 2, |i, k| match k {
        0 => rest[i],
        1 => back[i],
        k => columns[k - 2][i],
    });
    factor.whiten(&mut all);
    let white: Vec<&[f64]> = (2..columns.len() + 2)
        .map(|k| all.col_as_slice(k))
        .collect();
    let mut normal = Normal::new(all.col_as_slice(1), &white);
    let tied = gauge::tie(prior, &mut normal);
    let squares: f64 = all.col_as_slice(0).iter().map(|y| y * y).sum();
    let log_evidence =
        tied - 0.5 * (factor.log_det() + squares + normal.log_det(&sd)) - prior.cost(theta);
    let bounds: Vec<[f64; 2]> = (moving.iter())
        .map(|&i| prior.parameters[i].bounds.map(|b| b - prior.mean[i]))
        .collect();
    (log_evidence, normal.fit(&sd, &bounds))
}
