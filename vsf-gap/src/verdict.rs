//! The answer of a diagnosis: what the train sequences show, as far as it survives the check on the test sequences and the
//! field.

use crate::judge::{Judged, effect_set};
use crate::report::MOSTLY;
use serde::{Deserialize, Serialize};

/// A hypothesis with at least this probability is named.
pub(crate) const NAMED: f64 = 0.3;
/// Most effects beside the named ones that an answer may leave open.
const MOST_OPEN: usize = 4;

/// The kind of conclusion of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VerdictKind {
    /// The named effects explain the gap.
    Effects,
    /// The nominal model lacks nothing that these data could show.
    NoGap,
    /// Something acts that no effect explains, or none that the train sequences show.
    Unknown,
    /// Something acts, but these data fit too many effects alike, or fit an effect as well as a field that differs from
    /// place to place.
    NotDiagnosable,
}

/// The kind in words.
impl std::fmt::Display for VerdictKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Effects => "effects",
            Self::NoGap => "no gap",
            Self::Unknown => "unknown",
            Self::NotDiagnosable => "not diagnosable",
        })
    }
}

/// The conclusion of a diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Verdict {
    /// The named effects; empty for no gap.
    pub effects: Vec<String>,
    /// What kind of answer it is.
    pub kind: VerdictKind,
    /// Probability of the answer.
    ///
    /// For [`VerdictKind::Unknown`] without effects, it is the probability that no effect of the search is the cause; with
    /// effects, theirs among those of the search. Models that the check on other sequences refused have no probability: all
    /// probabilities are conditional on these not being the cause.
    pub probability: f64,
    /// The 95 % credible set: the effects of the likeliest models that, with "no gap", hold 95 % of the probability.
    ///
    /// The probability [`hidden`](Self::hidden) is included, unless the answer is "no gap". The set also contains effects
    /// that fit well but did not pass the check on other sequences, which does not rule them out.
    pub effect_set_95: Vec<String>,
    /// Probability that an effect acts that the stiffness field absorbs, mostly one of contact or material.
    ///
    /// For [`VerdictKind::NoGap`], it is also distributed over the effects. For [`VerdictKind::Unknown`] without effects,
    /// [`probability`](Self::probability) includes it.
    #[serde(default)]
    pub hidden: f64,
    /// Effects that were named in the contact in which the search began, but that another contact threshold explains as
    /// well.
    ///
    /// That threshold is then used. It is no cause, and leaves nothing for these effects to explain; they stay in the set.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub or_threshold: Vec<String>,
}

impl Verdict {
    /// Adds effects that are not ruled out to the set.
    pub(crate) fn leave_open(&mut self, effects: &[String]) {
        for effect in effects {
            if !self.effect_set_95.contains(effect) {
                self.effect_set_95.push(effect.clone());
            }
        }
    }
}

/// What the check on the test sequences, and the field, leave of what the train sequences show.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    /// Share of the gap that the corrected model closes.
    pub(crate) closed: f64,
    /// Effects that the field imitates, best first, if it is open what the field shows.
    pub(crate) in_field: Vec<String>,
    /// Effects that fit well but did not pass the check.
    pub(crate) refused: Vec<String>,
    /// Effects that were looked for, each with its share of what acts without showing.
    pub(crate) hidden: Vec<(String, f64)>,
    /// Whether much is left in free motion.
    pub(crate) left_free: bool,
    /// Whether the residuals of the named effects persist.
    pub(crate) lasts: bool,
    /// Whether their parameters stopped at a bound of the plausible range, far from explaining everything.
    pub(crate) stopped: bool,
    /// Whether the test sequences contradict the train sequences under the nominal model.
    pub(crate) contradicted: bool,
    /// Whether the named effects predict nothing better than sensors that read zero would.
    pub(crate) silent: bool,
    /// Whether what they leave to the springs is opposite to spring torques.
    pub(crate) opposed: bool,
    /// Whether, for one of the named effects, the readings determine no parameter.
    pub(crate) vague: bool,
    /// Whether nothing is touched, though there are points, and more is left than a known cause leaves.
    pub(crate) untouched: bool,
    /// Whether sensors look saturated, and far from everything is explained.
    pub(crate) saturated: bool,
}

