//! Predictive densities: what the readings of a fitted model say about further ones, and what its innovations say about the
//! model.

use crate::evidence::{Factor, Spread, outer};
use crate::fitted::{Fitted, whitened};
use crate::refine::Refined;
use crate::screen::{best_of, log_mean_exp};
use crate::spread_search::CONTACT;
use crate::windows::Window;
use crate::{Campaign, GapError, Motion};
use faer::Mat;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// The test sequences, and the train sequences that they are predicted from, in a model fitted to the latter.
pub(crate) struct TestDensity<'a> {
    all: Fitted<'a>,
    given: Vec<&'a Motion>,
    /// Readings minus the torques that depend neither on the stiffness nor on an open parameter.
    rest: Vec<f64>,
    /// The covariance due to open parameters, to first order, lower triangle.
    open: Mat<f64>,
}

impl<'a> TestDensity<'a> {
    /// Stiffness that was never touched stays uncertain, so it does not count against a model. `None` without test
    /// sequences.
    ///
    /// # Errors
    /// Rows that contact cannot take.
    pub(crate) fn new(
        campaign: &'a Campaign,
        fitted: &Fitted<'a>,
    ) -> Result<Option<Self>, GapError> {
        if campaign.test.is_empty() {
            return Ok(None);
        }
        let mut all = campaign.fitted(&fitted.model, campaign.session())?;
        let touched: BTreeSet<u32> = (fitted.logs.iter())
            .flat_map(|log| &log.contacts)
            .flat_map(|c| c.points().iter().copied())
            .collect();
        // Points that came out negative.
        let left_out =
            |p: u32| touched.contains(&p) && fitted.design.points.binary_search(&p).is_err();
        all.leave_out(campaign, left_out);
        Ok(Some(Self {
            rest: all.rest(),
            open: Mat::zeros(all.windows.rows(), all.windows.rows()),
            all,
            given: fitted.motions.clone(),
        }))
    }

    /// Makes the parameters of the fitted model as uncertain as in its prior, so that the given sequences determine them.
    /// Other postures show what these sequences leave open. Shares relative to a joint count as independent.
    ///
    /// # Errors
    /// Rows that contact cannot take; a covariance that is not positive definite.
    pub(crate) fn with_open(
        mut self,
        campaign: &Campaign,
        refined: &Refined,
    ) -> Result<Self, GapError> {
        let prior = refined.open();
        let field = self.field(campaign, &refined.spread)?;
        let columns = campaign.columns(&refined.model, &self.all, &field, &prior)?;
        let moving: Vec<usize> = prior.moving().collect();
        for &i in &moving {
            let by = refined.theta[i] - prior.mean[i];
            (self.rest.iter_mut().zip(&columns[i])).for_each(|(r, c)| *r += by * c);
        }
        self.open = outer(&Mat::from_fn(self.rest.len(), moving.len(), |row, k| {
            prior.sd[moving[k]] * columns[moving[k]][row]
        }));
        Ok(self)
    }

    /// The expected stiffness per rest point (N/m) given the train sequences, not negative, also where they touch nothing.
    fn field(&self, campaign: &Campaign, spread: &Spread) -> Result<Vec<f64>, GapError> {
        let (order, given) = self.given_first();
        let given = &order[..given];
        let own: Vec<f64> = given.iter().map(|row| self.rest[*row]).collect();
        let covariance = self.all.parts.covariance(spread);
        let solved = Factor::new(part(&covariance, given))?.solved(&own);
        let mut all = vec![0.0; self.rest.len()];
        (given.iter().zip(solved)).for_each(|(&row, s)| all[row] = s);
        let mut field = self.all.field(campaign, spread, &all);
        field.iter_mut().for_each(|k| *k = k.max(0.0));
        Ok(field)
    }

    /// The covariance of all readings, lower triangle.
    fn covariance(&self, spread: &Spread) -> Mat<f64> {
        let mut covariance = self.all.parts.covariance(spread);
        covariance += &self.open;
        covariance
    }

    /// All rows, those of train sequences first, and the number of the latter.
    fn given_first(&self) -> (Vec<usize>, usize) {
        let d = self.all.windows.joints;
        let (given, others): (Vec<_>, Vec<_>) =
            (self.all.windows.list.iter().enumerate()).partition(|(_, w)| self.is_given(w));
        let windows = given.iter().chain(&others);
        let rows = windows.flat_map(|(i, _)| i * d..(i + 1) * d);
        (rows.collect(), given.len() * d)
    }

