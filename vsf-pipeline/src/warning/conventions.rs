//! Signs, columns and units of readings in contact: finds those under which independent springs explain the
//! readings best.
//!
//! A touch that several joints feel must look the same to all of them, whatever the stiffness. The marginal
//! likelihood, with stiffness integrated out, therefore separates readings with flipped signs, exchanged
//! columns or one joint in another unit by hundreds of nats, except for joints that hardly feel anything.
//! It cannot determine the common sign of all joints, since stiffness may be negative in it. That sign is
//! determined by springs of equal stiffness at all points.

use super::PipelineWarning;
use super::order::{Columns, as_given, orders, with_signs};
use super::springs::{Likeness, Springs};
use crate::{Scene, Trace, reading_unit};
use nalgebra::{DMatrix, DVector};
use vsf_core::{Observation, median};
use vsf_robots::Joint;

/// Of robots with more joints nothing is said.
const MOST_JOINTS: usize = 32;
/// Readings, means over blocks of samples, and points that are looked at, of all parts of the recording.
const MOST_READINGS: usize = 700;
const MOST_POINTS: usize = 1000;
/// Nats by which another convention has to do better. Of the plants, soft bodies and silicone that the defaults were settled
/// with, with any effect of a diagnosis or none, none does by 60.
const EVIDENT: f64 = 100.0;
/// Standard deviations of a typical reading that springs expect, per one of its noise.
const RATIOS: [f64; 5] = [0.3, 1.0, 3.0, 10.0, 30.0];
/// Variance of what persists of the noise of a reading, per variance of that which does not, and for how long (s); and that
/// of the zero of a joint.
const PERSISTING: f64 = 1.0;
const PERSISTS: f64 = 1.0;
const ZERO: f64 = 10.0;
/// Share of what springs give at all joints of a unit that the noise of each has besides its own.
const FLOOR: f64 = 0.05;
/// Readings that are less like those of springs of one stiffness everywhere are of the other sign.
const OPPOSITE: f64 = -0.5;

/// Units of one joint that are tried (its readings per those of the others), and the least times by which its best scale differs
/// from that of the others where it is told.
const UNITS: std::ops::RangeInclusive<i32> = -12..=12;
const UNITS_PER_DECADE: f64 = 4.0;
const LEAST_TIMES: f64 = 4.0;
/// Correlation of its readings with the torques of springs from which on a scale is one.
const FELT: f64 = 0.6;

/// Reports torques of the wrong sign (of some joints or of all), columns in the wrong order, and one joint
/// in another unit.
pub fn warning<'a>(
    scene: &Scene,
    traces: &'a [Trace],
    springs: &'a [Springs],
) -> Option<PipelineWarning> {
    let of_trace = |(sequence, (trace, springs)): (usize, (&'a Trace, &'a Springs))| {
        let samples = trace.time.iter().zip(&trace.observations).zip(springs);
        samples.map(move |((time, observation), springs)| Sample {
            sequence,
            time: *time,
            observation,
            springs,
        })
    };
    let touching = traces.iter().zip(springs).enumerate().flat_map(of_trace);
    let touching: Vec<Sample> = touching.filter(|s| !s.observation.is_empty()).collect();
    let joints = scene.robot().joints();
    let mut signs = vec![1.0; joints.len()];
    let mut gain = 0.0;
    let evidence = Evidence::new(&touching, joints);
    let likeness = UniformSprings::new(&touching, joints.len());
    if let Some(evidence) = &evidence {
        let own = evidence.of(&as_given(joints.len()));
        let turned = evidence.signs();
        gain = evidence.of(&with_signs(&turned)) - own;
        let scaled = evidence.scaled();
        let orders = orders(joints.len()).map(|(order, columns)| {
            let value = evidence.of(&columns);
            (columns, order, value)
        });
        // A stiffness that may be negative takes up what it wants of readings that press one way only. The sign of all joints
        // together may be turned as well.
        let given = likeness.of(&as_given(joints.len())).abs();
        let orders = orders.filter(|(columns, ..)| likeness.of(columns).abs() > given);
        let better = orders.filter(|(.., v)| v - own > gain + EVIDENT);
        let mut better: Vec<_> = better.map(|(_, order, value)| (order, value)).collect();
        better.sort_by(|a, b| b.1.total_cmp(&a.1));
        let best_order = better
            .first()
            .map_or(own + gain, |(_, best)| best - EVIDENT);
        let scaled = scaled.filter(|(.., v)| v - own > EVIDENT && *v > best_order);
        if let Some((joint, factor, value)) = scaled
            && is_felt(&touching, joint)
            && (0..joints.len()).any(|other| other != joint && is_felt(&touching, other))
        {
            return Some(PipelineWarning::ScaledJoint {
                joint: joints[joint].name().to_owned(),
                factor,
                gain: value - own,
            });
        }
        // Columns of a joint that is read in another unit, or hardly feels what is touched, are not told.
        if let Some((_, best)) = better.first().filter(|_| scaled.is_none()) {
            // Those that do nearly as well are not told from the best.
            let near = better.iter().take_while(|(_, v)| best - v < EVIDENT);
            let near: Vec<String> = near.map(|(order, _)| order.in_words(joints)).collect();
            return Some(PipelineWarning::MixedColumns {
                order: near.join(", or "),
                gain: best - own,
            });
        }
        signs = turned;
    }
    let correlation = likeness.of(&with_signs(&signs));
    // Signs and their opposites are as likely. One stiffness everywhere tells which, clearly if more joints are turned then.
    let turned = signs.iter().filter(|s| **s < 0.0).count();
    let as_few = turned > 0 && 2 * turned >= joints.len();
    if correlation < OPPOSITE || correlation < 0.0 && as_few {
        signs.iter_mut().for_each(|s| *s = -*s);
        // Where some keep theirs, a joint that feels next to nothing is not to be named with the others.
        if let Some(evidence) = evidence.filter(|_| turned > 0) {
            let told = evidence.told(&signs);
            let untold = signs.iter_mut().zip(told).filter(|(_, told)| !told);
            untold.for_each(|(s, _)| *s = 1.0);
        }
    }
    let opposite = joints.iter().zip(&signs).filter(|(_, s)| **s < 0.0);
    let opposite: Vec<&str> = opposite.map(|(joint, _)| joint.name()).collect();
    match opposite.len() {
        0 => None,
        n if n == joints.len() => Some(PipelineWarning::OppositeTorques { correlation }),
        _ => Some(PipelineWarning::OppositeJoints {
            joints: opposite.join(", "),
            gain,
        }),
    }
}