/// The conclusion.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) verdict: Verdict,
    /// Probability of every effect that was fitted.
    pub(crate) probabilities: Vec<(String, f64)>,
    /// Probability that none of them acts.
    pub(crate) nothing: f64,
    /// Whether much is left where nothing is touched.
    pub(crate) left_free: bool,
    /// Whether the cause is unknown only because the residuals of the named effects persist, or because the test sequences
    /// contradict the train sequences.
    pub(crate) open: bool,
}

/// The kind of an answer that names effects.
pub(crate) fn kind_of_claim(
    effects: &[String],
    probability: f64,
    effect_set_95: &[String],
) -> VerdictKind {
    let others = effect_set_95.iter().filter(|e| !effects.contains(e));
    if probability >= NAMED && others.count() <= MOST_OPEN {
        VerdictKind::Effects
    } else {
        VerdictKind::NotDiagnosable
    }
}

impl Judged {
    /// Draws the conclusion.
    pub(crate) fn conclude(&self, found: &Findings) -> Answer {
        let (mut verdict, mut probabilities) = (self.verdict.clone(), self.probabilities.clone());
        or_field(&mut verdict, &mut probabilities, &found.in_field);
        let claims = !verdict.effects.is_empty();
        let kind = match (found.closed >= MOSTLY, verdict.kind) {
            // However rough the rest.
            (true, VerdictKind::Unknown) if claims => kind_of_claim(
                &verdict.effects,
                verdict.probability,
                &verdict.effect_set_95,
            ),
            (false, _) if found.left_free => VerdictKind::Unknown,
            (_, kind) => kind,
        };
        // However much is closed: something else acts, too.
        let lasting = found.lasts && kind != VerdictKind::Unknown;
        let contradicted = found.contradicted && kind == VerdictKind::NoGap;
        let faulty = found.stopped
            || found.untouched
            || found.saturated
            || claims && (found.silent || found.opposed || found.vague);
        let known = found.saturated || found.opposed || found.untouched;
        let open = !known && (lasting || contradicted);
        verdict.kind = if lasting || contradicted || faulty {
            VerdictKind::Unknown
        } else {
            kind
        };
        // An effect that does not show, or one that is not looked for.
        if verdict.kind == VerdictKind::Unknown && !claims {
            verdict.probability += self.verdict.hidden;
        }
        if verdict.kind == VerdictKind::NoGap {
            self.spread(&found.hidden, &mut verdict, &mut probabilities);
        }
        // Not borne out is not ruled out.
        verdict.leave_open(&found.refused);
        Answer {
            verdict,
            probabilities,
            nothing: self.none + self.verdict.hidden,
            left_free: found.left_free,
            open,
        }
    }

    /// Gives effects their shares of the probability of what acts without showing.
    fn spread(
        &self,
        hidden: &[(String, f64)],
        verdict: &mut Verdict,
        probabilities: &mut Vec<(String, f64)>,
    ) {
        let mut all = self.of_hypotheses.clone();
        let mut covered = self.none + self.verdict.hidden;
        for (effect, share) in hidden {
            let own = share * self.verdict.hidden;
            covered -= own;
            match all
                .iter_mut()
                .find(|(e, _)| e == std::slice::from_ref(effect))
            {
                Some((_, p)) => *p += own,
                None => all.push((vec![effect.clone()], own)),
            }
            match probabilities.iter_mut().find(|(e, _)| e == effect) {
                Some((_, p)) => *p += own,
                None => probabilities.push((effect.clone(), own)),
            }
        }
        verdict.effect_set_95 = effect_set(&all, covered);
    }
}

