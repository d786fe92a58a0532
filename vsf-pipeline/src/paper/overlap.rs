use crate::estimate::touched_points;
use crate::{Experiment, Trace};
use serde::Serialize;
use std::fmt;
use vsf_core::median;

/// Least share of contacts on common points of touches that overlap.
const OVERLAP: f64 = 0.25;

/// Where the touches of an experiment lie: the three datasets of section IV-B, told from the contacts
/// alone. A *share* is that of a sequence's contacts, summed over its samples, on points that other
/// sequences touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Overlap {
    /// One place: every sequence shares at least 0.25 with every other one.
    Full,
    /// Similar places: neither of the others.
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

/// What [`Overlap`] is told from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OverlapShares {
    /// Least share of a sequence with another one.
    pub least_pair: f64,
    /// Median share of a sequence with all others.
    pub with_all: f64,
}

impl OverlapShares {
    /// Shares of the sequences of an experiment.
    pub fn of(experiment: &Experiment) -> Self {
        Self::between(experiment.traces(), experiment.scene().rest().len())
    }

    fn between(traces: &[Trace], field_len: usize) -> Self {
        let others = |k: usize| (0..traces.len()).filter(move |&j| j != k);
        let pairs = (0..traces.len()).flat_map(|k| others(k).map(move |j| (k, j)));
        let shares = pairs.map(|(k, j)| share([&traces[j]], &traces[k], field_len));
        let with_all = |k: usize| share(others(k).map(|j| &traces[j]), &traces[k], field_len);
        Self {
            least_pair: shares.fold(1.0, f64::min),
            with_all: median((0..traces.len()).map(with_all).collect()).unwrap_or(0.0),
        }
    }

    /// The dataset of the paper that these shares belong to.
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

/// Share of the contacts of a trace on points that `others` touch; 0 without contact.
fn share<'a>(others: impl IntoIterator<Item = &'a Trace>, trace: &Trace, field_len: usize) -> f64 {
    let known = touched_points(others, field_len);
    let (mut shared, mut all) = (0usize, 0usize);
    for obs in &trace.observations {
        all += obs.len();
        shared += obs.points().iter().filter(|&&p| known[p as usize]).count();
    }
    shared as f64 / all.max(1) as f64
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
        assert_eq!(overlap(&[&[], &[2, 3]]), Overlap::No);
    }
}
