use crate::evidence::{Fit, Normal, Spread};
use crate::fitted::Fitted;
use crate::{Acts, Campaign, ContactLog, Effect, GapError, Model, Motion, Parameter, Role};
use faer::Mat;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Prior size of an effect: the RMS torque of each of its parameters, as a share of the RMS reading.
const SIZE: f64 = 0.3;
/// Upper bound of that prior, in scales of the parameter.
pub(crate) const MOST_SCALES: f64 = 5.0;
/// Largest change by zero amplitudes that counts as rounding, as a share of the readings.
const NEUTRAL: f64 = 1e-6;

/// Derivative of the predicted torques with respect to each amplitude of an effect, at the nominal model.
pub(crate) struct Tangent {
    /// The effect.
    pub(crate) effect: Arc<dyn Effect>,
    /// All parameters at the point of the tangent; amplitudes are zero.
    pub(crate) start: Vec<f64>,
    /// Indices of the amplitudes that may act, among the parameters.
    pub(crate) amplitudes: Vec<usize>,
    /// Prior deviation of each amplitude.
    pub(crate) sd: Vec<f64>,
    /// Bounds of each amplitude.
    pub(crate) bounds: Vec<[f64; 2]>,
    /// Cost (nats) of being one of several sets of amplitudes that may act, each equally likely a priori.
    pub(crate) choice: f64,
    /// One column per amplitude.
    pub(crate) columns: Vec<Vec<f64>>,
}

impl Tangent {
    /// Whether the effect changes any torque.
    pub(crate) fn shows(&self) -> bool {
        self.columns.iter().flatten().any(|torque| *torque != 0.0)
    }
}

/// Result of screening for one tangent.
#[derive(Clone)]
pub(crate) struct Screened {
    /// Index of the tangent.
    pub(crate) tangent: usize,
    /// Log evidence with the effect, averaged over roughness (nats, without constants).
    pub(crate) log_evidence: f64,
    /// The best roughness among those tried.
    pub(crate) spread: Spread,
    /// The fit under that roughness.
    pub(crate) fit: Fit,
}

/// Log evidence of the nominal model and of every candidate.
pub(crate) struct Screening {
    /// Log evidence of the nominal model at each spread.
    pub(crate) nominal: Vec<f64>,
    /// Information of the readings on the amplitudes of every tangent, at each spread.
    pub(crate) normals: Vec<Vec<Normal>>,
    /// The candidates, in the order of the tangents.
    pub(crate) candidates: Vec<Screened>,
}

/// Log of the mean of the exponentials.
pub(crate) fn log_mean_exp(x: &[f64]) -> f64 {
    let top = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !top.is_finite() {
        return top;
    }
    let sum: f64 = x.iter().map(|v| (v - top).exp()).sum();
    top + (sum / x.len() as f64).ln()
}

/// Index of the largest number; 0 if there are none.
pub(crate) fn best_of(x: &[f64]) -> usize {
    (0..x.len())
        .max_by(|a, b| x[*a].total_cmp(&x[*b]))
        .unwrap_or(0)
}