/// Whether the readings of a joint follow what springs of one stiffness everywhere give there: then their scale tells.
fn is_felt(touching: &[Sample], joint: usize) -> bool {
    let mut likeness = Likeness::default();
    for sample in touching {
        likeness.add(sample.observation.reading()[joint], sample.springs[joint]);
    }
    likeness.correlation() > FELT
}

/// A reading in contact.
struct Sample<'a> {
    sequence: usize,
    /// In the sequence (s).
    time: f64,
    observation: &'a Observation<f64>,
    /// What springs of 1 N/m give.
    springs: &'a [f64],
}

/// Medians of readings of one sequence, one after the other, in which noise shrinks and single wrong ones do not count.
struct Block {
    sequence: usize,
    time: f64,
    reading: Vec<f64>,
}

impl Block {
    fn new(samples: &[Sample]) -> Self {
        let share = 1.0 / samples.len() as f64;
        let first = &samples[0];
        let of_joint = |j: usize| {
            let readings = samples.iter().map(|s| s.observation.reading()[j]);
            median(readings.collect()).unwrap_or(0.0)
        };
        Self {
            sequence: first.sequence,
            time: samples.iter().map(|s| share * s.time).sum(),
            reading: (0..first.observation.dim()).map(of_joint).collect(),
        }
    }
}

/// Samples one after the other, of one sequence each, all as long as may be: at most so many parts.
fn parts<'s, 'a>(touching: &'s [Sample<'a>], most: usize) -> Vec<&'s [Sample<'a>]> {
    let of_sequences: Vec<&[Sample]> =
        (touching.chunk_by(|a, b| a.sequence == b.sequence)).collect();
    let longest = of_sequences.iter().map(|s| s.len()).max().unwrap_or(0);
    let count = |length: usize| {
        of_sequences
            .iter()
            .map(|s| s.len().div_ceil(length))
            .sum::<usize>()
    };
    // Every sequence ends with a shorter one.
    let mut length = touching.len().div_ceil(most).max(1);
    while count(length) > most && length < longest {
        length += 1 + length / 16;
    }
    let parts: Vec<_> = of_sequences.iter().flat_map(|s| s.chunks(length)).collect();
    let every = parts.len().div_ceil(most).max(1);
    parts.into_iter().step_by(every).collect()
}

/// Log marginal likelihood of readings in any convention, from one factorization per ratio of springs and noise.
struct Evidence {
    joints: usize,
    /// For every ratio, `log det C` and, for every joint in turn, the readings of every column in its rows, whitened.
    ratios: Vec<(f64, DMatrix<f64>)>,
}

