//! How large effects have to be for a recording to show them.

use crate::evidence::Normal;
use crate::screen::{Screened, Tangent};
use crate::{Effect, Site};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Standard normal quantile of the probability with which an effect of the stated size shows, 80 %.
const POWER: f64 = 0.8416;

/// The smallest size of a parameter that a recording shows: its effect, with this parameter alone, would be named with
/// a probability of 80 %. To first order in the parameter, beside a field that takes what it can, and beside what the
/// nominal model leaves unexplained: where a gap is, limits are those of a further effect that comes with it.
///
/// The minimal detectable bias of W. Baarda, "A testing procedure for use in geodetic networks", 1968, with the
/// evidence that an effect needs here in place of the critical value of a test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the parameter.
    pub name: String,
    /// Its smallest size that shows, of either sign; `null` where no plausible one does.
    pub value: Option<f64>,
    /// Its unit.
    pub unit: String,
}

/// The limits of the amplitudes of an effect that has to gain `needed` nats, the parameter that shows best first: as
/// a multiple of its typical size.
pub(crate) fn limits(
    effect: &dyn Effect,
    site: &Site,
    tangents: &[Tangent],
    screened: &[Screened],
    needed: f64,
) -> Vec<Limit> {
    let parameters = effect.parameters(site);
    let mut least = vec![f64::INFINITY; parameters.len()];
    for s in screened {
        let tangent = &tangents[s.tangent];
        if tangent.effect.name() == effect.name() {
            let sizes = sizes(&s.normal, &tangent.sd, needed + tangent.choice);
            for (&i, size) in tangent.amplitudes.iter().zip(sizes) {
                least[i] = least[i].min(size);
            }
        }
    }
    let acting = |i: &usize| tangents_of(effect, tangents).any(|t| t.amplitudes.contains(i));
    let mut found: Vec<usize> = (0..parameters.len()).filter(acting).collect();
    let in_scales = |i: &usize| least[*i] / parameters[*i].scale;
    found.sort_by(|a, b| in_scales(a).total_cmp(&in_scales(b)));
    (found.into_iter())
        .map(|i| {
            let p = &parameters[i];
            let most = p.bounds.iter().fold(0.0_f64, |most, b| most.max(b.abs()));
            Limit {
                name: p.name.clone(),
                value: Some(least[i]).filter(|size| *size <= most),
                unit: p.unit.to_owned(),
            }
        })
        .collect()
}

fn tangents_of<'t>(
    effect: &dyn Effect,
    tangents: &'t [Tangent],
) -> impl Iterator<Item = &'t Tangent> {
    let name = effect.name().to_owned();
    tangents.iter().filter(move |t| t.effect.name() == name)
}

/// The size of each amplitude, alone, at which the evidence grows by `needed` nats: infinite for those that change
/// nothing. The gain is that of [`Normal::fit`] for readings that are the effect itself.
fn sizes(normal: &Normal, sd: &[f64], needed: f64) -> Vec<f64> {
    let p = sd.len();
    let information = &normal.information;
    // In units of the prior's deviations.
    let scaled = DMatrix::from_fn(p, p, |i, j| sd[i] * sd[j] * information[(i, j)]);
    let Some(factor) = (&scaled + DMatrix::identity(p, p)).cholesky() else {
        return vec![f64::INFINITY; p];
    };
    let shown = &scaled * factor.solve(&scaled);
    let needed = (2.0 * needed + normal.log_det(sd)).max(0.0).sqrt() + POWER;
    let size = |i: usize| match shown[(i, i)] {
        shown if shown > 0.0 => needed * sd[i] / shown.sqrt(),
        _ => f64::INFINITY,
    };
    (0..p).map(size).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One column of ten readings with white noise of deviation 0.1: the closed form.
    #[test]
    fn the_size_of_a_bias_is_that_of_its_mean() {
        let noise = 0.1;
        let white = [1.0 / noise; 10];
        let normal = Normal::new(&[0.0; 10], &[&white]);
        let (sd, needed) = (50.0, 12.0);
        let found = sizes(&normal, &[sd], needed);
        let deviation = noise / 10f64.sqrt();
        let cost = (sd / deviation).powi(2).ln_1p();
        let expected = deviation * ((2.0 * needed + cost).sqrt() + POWER);
        assert!((found[0] / expected - 1.0).abs() < 1e-4, "{found:?}");
        // At that size less the power's share, the evidence grows by what is needed.
        let size = found[0] - POWER * deviation;
        let readings = white.map(|w| size * w);
        let gain = Normal::new(&readings, &[&white])
            .fit(&[sd], &[[-100.0, 100.0]])
            .map_or(0.0, |fit| fit.gain);
        assert!((gain / needed - 1.0).abs() < 1e-3, "{gain}");
    }

    #[test]
    fn what_changes_nothing_never_shows() {
        let normal = Normal::new(&[1.0, 2.0], &[&[0.0, 0.0], &[1.0, 1.0]]);
        let found = sizes(&normal, &[1.0, 1.0], 1.0);
        assert_eq!(found[0], f64::INFINITY);
        assert!(found[1].is_finite());
    }
}