impl Campaign {
    /// Tangents for every start of an effect added to a model.
    ///
    /// # Errors
    /// Rows that contact cannot take.
    pub(crate) fn tangents(
        &self,
        base: &Model,
        fitted: &Fitted<'_>,
        stiffness: &[f64],
        effect: &Arc<dyn Effect>,
    ) -> Result<Vec<Tangent>, GapError> {
        let nominal = fitted.predicted(stiffness);
        let parameters = effect.parameters(&self.site);
        let mut starts = effect.starts(&self.site);
        for start in &mut starts {
            let amplitudes = parameters
                .iter()
                .zip(start)
                .filter(|(p, _)| p.role == Role::Amplitude);
            amplitudes.for_each(|(_, theta)| *theta = 0.0);
        }
        let acting: Vec<Vec<usize>> = (0..starts.len())
            .map(|k| effect.acting(&self.site, k))
            .collect();
        let sets: BTreeSet<&Vec<usize>> = acting.iter().collect();
        let choice = (sets.len() as f64).ln();
        // Starts that differ by what may act alone share columns, under the first of them.
        let alike: Vec<usize> = (starts.iter())
            .map(|s| starts.iter().position(|t| t == s).unwrap_or(0))
            .collect();
        let needed: BTreeSet<(usize, usize)> = (alike.iter().zip(&acting))
            .flat_map(|(k, set)| set.iter().map(move |i| (*k, *i)))
            .collect();
        if let Some(start) = starts.first().filter(|_| effect.acts() != Acts::Contact) {
            let (motions, logs, windows) = (&fitted.motions, &fitted.logs, &fitted.windows);
            let idle =
                self.torques(&base.with(effect, start), motions, logs, windows, stiffness)?;
            let change: Vec<f64> = idle.iter().zip(&nominal).map(|(a, b)| a - b).collect();
            if rms(&change) > NEUTRAL * rms(&fitted.readings) {
                return Err(GapError::Model {
                    effect: effect.name().to_owned(),
                    problem: "it changes the torques though all of its amplitudes are zero; what acts has to go with them"
                        .to_owned(),
                });
            }
        }
        let column = |k: usize, i: usize| -> Result<Vec<f64>, GapError> {
            let p = &parameters[i];
            let at = |step: f64| {
                let mut theta = starts[k].clone();
                theta[i] = step;
                let model = base.with(effect, &theta);
                self.predicted_near(&model, p, fitted, stiffness, &nominal)
            };
            let step = p.scale.min(0.5 * p.bounds[1]);
            let ahead = at(step)?;
            let (behind, width) = if effect.acts() == Acts::Contact && p.bounds[0] <= -step {
                (at(-step)?, 2.0 * step)
            } else {
                (nominal.clone(), step)
            };
            Ok((ahead.iter().zip(&behind))
                .map(|(a, b)| (a - b) / width)
                .collect())
        };
        let columns: BTreeMap<(usize, usize), Vec<f64>> = (needed.into_par_iter())
            .map(|(k, i)| Ok(((k, i), column(k, i)?)))
            .collect::<Result<_, GapError>>()?;
        let size = SIZE * rms(&fitted.readings);
        let sd = |i: usize, column: &[f64]| {
            let widest = MOST_SCALES * parameters[i].scale;
            match rms(column) {
                torque if torque > 0.0 => (size / torque).clamp(f64::MIN_POSITIVE, widest),
                _ => widest,
            }
        };
        Ok((acting.into_iter().enumerate())
            .map(|(k, amplitudes)| {
                let columns: Vec<Vec<f64>> = (amplitudes.iter())
                    .map(|&i| columns[&(alike[k], i)].clone())
                    .collect();
                Tangent {
                    effect: effect.clone(),
                    start: starts[k].clone(),
                    sd: (amplitudes.iter().zip(&columns))
                        .map(|(&i, column)| sd(i, column))
                        .collect(),
                    bounds: amplitudes.iter().map(|&i| parameters[i].bounds).collect(),
                    amplitudes,
                    choice,
                    columns,
                }
            })
            .collect())
    }

    /// Torques over windows of a model that differs slightly, in parameter `p`, from the fitted one, whose torques are
    /// `known`.
    ///
    /// # Errors
    /// Rows that contact cannot take.
    pub(crate) fn predicted_near(
        &self,
        model: &Model,
        p: &Parameter,
        fitted: &Fitted<'_>,
        stiffness: &[f64],
        known: &[f64],
    ) -> Result<Vec<f64>, GapError> {
        let named = p.sequence.map(|s| &self.site.sequences[s]);
        if named.is_some_and(|id| fitted.motions.iter().all(|m| m.id != *id)) {
            return Ok(known.to_vec());
        }
        let log = |(motion, log): (&&Motion, &Arc<ContactLog>)| -> Result<_, GapError> {
            let other = named.is_some_and(|id| *id != motion.id);
            if other || model.acts() != Acts::Contact {
                return Ok(log.clone());
            }
            Ok(Arc::new(
                match self.answer(&fitted.model, model, motion, log)? {
                    Some(answer) => answer,
                    None => self.contact_log(model, motion)?,
                },
            ))
        };
        let logs: Vec<Arc<ContactLog>> = (fitted.motions.iter())
            .zip(&fitted.logs)
            .map(log)
            .collect::<Result<_, _>>()?;
        self.torques(model, &fitted.motions, &logs, &fitted.windows, stiffness)
    }
}