impl Evidence {
    /// `None` where all readings or columns are zero, where the arithmetic fails, and of too many joints.
    fn new(touching: &[Sample], joints: &[Joint]) -> Option<Self> {
        let d = joints.len();
        let is_zero = |s: &Sample| s.observation.reading().iter().all(|r| *r == 0.0);
        if d > MOST_JOINTS || touching.iter().all(is_zero) {
            return None;
        }
        let most = (MOST_READINGS / d).max(1);
        let parts = parts(touching, most);
        let blocks: Vec<Block> = parts.iter().map(|part| Block::new(part)).collect();
        let along = springs_along(&parts, d);
        let mut springs = &along * along.transpose();
        let noise = noise(&springs, joints)?;
        let n = springs.nrows();
        let of_row = |row: usize| noise[row % d];
        for c in 0..n {
            let mut column = springs.column_mut(c);
            (0..n).for_each(|r| column[r] /= of_row(r) * of_row(c));
        }
        let of_block = |i: usize| {
            let rows = i * d..(i + 1) * d;
            (rows.map(|r| springs[(r, r)]).sum::<f64>() / d as f64).sqrt()
        };
        let typical = median((0..blocks.len()).map(of_block).collect()).filter(|t| *t > 0.0)?;
        let readings = DMatrix::from_fn(n, d * d, |row, place| {
            let (joint, column) = (place / d, place % d);
            if row % d == joint {
                blocks[row / d].reading[column] / noise[joint]
            } else {
                0.0
            }
        });
        let errors = errors_together(&blocks, d);
        let at = |ratio: &f64| {
            let covariance = &springs * (ratio / typical).powi(2) + &errors;
            let factor = covariance.cholesky()?;
            let log_det = 2.0 * (0..n).map(|i| factor.l_dirty()[(i, i)].ln()).sum::<f64>();
            let mut white = readings.clone();
            (factor.l_dirty()).solve_lower_triangular_mut(&mut white);
            Some((log_det, white))
        };
        let ratios: Vec<_> = RATIOS.iter().filter_map(at).collect();
        (!ratios.is_empty()).then_some(Self { joints: d, ratios })
    }

