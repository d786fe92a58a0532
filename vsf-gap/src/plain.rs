//! What one stiffness everywhere explains together with an effect, beside what a free one explains alone: a
//! field that grows stiff with depth and springs that stiffen push alike.

use crate::nominal::Fitted;
use crate::{Acts, Campaign, Effect, GapError, Model};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// The share of what a free stiffness explains beyond a uniform one, from which on an effect with a uniform
/// one says the same.
const SAME: f64 = 0.8;
/// A free stiffness has to explain at least this share of what a uniform one leaves.
const CALLED_FOR: f64 = 0.75;

/// An effect beside one stiffness everywhere.
pub(crate) struct Plain {
    pub(crate) effect: Arc<dyn Effect>,
    /// Its parameters.
    pub(crate) theta: Vec<f64>,
    /// The stiffness (N/m).
    pub(crate) stiffness: f64,
    /// The energy of the readings over windows that is left.
    left: f64,
}

/// One stiffness everywhere, alone and with each effect that acts on springs.
pub(crate) struct Plainly {
    /// The energy that it leaves alone.
    alone: f64,
    with: Vec<Plain>,
}

impl Plainly {
    /// The effects that explain as much as a free stiffness does, which leaves the energy `free`, and the
    /// share that they explain of what it explains beyond a uniform one; best first.
    pub(crate) fn instead_of_field(&self, free: f64) -> Vec<(&Plain, f64)> {
        let explained = self.alone - free;
        if explained < CALLED_FOR * self.alone {
            return Vec::new();
        }
        let share = |p: &Plain| (self.alone - p.left) / explained;
        let mut same: Vec<(&Plain, f64)> = self.with.iter().map(|p| (p, share(p))).collect();
        same.retain(|(_, share)| *share >= SAME);
        same.sort_by(|a, b| b.1.total_cmp(&a.1));
        same
    }
}

impl Campaign {
    /// Fits one stiffness to the readings of a nominal model, alone and with each of the effects.
    ///
    /// # Errors
    /// Parameters that an effect cannot take.
    pub(crate) fn plainly<'e>(
        &self,
        nominal: &Fitted<'_>,
        effects: impl Iterator<Item = &'e Arc<dyn Effect>>,
    ) -> Result<Plainly, GapError> {
        let field = vec![1.0; self.site.rest.len()];
        let unit = DVector::from_vec(nominal.predicted(&field));
        let readings = DVector::from_column_slice(&nominal.readings);
        let mut with: Vec<Plain> = Vec::new();
        for effect in effects.filter(|e| e.acts() == Acts::Springs) {
            let parameters = effect.parameters(&self.site);
            let mut best: Option<Plain> = None;
            for tangent in self.tangents(&Model::default(), nominal, &field, effect)? {
                let columns = (tangent.columns.iter()).map(|c| DVector::from_column_slice(c));
                let columns: Vec<DVector<f64>> = columns.collect();
                let all = [vec![unit.clone()], columns.clone()].concat();
                let all = DMatrix::from_columns(&all);
                let Some(normal) = (all.transpose() * &all).cholesky() else {
                    continue;
                };
                let fit = normal.solve(&(all.transpose() * &readings));
                if fit[0] <= 0.0 {
                    continue;
                }
                let mut theta = tangent.start.clone();
                let mut predicted = unit.clone();
                for (k, (&i, column)) in tangent.amplitudes.iter().zip(&columns).enumerate() {
                    let [lo, hi] = parameters[i].bounds;
                    theta[i] = (fit[k + 1] / fit[0]).clamp(lo, hi);
                    predicted += column * theta[i];
                }
                let stiffness = predicted.dot(&readings) / predicted.norm_squared();
                if !stiffness.is_finite() {
                    continue;
                }
                let left = (&readings - predicted * stiffness).norm_squared();
                if best.as_ref().is_none_or(|b| left < b.left) {
                    best = Some(Plain {
                        effect: effect.clone(),
                        theta,
                        stiffness,
                        left,
                    });
                }
            }
            with.extend(best);
        }
        let scale = unit.dot(&readings) / unit.norm_squared().max(f64::MIN_POSITIVE);
        Ok(Plainly {
            alone: (&readings - unit * scale).norm_squared(),
            with,
        })
    }
}
