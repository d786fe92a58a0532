//! How well diagnoses agree with the truth.

mod score;

pub use score::Score;

use crate::console::{number, table};
use serde::Serialize;
use std::collections::BTreeMap;
use vsf::gap::{Campaign, LocatedShare, Outcome, Place, VerdictKind};
use vsf_world::{Class, Label, Level, Protocol};

/// A case, its diagnosis and its truth.
#[derive(Debug, Clone, Serialize)]
pub struct Case {
    case: String,
    kind: vsf_world::Kind,
    level: Level,
    protocol: Protocol,
    #[serde(skip)]
    class: Class,
    /// Names of the true effects.
    truth: Vec<String>,
    kind_of_answer: Option<VerdictKind>,
    named: Vec<String>,
    /// Effects by probability, the likeliest three.
    top: Vec<String>,
    probability_of_truth: f64,
    #[serde(skip)]
    probability: f64,
    effect_set_95: Vec<String>,
    right_joint: Option<bool>,
    right_phase: Option<bool>,
    test_error_nominal: f64,
    test_error_corrected: f64,
    closed_fraction: f64,
    /// Energy that the effects add to the readings, as a share of the gap's, at most 1: what there is to close.
    oracle_closed: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl Case {
    /// A case that was diagnosed.
    pub fn new(case: String, label: &Label, campaign: &Campaign, outcome: &Outcome) -> Self {
        let d = &outcome.diagnosis;
        let truth: Vec<String> = label.spec.effects.clone();
        let top: Vec<String> = (d.effects.iter())
            .filter(|e| e.testable)
            .take(3)
            .map(|e| e.effect.clone())
            .collect();
        let of_truth = (d.effects.iter())
            .filter(|e| truth.contains(&e.effect))
            .map(|e| e.probability);
        let of_truth = sum(of_truth) / truth.len().max(1) as f64;
        let named = !d.verdict.effects.is_empty();
        let joints = campaign.site().robot.joints();
        let true_joint =
            largest(&label.truth_share.joint).and_then(|j| Some(joints.get(j)?.name().to_owned()));
        let found_joint = first(&d.location.joint).map(|of| match of {
            Place::Joint(name) => name.clone(),
            _ => String::new(),
        });
        let phases: Vec<(String, f64)> = (label.truth_share.phase.iter())
            .map(|(p, share)| (format!("{p:?}").to_lowercase(), *share))
            .collect();
        let shares: Vec<f64> = phases.iter().map(|p| p.1).collect();
        let true_phase = largest(&shares).map(|i| phases[i].0.clone());
        let found_phase = first(&d.location.phase).map(|of| match of {
            Place::Phase(phase) => phase.name().to_owned(),
            _ => String::new(),
        });
        let floor = campaign.site().joints() as f64 * label.noise_nm.powi(2);
        let nominal = outcome.nominal.mean_square();
        let oracle = oracle_square(label, campaign);
        Self {
            case,
            kind: label.spec.kind,
            level: label.spec.level,
            protocol: label.spec.protocol,
            class: label.class,
            kind_of_answer: Some(d.verdict.kind),
            named: d.verdict.effects.clone(),
            top,
            probability_of_truth: match label.class {
                Class::None if d.verdict.kind == VerdictKind::NoGap => d.verdict.probability,
                Class::None => 0.0,
                _ => of_truth,
            },
            probability: d.verdict.probability,
            effect_set_95: d.verdict.effect_set_95.clone(),
            right_joint: named.then(|| found_joint == true_joint),
            right_phase: named.then(|| found_phase == true_phase),
            test_error_nominal: d.gap.test_error_nominal,
            test_error_corrected: d.gap.test_error_corrected,
            closed_fraction: d.gap.closed_fraction,
            oracle_closed: if nominal > floor {
                (oracle / (nominal - floor)).min(1.0)
            } else {
                0.0
            },
            truth,
            error: None,
        }
    }

    /// A case whose diagnosis failed.
    pub fn failed(case: String, label: &Label, error: &str) -> Self {
        Self {
            case,
            kind: label.spec.kind,
            level: label.spec.level,
            protocol: label.spec.protocol,
            class: label.class,
            truth: label.spec.effects.clone(),
            kind_of_answer: None,
            named: Vec::new(),
            top: Vec::new(),
            probability_of_truth: 0.0,
            probability: 0.0,
            effect_set_95: Vec::new(),
            right_joint: None,
            right_phase: None,
            test_error_nominal: 0.0,
            test_error_corrected: 0.0,
            closed_fraction: 0.0,
            oracle_closed: 0.0,
            error: Some(error.to_owned()),
        }
    }

    /// Whether its diagnosis came to an end.
    pub fn is_diagnosed(&self) -> bool {
        self.error.is_none()
    }

    /// Whether the answer is right, as a whole.
    fn answered(&self) -> bool {
        match self.class {
            Class::None => self.kind_of_answer == Some(VerdictKind::NoGap),
            Class::Unknown => self.kind_of_answer == Some(VerdictKind::Unknown),
            _ => self.kind_of_answer == Some(VerdictKind::Effects) && self.names_truth(),
        }
    }

    /// Whether the true effects are named, and no others.
    fn names_truth(&self) -> bool {
        let known = matches!(self.class, Class::Single | Class::Pair);
        let all = self.truth.iter().all(|e| self.named.contains(e));
        known && self.named.len() == self.truth.len() && all
    }

    /// Whether what its probability is of is so: what is named, whatever else may act; or, where nothing is, the answer.
    fn came_true(&self) -> bool {
        if self.named.is_empty() {
            self.answered()
        } else {
            self.names_truth()
        }
    }
}

/// Mean square of what the effects change on the test sequences: the part of the gap that is theirs.
fn oracle_square(label: &Label, campaign: &Campaign) -> f64 {
    let rows: usize = campaign.test().iter().map(|m| m.len()).sum();
    label.diff_energy_test / rows.max(1) as f64
}

fn largest(shares: &[f64]) -> Option<usize> {
    (0..shares.len())
        .filter(|&i| shares[i] > 0.0)
        .max_by(|a, b| shares[*a].total_cmp(&shares[*b]))
}

fn first(parts: &[LocatedShare]) -> Option<&Place> {
    parts.first().map(|p| &p.of)
}

/// The sum, of nothing too: 0, where that of the iterator is -0.
fn sum(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |sum, value| sum + value)
}

