//! The ground truth of a case.

use crate::arm::{JOINTS, JointVector};
use crate::case::{CaseSpec, Class, Level};
use crate::effect::Effect;
use crate::motion::{FIRST_TEST, Phase, RATE_HZ, Trajectory};
use crate::sensor::Rows;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The ground truth of a case, which no recording contains.
///
/// Differences are those of noise-free torques: as recorded, minus those of the same world without effects at the
/// *recorded* angles. For an effect that changes only the recorded angles (`what_if`), the difference is the change that
/// these angles would cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Label {
    /// The requested case.
    pub spec: CaseSpec,
    /// Kind of answer that is right.
    pub class: Class,
    /// The effects with their parameters.
    pub effects: Vec<AppliedEffect>,
    /// True if an effect changes the recorded angles but not the torques.
    pub what_if: bool,
    /// RMS of `|tau|` over the test rows without effects \[N m\].
    pub rms_tau_test: f64,
    /// RMS of the difference over the test rows \[N m\].
    pub rms_diff_test: f64,
    /// `rms_diff_test / rms_tau_test`.
    pub ratio_test: f64,
    /// Sum of the squared differences over the train rows and all joints \[N^2 m^2\].
    pub diff_energy_train: f64,
    /// Sum of the squared differences over the test rows and all joints \[N^2 m^2\].
    pub diff_energy_test: f64,
    /// Shares of the squared difference, over train and test rows.
    pub truth_share: TruthShare,
    /// Largest `|tau|` without effects in each sequence \[N m\].
    pub peak_tau: Vec<f64>,
    /// Commanded depth of each sequence \[m\].
    pub push_depth_m: Vec<f64>,
    /// Phases of each sequence, with start and end \[s\].
    pub schedule: Vec<Vec<(Phase, f64, f64)>>,
    /// Standard deviation of the torque noise of a joint \[N m\].
    pub noise_nm: f64,
    /// Correlation of the noise between consecutive samples.
    pub noise_ar1: f64,
    /// Friction coefficient of the surface without effects.
    pub friction: f64,
    /// Noise-free torques without effects at the recorded angles, per sequence \[N m\]: the prediction of a model that
    /// knows everything but the effects.
    pub oracle: Vec<Vec<JointVector>>,
}

/// An applied effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AppliedEffect {
    /// Name and parameters.
    #[serde(flatten)]
    pub effect: Effect,
    /// Requested strength.
    pub level: Level,
    /// Factor on the drawn parameters, found by trial.
    pub strength: f64,
    /// `ratio_test` for this effect alone.
    pub ratio_alone: f64,
    /// Joints that have the effect, counted from 1; none if it does not act on joints.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub joints: Option<Vec<usize>>,
    /// Phases in which the mean squared change is at least half of that over all rows.
    pub phases: Vec<Phase>,
    /// Sequences in which the mean squared change is at least half of that over all rows.
    pub sequences: Vec<String>,
}

/// Shares of a squared difference. Each group sums to one, or is zero if there is no difference.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct TruthShare {
    /// Shares per joint.
    pub joint: JointVector,
    /// Shares per sequence, in order.
    pub sequence: Vec<f64>,
    /// Shares per phase.
    pub phase: BTreeMap<Phase, f64>,
}

/// Folder ID of sequence `s`.
pub(crate) fn sequence_id(s: usize) -> String {
    format!("{s:03}")
}

/// Difference row by row.
pub(crate) fn difference(a: &[Rows], b: &[Rows]) -> Vec<Rows> {
    let row = |(a, b): (&JointVector, &JointVector)| std::array::from_fn(|j| a[j] - b[j]);
    let rows = |(a, b): (&Rows, &Rows)| a.iter().zip(b).map(row).collect();
    a.iter().zip(b).map(rows).collect()
}

/// Sum of squares.
pub(crate) fn energy(rows: &[Rows]) -> f64 {
    rows.iter().flatten().flatten().map(|x| x * x).sum()
}

/// RMS of the norm of the rows of the test sequences.
pub(crate) fn rms_test(rows: &[Rows]) -> f64 {
    let test = &rows[FIRST_TEST..];
    let count = test.iter().map(Vec::len).sum::<usize>().max(1);
    (energy(test) / count as f64).sqrt()
}

/// Distribution of the difference over joints, sequences and phases.
pub(crate) fn truth_share(diff: &[Rows], plan: &[Trajectory]) -> TruthShare {
    let total = energy(diff);
    let share = |e: f64| if total > 0.0 { e / total } else { 0.0 };
    let mut joint = [0.0; JOINTS];
    let mut phase: BTreeMap<Phase, f64> = BTreeMap::new();
    for (rows, t) in diff.iter().zip(plan) {
        for (row, p) in rows.iter().zip(&t.phases) {
            for (sum, x) in joint.iter_mut().zip(row) {
                *sum += share(x * x);
            }
            *phase.entry(*p).or_default() += share(row.iter().map(|x| x * x).sum());
        }
    }
    let sequence = diff.chunks(1).map(|s| share(energy(s))).collect();
    TruthShare {
        joint,
        sequence,
        phase,
    }
}

/// Phases and sequences in which the mean squared change is at least half of the overall one.
pub(crate) fn where_it_acts(diff: &[Rows], plan: &[Trajectory]) -> (Vec<Phase>, Vec<String>) {
    let shares = truth_share(diff, plan);
    let rows: usize = diff.iter().map(Vec::len).sum();
    let acts = |share: f64, count: usize| share * rows as f64 >= 0.5 * count as f64 && share > 0.0;
    let count = |p: &Phase| {
        plan.iter()
            .flat_map(|t| &t.phases)
            .filter(|x| *x == p)
            .count()
    };
    let phases = shares
        .phase
        .iter()
        .filter(|(p, s)| acts(**s, count(p)))
        .map(|(p, _)| *p);
    let sequences = shares.sequence.iter().enumerate();
    let sequences = sequences.filter(|(s, share)| acts(**share, diff[*s].len()));
    (
        phases.collect(),
        sequences.map(|(s, _)| sequence_id(s)).collect(),
    )
}

/// Phases with their start and end.
pub(crate) fn schedule(phases: &[Phase]) -> Vec<(Phase, f64, f64)> {
    let mut out: Vec<(Phase, f64, f64)> = Vec::new();
    for (k, p) in phases.iter().enumerate() {
        let end = (k + 1) as f64 / RATE_HZ;
        match out.last_mut() {
            Some((last, _, to)) if last == p => *to = end,
            _ => out.push((*p, k as f64 / RATE_HZ, end)),
        }
    }
    out
}
