//! Shares by which joints scale the torques of the field. If all are equal, they are a scale of the stiffness, which the
//! field already has.
//!
//! The shares are fitted with mean zero, so that no evidence comes from such a scale. They are reported relative to the
//! joint that most others agree with, so that few joints differ.

use crate::Parameter;
use crate::evidence::Normal;
use crate::refine::{Prior, Refined};
use crate::screen::Tangent;
use nalgebra::DMatrix;
use std::collections::BTreeSet;

/// How far the mean may be from zero.
const TIED: f64 = 1e-3;
/// Shares that differ by less agree, however certain they are.
const AGREE: f64 = 0.03;
/// A share is unknown if its deviation is more than this part of that of its prior.
const KNOWN: f64 = 0.9;

/// Weights of an effect's parameters in the mean that is held at zero, by the energy of what they change. All are 0 if the
/// effect does not scale the field, or if one of its shares may not move.
pub(crate) fn weights(parameters: &[Parameter], tangent: &Tangent) -> Vec<f64> {
    let mut weights = vec![0.0; parameters.len()];
    let scales = |i: &usize| parameters[*i].scales_field;
    let all = (0..parameters.len()).filter(scales);
    if all.clone().all(|i| tangent.amplitudes.contains(&i)) {
        let changes = tangent.amplitudes.iter().zip(&tangent.columns);
        for (&i, change) in changes.filter(|(i, _)| scales(i)) {
            weights[i] = change.iter().map(|c| c * c).sum();
        }
    }
    let sum: f64 = weights.iter().sum();
    if sum > 0.0 {
        weights.iter_mut().for_each(|w| *w /= sum);
    }
    weights
}

/// The tied shares: their indices among the parameters that may move, and among all. Empty if two effects scale the field.
fn tied(prior: &Prior) -> Vec<(usize, usize)> {
    let moving = prior.moving().enumerate();
    let own: Vec<(usize, usize)> = moving.filter(|(_, i)| prior.weights[*i] > 0.0).collect();
    let joints: BTreeSet<Option<usize>> = (own.iter())
        .map(|(_, i)| prior.parameters[*i].joint)
        .collect();
    if joints.len() == own.len() {
        own
    } else {
        Vec::new()
    }
}

fn mean(prior: &Prior, theta: &[f64]) -> f64 {
    let own = tied(prior).into_iter();
    own.map(|(_, i)| prior.weights[i] * theta[i]).sum()
}

/// Shares shifted to mean zero, and the factor on the stiffness that keeps the torques as they are.
pub(crate) fn centered(prior: &Prior, mut theta: Vec<f64>) -> (Vec<f64>, f64) {
    let scale = 1.0 + mean(prior, &theta);
    for (_, i) in tied(prior) {
        let [low, high] = prior.parameters[i].bounds;
        theta[i] = ((1.0 + theta[i]) / scale - 1.0).clamp(low, high);
    }
    (theta, scale)
}

/// Cost (nats) of a mean that is not zero.
pub(crate) fn cost(prior: &Prior, theta: &[f64]) -> f64 {
    0.5 * (mean(prior, theta) / TIED).powi(2)
}

/// Ties the shares to mean zero in the information on the parameters that may move. Returns what this adds to the log
/// evidence, since the prior is one of shares of mean zero.
pub(crate) fn tie(prior: &Prior, normal: &mut Normal) -> f64 {
    let own = tied(prior);
    let weight = |i: usize| prior.weights[i] / TIED;
    for &(a, i) in &own {
        for &(b, j) in &own {
            normal.information[(a, b)] += weight(i) * weight(j);
        }
    }
    let of_prior = |(_, i): &(usize, usize)| (weight(*i) * prior.sd[*i]).powi(2);
    0.5 * own.iter().map(of_prior).sum::<f64>().ln_1p()
}

/// The joint whose share is set to zero, since the others are relative to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Reference {
    /// Index of its share among all parameters.
    pub(crate) share: usize,
    /// Whether most others agree with it.
    pub(crate) agreed: bool,
}

/// Makes shares relative to the joint that most others agree with, if that leaves all shares within their bounds.
///
/// Scales the stiffness of the model and its spread accordingly, so the predictions stay the same. `covariance` is that of
/// the parameters that may move; returns it after the change.
pub(crate) fn relative(model: &mut Refined, covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let own = tied(&model.prior);
    let Some((at, reference)) = reference(model, &own, covariance) else {
        return covariance.clone();
    };
    let scale = 1.0 + model.theta[reference.share];
    let mut theta = model.theta.clone();
    let mut turn = DMatrix::identity(covariance.nrows(), covariance.ncols());
    for &(k, i) in &own {
        let share = 1.0 + theta[i];
        theta[i] = share / scale - 1.0;
        turn[(k, k)] = 1.0 / scale;
        turn[(k, at)] -= share / (scale * scale);
    }
    turn.row_mut(at).fill(0.0);
    theta[reference.share] = 0.0;
    let inside = |&(_, i): &(usize, usize)| {
        let [low, high] = model.prior.parameters[i].bounds;
        (low..=high).contains(&theta[i])
    };
    if !own.iter().all(inside) {
        return covariance.clone();
    }
    for &(_, i) in &own {
        model.tangent[i].iter_mut().for_each(|t| *t *= scale);
    }
    model.model = model.model.at(&theta);
    model.theta = theta;
    model.stiffness.iter_mut().for_each(|k| *k *= scale);
    model.spread = model.spread.scaled(scale);
    model.reference = Some(reference);
    &turn * covariance * turn.transpose()
}