    /// With the ratio and the level of springs and noise at their best (nats, without constants).
    fn of(&self, columns: &Columns) -> f64 {
        let at = |(log_det, white): &(f64, DMatrix<f64>)| {
            let mut all = DVector::zeros(white.nrows());
            for (joint, (column, sign)) in columns.iter().enumerate() {
                all.axpy(*sign, &white.column(joint * self.joints + column), 1.0);
            }
            let n = white.nrows() as f64;
            -0.5 * (n * (all.norm_squared() / n).ln() + log_det)
        };
        self.ratios.iter().map(at).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The joint whose readings, in another unit, do best, what they are per those that the others ask for, and how well they do
    /// then (nats); `None` where that is less than [`LEAST_TIMES`] off.
    fn scaled(&self) -> Option<(usize, f64, f64)> {
        let units = UNITS.map(|k| 10_f64.powf(f64::from(k) / UNITS_PER_DECADE));
        let cases = (0..self.joints).flat_map(|joint| units.clone().map(move |unit| (joint, unit)));
        let of = |(joint, unit): (usize, f64)| {
            let mut columns = as_given(self.joints);
            columns[joint].1 = 1.0 / unit;
            // Densities of the readings themselves.
            let rows = self.ratios[0].1.nrows() / self.joints;
            (joint, unit, self.of(&columns) - rows as f64 * unit.ln())
        };
        let best = cases.map(of).max_by(|a, b| a.2.total_cmp(&b.2))?;
        (best.1.ln().abs() >= LEAST_TIMES.ln()).then_some(best)
    }

    /// Whether each joint's sign is evident, those of the others being these.
    fn told(&self, signs: &[f64]) -> Vec<bool> {
        let value = self.of(&with_signs(signs));
        let is_told = |j: usize| {
            let mut turned = signs.to_vec();
            turned[j] = -turned[j];
            value - self.of(&with_signs(&turned)) > EVIDENT
        };
        (0..self.joints).map(is_told).collect()
    }

    /// The signs that do best, by turning one joint's after the other, or two at once, while that is evident.
    fn signs(&self) -> Vec<f64> {
        let mut signs = vec![1.0; self.joints];
        let mut value = self.of(&with_signs(&signs));
        let joints = 0..self.joints;
        let singles: Vec<(usize, usize)> = joints.clone().map(|a| (a, a)).collect();
        let pairs = joints.flat_map(|a| (a + 1..self.joints).map(move |b| (a, b)));
        let moves = [singles, pairs.collect()];
        for _ in 0..self.joints {
            let best_of = |moves: &Vec<(usize, usize)>| {
                let turned = moves.iter().map(|&(a, b)| {
                    let mut turned = signs.clone();
                    turned[a] = -signs[a];
                    turned[b] = -signs[b];
                    (self.of(&with_signs(&turned)), turned)
                });
                let best = turned.max_by(|a, b| a.0.total_cmp(&b.0));
                best.filter(|(better, _)| better - value > EVIDENT)
            };
            let Some(better) = moves.iter().find_map(best_of) else {
                break;
            };
            (value, signs) = better;
        }
        signs
    }
}

/// The noise of every joint, up to its level: error of the model above all, which grows with what springs give there.
/// `springs` is their covariance, a row for every joint of a block. `None` where they give nothing.
fn noise(springs: &DMatrix<f64>, joints: &[Joint]) -> Option<Vec<f64>> {
    let d = joints.len();
    let rms = |j: usize| {
        let rows = (j..springs.nrows()).step_by(d);
        (rows.map(|r| springs[(r, r)]).sum::<f64>() * d as f64 / springs.nrows() as f64).sqrt()
    };
    let rms: Vec<f64> = (0..d).map(rms).collect();
    let unit = |j: usize| reading_unit(&joints[j]);
    let norm = |j: usize| {
        let alike = (0..d).filter(|&k| unit(k) == unit(j));
        alike.map(|k| rms[k] * rms[k]).sum::<f64>().sqrt()
    };
    let noise: Vec<f64> = (0..d).map(|j| rms[j] + FLOOR * norm(j)).collect();
    noise.iter().all(|sd| *sd > 0.0).then_some(noise)
}

/// What springs of 1 N/m at some points, a column for each, give on average over parts of a recording, a row for every
/// joint of a part.
fn springs_along(parts: &[&[Sample]], joints: usize) -> DMatrix<f64> {
    let samples = || parts.iter().copied().flatten();
    let touched = samples().filter_map(|s| s.observation.points().iter().max());
    let mut is_touched = vec![false; touched.max().map_or(0, |p| *p as usize + 1)];
    for sample in samples() {
        (sample.observation.points().iter()).for_each(|p| is_touched[*p as usize] = true);
    }
    let mut points: Vec<u32> = (0..is_touched.len() as u32)
        .filter(|p| is_touched[*p as usize])
        .collect();
    // Scattered, since neighbors in a lattice have like indices.
    points.sort_by_key(|p| p.wrapping_mul(0x9E37_79B1));
    points.truncate(MOST_POINTS);
    let mut column = vec![None; is_touched.len()];
    (points.iter().enumerate()).for_each(|(k, p)| column[*p as usize] = Some(k));
    let mut along = DMatrix::zeros(parts.len() * joints, points.len());
    for (i, part) in parts.iter().enumerate() {
        let share = 1.0 / part.len() as f64;
        for Sample { observation, .. } in *part {
            let columns = observation.points().iter().map(|p| column[*p as usize]);
            for (k, column) in columns.enumerate().filter_map(|(k, c)| Some((k, c?))) {
                for j in 0..joints {
                    along[(i * joints + j, column)] += share * observation.row(j)[k];
                }
            }
        }
    }
    along
}

/// Covariance of the errors of the readings, in units of the noise: of the noise itself, of what persists for a while, and
/// of the zero of every joint.
fn errors_together(blocks: &[Block], joints: usize) -> DMatrix<f64> {
    let n = blocks.len() * joints;
    let mut together = DMatrix::identity(n, n);
    for (i, a) in blocks.iter().enumerate() {
        for (k, b) in blocks.iter().enumerate() {
            let persists = if a.sequence == b.sequence {
                PERSISTING * (-(a.time - b.time).abs() / PERSISTS).exp()
            } else {
                0.0
            };
            for j in 0..joints {
                together[(i * joints + j, k * joints + j)] += persists + ZERO;
            }
        }
    }
    together
}

/// How like readings in some convention are to the torques of springs of one stiffness everywhere.
struct UniformSprings {
    /// Sums of what springs give at a joint times the reading of a column.
    products: DMatrix<f64>,
    /// Product of the norms of both.
    norms: f64,
}

impl UniformSprings {
    fn new(touching: &[Sample], joints: usize) -> Self {
        let mut products = DMatrix::zeros(joints, joints);
        let (mut of_springs, mut of_readings) = (0.0, 0.0);
        for sample in touching {
            let reading = sample.observation.reading();
            for (j, spring) in sample.springs.iter().enumerate() {
                of_springs += spring * spring;
                of_readings += reading[j] * reading[j];
                for (c, r) in reading.iter().enumerate() {
                    products[(j, c)] += spring * r;
                }
            }
        }
        Self {
            products,
            norms: (of_springs * of_readings).sqrt(),
        }
    }

    /// The correlation of both; NaN where one of them is zero.
    fn of(&self, columns: &Columns) -> f64 {
        let pairs = columns.iter().enumerate();
        let both = pairs.map(|(j, (c, sign))| sign * self.products[(j, *c)]);
        both.sum::<f64>() / self.norms
    }
}