/// Leaves it open whether one of some effects, best first, or the field that imitates them is the cause. All are equally
/// likely, and the best effect is named. Other effects may act beside the field.
fn or_field(verdict: &mut Verdict, probabilities: &mut Vec<(String, f64)>, effects: &[String]) {
    let Some(best) = effects.first() else {
        return;
    };
    let p = 1.0 / (1 + effects.len()) as f64;
    probabilities.retain(|(e, _)| !effects.contains(e));
    // If it is the field, they are as likely as before.
    probabilities.iter_mut().for_each(|(_, q)| *q *= p);
    probabilities.extend(effects.iter().map(|e| (e.clone(), p)));
    verdict.effect_set_95.retain(|e| !effects.contains(e));
    verdict.effect_set_95.splice(..0, effects.iter().cloned());
    verdict.effects = vec![best.clone()];
    (verdict.kind, verdict.probability) = (VerdictKind::NotDiagnosable, p);
    verdict.hidden *= p;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(of: &[&str]) -> Vec<String> {
        of.iter().map(|e| (*e).to_owned()).collect()
    }

    fn judged(effects: &[&str], kind: VerdictKind, probability: f64) -> Judged {
        let probabilities = [("adhesion", 0.9), ("strain_stiffening", 0.06)];
        Judged {
            verdict: Verdict {
                effects: names(effects),
                kind,
                probability,
                effect_set_95: names(&["adhesion", "strain_stiffening"]),
                hidden: 0.2,
                or_threshold: Vec::new(),
            },
            named: Some(0).filter(|_| !effects.is_empty()),
            probabilities: probabilities.map(|(e, p)| (e.to_owned(), p)).to_vec(),
            none: 0.1,
            of_hypotheses: vec![
                (names(&["adhesion"]), 0.5),
                (names(&["strain_stiffening"]), 0.2),
            ],
        }
    }

    #[test]
    fn saturated_sensors_leave_the_cause_unknown() {
        let found = Findings {
            saturated: true,
            lasts: true,
            contradicted: true,
            ..Findings::default()
        };
        for effects in [&["adhesion"][..], &[]] {
            let answer = judged(effects, VerdictKind::Effects, 0.9).conclude(&found);
            assert_eq!(answer.verdict.kind, VerdictKind::Unknown);
            assert_eq!(answer.verdict.effects, names(effects));
            // Halves of test sequences would not tell.
            assert!(!answer.open);
        }
    }

    /// Named effects are no alternatives to each other.
    #[test]
    fn a_claim_may_leave_few_others_open() {
        let set = names(&[
            "payload",
            "latency",
            "adhesion",
            "torque_gain",
            "torque_bias",
            "torque_drift",
        ]);
        let kind = |named: usize, probability| kind_of_claim(&set[..named], probability, &set);
        assert_eq!(kind(1, 0.9), VerdictKind::NotDiagnosable);
        assert_eq!(kind(2, 0.9), VerdictKind::Effects);
        assert_eq!(kind(2, 0.29), VerdictKind::NotDiagnosable);
    }

    #[test]
    fn what_the_field_imitates_is_as_likely_as_the_field() {
        let found = Findings {
            in_field: names(&["strain_stiffening", "plastic_set"]),
            ..Findings::default()
        };
        let answer = judged(&["adhesion"], VerdictKind::Effects, 0.9).conclude(&found);
        let third = 1.0 / 3.0;
        assert_eq!(
            answer.verdict,
            Verdict {
                effects: names(&["strain_stiffening"]),
                kind: VerdictKind::NotDiagnosable,
                probability: third,
                effect_set_95: names(&["strain_stiffening", "plastic_set", "adhesion"]),
                hidden: 0.2 * third,
                or_threshold: Vec::new(),
            }
        );
        // Beside the field, others are as likely as they were.
        let of = |name: &str| answer.probabilities.iter().find(|(e, _)| e == name);
        let close = |name: &str, p: f64| of(name).is_some_and(|(_, q)| (q - p).abs() < 1e-12);
        assert!(close("strain_stiffening", third) && close("plastic_set", third));
        assert!(close("adhesion", 0.9 * third));
        assert_eq!(answer.probabilities.len(), 3);
    }

    #[test]
    fn the_check_decides_whether_a_cause_is_known() {
        use VerdictKind::{Effects, NoGap, Unknown};
        let kind = |named: &[&str], kind, found: &Findings| {
            let answer = judged(named, kind, 0.9).conclude(found);
            (answer.verdict.kind, answer.open)
        };
        let found = |closed, left_free, lasts, stopped| Findings {
            closed,
            left_free,
            lasts,
            stopped,
            ..Findings::default()
        };
        let named: &[&str] = &["adhesion"];
        for (closed, left_free, lasts, stopped, from, expected, lasting) in [
            (0.2, false, false, false, Effects, Effects, false),
            (0.2, false, false, false, Unknown, Unknown, false),
            (0.8, false, false, false, Unknown, Effects, false),
            (0.8, true, false, false, Effects, Effects, false),
            (0.2, true, false, false, Effects, Unknown, false),
            (0.8, false, true, false, Effects, Unknown, true),
            (0.2, true, true, false, Effects, Unknown, false),
            (0.8, false, false, true, Effects, Unknown, false),
        ] {
            let found = found(closed, left_free, lasts, stopped);
            assert_eq!(kind(named, from, &found), (expected, lasting), "{found:?}");
        }
        let nothing = found(0.0, true, false, false);
        assert_eq!(kind(&[], NoGap, &nothing).0, Unknown);
        let [mut silent, mut opposed, mut vague] =
            [(); 3].map(|()| found(0.8, false, false, false));
        (silent.silent, opposed.opposed, vague.vague) = (true, true, true);
        for wrong in [silent, opposed, vague] {
            assert_eq!(kind(named, Effects, &wrong).0, Unknown);
            assert_eq!(kind(&[], NoGap, &wrong).0, NoGap);
        }
        // Halves of test sequences would not tell.
        let untouched = Findings {
            untouched: true,
            contradicted: true,
            ..found(0.2, false, true, false)
        };
        assert_eq!(kind(named, Effects, &untouched), (Unknown, false));
        assert_eq!(kind(&[], NoGap, &untouched), (Unknown, false));
        let contradicted = Findings {
            contradicted: true,
            ..Findings::default()
        };
        assert_eq!(kind(&[], NoGap, &contradicted), (Unknown, true));
        assert_eq!(kind(named, Effects, &contradicted).0, Effects);
        assert_eq!(kind(&[], NoGap, &Findings::default()).0, NoGap);
    }

    #[test]
    fn an_unknown_cause_may_be_one_that_does_not_show() {
        let probability = |kind, effects: &[&str]| {
            let answer = judged(effects, kind, 0.5).conclude(&Findings::default());
            answer.verdict.probability
        };
        assert_eq!(probability(VerdictKind::Unknown, &[]), 0.7);
        assert_eq!(probability(VerdictKind::NoGap, &[]), 0.5);
        assert_eq!(probability(VerdictKind::Unknown, &["adhesion"]), 0.5);
    }

    /// Where there is no gap to see, what is hidden belongs to effects, as far as they were looked for.
    #[test]
    fn what_does_not_show_may_be_any_effect() {
        let shares = [("adhesion", 0.25), ("damage_softening", 0.5)];
        let found = Findings {
            hidden: shares.map(|(e, share)| (e.to_owned(), share)).to_vec(),
            ..Findings::default()
        };
        let answer = judged(&[], VerdictKind::NoGap, 0.1).conclude(&found);
        let of = |name: &str| answer.probabilities.iter().find(|(e, _)| e == name);
        let close = |name: &str, p: f64| of(name).is_some_and(|(_, q)| (q - p).abs() < 1e-12);
        assert!(close("adhesion", 0.9 + 0.05) && close("damage_softening", 0.1));
        // Without the last one 90 % would be covered.
        let set = names(&["adhesion", "strain_stiffening", "damage_softening"]);
        assert_eq!(answer.verdict.effect_set_95, set);
        for (named, kind) in [
            (&[][..], VerdictKind::Unknown),
            (&["adhesion"], VerdictKind::Effects),
        ] {
            let answer = judged(named, kind, 0.1).conclude(&found);
            assert_eq!(answer.verdict.effect_set_95, set[..2], "{kind:?}");
            assert_eq!(answer.probabilities.len(), 2);
        }
    }

    #[test]
    fn what_the_check_refuses_is_not_ruled_out() {
        let found = Findings {
            refused: names(&["payload", "adhesion"]),
            ..Findings::default()
        };
        let answer = judged(&[], VerdictKind::NoGap, 0.5).conclude(&found);
        let set = names(&["adhesion", "strain_stiffening", "payload"]);
        assert_eq!(answer.verdict.effect_set_95, set);
    }
}
