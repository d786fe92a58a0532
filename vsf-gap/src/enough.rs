use crate::{Campaign, GapError};

/// Samples in a row that noise is read from, and how many such runs tell it.
const SHORTEST_RUN: usize = 4;
const FEWEST_RUNS: usize = 8;
/// A joint that moves by less (rad or m) stands still.
const STILL: f64 = 1e-3;

/// Checks that the train sequences tell noise from a gap, and a gap from a constant.
pub(crate) fn enough(campaign: &Campaign) -> Result<(), GapError> {
    if campaign.train.is_empty() {
        return Err(GapError::TooLittle {
            what: "train sequences",
            problem: "there are none; give the recording a train split".to_owned(),
        });
    }
    let runs: usize = (campaign.train.iter())
        .map(|m| (m.len() + 1).saturating_sub(SHORTEST_RUN))
        .sum();
    if runs < FEWEST_RUNS {
        return Err(GapError::TooLittle {
            what: "train samples",
            problem: format!(
                "noise is read from {SHORTEST_RUN} samples in a row, of which there are {runs} in the train sequences \
                 and {FEWEST_RUNS} are needed; record longer sequences"
            ),
        });
    }
    let rows = || campaign.train.iter().flat_map(|m| m.q.iter());
    let range = |j: usize| {
        let (low, high) = rows().fold((f64::MAX, f64::MIN), |(low, high), q| {
            (low.min(q[j]), high.max(q[j]))
        });
        high - low
    };
    if (0..campaign.site.joints()).all(|j| range(j) < STILL) {
        return Err(GapError::TooLittle {
            what: "motion in the train sequences",
            problem: format!(
                "no joint moves by {STILL} rad (or m), so that any constant explains the readings; record motion"
            ),
        });
    }
    Ok(())
}