    /// Whether a window is of a train sequence.
    fn is_given(&self, window: &Window) -> bool {
        let motion = self.all.motions[window.sequence];
        self.given.iter().any(|own| std::ptr::eq(*own, motion))
    }

    /// Log density of the test sequences given the others (nats), without constants, for a spread of the stiffness and the
    /// roughness that suits best.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn log_density(&self, stiffness: &Spread) -> Result<f64, GapError> {
        let all = &self.all;
        let (order, given) = self.given_first();
        let densities: Vec<(f64, f64)> = (all.roughness(stiffness).par_iter())
            .map(|spread| log_densities(&self.rest, &self.covariance(spread), &order, given))
            .collect::<Result<_, GapError>>()?;
        let (both, of_given): (Vec<f64>, Vec<f64>) = densities.into_iter().unzip();
        Ok(log_mean_exp(&both) - log_mean_exp(&of_given))
    }

    /// Deviation of the test sequences from their prediction from the others (root mean square, in standard deviations). 1
    /// if the model is right; `None` without windows of them.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn surprise(&self, spread: &Spread) -> Result<Option<f64>, GapError> {
        let (order, given) = self.given_first();
        let (mut white, _) = whitened_in(&self.rest, &self.covariance(spread), &order)?;
        let left = white.split_off(given);
        let squares: f64 = left.iter().map(|y| y * y).sum();
        Ok((!left.is_empty()).then(|| (squares / left.len() as f64).sqrt()))
    }
}

impl Fitted<'_> {
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

    /// Standardized innovations of the readings, each given all previous ones: white and of variance 1 if the model is
    /// right.
    fn innovations(&self, factor: &Factor) -> Vec<f64> {
        whitened(&self.rest(), factor)
    }

    /// Persistence of the innovations: their correlation from a window to the next in a touch, over all joints, if less
    /// than a window lies between the two. About 0 if the model is right. Less than three deviations of the correlation of
    /// white innovations counts as 0.
    pub(crate) fn persistence(&self, factor: &Factor) -> f64 {
        let list = &self.windows.list;
        let follows: Vec<bool> = (0..list.len())
            .map(|i| i > 0 && list[i].follows(&list[i - 1]))
            .collect();
        let correlation = correlation(&self.innovations(factor), self.windows.joints, &follows);
        let pairs = follows.iter().filter(|f| **f).count() * self.windows.joints;
        if correlation > 3.0 / (pairs as f64).sqrt() {
            correlation
        } else {
            0.0
        }
    }
}

/// Log density of values of mean zero in some rows, without constants. `covariance` holds the lower triangle.
fn log_density_of(values: &[f64], covariance: &Mat<f64>, rows: &[usize]) -> Result<f64, GapError> {
    Ok(log_densities(values, covariance, rows, rows.len())?.0)
}

/// The lower triangle of a covariance in some rows, in their order. `covariance` holds the lower triangle.
fn part(covariance: &Mat<f64>, rows: &[usize]) -> Mat<f64> {
    Mat::from_fn(rows.len(), rows.len(), |i, k| {
        if i >= k {
            covariance[(rows[i].max(rows[k]), rows[i].min(rows[k]))]
        } else {
            0.0
        }
    })
}

/// The values in some rows, in their order, whitened, and the factor of their covariance. `covariance` holds the lower
/// triangle.
fn whitened_in(
    values: &[f64],
    covariance: &Mat<f64>,
    rows: &[usize],
) -> Result<(Vec<f64>, Factor), GapError> {
    let own: Vec<f64> = rows.iter().map(|row| values[*row]).collect();
    let factor = Factor::new(part(covariance, rows))?;
    Ok((whitened(&own, &factor), factor))
}

/// Log density of all values of mean zero, in the rows of `order`, and of a number of first ones, without constants.
fn log_densities(
    values: &[f64],
    covariance: &Mat<f64>,
    order: &[usize],
    given: usize,
) -> Result<(f64, f64), GapError> {
    let (white, factor) = whitened_in(values, covariance, order)?;
    let of = |rows: usize| {
        let squares: f64 = white[..rows].iter().map(|y| y * y).sum();
        -0.5 * (factor.log_det_of(rows) + squares)
    };
    Ok((of(order.len()), of(given)))
}

