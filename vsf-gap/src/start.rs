use crate::evidence::Spread;
use crate::refine::Prior;
use crate::screen::{MOST_SCALES, Screened, Tangent, best_of};
use crate::{Acts, Campaign, GapError, Model, Parameter, Role, Site};
use rayon::prelude::*;

/// Sizes of the steps of single parameters, in scales, large ones first, in the search for a start of
/// effects that move surfaces; most rounds of it; most steps of one scale that follow one that was taken,
/// along it; and the nats for which a step is taken.
const EXCURSIONS: [f64; 2] = [3.0, 1.0];
const MOST_ROUNDS: usize = 6;
const MOST_FOLLOWING: usize = 3;
const WORTHWHILE: f64 = 6.0;
/// Of more points than this, each is moved alone in the search for a start: they lie so close that what is around them
/// matters little, and there is much of it.
const MANY: usize = 20_000;
/// Prior deviation of shapes, in scales, that is not exceeded however wide their bounds.
const WIDEST: f64 = 50.0;

impl Tangent {
    /// Prior of all parameters, those that may not act held at zero. Screening bounds amplitudes by the
    /// torques that they cause; of surfaces that move, torques are no measure, since contact and stiffness
    /// change with them.
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
            parameters,
            mean: self.start.clone(),
            sd,
            choice: vec![self.choice],
        }
    }
}

impl Campaign {
    /// Where to start the fit of an effect: what screening found, or, for effects that move
    /// surfaces by more than contact answers linearly, what a search along single parameters finds.
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
        let rough = (self.site.rest.len() > MANY).then(|| self.rough());
        let within = rough.as_ref().unwrap_or(self);
        let value = |theta: &Vec<f64>| {
            let mut fitted = within.fitted(&base.with(effect, theta), &within.train)?;
            let spread = fitted.adapted(spread)?;
            let (_, factor) = within.field(&mut fitted, &spread)?;
            Ok(fitted.log_evidence_of(&factor) - prior.cost(theta))
        };
        let mut best = tangent.start.clone();
        let mut most = value(&best)?;
        let mut seen = vec![best.clone()];
        // The best of some, if it is worth a step; those that were tried before are not.
        let mut better = |thetas: Vec<Vec<f64>>, most: f64| -> Result<_, GapError> {
            let from = seen.len();
            for theta in thetas {
                if !seen.contains(&theta) {
                    seen.push(theta);
                }
            }
            let values: Vec<f64> = (seen[from..].par_iter())
                .map(value)
                .collect::<Result<_, GapError>>()?;
            let k = best_of(&values);
            let worthwhile = values.get(k).filter(|v| **v >= most + WORTHWHILE);
            Ok(worthwhile.map(|v| (seen[from + k].clone(), *v)))
        };
        let mut size = EXCURSIONS[0];
        for round in 0..MOST_ROUNDS {
            let mut tried = steps(&prior, &best, size);
            if round == 0 {
                tried.push(linear.clone());
            }
            match better(tried, most)? {
                Some((next, value)) => {
                    let way: Vec<f64> = (next.iter().zip(&best))
                        .map(|(t, b)| (t - b) / size)
                        .collect();
                    (best, most) = (next, value);
                    for _ in 0..MOST_FOLLOWING {
                        let around = [1.0, -1.0].map(|by| moved(&parameters, &best, &way, by));
                        match better(around.into(), most)? {
                            Some(next) => (best, most) = next,
                            None => break,
                        }
                    }
                }
                // Nothing at all, or nothing left.
                _ if round == 0 || size == EXCURSIONS[1] => break,
                _ => size = EXCURSIONS[1],
            }
        }
        Ok(base.with(effect, &best))
    }
}

/// `theta` and `by` times `way` further, within bounds.
fn moved(parameters: &[Parameter], theta: &[f64], way: &[f64], by: f64) -> Vec<f64> {
    (parameters.iter().zip(theta).zip(way))
        .map(|((p, t), w)| (t + by * w).clamp(p.bounds[0], p.bounds[1]))
        .collect()
}

/// Steps of so many scales from `theta`, of every amplitude of the whole session that may act on its own; of
/// compliances, which cannot be negative, of all together as well.
fn steps(prior: &Prior, theta: &[f64], size: f64) -> Vec<Vec<f64>> {
    let parameters = &prior.parameters;
    let moves = |i: usize, p: &Parameter| {
        p.role == Role::Amplitude && p.sequence.is_none() && prior.sd[i] > 0.0
    };
    let step = |which: &dyn Fn(usize) -> bool, size: f64| {
        let own = |(i, p): (usize, &Parameter)| match moves(i, p) && which(i) {
            true => p.scale,
            false => 0.0,
        };
        let way: Vec<f64> = parameters.iter().enumerate().map(own).collect();
        moved(parameters, theta, &way, size)
    };
    let mut steps: Vec<Vec<f64>> = (0..parameters.len())
        .flat_map(|k| [-size, size].map(|size| step(&|i| i == k, size)))
        .collect();
    let mut moving = parameters.iter().enumerate().filter(|(i, p)| moves(*i, p));
    if moving.all(|(_, p)| p.bounds[0] == 0.0) {
        steps.extend([-size, size].map(|size| step(&|_| true, size)));
    }
    steps
}
