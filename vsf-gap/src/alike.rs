//! How much of each effect the stiffness absorbs, and which effects look alike.

use crate::GapError;
use crate::evidence::{Factor, Normal, Spread};
use crate::screen::Tangent;
use crate::search::{Candidate, Search};
use faer::Mat;
use std::collections::BTreeMap;

/// Share of an effect's torques that another one must imitate for the two to be ambiguous.
const ALIKE: f64 = 0.9;

/// Similarity of the effects of a search to each other and to the stiffness.
pub(crate) struct Likeness {
    /// The share of every candidate's information that the stiffness absorbs: see [`Likeness::absorbed`].
    absorbed: BTreeMap<String, f64>,
    /// Two effects, and the share of the first one's torques that the second can imitate.
    pairs: Vec<(String, String, f64)>,
}

impl Likeness {
    /// Computes the similarity of the effects of a search.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn new(search: &Search<'_>) -> Result<Self, GapError> {
        let parts = &search.nominal.parts;
        let bare = Spread {
            point: 0.0,
            smooth: 0.0,
            level: 0.0,
            ..search.spread
        };
        let free = parts.factor(&search.spread)?;
        // That of a known stiffness may be singular.
        let known = parts.factor(&bare).ok();
        let of = |c: &Candidate| {
            let share = absorbed(&search.tangents[c.found.tangent], &free, known.as_ref()?);
            Some((c.effect.name().to_owned(), share?))
        };
        Ok(Self {
            absorbed: search.candidates.iter().filter_map(of).collect(),
            pairs: pairs(search, &free),
        })
    }

    /// The effects that imitate another one when the stiffness is free.
    pub(crate) fn ambiguous_with(&self, effect: &str) -> Vec<String> {
        let alike = |(a, _, share): &&(String, String, f64)| a == effect && *share > ALIKE;
        let with = self.pairs.iter().filter(alike).map(|(_, b, _)| b.clone());
        with.collect()
    }

    /// The share of an effect's information that the stiffness absorbs, 0 to 1; `None` for effects that change nothing or
    /// were not looked for.
    pub(crate) fn absorbed(&self, effect: &str) -> Option<f64> {
        self.absorbed.get(effect).copied()
    }
}

/// The share of a tangent's information that is lost when the stiffness is free instead of known.
fn absorbed(tangent: &Tangent, free: &Factor, known: &Factor) -> Option<f64> {
    let columns = &tangent.columns;
    let n = columns.first()?.len();
    let information = |factor: &Factor| {
        let mut all = Mat::from_fn(n, columns.len(), |i, k| columns[k][i] * tangent.sd[k]);
        factor.whiten(&mut all);
        (0..columns.len())
            .map(|k| all.col_as_slice(k).iter().map(|v| v * v).sum::<f64>())
            .sum::<f64>()
    };
    let whole = information(known);
    (whole > 0.0).then(|| (1.0 - information(free) / whole).clamp(0.0, 1.0))
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
