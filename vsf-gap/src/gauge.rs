//! Shares by which joints scale the torques of the field: equal ones are a scale of the stiffness, which the field has
//! already. They are fitted with mean zero, so that no evidence comes from such a scale, and told relative to the joint
//! that most others agree with, so that few differ.

use crate::Parameter;
use crate::evidence::Normal;
use crate::refine::{Prior, Refined};
use crate::screen::Tangent;
use nalgebra::DMatrix;

/// How far the mean may be from zero.
const TIED: f64 = 1e-3;
/// Shares that differ by less agree, however sure they are.
const AGREE: f64 = 0.03;
/// A share whose deviation is more than this part of that of its prior is not known.
const KNOWN: f64 = 0.9;

/// Weights of an effect's parameters in the mean that is zero, by the energy of what they change; all 0 of an effect
/// that does not scale the field, or not of every joint.
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

/// The shares that are tied: their places among the parameters that may move, and among all.
fn tied(prior: &Prior) -> impl Iterator<Item = (usize, usize)> {
    let moving = prior.moving().enumerate();
    moving.filter(|(_, i)| prior.weights[*i] > 0.0)
}

/// Nats that it costs that their mean is not zero.
pub(crate) fn cost(prior: &Prior, theta: &[f64]) -> f64 {
    let mean: f64 = tied(prior).map(|(_, i)| prior.weights[i] * theta[i]).sum();
    0.5 * (mean / TIED).powi(2)
}

/// Ties them in what readings tell of the parameters that may move, and returns what that adds to the log evidence: the
/// prior is one of shares of mean zero.
pub(crate) fn tie(prior: &Prior, normal: &mut Normal) -> f64 {
    let own: Vec<(usize, usize)> = tied(prior).collect();
    let weight = |i: usize| prior.weights[i] / TIED;
    for &(a, i) in &own {
        for &(b, j) in &own {
            normal.information[(a, b)] += weight(i) * weight(j);
        }
    }
    let of_prior = |(_, i): &(usize, usize)| (weight(*i) * prior.sd[*i]).powi(2);
    0.5 * own.iter().map(of_prior).sum::<f64>().ln_1p()
}

/// Scales the stiffness of a model such that the joint that most others agree with has no share, if that leaves all
/// shares within their bounds; takes the covariance of the parameters that may move and returns what it is then. The
/// model predicts what it did.
pub(crate) fn relative(model: &mut Refined, covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let own: Vec<(usize, usize)> = tied(&model.prior).collect();
    let Some(reference) = reference(model, &own, covariance) else {
        return covariance.clone();
    };
    let scale = 1.0 + model.theta[reference.1];
    let mut theta = model.theta.clone();
    let mut turn = DMatrix::identity(covariance.nrows(), covariance.ncols());
    for &(k, i) in &own {
        let share = 1.0 + theta[i];
        theta[i] = share / scale - 1.0;
        turn[(k, k)] = 1.0 / scale;
        turn[(k, reference.0)] -= share / (scale * scale);
    }
    turn.row_mut(reference.0).fill(0.0);
    theta[reference.1] = 0.0;
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
    &turn * covariance * turn.transpose()
}

/// The share that others are relative to, among all parameters, if a model has such ones.
pub(crate) fn reference_of(model: &Refined) -> Option<usize> {
    let mut own = tied(&model.prior).map(|(_, i)| i);
    own.find(|&i| model.sd[i] == 0.0)
}

/// Where the share of the joint that most others agree with is, among the parameters that may move and among all.
fn reference(
    model: &Refined,
    own: &[(usize, usize)],
    covariance: &DMatrix<f64>,
) -> Option<(usize, usize)> {
    let is_known =
        |&&(k, i): &&(usize, usize)| covariance[(k, k)].sqrt() < KNOWN * model.prior.sd[i];
    let known: Vec<(usize, usize)> = own.iter().filter(is_known).copied().collect();
    // Of sums of logs: a joint far off counts little more than one that is off.
    let apart = |(k, i): (usize, usize)| -> f64 {
        let from = |&(l, j): &(usize, usize)| {
            let variance = covariance[(k, k)] + covariance[(l, l)] - 2.0 * covariance[(k, l)];
            let difference = model.theta[i] - model.theta[j];
            (AGREE * AGREE + variance.max(0.0) + difference * difference).ln()
        };
        known.iter().map(from).sum()
    };
    (known.iter().copied()).min_by(|a, b| apart(*a).total_cmp(&apart(*b)))
}