/// The report for people.
pub fn text(cases: &[Case], scores: &[Score]) -> String {
    let join = |names: &[String]| match names {
        [] => "-".to_owned(),
        names => names.join(" + "),
    };
    let rows: Vec<Vec<String>> = (cases.iter())
        .map(|c| {
            vec![
                c.case.clone(),
                format!("{:?} {:?} {:?}", c.kind, c.level, c.protocol).to_lowercase(),
                join(&c.truth),
                match (c.kind_of_answer, &c.error) {
                    (_, Some(error)) => format!("failed: {error}"),
                    (Some(VerdictKind::NoGap), _) => "no gap".to_owned(),
                    (Some(VerdictKind::Unknown), _) => format!("unknown ({})", join(&c.named)),
                    (Some(VerdictKind::NotDiagnosable), _) => {
                        format!("undecided ({})", join(&c.named))
                    }
                    _ => join(&c.named),
                },
                number(c.probability_of_truth),
                number(c.test_error_nominal),
                number(c.test_error_corrected),
            ]
        })
        .collect();
    let mut text = table(
        &[
            "case",
            "what",
            "truth",
            "diagnosis",
            "P(truth)",
            "before",
            "after",
        ],
        &rows,
    );
    text += "\nconfusion of single effects (truth: named, times)\n";
    let mut confusion: BTreeMap<(String, String), usize> = BTreeMap::new();
    for c in cases.iter().filter(|c| c.class == Class::Single) {
        let named = c.top.first().cloned().unwrap_or_default();
        *confusion.entry((c.truth[0].clone(), named)).or_default() += 1;
    }
    let rows: Vec<Vec<String>> = (confusion.into_iter())
        .map(|((truth, named), n)| vec![truth, named, n.to_string()])
        .collect();
    text += &table(&["truth", "likeliest", "times"], &rows);
    scores.iter().for_each(|score| text += &score.text());
    text
}
