//! What the stiffness absorbs of effects, and which of them look alike.

use crate::GapError;
use crate::evidence::{Factor, Normal, Spread};
use crate::screen::Tangent;
use crate::search::{Candidate, Search};
use faer::Mat;

/// Share of an effect's torques that another must imitate for the two to be one group.
const ALIKE: f64 = 0.9;

/// The effects of a search beside each other, and beside the stiffness.
pub(crate) struct Likeness<'a> {
    tangents: &'a [Tangent],
    /// Factored covariances of the readings with a free stiffness, and with a known one, which may be
    /// singular.
    free: Factor,
    known: Option<Factor>,
    /// Two effects, and the share of the first one's torques that the second can imitate.
    pairs: Vec<(String, String, f64)>,
}

impl<'a> Likeness<'a> {
    /// Of the effects that were fitted.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn new(search: &'a Search<'_>) -> Result<Self, GapError> {
        let parts = &search.nominal.parts;
        let bare = Spread {
            point: 0.0,
            smooth: 0.0,
            level: 0.0,
            ..search.spread
        };
        let free = parts.factor(&search.spread)?;
        Ok(Self {
            tangents: &search.tangents,
            pairs: pairs(search, &free),
            free,
            known: parts.factor(&bare).ok(),
        })
    }

    /// The effects that imitate another one, the stiffness being free.
    pub(crate) fn ambiguous_with(&self, effect: &str) -> Vec<String> {
        let alike = |(a, _, share): &&(String, String, f64)| a == effect && *share > ALIKE;
        let with = self.pairs.iter().filter(alike).map(|(_, b, _)| b.clone());
        with.collect()
    }

    /// The share of an effect's information that the stiffness absorbs: what is left of its tangents,
    /// beside what they would tell were the stiffness known.
    pub(crate) fn absorbed(&self, candidate: &Candidate) -> Option<f64> {
        let tangent = &self.tangents[candidate.found.tangent];
        let columns = &tangent.columns;
        let n = columns.first()?.len();
        let information = |factor: &Factor| {
            let mut all = Mat::from_fn(n, columns.len(), |i, k| columns[k][i] * tangent.sd[k]);
            factor.whiten(&mut all);
            (0..columns.len())
                .map(|k| all.col_as_slice(k).iter().map(|v| v * v).sum::<f64>())
                .sum::<f64>()
        };
        let whole = information(self.known.as_ref()?);
        (whole > 0.0).then(|| (1.0 - information(&self.free) / whole).clamp(0.0, 1.0))
    }
}

/// For every pair of fitted effects, the share of the first one's torques that the second can
/// imitate; `factor` is that of the covariance with a free stiffness.
fn pairs(search: &Search<'_>, factor: &Factor) -> Vec<(String, String, f64)> {
    let n = search.nominal.readings.len();
    // Torques of the effect as fitted, and whitened tangents around there.
    let mut white = Vec::new();
    for candidate in &search.candidates {
        let Some(refined) = &candidate.refined else {
            continue;
        };
        let amplitudes = &search.tangents[candidate.found.tangent].amplitudes;
        let columns: Vec<&[f64]> = refined.moving_columns().collect();
        let mut all = Mat::from_fn(n, columns.len() + 1, |i, k| match k {
            0 => (amplitudes.iter())
                .map(|&p| refined.tangent[p][i] * refined.theta[p])
                .sum(),
            k => columns[k - 1][i],
        });
        factor.whiten(&mut all);
        white.push((candidate.effect.name().to_owned(), all));
    }
    let mut pairs = Vec::new();
    for (a, of_a) in &white {
        for (b, of_b) in white.iter().filter(|(b, _)| a != b) {
            let signal = of_a.col_as_slice(0);
            let whole: f64 = signal.iter().map(|v| v * v).sum();
            let columns: Vec<&[f64]> = (1..of_b.ncols()).map(|k| of_b.col_as_slice(k)).collect();
            let normal = Normal::new(signal, &columns);
            let ridge = 1e-9 * normal.information.trace().max(f64::MIN_POSITIVE);
            let damped = &normal.information
                + nalgebra::DMatrix::identity(columns.len(), columns.len()) * ridge;
            let explained = damped
                .cholesky()
                .map_or(0.0, |f| normal.score.dot(&f.solve(&normal.score)));
            if whole > 0.0 {
                pairs.push((a.clone(), b.clone(), (explained / whole).clamp(0.0, 1.0)));
            }
        }
    }
    pairs
}
