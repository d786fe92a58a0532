//! How large effects have to be for a recording to show them.

use crate::evidence::Normal;
use crate::screen::{Screening, Tangent, log_mean_exp};
use crate::{Effect, Site};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Standard normal quantile of 80 %, the probability with which an effect of the stated size shows.
const POWER: f64 = 0.8416;
/// Halvings of the interval in which a size is searched.
const HALVINGS: usize = 60;

/// The smallest size of a parameter that a recording shows.
///
/// With this parameter alone, the effect would gain the log evidence that it needs to be named, with a probability of 80 %.
/// The size is computed to first order in the parameter, for effects whose form is right, beside a field that takes what it
/// can and beside what the nominal model leaves unexplained. Smaller effects stay hidden. Larger ones may, too, if other
/// effects imitate them or if springs err by as much, as they do in contact.
///
/// This is the minimal detectable bias of W. Baarda, "A testing procedure for use in geodetic networks", 1968, with the
/// evidence that an effect needs here in place of the critical value of a test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the parameter.
    pub name: String,
    /// Smallest size that shows, with a sign that it may have; `null` if no plausible size does.
    pub value: Option<f64>,
    /// Its unit.
    pub unit: String,
}

/// The limits of the amplitudes of an effect that has to gain `required_gain` nats. The parameter that shows best, relative
/// to its typical size, comes first. For a more general form, only the amplitudes that its special case lacks.
pub(crate) fn limits(
    effect: &dyn Effect,
    site: &Site,
    tangents: &[Tangent],
    screening: &Screening,
    required_gain: f64,
) -> Vec<Limit> {
    let special = (tangents.iter()).find(|t| Some(t.effect.name()) == effect.extends());
    let special = special.map_or_else(Vec::new, |t| t.effect.parameters(site));
    let parameters = effect.parameters(site);
    let mut least: Vec<Option<f64>> = vec![None; parameters.len()];
    for (t, tangent) in tangents.iter().enumerate() {
        if tangent.effect.name() != effect.name() {
            continue;
        }
        let normals = screening.normals.iter().map(|of_all| &of_all[t]);
        let Some(shown) = normals
            .map(|n| shown(n, &tangent.sd))
            .collect::<Option<Vec<_>>>()
        else {
            continue;
        };
        for (k, &i) in tangent.amplitudes.iter().enumerate() {
            if special.iter().any(|p| p.name == parameters[i].name) {
                continue;
            }
            let required_gain = required_gain + tangent.choice;
            if let Some(size) = size(&screening.nominal, &shown, k, required_gain) {
                let size = tangent.sd[k] * size;
                least[i] = Some(least[i].map_or(size, |other| other.min(size)));
            }
        }
    }
    let mut found: Vec<(f64, Limit)> = (parameters.into_iter().zip(least))
        .filter_map(|(p, least)| {
            let most = p.bounds.iter().fold(0.0_f64, |most, b| most.max(b.abs()));
            let value = Some(least?).filter(|size| *size <= most);
            let in_scales = value.map_or(f64::INFINITY, |size| size / p.scale);
            let (name, unit) = (p.name, p.unit.to_owned());
            Some((in_scales, Limit { name, value, unit }))
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().map(|(_, limit)| limit).collect()
}

/// Information on the amplitudes of a tangent under one spread, in units of their prior deviations.
struct Shown {
    /// Information on each amplitude.
    whole: Vec<f64>,
    /// The part of it that the effect explains under the prior of its amplitudes: see [`Normal::fit`].
    explained: Vec<f64>,
    /// What integrating out the amplitudes costs (nats).
    cost: f64,
}

/// `None` if the numbers do not allow a result.
fn shown(normal: &Normal, sd: &[f64]) -> Option<Shown> {
    let p = sd.len();
    let scaled = DMatrix::from_fn(p, p, |i, j| sd[i] * sd[j] * normal.information[(i, j)]);
    let solved = (&scaled + DMatrix::identity(p, p))
        .cholesky()?
        .solve(&scaled);
    let whole: Vec<f64> = scaled.diagonal().iter().copied().collect();
    let explained = |k: usize| scaled.column(k).dot(&solved.column(k)).min(whole[k]);
    Some(Shown {
        explained: (0..p).map(explained).collect(),
        cost: 0.5 * normal.log_det(sd),
        whole,
    })
}

/// The size of amplitude `k` alone, in its prior deviations, at which the evidence grows by `required_gain` nats. Infinite
/// for one that changes nothing, `None` if the numbers do not allow a result.
///
/// `nominal` is the log evidence of the nominal model, and `all` what the amplitudes tell, at every spread. A real effect
/// makes rougher models likelier, with and without the effect in the model.
fn size(nominal: &[f64], all: &[Shown], k: usize, required_gain: f64) -> Option<f64> {
    let gain = |amplitude: f64| {
        let square = 0.5 * amplitude * amplitude;
        let each = |of: &dyn Fn(&Shown) -> f64| -> Vec<f64> {
            let pairs = nominal.iter().zip(all);
            pairs.map(|(nominal, s)| nominal - of(s)).collect()
        };
        let with = each(&|s| square * (s.whole[k] - s.explained[k]) + s.cost);
        let without = each(&|s| square * s.whole[k]);
        log_mean_exp(&with) - log_mean_exp(&without)
    };
    let explained = all.iter().map(|s| s.explained[k]).fold(0.0, f64::max);
    if explained <= 0.0 {
        return Some(f64::INFINITY);
    }
    let deviation = 1.0 / explained.sqrt();
    let (mut low, mut high) = (0.0, deviation);
    while gain(high) < required_gain {
        (low, high) = (high, 2.0 * high);
        if !gain(high).is_finite() {
            return None;
        }
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if gain(middle) < required_gain {
            low = middle
        } else {
            high = middle
        }
    }
    Some(high + POWER * deviation)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The size of an amplitude in its own unit.
    fn size_of(
        nominal: &[f64],
        normals: &[Normal],
        sd: &[f64],
        k: usize,
        required_gain: f64,
    ) -> Option<f64> {
        let all: Option<Vec<Shown>> = normals.iter().map(|n| shown(n, sd)).collect();
        Some(sd[k] * size(nominal, &all?, k, required_gain)?)
    }

    /// One column of ten readings with white noise of deviation 0.1: the closed form.
    #[test]
    fn the_size_of_a_bias_is_that_of_its_mean() {
        let noise = 0.1;
        let white = [1.0 / noise; 10];
        let normal = Normal::new(&[0.0; 10], &[&white]);
        let (sd, required_gain) = (50.0, 12.0);
        let found = size_of(
            &[-3.0],
            std::slice::from_ref(&normal),
            &[sd],
            0,
            required_gain,
        );
        let deviation = noise / 10f64.sqrt();
        let cost = (sd / deviation).powi(2).ln_1p();
        let expected = deviation * ((2.0 * required_gain + cost).sqrt() + POWER);
        let found = found.unwrap_or(0.0);
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
        // At that size less the power's share, the evidence grows by what is required.
        let size = found - POWER * deviation;
        let readings = white.map(|w| size * w);
        let gain = Normal::new(&readings, &[&white])
            .fit(&[sd], &[[-100.0, 100.0]])
            .map_or(0.0, |fit| fit.gain);
        assert!((gain / required_gain - 1.0).abs() < 1e-3, "{gain}");
    }

    /// A rougher model that is as likely without the effect explains some of it.
    #[test]
    fn roughness_hides_effects() {
        let normal = |noise: f64| Normal::new(&[0.0; 10], &[&[1.0 / noise; 10]]);
        let of = |normals: &[Normal], nominal: &[f64]| size_of(nominal, normals, &[5.0], 0, 12.0);
        let smooth = of(&[normal(0.1)], &[0.0]);
        let rough = of(&[normal(0.2)], &[0.0]);
        let either = of(&[normal(0.1), normal(0.2)], &[0.0, 0.0]);
        assert!(
            smooth < either && either < rough,
            "{smooth:?} {either:?} {rough:?}"
        );
    }

    #[test]
    fn what_changes_nothing_never_shows() {
        let normal = Normal::new(&[1.0, 2.0], &[&[0.0, 0.0], &[1.0, 1.0]]);
        let of = |k| size_of(&[0.0], std::slice::from_ref(&normal), &[1.0, 1.0], k, 1.0);
        assert_eq!(of(0), Some(f64::INFINITY));
        assert!(of(1).is_some_and(f64::is_finite));
    }
}
