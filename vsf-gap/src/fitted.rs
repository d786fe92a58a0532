use crate::campaign::sequence_begins;
use crate::design::Design;
use crate::evidence::{Errors, Factor, Parts, Spread, field_mean, times};
use crate::windows::Windows;
use crate::{Campaign, ContactLog, GapError, Model, Motion};
use faer::Mat;
use std::sync::Arc;

/// Number of standard deviations of the noise beyond which readings count as similar or opposite to torques.
const SURE: f64 = 4.0;

/// A model on sequences: contacts, columns and covariance.
pub(crate) struct Fitted<'a> {
    /// The model.
    pub(crate) model: Model,
    /// The sequences.
    pub(crate) motions: Vec<&'a Motion>,
    /// Their contacts.
    pub(crate) logs: Vec<Arc<ContactLog>>,
    /// How samples are averaged.
    pub(crate) windows: Windows,
    /// Columns and torques.
    pub(crate) design: Design,
    /// Readings over windows.
    pub(crate) readings: Vec<f64>,
    /// Parts of the covariance.
    pub(crate) parts: Parts,
    /// The uniform stiffness (N/m) that explains the readings best.
    pub(crate) uniform: f64,
    /// Correlation, in the windows in contact, of the torques of a uniform stiffness with the readings minus the torques
    /// that do not depend on the stiffness, -1 to 1; 0 if it may be due to noise.
    pub(crate) likeness: f64,
    /// Whether anything is touched, points that were removed included.
    pub(crate) touched: bool,
}
impl Campaign {
    /// Computes contacts, columns and covariance of a model over sequences.
    ///
    /// # Errors
    /// Rows that contact cannot take; parameters that an effect cannot take.
    pub(crate) fn fitted<'a>(
        &self,
        model: &Model,
        motions: impl IntoIterator<Item = &'a Motion>,
    ) -> Result<Fitted<'a>, GapError> {
        let d = self.site.joints();
        let motions: Vec<&Motion> = motions.into_iter().collect();
        let windows = self.windows(&motions);
        let logs = self.contact_logs(model, &motions)?;
        let design = self.design(model, &motions, &logs, &windows)?;
        let readings = windows.means(|s| &motions[s].reading);
        let joint_rms: Vec<f64> = (0..d)
            .map(|j| {
                let rows = readings.iter().skip(j).step_by(d);
                let n = windows.list.len().max(1) as f64;
                let rms = (rows.map(|y| y * y).sum::<f64>() / n).sqrt();
                rms.max(self.noise[j].sd)
            })
            .collect();
        // Noise that is zero by construction still has rounding.
        let scale = joint_rms.iter().fold(0.0_f64, |a, b| a.max(*b)).max(1e-9);
        let mut noise = windows.noise(&self.noise);
        let own = noise.iter_mut().filter(|(row, col, _)| row == col);
        own.for_each(|(.., v)| *v = v.max(1e-6 * scale * scale));
        let lever = self.lever(&logs, &windows);
        let errors = Errors {
            noise,
            zeros: windows.zeros(&motions, &self.noise),
            joint_rms,
            walks: model.random_walks(&self.site)?,
            begins: sequence_begins(&motions),
            tared: motions.iter().map(|m| m.tare > 0).collect(),
        };
        let rest = self.site.rest.positions();
        let parts = Parts::new(&design, rest, &windows, lever, errors);
        let unit = parts.unit_field();
        let squares: f64 = unit.iter().map(|u| u * u).sum();
        let rest = readings.iter().zip(&design.a).map(|(y, a)| y - a);
        let along: f64 = unit.iter().zip(rest).map(|(u, y)| u * y).sum();
        let uniform = if squares > 0.0 {
            (along / squares).abs()
        } else {
            1.0
        };
        let likeness = likeness(unit, &readings, &design.a, d, parts.noise_along(unit));
        Ok(Fitted {
            model: model.clone(),
            motions,
            logs,
            windows,
            uniform,
            likeness,
            touched: (0..design.w.ncols())
                .any(|k| design.w.col_as_slice(k).iter().any(|w| *w != 0.0)),
            design,
            readings,
            parts,
        })
    }
}

