use super::PipelineWarning;
use super::jumps::moves;
use vsf_core::median;
use vsf_data::Sequence;

/// Times the usual step beyond which samples are missing, and how long (s) that is at least.
const MOST_STEPS: f64 = 10.0;
const LEAST_GAP: f64 = 0.1;

/// Reports missing time within a touch.
pub fn warning(sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let gap = |s: &&Sequence| {
        let step = |row: usize| s.time[row] - s.time[row - 1];
        let usual = median(moves(s).map(step).collect())?;
        let row = moves(s).find(|row| step(*row) > LEAST_GAP.max(MOST_STEPS * usual))?;
        Some((s.id.clone(), row, step(row), usual))
    };
    let mut found = sequences.iter().filter_map(gap);
    let (sequence, row, seconds, usual) = found.next()?;
    Some(PipelineWarning::TimeGap {
        sequence,
        row,
        seconds,
        usual,
        others: found.count(),
    })
}
