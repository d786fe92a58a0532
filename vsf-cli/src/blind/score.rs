use super::{Case, sum};
use crate::console::{number, table};
use serde::Serialize;
use vsf::core::median;
use vsf_world::{Class, Level, Protocol};

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
    /// Of cases with known effects in which any is named: those in which no other one is.
    none_besides: Share,
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

    /// A table for people.
    pub fn text(&self) -> String {
        let optional = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), number);
        let lines = [
            ("single effect, likeliest", self.top1.text()),
            ("single effect, of the two likeliest", self.top2.text()),
            ("truth in the 95 % set", self.in_set.text()),
            ("mean size of that set", optional(self.set_size)),
            ("both of two effects", self.both_of_two.text()),
            ("one of two effects", self.one_of_two.text()),
            ("named, and none besides", self.none_besides.text()),
            ("quiet without effect", self.quiet_without_effect.text()),
            ("unknown effects flagged", self.unknown_flagged.text()),
            ("right joint", self.right_joint.text()),
            ("right phase", self.right_phase.text()),
            ("corrected model no worse", self.never_worse.text()),
            (
                "mean probability of the truth",
                optional(self.mean_probability),
            ),
            ("calibration error", optional(self.ece)),
            (
                "closed, of what the effect makes of the gap, median",
                optional(self.closed_of_oracle),
            ),
        ];
        let rows: Vec<Vec<String>> = (lines.into_iter())
            .map(|(name, value)| vec![name.to_owned(), value])
            .collect();
        format!("\n{}\n{}", self.group, table(&["measure", "value"], &rows))
    }

    fn of(group: &str, cases: &[Case], member: impl Fn(&Case) -> bool) -> Self {
        let of = |class: Class| {
            let own = cases.iter().filter(|c| member(c));
            own.filter(move |c| c.class == class)
        };
        let all = || cases.iter().filter(|c| member(c));
        let among = |c: &Case, k: usize| c.top.iter().take(k).any(|e| c.truth.contains(e));
        let mean = |x: Vec<f64>| (!x.is_empty()).then(|| sum(x.iter().copied()) / x.len() as f64);
        let closed = of(Class::Single)
            .filter(|c| c.names_truth() && c.oracle_closed > 0.05)
            .map(|c| c.closed_fraction / c.oracle_closed);
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
            none_besides: Share::of(
                (of(Class::Single).chain(of(Class::Pair))).filter(|c| !c.named.is_empty()),
                |c| c.named.iter().all(|n| c.truth.contains(n)),
            ),
            quiet_without_effect: Share::of(of(Class::None), Case::answered),
            unknown_flagged: Share::of(of(Class::Unknown), Case::answered),
            right_joint: Share::of(all().filter(|c| c.right_joint.is_some()), |c| {
                c.right_joint == Some(true)
            }),
            right_phase: Share::of(all().filter(|c| c.right_phase.is_some()), |c| {
                c.right_phase == Some(true)
            }),
            never_worse: Share::of(all().filter(|c| c.is_diagnosed()), |c| {
                c.test_error_corrected <= c.test_error_nominal + 1e-12
            }),
            mean_probability: mean(of(Class::Single).map(|c| c.probability_of_truth).collect()),
            ece: calibration(&all().filter(|c| c.is_diagnosed()).collect::<Vec<_>>()),
            closed_of_oracle: median(closed.collect()),
        }
    }
}

/// Mean gap between stated probability and share of those that came true, over five bins; `None` without cases. Few cases
/// give a gap by chance, however well probabilities are stated.
fn calibration(cases: &[&Case]) -> Option<f64> {
    let bins = 5;
    let mut error = 0.0;
    for bin in 0..bins {
        let own: Vec<&&Case> = (cases.iter())
            .filter(|c| ((c.probability * bins as f64) as usize).min(bins - 1) == bin)
            .collect();
        let n = own.len() as f64;
        let stated: f64 = own.iter().map(|c| c.probability).sum();
        let right = own.iter().filter(|c| c.came_true()).count() as f64;
        if n > 0.0 {
            error += (stated - right).abs();
        }
    }
    (!cases.is_empty()).then(|| error / cases.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vsf::gap::VerdictKind;

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
        assert_eq!((s.none_besides.hits, s.none_besides.of), (2, 3));
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

    /// The probability of an answer that names effects though it calls the cause unknown is that of these effects.
    #[test]
    fn named_but_unknown() {
        let named =
            |class, truth: &[&str]| case(class, truth, &["payload"], VerdictKind::Unknown, 1.0);
        let known = named(Class::Single, &["payload"]);
        assert!(!known.answered() && known.came_true());
        assert_eq!(calibration(&[&known]), Some(0.0));
        let other = named(Class::Unknown, &["backlash"]);
        assert!(other.answered() && !other.came_true());
        assert_eq!(calibration(&[&other]), Some(1.0));
    }
}
