use crate::campaign::sequence_begins;
use crate::evidence::{Errors, Factor, Parts, Spread, field_mean, times};
use crate::screen::{best_of, log_mean_exp};
use crate::windows::{Design, Window, Windows};
use crate::{Campaign, ContactLog, GapError, Model, Motion};
use faer::Mat;
use rayon::prelude::*;
use std::sync::Arc;

/// A model fitted to sequences: contacts, columns and the spread that the readings call for.
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
    /// A stiffness (N/m) that, everywhere the same, explains the readings best.
    pub(crate) uniform: f64,
    /// Correlation of the readings with what it gives, -1 to 1.
    pub(crate) likeness: f64,
}

/// Roughness of contact and of joints that are tried.
pub(crate) const CONTACT: [f64; 3] = [0.03, 0.1, 0.3];
pub(crate) const JOINT: [f64; 3] = [0.0, 0.05, 0.2];
/// Random walks of effects that are tried, in their own sizes.
const WALK: [f64; 3] = [0.0, 0.1, 0.3];
/// Spread of single points and of the smooth part, in units of the uniform stiffness.
const POINT: [f64; 3] = [0.3, 1.0, 3.0];
const SMOOTH: [f64; 3] = [0.3, 1.0, 3.0];
const LEVEL: f64 = 3.0;
/// Factors by which both are raised further where the largest suits best, as where a few layers are a
/// hundred times as stiff as the rest; most times that they are.
const RAISE: f64 = 3.0;
const MOST_RAISED: usize = 4;
/// Nats for which a spread is raised once more.
const WORTH_RAISING: f64 = 1.0;
/// A uniform stiffness that differs by less than this factor calls for no other spread.
const RESCALE: f64 = 1.4;

impl Campaign {
    /// Contacts, columns and covariance of a model over sequences.
    ///
    /// # Errors
    /// Rows that contact cannot take, parameters that an effect cannot take.
    pub(crate) fn fitted<'a>(
        &self,
        model: &Model,
        motions: impl IntoIterator<Item = &'a Motion>,
    ) -> Result<Fitted<'a>, GapError> {
        let d = self.site.joints();
        let motions: Vec<&Motion> = motions.into_iter().collect();
        let windows = Windows::new(&motions, d);
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
        let along: f64 = unit.iter().zip(&readings).map(|(u, y)| u * y).sum();
        let uniform = if squares > 0.0 {
            (along / squares).abs()
        } else {
            1.0
        };
        let energy: f64 = readings.iter().map(|y| y * y).sum();
        let product = (squares * energy).sqrt();
        let likeness = if product > 0.0 { along / product } else { 0.0 };
        Ok(Fitted {
            model: model.clone(),
            motions,
            logs,
            windows,
            design,
            readings,
            parts,
            uniform,
            likeness,
        })
    }
}

