use crate::evidence::Spread;
use crate::gauge;
use crate::refine::Prior;
use crate::screen::{MOST_SCALES, Screened, Tangent, best_of};
use crate::{Acts, Campaign, GapError, Model, Parameter, Role, Site};
use rayon::prelude::*;

/// Parameters of the search for a start of effects that move surfaces: the step sizes of single parameters, in scales,
/// large ones first; most rounds; most further steps of one scale along a step that was taken; and the gain (nats) for
/// which a step is taken.
const EXCURSIONS: [f64; 2] = [3.0, 1.0];
const MOST_ROUNDS: usize = 6;
const MOST_FOLLOWING: usize = 3;
const WORTHWHILE: f64 = 6.0;
/// With more points than this, the search for a start of several amplitudes runs contact for the points alone, without
/// subdivision. They lie so close together that what is around them matters little, and there is much of it.
const MANY: usize = 20_000;
/// Largest prior deviation of shapes, in scales, however wide their bounds.
const WIDEST: f64 = 50.0;

impl Tangent {
    /// Prior of all parameters; those that may not act are held at zero.
    ///
    /// Screening bounds amplitudes by the torques that they cause. For surfaces that move, torques are no measure, since
    /// contact and stiffness change with them.
    pub(crate) fn prior(&self, site: &Site) -> Prior {
        let parameters = self.effect.parameters(site);
        let mut sd: Vec<f64> = (parameters.iter())
            .map(|p| match p.role {
                Role::Amplitude => 0.0,
                Role::Shape => (0.25 * (p.bounds[1] - p.bounds[0])).min(WIDEST * p.scale),
            })
            .collect();
        for (&i, s) in self.amplitudes.iter().zip(&self.sd) {
            sd[i] = match self.effect.acts() {
                Acts::Contact => MOST_SCALES * parameters[i].scale,
                Acts::Torques | Acts::Springs => *s,
            };
        }
        Prior {
            weights: gauge::weights(&parameters, self),
            parameters,
            mean: self.start.clone(),
            sd,
            choice: vec![self.choice],
        }
    }
}

impl Campaign {
    /// Start for the fit of an effect: the result of screening or, for effects that move surfaces beyond the linear range
    /// of contact, that of a search along single parameters.
    pub(crate) fn start(
        &self,
        base: &Model,
        tangent: &Tangent,
        found: &Screened,
        spread: &Spread,
    ) -> Result<Model, GapError> {
        let effect = &tangent.effect;
        let parameters = effect.parameters(&self.site);
        let mut linear = tangent.start.clone();
        for (&i, v) in tangent.amplitudes.iter().zip(found.fit.theta.iter()) {
            linear[i] = v.clamp(parameters[i].bounds[0], parameters[i].bounds[1]);
        }
        if effect.acts() != Acts::Contact || self.site.rest.is_empty() {
            return Ok(base.with(effect, &linear));
        }
        let prior = tangent.prior(&self.site);
        let many = self.site.rest.len() > MANY && tangent.amplitudes.len() > 1;
        let rough = many.then(|| self.rough());
        let within = rough.as_ref().unwrap_or(self);
        let value = |theta: &Vec<f64>| {
            let mut fitted = within.fitted(&base.with(effect, theta), within.train.iter())?;
            let spread = fitted.adapted(spread)?;
            let (_, factor) = within.field(&mut fitted, &spread)?;
            Ok(fitted.log_evidence_of(&factor) - prior.cost(theta))
        };
        let mut best = tangent.start.clone();
        let mut most = value(&best)?;
        let mut seen = vec![best.clone()];
        // Those that were tried before are no better than what was taken then.
        let mut values = |thetas: &[Vec<f64>]| -> Result<Vec<f64>, GapError> {
            let mut is_new = |theta: &Vec<f64>| {
                let new = !seen.contains(theta);
                seen.extend(new.then(|| theta.clone()));
                new
            };
            let new: Vec<bool> = thetas.iter().map(&mut is_new).collect();
            let of = |(theta, new): (&Vec<f64>, &bool)| {
                if *new {
                    value(theta)
                } else {
                    Ok(f64::NEG_INFINITY)
                }
            };
            thetas.par_iter().zip(&new).map(of).collect()
        };
        let all = ways(&prior);
        let mut size = EXCURSIONS[0];
        let mut likely = all.clone();
        for round in 0..MOST_ROUNDS {
            // Ways that led up last time come first; the others may be spared.
            let others: Vec<_> = (all.iter().filter(|w| !likely.contains(w)).cloned()).collect();
            let mut step = None;
            for ways in [likely.clone(), others] {
                let mut tried: Vec<_> = (ways.iter())
                    .map(|way| moved(&parameters, &best, way, size))
                    .collect();
                tried.extend((round == 0).then(|| linear.clone()));
                let found = values(&tried)?;
                let k = best_of(&found);
                if found.get(k).is_some_and(|v| *v >= most + WORTHWHILE) {
                    let led_up = ways.into_iter().zip(&found).filter(|(_, v)| **v > most);
                    likely = led_up.map(|(way, _)| way).collect();
                    step = Some((tried[k].clone(), found[k]));
                    break;
                }
            }
            match step {
                Some((next, value)) => {
                    let way: Vec<f64> = (next.iter().zip(&best))
                        .map(|(t, b)| (t - b) / size)
                        .collect();
                    (best, most) = (next, value);
                    for _ in 0..MOST_FOLLOWING {
                        let around = [1.0, -1.0].map(|by| moved(&parameters, &best, &way, by));
                        let found = values(&around)?;
                        let k = best_of(&found);
                        if found[k] < most + WORTHWHILE {
                            break;
                        }
                        (best, most) = (around[k].clone(), found[k]);
                    }
                }
                // Nothing at all, or nothing left.
                None if round == 0 || size == EXCURSIONS[1] => break,
                None => (size, likely) = (EXCURSIONS[1], all.clone()),
            }
        }
        Ok(base.with(effect, &best))
    }
}

/// `theta` moved by `by` times `way`, within bounds.
fn moved(parameters: &[Parameter], theta: &[f64], way: &[f64], by: f64) -> Vec<f64> {
    (parameters.iter().zip(theta).zip(way))
        .map(|((p, t), w)| (t + by * w).clamp(p.bounds[0], p.bounds[1]))
        .collect()
}

/// Search directions: up and down by one scale, for every amplitude of the whole session that may act on its own. For
/// compliances, which cannot be negative, also all of them together.
fn ways(prior: &Prior) -> Vec<Vec<f64>> {
    let parameters = &prior.parameters;
    let moves = |i: usize| {
        let p = &parameters[i];
        p.role == Role::Amplitude && p.sequence.is_none() && prior.sd[i] > 0.0
    };
    let moving: Vec<usize> = (0..parameters.len()).filter(|&i| moves(i)).collect();
    let mut sets: Vec<Vec<usize>> = moving.iter().map(|&i| vec![i]).collect();
    if moving.iter().all(|&i| parameters[i].bounds[0] == 0.0) {
        sets.push(moving);
    }
    let way = |set: &Vec<usize>, sign: f64| {
        let own = |(i, p): (usize, &Parameter)| {
            if set.contains(&i) {
                sign * p.scale
            } else {
                0.0
            }
        };
        parameters.iter().enumerate().map(own).collect()
    };
    (sets.iter())
        .flat_map(|set| [-1.0, 1.0].map(|sign| way(set, sign)))
        .collect()
}