/// Remainder of a column that others explain (share of its square) that counts as rounding.
const NOTHING_LEFT: f64 = 1e-20;

/// Makes every column orthogonal to column `k`. All columns before `k` were already removed from it; `whole` was its square
/// before that.
fn take_out(all: &mut Mat<f64>, k: usize, whole: f64) {
    let along = all.col_as_slice(k).to_vec();
    let size = square(&along);
    if size <= NOTHING_LEFT * whole {
        return;
    }
    // Those before it that were taken out are orthogonal to it.
    for other in (0..all.ncols()).filter(|other| *other == 0 || *other >= k) {
        let column = all.col_as_slice_mut(other);
        let share = column.iter().zip(&along).map(|(c, a)| c * a).sum::<f64>() / size;
        column
            .iter_mut()
            .zip(&along)
            .for_each(|(c, a)| *c -= share * a);
    }
}

fn square(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

fn rms(x: &[f64]) -> f64 {
    (square(x) / x.len().max(1) as f64).sqrt()
}

/// The nominal model and every tangent, under one spread.
struct Under {
    nominal: f64,
    normals: Vec<Normal>,
    fits: Vec<Option<Fit>>,
}

/// The evidence of every tangent, at all spreads.
///
/// `free` are the torques of the field at which the tangents were taken, and their derivatives with respect to whatever
/// else was fitted. These were fitted to the same readings, so a tangent that resembles them would explain their share for
/// free, and one whose share they took would explain nothing. They are therefore free in every model, including the nominal
/// one.
///
/// # Errors
/// A covariance that is not positive definite.
pub(crate) fn screen(
    fitted: &Fitted<'_>,
    free: &[&[f64]],
    tangents: &[Tangent],
    spreads: &[Spread],
) -> Result<Screening, GapError> {
    let rest = fitted.rest();
    let own = tangents.iter().flat_map(|t| &t.columns).map(Vec::as_slice);
    let columns: Vec<&[f64]> = (std::iter::once(rest.as_slice()))
        .chain(free.iter().copied())
        .chain(own)
        .collect();
    let found: Vec<Under> = (spreads.par_iter())
        .map(|spread| {
            let factor = fitted.parts.factor(spread)?;
            let mut all = Mat::from_fn(rest.len(), columns.len(), |i, k| columns[k][i]);
            factor.whiten(&mut all);
            let whole: Vec<f64> = (0..=free.len())
                .map(|k| square(all.col_as_slice(k)))
                .collect();
            (1..=free.len()).for_each(|k| take_out(&mut all, k, whole[k]));
            let y = all.col_as_slice(0);
            let squares = square(y);
            let nominal = -0.5 * (factor.log_det() + squares);
            let mut next = 1 + free.len();
            let (normals, fits) = (tangents.iter())
                .map(|t| {
                    let own = next..next + t.columns.len();
                    next = own.end;
                    let white: Vec<&[f64]> = own.map(|k| all.col_as_slice(k)).collect();
                    let normal = Normal::new(y, &white);
                    let fit = normal.fit(&t.sd, &t.bounds);
                    (normal, fit)
                })
                .unzip();
            Ok(Under {
                nominal,
                normals,
                fits,
            })
        })
        .collect::<Result<_, GapError>>()?;
    let nominal: Vec<f64> = found.iter().map(|f| f.nominal).collect();
    let candidates = (0..tangents.len())
        .filter_map(|k| {
            let fit = |i: usize| found[i].fits[k].as_ref();
            let at = |i: usize| {
                let gain = fit(i).map_or(f64::NEG_INFINITY, |f| f.gain);
                nominal[i] + gain - tangents[k].choice
            };
            let all: Vec<f64> = (0..spreads.len()).map(at).collect();
            let best = best_of(&all);
            Some(Screened {
                tangent: k,
                log_evidence: log_mean_exp(&all),
                spread: spreads[best],
                fit: fit(best)?.clone(),
            })
        })
        .collect();
    let normals = found.into_iter().map(|f| f.normals).collect();
    Ok(Screening {
        nominal,
        normals,
        candidates,
    })
}