impl Fitted<'_> {
    /// Takes points out of the model.
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

    /// Readings less the torques that do not depend on the stiffness.
    pub(crate) fn rest(&self) -> Vec<f64> {
        (self.readings.iter().zip(&self.design.a))
            .map(|(y, a)| y - a)
            .collect()
    }

    /// Log of the evidence of the readings, without constants.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn log_evidence(&self, spread: &Spread) -> Result<f64, GapError> {
        let factor = self.parts.factor(spread)?;
        Ok(self.log_evidence_of(&factor))
    }

    /// The same, with the factor at hand.
    pub(crate) fn log_evidence_of(&self, factor: &Factor) -> f64 {
        log_density(&self.rest(), factor)
    }

    /// The rows of windows in which nothing is touched, in order.
    pub(crate) fn rows_in_air(&self) -> Vec<usize> {
        let d = self.windows.joints;
        let touches = |w: &Window| {
            let mut contacts = self.logs[w.sequence].contacts[w.rows.clone()].iter();
            contacts.any(|c| !c.is_empty())
        };
        (self.windows.list.iter().enumerate())
            .filter(|(_, w)| !touches(w))
            .flat_map(|(i, _)| i * d..(i + 1) * d)
            .collect()
    }

    /// Log density of the readings in rows where nothing is touched, without constants, under the roughness of joints that
    /// suits them best.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn log_density_in(&self, rows: &[usize], spread: &Spread) -> Result<f64, GapError> {
        if rows.is_empty() {
            return Ok(0.0);
        }
        let rest = self.rest();
        let spreads = self.roughness(spread);
        // That of contact says nothing there.
        let of_joints = spreads.iter().filter(|s| s.contact == CONTACT[0]);
        let densities: Vec<f64> = of_joints
            .map(|s| log_density_of(&rest, &self.parts.covariance(s), rows))
            .collect::<Result<_, GapError>>()?;
        Ok(densities[best_of(&densities)])
    }

    /// Log density of the readings of the other sequences, given those of some, without constants; with a spread of
    /// the stiffness and whatever roughness suits.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn log_predictive(
        &self,
        stiffness: &Spread,
        given: impl Fn(&Motion) -> bool,
    ) -> Result<f64, GapError> {
        let d = self.windows.joints;
        let is_given = |w: &Window| given(self.motions[w.sequence]);
        let rows: Vec<usize> = (self.windows.list.iter().enumerate())
            .filter(|(_, w)| is_given(w))
            .flat_map(|(i, _)| i * d..(i + 1) * d)
            .collect();
        let rest = self.rest();
        let densities: Vec<(f64, f64)> = (self.roughness(stiffness).par_iter())
            .map(|spread| log_densities(&rest, self.parts.covariance(spread), &rows))
            .collect::<Result<_, GapError>>()?;
        let (all, of_given): (Vec<f64>, Vec<f64>) = densities.into_iter().unzip();
        Ok(log_mean_exp(&all) - log_mean_exp(&of_given))
    }

    /// Mean square of the readings of the other sequences about what those of some lead to expect, each in its standard
    /// deviations: 1 if the model is right; `None` without others.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn surprise(
        &self,
        spread: &Spread,
        given: impl Fn(&Motion) -> bool,
    ) -> Result<Option<f64>, GapError> {
        let d = self.windows.joints;
        let (known, others): (Vec<_>, Vec<_>) = (self.windows.list.iter().enumerate())
            .partition(|(_, w)| given(self.motions[w.sequence]));
        let windows = known.iter().chain(&others);
        let rows: Vec<usize> = windows.flat_map(|(i, _)| i * d..(i + 1) * d).collect();
        let covariance = self.parts.covariance(spread);
        let ordered = Mat::from_fn(rows.len(), rows.len(), |i, k| {
            let (low, high) = (rows[i].min(rows[k]), rows[i].max(rows[k]));
            covariance[(high, low)]
        });
        let rest = self.rest();
        let values: Vec<f64> = rows.iter().map(|row| rest[*row]).collect();
        let left = whitened(&values, &Factor::new(ordered)?).split_off(known.len() * d);
        let squares: f64 = left.iter().map(|y| y * y).sum();
        Ok((!left.is_empty()).then(|| squares / left.len() as f64))
    }

    /// What every reading adds to what those before it tell, in its standard deviations: white and of variance 1
    /// if the model is right.
    fn innovations(&self, factor: &Factor) -> Vec<f64> {
        whitened(&self.rest(), factor)
    }

    /// How far innovations persist: their correlation from window to window of a touch, over all joints. About 0
    /// if the model is right; less than three deviations of what white ones have count as 0.
    pub(crate) fn persistence(&self, factor: &Factor) -> f64 {
        let list = &self.windows.list;
        let follows: Vec<bool> = (0..list.len())
            .map(|i| i > 0 && list[i].run == list[i - 1].run)
            .collect();
        let correlation = correlation(&self.innovations(factor), self.windows.joints, &follows);
        let pairs = follows.iter().filter(|f| **f).count() * self.windows.joints;
        match correlation > 3.0 / (pairs as f64).sqrt() {
            true => correlation,
            false => 0.0,
        }
    }

    /// The spread of the stiffness with the largest evidence, given the roughness of contact and of joints.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn best_stiffness(&self, contact: f64, joint: f64) -> Result<Spread, GapError> {
        let spread = |point: f64, smooth: f64| Spread {
            point: point * self.uniform,
            smooth: smooth * self.uniform,
            level: LEVEL * self.uniform,
            contact,
            joint,
            white: 0.0,
            walk: 0.0,
        };
        if !self.touches() {
            return Ok(spread(1.0, 1.0));
        }
        let tried: Vec<Spread> = (POINT.iter())
            .flat_map(|&p| SMOOTH.iter().map(move |&s| (p, s)))
            .map(|(p, s)| spread(p, s))
            .collect();
        let found: Result<Vec<f64>, GapError> =
            tried.par_iter().map(|s| self.log_evidence(s)).collect();
        let found = found?;
        let best = best_of(&found);
        let mut best = (tried[best], found[best]);
        // Steps of the lattice are wide: an effect that scales the field would profit from them.
        for factor in [1.7, 1.3] {
            let less = 1.0 / factor;
            let around = [
                (factor, 1.0),
                (less, 1.0),
                (1.0, factor),
                (1.0, less),
                (factor, factor),
                (less, less),
            ];
            best = self.better(best, &around)?;
        }
        Ok(best.0)
    }

    /// A spread of the stiffness that suits best within the lattice, or a larger one where it lies at its
    /// upper edge.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn raised(&self, spread: &Spread) -> Result<Spread, GapError> {
        let largest = [(spread.point, POINT[2]), (spread.smooth, SMOOTH[2])];
        let inside = |(own, most): &(f64, f64)| *own < most * self.uniform;
        if !self.touches() || largest.iter().all(inside) {
            return Ok(*spread);
        }
        let mut best = (*spread, self.log_evidence(spread)?);
        for _ in 0..MOST_RAISED {
            let value = best.1;
            best = self.better(best, &[(RAISE, 1.0), (1.0, RAISE), (RAISE, RAISE)])?;
            if best.1 < value + WORTH_RAISING {
                break;
            }
        }
        Ok(best.0)
    }

    /// The spread with the largest evidence among one, whose evidence is known, and those with its parts of
    /// single points and of the smooth field times pairs of factors.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    fn better(
        &self,
        (spread, value): (Spread, f64),
        factors: &[(f64, f64)],
    ) -> Result<(Spread, f64), GapError> {
        let found: Vec<(Spread, f64)> = (factors.par_iter())
            .map(|(point, smooth)| {
                let spread = Spread {
                    point: point * spread.point,
                    smooth: smooth * spread.smooth,
                    ..spread
                };
                Ok((spread, self.log_evidence(&spread)?))
            })
            .collect::<Result<_, GapError>>()?;
        Ok((found.into_iter()).fold(
            (spread, value),
            |best, next| {
                if next.1 > best.1 { next } else { best }
            },
        ))
    }

    /// A spread of the stiffness that was chosen for another model, or the same in proportion to this
    /// model's own uniform stiffness: what has the larger evidence. Where contact changes much, so
    /// does the stiffness that explains the readings.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn adapted(&self, spread: &Spread) -> Result<Spread, GapError> {
        let ratio = LEVEL * self.uniform / spread.level;
        if !self.touches() || (1.0 / RESCALE..RESCALE).contains(&ratio) || !ratio.is_normal() {
            return Ok(*spread);
        }
        let own = spread.scaled(ratio);
        match self.log_evidence(&own)? > self.log_evidence(spread)? {
            true => Ok(own),
            false => Ok(*spread),
        }
    }

    /// That spread of the stiffness with every roughness that is tried.
    pub(crate) fn roughness(&self, stiffness: &Spread) -> Vec<Spread> {
        let contact: &[f64] = if self.touches() {
            &CONTACT
        } else {
            &CONTACT[..1]
        };
        let walk: &[f64] = if self.parts.walks() {
            &WALK
        } else {
            &WALK[..1]
        };
        let of = |&contact: &f64| {
            JOINT.iter().flat_map(move |&joint| {
                walk.iter().map(move |&walk| Spread {
                    contact,
                    joint,
                    walk,
                    ..*stiffness
                })
            })
        };
        contact.iter().flat_map(of).collect()
    }

    /// Mean stiffness per rest point, without the constraint that it is not negative; `factor` is that
    /// of the covariance with this spread.
    pub(crate) fn stiffness(
        &self,
        campaign: &Campaign,
        spread: &Spread,
        factor: &Factor,
    ) -> Vec<f64> {
        let rest = self.rest();
        let mut solved = Mat::from_fn(rest.len(), 1, |i, _| rest[i]);
        factor.solve(&mut solved);
        let positions = campaign.site.rest.positions();
        let touched = field_mean(&self.design, positions, spread, solved.col_as_slice(0));
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

fn whitened(values: &[f64], factor: &Factor) -> Vec<f64> {
    let mut y = Mat::from_fn(values.len(), 1, |i, _| values[i]);
    factor.whiten(&mut y);
    y.col_as_slice(0).to_vec()
}

/// Log of the density of values of mean zero, without constants.
fn log_density(values: &[f64], factor: &Factor) -> f64 {
    let squares: f64 = whitened(values, factor).iter().map(|y| y * y).sum();
    -0.5 * (factor.log_det() + squares)
}

/// Log of the density of the values of mean zero in some rows, in order, without constants; of `covariance` the lower half.
fn log_density_of(values: &[f64], covariance: &Mat<f64>, rows: &[usize]) -> Result<f64, GapError> {
    let own: Vec<f64> = rows.iter().map(|row| values[*row]).collect();
    let part = Mat::from_fn(rows.len(), rows.len(), |i, k| match i >= k {
        true => covariance[(rows[i], rows[k])],
        false => 0.0,
    });
    Ok(log_density(&own, &Factor::new(part)?))
}

/// The same of all values, and of those in some rows.
fn log_densities(
    values: &[f64],
    covariance: Mat<f64>,
    rows: &[usize],
) -> Result<(f64, f64), GapError> {
    let of_rows = log_density_of(values, &covariance, rows)?;
    Ok((log_density(values, &Factor::new(covariance)?), of_rows))
}

/// Correlation of the values of every window with those of the one before it, of those that follow one; `joints`
/// values a window.
fn correlation(values: &[f64], joints: usize, follows: &[bool]) -> f64 {
    let (mut along, mut squares) = (0.0, 0.0);
    for i in (1..follows.len()).filter(|i| follows[*i]) {
        for (a, b) in (i * joints..(i + 1) * joints).map(|k| (values[k - joints], values[k])) {
            along += a * b;
            squares += 0.5 * (a * a + b * b);
        }
    }
    if squares > 0.0 { along / squares } else { 0.0 }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// What is left of the density of all values is that of the others about what the given ones lead to expect.
    #[test]
    fn val_densities_are_those_of_the_conditional_gaussian() {
        let mut rng = Pcg64Mcg::seed_from_u64(7);
        let (n, given, others) = (6, [0, 2, 3], [1, 4, 5]);
        let root = DMatrix::from_fn(n, n, |_, _| rng.random_range(-1.0..1.0_f64));
        let covariance = &root * root.transpose() + DMatrix::identity(n, n);
        let values = DVector::from_fn(n, |_, _| rng.random_range(-2.0..2.0_f64));

        let part = |a: &[usize], b: &[usize]| covariance.select_rows(a).select_columns(b);
        let gain = part(&others, &given) * part(&given, &given).try_inverse().unwrap();
        let left = values.select_rows(&others) - &gain * values.select_rows(&given);
        let spread = part(&others, &others) - gain * part(&given, &others);
        let squares = left.dot(&(spread.clone().try_inverse().unwrap() * &left));
        let expected = -0.5 * (spread.determinant().ln() + squares);

        let covariance = Mat::from_fn(n, n, |i, k| covariance[(i, k)]);
        let (all, of_given) = log_densities(values.as_slice(), covariance, &given).unwrap();
        assert!(
            (all - of_given - expected).abs() < 1e-12,
            "{}",
            all - of_given
        );
    }

    #[test]
    fn correlation_is_that_of_windows_that_follow_each_other() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let (windows, joints) = (20_000, 2);
        for phi in [0.0, 0.3, 0.8] {
            let mut values: Vec<f64> = Vec::new();
            for k in 0..windows * joints {
                // Every tenth window begins afresh.
                let fresh = k < joints || k / joints % 10 == 0;
                let before = if fresh { 0.0 } else { phi * values[k - joints] };
                let spread = if fresh {
                    (1.0 - phi * phi).powf(-0.5)
                } else {
                    1.0
                };
                values.push(before + spread * rng.random_range(-1.0..1.0));
            }
            let follows: Vec<bool> = (0..windows).map(|i| i % 10 != 0).collect();
            let found = correlation(&values, joints, &follows);
            assert!((found - phi).abs() < 0.02, "{found} of {phi}");
        }
        assert_eq!(correlation(&[], 3, &[]), 0.0);
        assert_eq!(correlation(&[0.0; 4], 2, &[false, true]), 0.0);
    }
}
