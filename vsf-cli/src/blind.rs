//! How well diagnoses agree with the truth.

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

    fn answered(&self) -> bool {
        match self.class {
            Class::None => self.kind_of_answer == Some(VerdictKind::NoGap),
            Class::Unknown => self.kind_of_answer == Some(VerdictKind::Unknown),
            _ => self.named.iter().all(|e| self.truth.contains(e)) && !self.named.is_empty(),
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

/// Hits out of some cases, with Wilson's interval of 95 %.
#[derive(Debug, Clone, Serialize)]
pub struct Share {
    hits: usize,
    of: usize,
    share: f64,
    interval: [f64; 2],
}

impl Share {
    fn of<'a>(cases: impl Iterator<Item = &'a Case>, hit: impl Fn(&Case) -> bool) -> Self {
        let all: Vec<bool> = cases.map(hit).collect();
        let (hits, of) = (all.iter().filter(|h| **h).count(), all.len());
        let (n, p) = (of.max(1) as f64, hits as f64 / of.max(1) as f64);
        let z = 1.96_f64;
        let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        Self {
            hits,
            of,
            share: p,
            interval: [(middle - half).max(0.0), (middle + half).min(1.0)],
        }
    }

    fn text(&self) -> String {
        if self.of == 0 {
            return "-".to_owned();
        }
        format!(
            "{}/{} = {:.0} % ({:.0}..{:.0})",
            self.hits,
            self.of,
            100.0 * self.share,
            100.0 * self.interval[0],
            100.0 * self.interval[1]
        )
    }
}

/// How a group of cases came out.
#[derive(Debug, Clone, Serialize)]
pub struct Score {
    group: String,
    top1: Share,
    top2: Share,
    in_set: Share,
    set_size: Option<f64>,
    both_of_two: Share,
    one_of_two: Share,
    quiet_without_effect: Share,
    unknown_flagged: Share,
    right_joint: Share,
    right_phase: Share,
    never_worse: Share,
    mean_probability: Option<f64>,
    /// Expected calibration error of the verdict's probability, five bins.
    ece: Option<f64>,
    /// Median of closed fraction over what there is to close, of single effects that were named right.
    closed_of_oracle: Option<f64>,
}

impl Score {
    /// Over all cases, by kind, level and protocol.
    pub fn all(cases: &[Case]) -> Vec<Self> {
        let kind = |k| move |c: &Case| c.kind == k;
        let level = |l| move |c: &Case| c.level == l;
        let protocol = |p| move |c: &Case| c.protocol == p;
        vec![
            Self::of("all", cases, |_| true),
            Self::of("springs", cases, kind(vsf_world::Kind::Springs)),
            Self::of("plants", cases, kind(vsf_world::Kind::Plant)),
            Self::of("clear", cases, level(Level::Clear)),
            Self::of("subtle", cases, level(Level::Subtle)),
            Self::of("rich", cases, protocol(Protocol::Rich)),
            Self::of("push only", cases, protocol(Protocol::PushOnly)),
        ]
    }

    fn of(group: &str, cases: &[Case], member: impl Fn(&Case) -> bool) -> Self {
        let of = |class: Class| {
            let own = cases.iter().filter(|c| member(c));
            own.filter(move |c| c.class == class)
        };
        let all = || cases.iter().filter(|c| member(c));
        let among = |c: &Case, k: usize| c.top.iter().take(k).any(|e| c.truth.contains(e));
        let mean = |x: Vec<f64>| (!x.is_empty()).then(|| sum(x.iter().copied()) / x.len() as f64);
        let mut closed: Vec<f64> = of(Class::Single)
            .filter(|c| c.answered() && c.oracle_closed > 0.05)
            .map(|c| c.closed_fraction / c.oracle_closed)
            .collect();
        closed.sort_by(f64::total_cmp);
        Self {
            group: group.to_owned(),
            top1: Share::of(of(Class::Single), |c| among(c, 1)),
            top2: Share::of(of(Class::Single), |c| among(c, 2)),
            in_set: Share::of(of(Class::Single), |c| {
                c.truth.iter().all(|t| c.effect_set_95.contains(t))
            }),
            set_size: mean(
                of(Class::Single)
                    .map(|c| c.effect_set_95.len() as f64)
                    .collect(),
            ),
            both_of_two: Share::of(of(Class::Pair), |c| {
                c.truth.iter().all(|t| c.named.contains(t))
            }),
            one_of_two: Share::of(of(Class::Pair), |c| {
                c.truth.iter().any(|t| c.named.contains(t))
            }),
            quiet_without_effect: Share::of(of(Class::None), Case::answered),
            unknown_flagged: Share::of(of(Class::Unknown), Case::answered),
            right_joint: Share::of(all().filter(|c| c.right_joint.is_some()), |c| {
                c.right_joint == Some(true)
            }),
            right_phase: Share::of(all().filter(|c| c.right_phase.is_some()), |c| {
                c.right_phase == Some(true)
            }),
            never_worse: Share::of(all(), |c| {
                c.test_error_corrected <= c.test_error_nominal + 1e-12
            }),
            mean_probability: mean(of(Class::Single).map(|c| c.probability_of_truth).collect()),
            ece: calibration(&all().collect::<Vec<_>>()),
            closed_of_oracle: closed.get(closed.len() / 2).copied(),
        }
    }
}

/// Mean gap between stated probability and share of right answers, over five bins; `None` without cases.
fn calibration(cases: &[&Case]) -> Option<f64> {
    let bins = 5;
    let mut error = 0.0;
    for bin in 0..bins {
        let own: Vec<&&Case> = (cases.iter())
            .filter(|c| ((c.probability * bins as f64) as usize).min(bins - 1) == bin)
            .collect();
        let n = own.len() as f64;
        let stated: f64 = own.iter().map(|c| c.probability).sum();
        let right = own.iter().filter(|c| c.answered()).count() as f64;
        if n > 0.0 {
            error += (stated - right).abs();
        }
    }
    (!cases.is_empty()).then(|| error / cases.len() as f64)
}

/// The report for people.
pub fn text(cases: &[Case], scores: &[Score]) -> String {
    let or_none = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), number);
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
    for s in scores {
        text += &format!("\n{}\n", s.group);
        let lines = [
            ("single effect, likeliest", s.top1.text()),
            ("single effect, of the two likeliest", s.top2.text()),
            ("truth in the 95 % set", s.in_set.text()),
            ("mean size of that set", or_none(s.set_size)),
            ("both of two effects", s.both_of_two.text()),
            ("one of two effects", s.one_of_two.text()),
            ("quiet without effect", s.quiet_without_effect.text()),
            ("unknown effects flagged", s.unknown_flagged.text()),
            ("right joint", s.right_joint.text()),
            ("right phase", s.right_phase.text()),
            ("corrected model no worse", s.never_worse.text()),
            ("mean probability of the truth", or_none(s.mean_probability)),
            ("calibration error", or_none(s.ece)),
            (
                "closed, of what the effect makes of the gap, median",
                or_none(s.closed_of_oracle),
            ),
        ];
        let rows: Vec<Vec<String>> = (lines.into_iter())
            .map(|(name, value)| vec![name.to_owned(), value])
            .collect();
        text += &table(&["measure", "value"], &rows);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(
        class: Class,
        truth: &[&str],
        named: &[&str],
        kind: VerdictKind,
        probability: f64,
    ) -> Case {
        let own = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
        Case {
            case: String::new(),
            kind: vsf_world::Kind::Springs,
            level: Level::Clear,
            protocol: Protocol::Rich,
            class,
            truth: own(truth),
            kind_of_answer: Some(kind),
            named: own(named),
            top: own(named),
            probability_of_truth: probability,
            probability,
            effect_set_95: own(named),
            right_joint: None,
            right_phase: None,
            test_error_nominal: 1.0,
            test_error_corrected: 0.5,
            closed_fraction: 0.5,
            oracle_closed: 1.0,
            error: None,
        }
    }

    #[test]
    fn hits_are_counted_by_class() {
        let cases = [
            case(
                Class::Single,
                &["payload"],
                &["payload"],
                VerdictKind::Effects,
                0.9,
            ),
            case(
                Class::Single,
                &["payload"],
                &["torque_bias"],
                VerdictKind::Effects,
                0.6,
            ),
            case(
                Class::Pair,
                &["latency", "payload"],
                &["payload"],
                VerdictKind::Effects,
                0.9,
            ),
            case(Class::None, &[], &[], VerdictKind::NoGap, 0.8),
            case(
                Class::Unknown,
                &["backlash"],
                &[],
                VerdictKind::Unknown,
                0.7,
            ),
        ];
        let s = &Score::all(&cases)[0];
        assert_eq!((s.top1.hits, s.top1.of), (1, 2));
        assert_eq!((s.both_of_two.hits, s.one_of_two.hits), (0, 1));
        assert_eq!(
            (s.quiet_without_effect.hits, s.unknown_flagged.hits),
            (1, 1)
        );
        assert_eq!(s.never_worse.hits, 5);
        assert!((s.closed_of_oracle.unwrap() - 0.5).abs() < 1e-12);
        // Wilson's interval of 1 in 2: 9.5 % to 90.5 %.
        let [low, high] = s.top1.interval;
        assert!(
            (low - 0.0945).abs() < 1e-3 && (high - 0.9055).abs() < 1e-3,
            "{low} {high}"
        );
    }

    #[test]
    fn no_cases_give_no_numbers() {
        let s = &Score::all(&[])[0];
        for value in [s.set_size, s.mean_probability, s.ece, s.closed_of_oracle] {
            assert_eq!(value, None);
        }
    }

    #[test]
    fn calibration_compares_stated_and_true() {
        let sure = |hit: bool| {
            let named: &[&str] = if hit { &["payload"] } else { &["latency"] };
            case(
                Class::Single,
                &["payload"],
                named,
                VerdictKind::Effects,
                0.9,
            )
        };
        let cases: Vec<Case> = (0..10).map(|i| sure(i != 0)).collect();
        let all: Vec<&Case> = cases.iter().collect();
        assert!(calibration(&all).unwrap() < 1e-9);
        let wrong: Vec<Case> = (0..10).map(|_| sure(false)).collect();
        let wrong: Vec<&Case> = wrong.iter().collect();
        assert!((calibration(&wrong).unwrap() - 0.9).abs() < 1e-9);
    }
}
