//! Signs and columns of readings in contact: those under which independent springs explain them best.
//!
//! What touches one point at several joints has to agree, whatever the stiffness. The marginal likelihood of readings with
//! a sign or two columns exchanged, stiffness integrated out, tells by hundreds of nats; but for joints that feel next
//! to nothing. The sign of all joints together it does not tell: a stiffness may be negative there.

use super::{PipelineWarning, springs};
use crate::median::median;
use crate::{Scene, Trace};
use nalgebra::{DMatrix, DVector};
use vsf_core::Observation;

/// Readings and points that are looked at, evenly from all.
const MOST_READINGS: usize = 700;
const MOST_POINTS: usize = 1000;
/// Nats by which another convention has to do better. Of right readings, offsets and drifts included, none does by 50.
const EVIDENT: f64 = 100.0;
/// Standard deviations of a typical reading that springs expect, per one of its noise.
const RATIOS: [f64; 5] = [0.3, 1.0, 3.0, 10.0, 30.0];
/// Variance of what persists of the noise of a reading, per variance of that which does not, and for how long (s); and that
/// of the zero of a joint.
const PERSISTING: f64 = 1.0;
const PERSISTS: f64 = 1.0;
const ZERO: f64 = 10.0;
/// Share of the whole reading that the noise of every joint has besides its own.
const FLOOR: f64 = 0.05;
/// Readings that are less like those of springs of one stiffness everywhere are of the other sign.
const OPPOSITE: f64 = -0.5;

/// Torques of the wrong sign, of all joints or of one, and columns in the wrong order.
pub fn warning<'a>(scene: &Scene, traces: &'a [Trace]) -> Option<PipelineWarning> {
    let of_trace = |(sequence, trace): (usize, &'a Trace)| {
        let samples = trace.time.iter().zip(&trace.observations);
        samples.map(move |(time, observation)| Sample {
            sequence,
            time: *time,
            observation,
        })
    };
    let touching = traces.iter().enumerate().flat_map(of_trace);
    let touching: Vec<Sample> = touching.filter(|s| !s.observation.is_empty()).collect();
    let joints = scene.robot().joint_count();
    let name = |j: usize| scene.robot().joints()[j].name();
    let found = Evidence::new(&touching, joints).and_then(|evidence| {
        let own = evidence.of(&as_given(joints));
        let others = conventions(joints).map(|(kind, columns)| (kind, evidence.of(&columns) - own));
        others.max_by(|a, b| a.1.total_cmp(&b.1))
    });
    if let Some((convention, gain)) = found.filter(|(_, gain)| *gain > EVIDENT) {
        let order = match convention {
            Convention::Opposite(j) => {
                let joint = name(j).to_owned();
                return Some(PipelineWarning::OppositeJoint { joint, gain });
            }
            Convention::Reversed => "in reverse order".to_owned(),
            Convention::Turned(by) => {
                format!("turned on ({} in the column of {})", name(0), name(by))
            }
            Convention::Exchanged(a, b) => format!("of {} and {} exchanged", name(a), name(b)),
        };
        return Some(PipelineWarning::MixedColumns { order, gain });
    }
    let correlation = correlation(&touching);
    (correlation < OPPOSITE).then_some(PipelineWarning::OppositeTorques { correlation })
}

/// A reading in contact.
#[derive(Clone, Copy)]
struct Sample<'a> {
    sequence: usize,
    /// In the sequence (s).
    time: f64,
    observation: &'a Observation<f64>,
}

/// How readings may be other than they were meant.
enum Convention {
    /// One joint's of the other sign.
    Opposite(usize),
    /// Columns from the last to the first.
    Reversed,
    /// So many columns of the begin stand at the end.
    Turned(usize),
    /// Two columns, each the other's.
    Exchanged(usize, usize),
}

/// The column that each joint takes, and with which sign.
type Columns = Vec<(usize, f64)>;

fn as_given(joints: usize) -> Columns {
    (0..joints).map(|j| (j, 1.0)).collect()
}

fn conventions(joints: usize) -> impl Iterator<Item = (Convention, Columns)> {
    let with = move |change: &dyn Fn(&mut Columns)| {
        let mut columns = as_given(joints);
        change(&mut columns);
        columns
    };
    let reversed = (Convention::Reversed, with(&|c| c.reverse()));
    let opposite = (0..joints).map(move |j| (Convention::Opposite(j), with(&|c| c[j].1 = -1.0)));
    let turned = (1..joints).map(move |by| (Convention::Turned(by), with(&|c| c.rotate_left(by))));
    let pairs = (0..joints).flat_map(move |a| (a + 1..joints).map(move |b| (a, b)));
    let exchanged = pairs.map(move |(a, b)| (Convention::Exchanged(a, b), with(&|c| c.swap(a, b))));
    (opposite.chain(exchanged).chain(turned)).chain(std::iter::once(reversed))
}

/// Log marginal likelihood of readings in any convention, from one factorisation per ratio of springs and noise.
struct Evidence {
    joints: usize,
    readings: f64,
    /// For every ratio, `log det C` and the products `z^T C^-1 z` of the readings of every column in the rows of every joint.
    ratios: Vec<(f64, DMatrix<f64>)>,
}

