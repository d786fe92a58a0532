use crate::estimate::touched_points;
use crate::{Experiment, Trace};
use serde::Serialize;
use std::fmt;
use vsf_core::median;

/// Least share of contacts on common points of touches that overlap.
const OVERLAP: f64 = 0.25;

/// Overlap of the touched places of an experiment: the three datasets of section IV-B, classified by
/// contacts alone.
///
/// The *share* of a sequence is the fraction of its contacts, summed over its samples, on points that other
/// sequences touch. Sequences that touch nothing are ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Overlap {
    /// One place: every sequence shares at least 0.25 with every other one.
    Full,
    /// Similar places: neither of the other two.
    Partial,
    /// Separate places: the median sequence shares less than 0.25 with all others together.
    No,
}

impl fmt::Display for Overlap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Full => "FULL",
            Self::Partial => "PARTIAL",
            Self::No => "NO",
        })
    }
}

/// The shares that determine [`Overlap`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct OverlapShares {
    /// Least share of a sequence with another one.
    pub least_pair: f64,
    /// Median over sequences of the share with all others together.
    pub with_all: f64,
}

impl OverlapShares {
    /// Computes the shares of an experiment.
    pub fn of(experiment: &Experiment) -> Self {
        Self::between(experiment.traces(), experiment.scene().rest().len())
    }

    fn between(traces: &[Trace], field_len: usize) -> Self {
        let touching: Vec<&Trace> = (traces.iter())
            .filter(|t| t.contact_samples() > 0)
            .collect();
        let touched = touching.iter().map(|&t| touched_points([t], field_len));
        let touched: Vec<Vec<bool>> = touched.collect();
        let pairs = (0..touching.len()).flat_map(|k| (0..touched.len()).map(move |j| (k, j)));
        let pairs = pairs.filter(|(k, j)| k != j);
        let least_pair = pairs
            .map(|(k, j)| share(touching[k], |p| touched[j][p]))
            .reduce(f64::min);
        // Its own touch is one of them.
        let by_another = |p: usize| touched.iter().filter(|t| t[p]).count() > 1;
        let with_all = touching.iter().map(|t| share(t, by_another)).collect();
        Self {
            least_pair: least_pair.unwrap_or(0.0),
            with_all: median(with_all).unwrap_or(0.0),
        }
    }

    /// The dataset of the paper that matches these shares.
    pub fn overlap(&self) -> Overlap {
        if self.least_pair >= OVERLAP {
            Overlap::Full
        } else if self.with_all >= OVERLAP {
            Overlap::Partial
        } else {
            Overlap::No
        }
    }
}

/// Share of the contacts of a trace that touches on known points.
fn share(trace: &Trace, is_known: impl Fn(usize) -> bool) -> f64 {
    let (mut shared, mut all) = (0usize, 0usize);
    for obs in &trace.observations {
        all += obs.len();
        shared += obs
            .points()
            .iter()
            .filter(|&&p| is_known(p as usize))
            .count();
    }
    shared as f64 / all as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use vsf_core::{Noise, Observation};

    /// One sample that touches these of 10 points.
    fn touch(points: &[u32]) -> Trace {
        let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
        obs.rebuild(10, points, &[1.0], |_, w| w[0] = 1.0).unwrap();
        Trace {
            id: String::new(),
            time: vec![0.0],
            observations: vec![obs],
            touches: std::iter::once(0..1).collect(),
        }
    }

    fn overlap(touches: &[&[u32]]) -> Overlap {
        let traces: Vec<_> = touches.iter().map(|t| touch(t)).collect();
        OverlapShares::between(&traces, 10).overlap()
    }

    #[test]
    fn by_the_points_in_common() {
        assert_eq!(
            overlap(&[&[0, 1, 2], &[1, 2, 3], &[0, 2, 3]]),
            Overlap::Full
        );
        // The first and the last have nothing in common.
        assert_eq!(overlap(&[&[0, 1], &[1, 2], &[2, 3]]), Overlap::Partial);
        assert_eq!(overlap(&[&[0, 1], &[2, 3], &[4, 5]]), Overlap::No);
        // A push that missed says nothing of places.
        assert_eq!(overlap(&[&[], &[2, 3]]), Overlap::No);
        assert_eq!(overlap(&[&[0, 1], &[], &[0, 1]]), Overlap::Full);
    }
}