/// The joint that most others agree with: the index of its share among the parameters that may move, and the reference.
fn reference(
    model: &Refined,
    own: &[(usize, usize)],
    covariance: &DMatrix<f64>,
) -> Option<(usize, Reference)> {
    let is_known =
        |&&(k, i): &&(usize, usize)| covariance[(k, k)].sqrt() < KNOWN * model.prior.sd[i];
    let known: Vec<(usize, usize)> = own.iter().filter(is_known).copied().collect();
    // Squares of the difference of two shares, and of how far they are apart if they agree.
    let apart = |(k, i): (usize, usize), (l, j): (usize, usize)| {
        let variance = covariance[(k, k)] + covariance[(l, l)] - 2.0 * covariance[(k, l)];
        let difference = model.theta[i] - model.theta[j];
        (difference * difference, AGREE * AGREE + variance.max(0.0))
    };
    // Of sums of logs: a joint far off counts little more than one that is off.
    let all_apart = |one: (usize, usize)| -> f64 {
        let of = |&other: &(usize, usize)| {
            let (difference, least) = apart(one, other);
            (difference + least).ln()
        };
        known.iter().map(of).sum()
    };
    let (at, share) =
        (known.iter().copied()).min_by(|a, b| all_apart(*a).total_cmp(&all_apart(*b)))?;
    let agrees = |other: &&(usize, usize)| {
        let (difference, least) = apart((at, share), **other);
        other.1 != share && difference < 4.0 * least
    };
    let agreed = 2 * known.iter().filter(agrees).count() >= known.len().saturating_sub(1).max(1);
    Some((at, Reference { share, agreed }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn prior(sd: f64) -> Prior {
        let share = |j: usize| {
            let share = Parameter::amplitude(format!("g_{j}"), "1", [-0.9, 3.0], 0.1);
            share.of_field().of_joint(j)
        };
        Prior {
            parameters: vec![share(0), share(1)],
            mean: vec![0.0; 2],
            sd: vec![sd; 2],
            choice: vec![0.0],
            weights: vec![0.5; 2],
        }
    }

    /// Against the integral over the one share that is left, whose prior is that of two of opposite sign.
    #[test]
    fn val_the_evidence_of_tied_shares_is_that_of_one() {
        let (a, b) = ([1.0, 2.0, -0.5, 0.3], [0.7, -1.0, 0.4, 2.0]);
        let y = [0.5, 1.5, -0.6, -0.4];
        let prior = prior(0.3);
        let mut normal = Normal::new(&y, &[&a, &b]);
        let tied = tie(&prior, &mut normal);
        let fit = normal.fit(&prior.sd, &[[-9.0, 9.0]; 2]).unwrap();
        let likelihood = |t: f64| -> f64 {
            let rows = y.iter().zip(a.iter().zip(&b));
            let left = rows.map(|(y, (a, b))| (y - t * (a - b)).powi(2) - y * y);
            (-0.5 * left.sum::<f64>()).exp()
        };
        let sd = prior.sd[0] / 2.0_f64.sqrt();
        let step = 1e-4;
        let density =
            |t: f64| (-0.5 * (t / sd).powi(2)).exp() / (sd * std::f64::consts::TAU.sqrt());
        let at = |k: i32| step * f64::from(k);
        let integral: f64 = (-20_000..20_000)
            .map(|k| likelihood(at(k)) * density(at(k)) * step)
            .sum();
        assert!((tied + fit.gain - integral.ln()).abs() < 1e-3);
        assert!((fit.theta[0] + fit.theta[1]).abs() < 1e-4);
    }

    /// Torques stay, and the mean is zero.
    #[test]
    fn val_centered_shares_scale_the_stiffness() {
        let (theta, scale) = centered(&prior(0.3), vec![0.5, 0.2]);
        assert!((mean(&prior(0.3), &theta)).abs() < 1e-12);
        for (now, was) in theta.iter().zip([0.5, 0.2]) {
            assert!(((1.0 + now) * scale - (1.0 + was)).abs() < 1e-12);
        }
        assert!(cost(&prior(0.3), &theta) < 1e-12 && cost(&prior(0.3), &[0.5, 0.2]) > 1e4);
    }

    #[test]
    fn two_effects_that_scale_the_field_are_not_tied() {
        let both = prior(0.3).and(prior(0.2));
        assert!(tied(&both).is_empty() && tied(&prior(0.3)).len() == 2);
    }
}
