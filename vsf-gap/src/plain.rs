//! How much a uniform stiffness and an effect explain together, compared with a free stiffness alone. A field that grows
//! stiff with depth and springs that stiffen push alike.

use crate::fitted::Fitted;
use crate::{Acts, Campaign, Effect, GapError, Model};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// Share of what a free stiffness explains beyond a uniform one. An effect that explains at least this share, with a
/// uniform stiffness, is equivalent to the field.
const SAME: f64 = 0.8;
/// Smallest share of what a uniform stiffness leaves that a free stiffness has to explain.
const CALLED_FOR: f64 = 0.75;

/// An effect together with a uniform stiffness.
pub(crate) struct Plain {
    pub(crate) effect: Arc<dyn Effect>,
    /// Its parameters.
    pub(crate) theta: Vec<f64>,
    /// The uniform stiffness (N/m).
    pub(crate) stiffness: f64,
    /// Energy of the residuals over windows.
    left: f64,
}

/// A uniform stiffness, alone and with each effect that acts on springs.
pub(crate) struct Plainly {
    /// Energy of the residuals without an effect.
    alone: f64,
    with: Vec<Plain>,
}

impl Plainly {
    /// The effects that explain as much as a free stiffness, best first. Each comes with its share of what the free
    /// stiffness explains beyond a uniform one.
    ///
    /// `free` is the energy that the free stiffness leaves, `nominal` the model that was fitted.
    ///
    /// # Errors
    /// Parameters that an effect cannot take.
    pub(crate) fn instead_of_field(
        &self,
        campaign: &Campaign,
        nominal: &Fitted<'_>,
        free: f64,
    ) -> Result<Vec<(&Plain, f64)>, GapError> {
        let explained = self.alone - free;
        let mut same = Vec::new();
        if explained < CALLED_FOR * self.alone || explained <= 0.0 {
            return Ok(same);
        }
        let share = |left: f64| (self.alone - left) / explained;
        for plain in self.with.iter().filter(|p| share(p.left) >= SAME) {
            // Springs need not be linear in the parameters.
            let model = Model::of(&plain.effect, &plain.theta);
            let torques = |stiffness: f64| {
                let field = vec![stiffness; campaign.site.rest.len()];
                let Fitted {
                    motions,
                    logs,
                    windows,
                    ..
                } = nominal;
                let torques = campaign.torques(&model, motions, logs, windows, &field)?;
                Ok::<_, GapError>(DVector::from_vec(torques))
            };
            let additive = torques(0.0)?;
            let unit = torques(1.0)? - &additive;
            let rest = DVector::from_column_slice(&nominal.readings) - additive;
            let (_, left) = scaled(&unit, &rest);
            if share(left) >= SAME {
                same.push((plain, share(left)));
            }
        }
        same.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok(same)
    }
}

/// The factor, not negative, that brings torques closest to the readings, and the energy of the residuals.
fn scaled(torques: &DVector<f64>, readings: &DVector<f64>) -> (f64, f64) {
    let factor = torques.dot(readings) / torques.norm_squared();
    let factor = if factor > 0.0 { factor } else { 0.0 };
    (factor, (readings - torques * factor).norm_squared())
}

impl Campaign {
    /// Fits a uniform stiffness to the readings of a nominal model, alone and with each of the effects.
    ///
    /// # Errors
    /// Parameters that an effect cannot take.
    pub(crate) fn plainly<'e>(
        &self,
        nominal: &Fitted<'_>,
        effects: impl Iterator<Item = &'e Arc<dyn Effect>>,
    ) -> Result<Plainly, GapError> {
        let field = vec![1.0; self.site.rest.len()];
        let unit = DVector::from_column_slice(nominal.parts.unit_field());
        let readings = DVector::from_column_slice(&nominal.readings);
        let mut with: Vec<Plain> = Vec::new();
        for effect in effects.filter(|e| e.acts() == Acts::Springs) {
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
                let mut theta = tangent.start.clone();
                let mut predicted = unit.clone();
                for (k, (&i, column)) in tangent.amplitudes.iter().zip(&columns).enumerate() {
                    let [lo, hi] = tangent.bounds[k];
                    // Of an effect alone, without stiffness, there is never too much.
                    theta[i] = if fit[0] > 0.0 {
                        (fit[k + 1] / fit[0]).clamp(lo, hi)
                    } else if fit[k + 1] > 0.0 {
                        hi
                    } else {
                        lo
                    };
                    predicted += column * theta[i];
                }
                let (stiffness, left) = scaled(&predicted, &readings);
                if stiffness > 0.0 && best.as_ref().is_none_or(|b| left < b.left) {
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
        Ok(Plainly {
            alone: scaled(&unit, &readings).1,
            with,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stiffness_is_scaled_to_the_readings_and_never_negative() {
        let torques = DVector::from_column_slice(&[1.0, 2.0, 0.0]);
        // What is at right angles to the torques is left.
        let readings = DVector::from_column_slice(&[3.0, 6.0, 5.0]);
        let (factor, left) = scaled(&torques, &readings);
        assert!((factor - 3.0).abs() < 1e-12 && (left - 25.0).abs() < 1e-12);
        assert_eq!(
            scaled(&torques, &-&readings),
            (0.0, readings.norm_squared())
        );
        // Nothing is touched.
        let nothing = DVector::zeros(3);
        assert_eq!(scaled(&nothing, &readings), (0.0, readings.norm_squared()));
    }
}