impl Evidence {
    /// `None` where readings or columns are zero.
    fn new(touching: &[Sample], joints: usize) -> Option<Self> {
        let noise = noise(touching, joints)?;
        let most = (MOST_READINGS / joints).max(1);
        let thinned: Vec<_> = (touching.iter().copied())
            .step_by(touching.len().div_ceil(most))
            .collect();
        let springs = springs_together(&thinned, &noise);
        let errors = errors_together(&thinned, joints);
        let n = springs.nrows();
        let of_sample = |i: usize| {
            let rows = i * joints..(i + 1) * joints;
            (rows.map(|r| springs[(r, r)]).sum::<f64>() / joints as f64).sqrt()
        };
        let typical = median((0..thinned.len()).map(of_sample).collect()).filter(|t| *t > 0.0)?;
        let mut readings = DMatrix::zeros(n, joints * joints);
        for (i, Sample { observation, .. }) in thinned.iter().enumerate() {
            for (joint, noise) in noise.iter().enumerate() {
                for (column, reading) in observation.reading().iter().enumerate() {
                    readings[(i * joints + joint, joint * joints + column)] = reading / noise;
                }
            }
        }
        let at = |ratio: &f64| {
            let covariance = &springs * (ratio / typical).powi(2) + &errors;
            let factor = covariance.cholesky()?;
            let log_det = 2.0 * (0..n).map(|i| factor.l_dirty()[(i, i)].ln()).sum::<f64>();
            let mut white = readings.clone();
            (factor.l_dirty()).solve_lower_triangular_mut(&mut white);
            Some((log_det, white.tr_mul(&white)))
        };
        Some(Self {
            joints,
            readings: n as f64,
            ratios: RATIOS.iter().map(at).collect::<Option<_>>()?,
        })
    }

    /// With the ratio and the level of springs and noise at their best (nats, without constants).
    fn of(&self, columns: &Columns) -> f64 {
        let place =
            |(joint, (column, sign)): (usize, &(usize, f64))| (joint * self.joints + column, *sign);
        let places: Vec<(usize, f64)> = columns.iter().enumerate().map(place).collect();
        let at = |(log_det, products): &(f64, DMatrix<f64>)| {
            let pairs = places
                .iter()
                .flat_map(|a| places.iter().map(move |b| (a, b)));
            let squares: f64 = pairs.map(|(a, b)| a.1 * b.1 * products[(a.0, b.0)]).sum();
            -0.5 * (self.readings * (squares / self.readings).ln() + log_det)
        };
        self.ratios.iter().map(at).fold(f64::NEG_INFINITY, f64::max)
    }
}

/// The noise of every joint, up to its level: error of the model above all, which grows with the load.
fn noise(touching: &[Sample], joints: usize) -> Option<Vec<f64>> {
    let squares = |j: usize| {
        touching
            .iter()
            .map(|s| s.observation.reading()[j].powi(2))
            .sum::<f64>()
    };
    let rms = |j: usize| (squares(j) / touching.len() as f64).sqrt();
    let rms: Vec<f64> = (0..joints).map(rms).collect();
    let norm = DVector::from_column_slice(&rms).norm();
    (norm > 0.0).then(|| rms.iter().map(|r| r + FLOOR * norm).collect())
}

/// Covariance of the readings of independent springs, per variance of one, in units of the noise.
fn springs_together(samples: &[Sample], noise: &[f64]) -> DMatrix<f64> {
    let points = samples.iter().flat_map(|s| s.observation.points());
    let mut points: Vec<u32> = points.copied().collect();
    points.sort_unstable();
    points.dedup();
    let step = points.len().div_ceil(MOST_POINTS).max(1);
    let points: Vec<u32> = points.into_iter().step_by(step).collect();
    let mut of_point: Vec<Vec<(usize, f64)>> = vec![Vec::new(); points.len()];
    for (i, Sample { observation, .. }) in samples.iter().enumerate() {
        for (k, p) in observation.points().iter().enumerate() {
            if let Ok(place) = points.binary_search(p) {
                let row =
                    |(j, sd): (usize, &f64)| (i * noise.len() + j, observation.row(j)[k] / sd);
                of_point[place].extend(noise.iter().enumerate().map(row));
            }
        }
    }
    let n = samples.len() * noise.len();
    let mut together = DMatrix::zeros(n, n);
    for rows in &of_point {
        for &(c, b) in rows {
            let column = &mut together.column_mut(c);
            rows.iter().for_each(|&(r, a)| column[r] += a * b);
        }
    }
    together
}

/// Covariance of the errors of the readings, in units of the noise: of the noise itself, of what persists for a while, and
/// of the zero of every joint.
fn errors_together(samples: &[Sample], joints: usize) -> DMatrix<f64> {
    let n = samples.len() * joints;
    let mut together = DMatrix::identity(n, n);
    for (i, a) in samples.iter().enumerate() {
        for (k, b) in samples.iter().enumerate() {
            let persists = match a.sequence == b.sequence {
                true => PERSISTING * (-(a.time - b.time).abs() / PERSISTS).exp(),
                false => 0.0,
            };
            for j in 0..joints {
                together[(i * joints + j, k * joints + j)] += persists + ZERO;
            }
        }
    }
    together
}

/// Of readings with the torques of springs of one stiffness everywhere; NaN where one of both is zero.
fn correlation(touching: &[Sample]) -> f64 {
    let (mut both, mut of_springs, mut of_readings) = (0.0, 0.0, 0.0);
    for Sample { observation, .. } in touching {
        for (spring, reading) in springs(observation).zip(observation.reading()) {
            both += spring * reading;
            of_springs += spring * spring;
            of_readings += reading * reading;
        }
    }
    both / (of_springs * of_readings).sqrt()
}