impl Fitted<'_> {
    /// Removes points from the model.
    pub(crate) fn leave_out(&mut self, campaign: &Campaign, out: impl Fn(u32) -> bool) {
        let (left, kept): (Vec<usize>, Vec<usize>) =
            (0..self.design.points.len()).partition(|&k| out(self.design.points[k]));
        let w = &self.design.w;
        let columns = |of: &[usize]| Mat::from_fn(w.nrows(), of.len(), |i, k| w[(i, of[k])]);
        let (out, w) = (columns(&left), columns(&kept));
        self.design.points = kept.iter().map(|&k| self.design.points[k]).collect();
        self.design.w = w;
        let rest = campaign.site.rest.positions();
        self.parts.leave_out(&out, &self.design, rest);
    }

    /// Whether anything is touched.
    pub(crate) fn touches(&self) -> bool {
        !self.design.points.is_empty()
    }

    /// Readings minus the torques that do not depend on the stiffness.
    pub(crate) fn rest(&self) -> Vec<f64> {
        (self.readings.iter().zip(&self.design.a))
            .map(|(y, a)| y - a)
            .collect()
    }

    /// Log evidence of the readings, without constants.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn log_evidence(&self, spread: &Spread) -> Result<f64, GapError> {
        let factor = self.parts.factor(spread)?;
        Ok(self.log_evidence_of(&factor))
    }

    /// The log evidence for an existing factor.
    pub(crate) fn log_evidence_of(&self, factor: &Factor) -> f64 {
        log_density(&self.rest(), factor)
    }

    /// Mean stiffness per rest point, without the constraint that it is not negative; `factor` is that of the covariance
    /// with this spread.
    pub(crate) fn stiffness(
        &self,
        campaign: &Campaign,
        spread: &Spread,
        factor: &Factor,
    ) -> Vec<f64> {
        self.field(campaign, spread, &factor.solved(&self.rest()))
    }

    /// The same from readings that are already solved with the covariance.
    pub(crate) fn field(&self, campaign: &Campaign, spread: &Spread, solved: &[f64]) -> Vec<f64> {
        let positions = campaign.site.rest.positions();
        let touched = field_mean(&self.design, positions, spread, solved);
        let mut field = vec![0.0; positions.len()];
        for (&p, k) in self.design.points.iter().zip(touched) {
            field[p as usize] = k;
        }
        field
    }

    /// The model's torques over windows for a stiffness per rest point.
    pub(crate) fn predicted(&self, stiffness: &[f64]) -> Vec<f64> {
        let own: Vec<f64> = (self.design.points.iter())
            .map(|&p| stiffness[p as usize])
            .collect();
        let mut tau = times(&self.design.w, &own);
        tau.iter_mut()
            .zip(&self.design.a)
            .for_each(|(t, a)| *t += a);
        tau
    }
}

/// Correlation of `unit` with `readings - a` (`d` joints per window) in the windows where `unit` is not zero; `noise` is
/// the variance of the product of `unit` with the noise.
fn likeness(unit: &[f64], readings: &[f64], a: &[f64], d: usize, noise: f64) -> f64 {
    let [mut along, mut squares, mut energy] = [0.0; 3];
    let windows = unit.chunks(d).zip(readings.chunks(d).zip(a.chunks(d)));
    for (u, (y, a)) in windows.filter(|(u, _)| u.iter().any(|u| *u != 0.0)) {
        for (u, (y, a)) in u.iter().zip(y.iter().zip(a)) {
            let rest = y - a;
            along += u * rest;
            squares += u * u;
            energy += rest * rest;
        }
    }
    let product = (squares * energy).sqrt();
    if product > 0.0 && along.abs() > SURE * noise.sqrt() {
        along / product
    } else {
        0.0
    }
}

pub(crate) fn whitened(values: &[f64], factor: &Factor) -> Vec<f64> {
    let mut y = Mat::from_fn(values.len(), 1, |i, _| values[i]);
    factor.whiten(&mut y);
    y.col_as_slice(0).to_vec()
}

/// Log density of values of mean zero, without constants.
pub(crate) fn log_density(values: &[f64], factor: &Factor) -> f64 {
    let squares: f64 = whitened(values, factor).iter().map(|y| y * y).sum();
    -0.5 * (factor.log_det() + squares)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of windows without contact nothing counts, and what does not depend on the stiffness is taken off first.
    #[test]
    fn likeness_is_of_what_is_left_to_the_springs() {
        let unit = [1.0, 2.0, 0.0, 0.0, 2.0, 1.0];
        let a = [5.0, 5.0, 5.0, 5.0, 5.0, 5.0];
        let of = |k: f64, air: f64, noise: f64| {
            let readings = [k + 5.0, 2.0 * k + 5.0, air, air, 2.0 * k + 5.0, k + 5.0];
            likeness(&unit, &readings, &a, 2, noise)
        };
        assert!((of(3.0, 100.0, 0.0) - 1.0).abs() < 1e-12);
        assert!((of(-3.0, 100.0, 0.0) + 1.0).abs() < 1e-12);
        // The product is 30, and has to be more than four deviations.
        assert!(of(-3.0, 0.0, 49.0) < -0.9);
        assert_eq!(of(-3.0, 0.0, 64.0), 0.0);
        assert_eq!(likeness(&[0.0; 2], &[1.0; 2], &[0.0; 2], 2, 0.0), 0.0);
    }
}