/// Correlation of the values of each window that follows another with those of that one; `joints` values per window.
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
    use crate::{Model, effects};
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;
    use vsf_data::{Dataset, RobotRef, Sequence, Table};
    use vsf_pipeline::SceneOptions;

    /// An arm that hangs down while it is trained and lies when it is tested, with torques that a mass explains in part: what
    /// one that is uncertain leads to expect, integrated over many masses.
    #[test]
    fn val_uncertain_parameters_are_integrated_out() {
        let arm = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
        let sequence = |id: &str, from: f64| {
            let table = |value: &dyn Fn(f64, usize) -> f64| {
                let rows = (0..60).flat_map(|k| (0..3).map(move |j| value(f64::from(k), j)));
                Table::new(3, rows.collect()).unwrap()
            };
            let angles = table(&|k, j| if j == 0 { from + 0.002 * k } else { 0.0 });
            let noise = |k: f64, j: usize| 0.02 * (k * (k + j as f64) % 13.0 - 6.0);
            let torques = table(&|k, j| -0.4 * (from + 0.002 * k).cos() + noise(k, j));
            let time = (0..60).map(|k| f64::from(k) / 100.0).collect();
            Sequence::new(id, time, angles, torques)
        };
        let dataset = Dataset::new(arm, vec![sequence("0", -1.5), sequence("1", 0.0)]);
        let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
        let payload = effects::named(&["payload".to_owned()]).unwrap().remove(0);
        let nominal = campaign
            .fitted(&Model::default(), campaign.train.iter())
            .unwrap();
        let tangents = campaign
            .tangents(&nominal.model, &nominal, &[], &payload)
            .unwrap();
        let mut prior = tangents[0].prior(&campaign.site);
        prior.sd[1..].fill(0.0);
        let spread = nominal.best_stiffness(CONTACT[0], 0.0).unwrap();
        let start = Model::of(&payload, &[0.1, 0.0, 0.0, 0.0]);
        let refined = campaign.refined_at(&start, prior, &spread).unwrap();

        let fitted = campaign
            .fitted(&refined.model, campaign.train.iter())
            .unwrap();
        let certain = TestDensity::new(&campaign, &fitted).unwrap().unwrap();
        let known = certain.log_density(&spread).unwrap();
        let open = certain.with_open(&campaign, &refined).unwrap();
        let found = open.log_density(&spread).unwrap();

        let (mean, sd) = (refined.prior.mean[0], refined.prior.sd[0]);
        let all = campaign.session();
        let [none, unit] = [0.0, 1.0].map(|mass| {
            let model = refined.model.at(&[mass, 0.0, 0.0, 0.0]);
            campaign.fitted(&model, all.iter().copied()).unwrap()
        });
        let given: Vec<usize> = (0..campaign.train[0].len() * 3).collect();
        let over = |rows: &[usize]| {
            let spreads = none.roughness(&spread);
            let shares = (-300..300).map(|k| f64::from(k) / 50.0);
            let masses: Vec<f64> = shares.map(|s| mean + s * sd).collect();
            let of = |spread: &Spread| {
                let covariance = none.parts.covariance(spread);
                let of_rows = |mass: &f64| {
                    let both = none.rest().into_iter().zip(unit.rest());
                    let rest: Vec<f64> = both.map(|(a, b)| a + mass * (b - a)).collect();
                    let density = log_density_of(&rest, &covariance, rows).unwrap();
                    density - 0.5 * ((mass - mean) / sd).powi(2)
                };
                masses.iter().map(of_rows).collect::<Vec<f64>>()
            };
            log_mean_exp(&spreads.iter().flat_map(of).collect::<Vec<_>>())
        };
        let expected = over(&(0..none.windows.rows()).collect::<Vec<_>>()) - over(&given);
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        assert!((known - expected).abs() > 1.0, "{known} {expected}");
    }

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
        let order = [given, others].concat();
        let (all, of_given) = log_densities(values.as_slice(), &covariance, &order, 3).unwrap();
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
