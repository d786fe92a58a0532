use crate::effect::Arm;
use crate::report::EffectReport;
use crate::verdict::{Answer, VerdictKind};
use crate::{Effect, Probe};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// If nothing acts with at least this probability, a named cause is still to be shown.
const DOUBTFUL: f64 = 0.05;

/// What to record next.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct NextExperiment {
    /// What to do.
    pub action: String,
    /// Why: what it would resolve.
    pub why: String,
}

/// The experiment, among those that the arm can do, that best separates the surviving candidates, weighted by their
/// probabilities.
pub(crate) fn next_experiment(
    answer: &Answer,
    reports: &[EffectReport],
    effects: &[Arc<dyn Effect>],
    arm: Arm,
) -> NextExperiment {
    let (verdict, nothing) = (&answer.verdict, answer.nothing);
    let survivors: Vec<&EffectReport> = (reports.iter())
        .filter(|e| e.testable && verdict.effect_set_95.contains(&e.effect))
        .collect();
    // Effects that are named together are no rivals.
    let named = |e: &&EffectReport| verdict.effects.contains(&e.effect);
    let response = |report: &EffectReport, probe: Probe| {
        let effect = effects.iter().find(|e| e.name() == report.effect)?;
        effect.response(probe)
    };
    // Of what is named, beside nothing at all.
    let doubted = verdict.kind == VerdictKind::Effects && nothing >= DOUBTFUL;
    let shows = |e: &&&EffectReport, probe| doubted && named(e) && response(e, probe).is_some();
    let told = |probe: Probe| {
        let shown = survivors.iter().filter(|e| shows(e, probe));
        let mut sum: f64 = shown.map(|e| e.probability * nothing).sum();
        for (i, a) in survivors.iter().enumerate() {
            for b in &survivors[i + 1..] {
                if response(a, probe) != response(b, probe) && !(named(a) && named(b)) {
                    sum += a.probability * b.probability;
                }
            }
        }
        sum
    };
    let best = (Probe::ALL.into_iter())
        .filter(|probe| probe.is_open_to(arm))
        .map(|probe| (told(probe), probe))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(told, _)| *told > 0.0);
    let in_field = |e: &&EffectReport| named(e) && e.is_like_field();
    let undecided = verdict.kind == VerdictKind::NotDiagnosable;
    if let Some(effect) = reports.iter().find(in_field).filter(|_| undecided) {
        return NextExperiment {
            action: match arm.joints {
                1 => "turn the object, its points alike, and touch it from another side, as deep",
                _ => "touch the same object from another side, as deep",
            }
            .to_owned(),
            why: format!(
                "{} comes along, a stiffness that differs from place to place stays where it is",
                effect.effect
            ),
        };
    }
    let names = || {
        let names: Vec<&str> = survivors.iter().map(|e| e.effect.as_str()).collect();
        names.join(", ")
    };
    // Those that it answers alike stay together.
    let told_by = |probe: Probe| {
        let mut groups: Vec<(Option<&str>, Vec<&str>)> = Vec::new();
        for e in &survivors {
            let own = response(e, probe);
            match groups.iter_mut().find(|(response, _)| *response == own) {
                Some((_, names)) => names.push(&e.effect),
                None => groups.push((own, vec![&e.effect])),
            }
        }
        let words: Vec<String> = groups.iter().map(|(_, names)| names.join(", ")).collect();
        let together = survivors.len() > 1 && survivors.iter().all(named);
        match &words[..] {
            _ if together => format!("shows whether {} act", names()),
            [all] => format!("shows whether {all} acts"),
            [one, other] => format!("tells {one} from {other}"),
            _ => {
                let numbered = words.iter().zip(1..).map(|(w, k)| format!("({k}) {w}"));
                format!("tells apart {}", numbered.collect::<Vec<_>>().join("; "))
            }
        }
    };
    match (best, verdict.kind) {
        (Some((_, probe)), _) => NextExperiment {
            action: probe.action().to_owned(),
            why: match verdict.kind {
                VerdictKind::NoGap => format!("of what may act without showing it {}", told_by(probe)),
                _ => format!("it {}", told_by(probe)),
            },
        },
        (None, VerdictKind::Unknown) if arm.touches && !answer.left_free => NextExperiment {
            action: "touch the same places again, deeper, at two speeds and with a hold, and places between them".to_owned(),
            why: "none of the effects looked for explains what is left in contact; so it shows whether it follows depth, \
                  speed, time or place"
                .to_owned(),
        },
        (None, VerdictKind::Unknown) => NextExperiment {
            action: "move one joint at a time, slowly, through its range in free air".to_owned(),
            why: "none of the effects looked for explains it; so it shows on which joint, and whether it \
                  follows position, speed or time"
                .to_owned(),
        },
        (None, VerdictKind::NoGap) if !arm.touches => NextExperiment {
            action: "move every joint through its range, at two speeds, with and without a known payload".to_owned(),
            why: "nothing is missing so far; this shows effects that these motions could not".to_owned(),
        },
        (None, VerdictKind::NoGap) => NextExperiment {
            action: "push, hold, unload and touch again at two speeds, deeper the second time"
                .to_owned(),
            why: "nothing is missing so far; this shows effects that these touches could not"
                .to_owned(),
        },
        (None, _) => NextExperiment {
            action: match (arm.touches, arm.turns) {
                (false, _) => "repeat a motion at another speed",
                (true, true) => "repeat one touch, or a motion in free air, in other postures",
                (true, false) => "repeat one touch, or a motion in free air, at another speed",
            }
            .to_owned(),
            why: format!("it checks {} on data that the model has not seen", names()),
        },
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::Verdict;

    const AIR: Arm = Arm {
        joints: 7,
        turns: true,
        touches: false,
    };
    const STAGE: Arm = Arm {
        joints: 3,
        turns: false,
        touches: true,
    };
    const RAIL: Arm = Arm { joints: 1, ..STAGE };

    fn next(verdict: &Verdict, reports: &[EffectReport], arm: Arm) -> NextExperiment {
        next_experiment(
            &answer(verdict, false),
            reports,
            &crate::effects::catalogue(),
            arm,
        )
    }

    fn answer(verdict: &Verdict, left_free: bool) -> Answer {
        Answer {
            verdict: verdict.clone(),
            probabilities: Vec::new(),
            nothing: 1.0 - verdict.probability,
            left_free,
            open: false,
        }
    }

    fn verdict(kind: VerdictKind, effects: &[&str]) -> Verdict {
        let names: Vec<String> = effects.iter().map(|e| (*e).to_owned()).collect();
        Verdict {
            effects: names.iter().take(1).cloned().collect(),
            kind,
            probability: 0.5,
            effect_set_95: names,
            hidden: 0.0,
            or_threshold: Vec::new(),
        }
    }

    fn reports(effects: &[&str]) -> Vec<EffectReport> {
        let all = crate::effects::named(effects).unwrap();
        let mut reports: Vec<_> = all
            .iter()
            .map(|e| EffectReport::untestable(e.as_ref(), ""))
            .collect();
        for report in &mut reports {
            (report.testable, report.probability) = (true, 0.5);
        }
        reports
    }

    #[test]
    fn free_air_is_not_told_to_touch() {
        let nothing = verdict(VerdictKind::NoGap, &[]);
        let no_gap = next(&nothing, &[], AIR).action;
        let checked = next(&verdict(VerdictKind::Effects, &["payload"]), &[], AIR).action;
        let open = Probe::ALL.into_iter().filter(|probe| probe.is_open_to(AIR));
        let actions = open.map(|probe| probe.action().to_owned());
        for action in actions.chain([no_gap, checked]) {
            let touches = ["touch", "push", "deep", "load as"]
                .iter()
                .any(|w| action.contains(w));
            assert!(!touches, "{action}");
        }
        assert!(next(&nothing, &[], STAGE).action.contains("touch"));
    }

    /// Each effect answers to an experiment, and each experiment tells two of them apart.
    #[test]
    fn every_effect_has_an_experiment() {
        let effects = crate::effects::catalogue();
        for effect in &effects {
            let responds = |probe: &Probe| effect.response(*probe).is_some();
            assert!(Probe::ALL.iter().any(responds), "{}", effect.name());
        }
        for probe in Probe::ALL {
            let responses: std::collections::BTreeSet<_> =
                effects.iter().filter_map(|e| e.response(probe)).collect();
            assert!(responses.len() > 1, "{probe:?}");
        }
    }

    /// One rail, and axes that only slide, come to a place in one way.
    #[test]
    fn sliding_arms_are_not_told_to_take_another_posture() {
        for pair in [
            ["encoder_offset", "registration_offset"],
            ["torque_gain", "anisotropy"],
            ["torque_bias", "torque_gain"],
            ["payload", "torque_gain"],
            ["adhesion", "viscoelastic"],
        ] {
            let effects = reports(&pair);
            let next = |kind, of: &[&str], arm| {
                let sure = Verdict {
                    probability: 1.0,
                    ..verdict(kind, of)
                };
                next(&sure, &effects, arm)
            };
            for arm in [STAGE, RAIL] {
                for action in [
                    next(VerdictKind::NotDiagnosable, &pair, arm).action,
                    next(VerdictKind::Effects, &pair[..1], arm).action,
                ] {
                    let postures = action.contains("other posture") || action.contains("several");
                    assert!(!postures, "{pair:?}: {action}");
                    assert!(
                        arm.joints > 1 || !action.contains("another axis"),
                        "{action}"
                    );
                }
            }
            let arm = Arm {
                turns: true,
                ..STAGE
            };
            let checked = next(VerdictKind::Effects, &pair[..1], arm);
            assert!(checked.action.contains("other postures"), "{pair:?}");
        }
        let pair = ["registration_offset", "joint_elasticity"];
        let told = |arm| {
            let verdict = verdict(VerdictKind::NotDiagnosable, &pair);
            next(&verdict, &reports(&pair), arm).action
        };
        assert!(told(STAGE).contains("along another axis"));
        assert!(
            told(Arm {
                turns: true,
                ..STAGE
            })
            .contains("another posture")
        );
    }

    /// Effects that answer alike are one group; more than two groups are numbered.
    #[test]
    fn groups_that_an_experiment_tells_apart_are_told() {
        let why = |effects: &[&str]| {
            let verdict = verdict(VerdictKind::NotDiagnosable, effects);
            next(&verdict, &reports(effects), STAGE).why
        };
        let two = why(&["torque_bias", "torque_gain"]);
        assert_eq!(two, "it tells torque_bias from torque_gain");
        let more = why(&[
            "damage_softening",
            "strain_stiffening",
            "plastic_set",
            "geometry_padding",
        ]);
        assert!(
            more.starts_with("it tells apart (1) damage_softening"),
            "{more}"
        );
        assert!(more.contains("; (2) ") && more.contains("; (3) "), "{more}");
    }

    /// A cause that is doubted is looked for where it would answer.
    #[test]
    fn what_is_doubted_is_looked_for() {
        let mut found = verdict(VerdictKind::Effects, &["strain_stiffening"]);
        let effects = reports(&["strain_stiffening"]);
        let doubted = next(&found, &effects, STAGE);
        assert!(doubted.action.contains("deeper"), "{}", doubted.action);
        assert_eq!(doubted.why, "it shows whether strain_stiffening acts");
        found.probability = 0.99;
        let sure = next(&found, &effects, STAGE);
        assert!(sure.action.contains("repeat one touch"));
        // Of effects that act together each has the probability of both.
        let pair = ["payload", "torque_bias"];
        let both = Verdict {
            effects: pair.map(str::to_owned).to_vec(),
            probability: 0.6,
            ..verdict(VerdictKind::Effects, &pair)
        };
        let why = next(&both, &reports(&pair), STAGE).why;
        assert!(why.contains("it shows whether"), "{why}");
    }

    /// What no effect explains is looked for where it is.
    #[test]
    fn what_is_unknown_is_looked_for_where_it_is_left() {
        let unknown = verdict(VerdictKind::Unknown, &[]);
        let effects = crate::effects::catalogue();
        let action =
            |left_free| next_experiment(&answer(&unknown, left_free), &[], &effects, STAGE).action;
        assert!(action(true).contains("free air"));
        assert!(action(false).contains("touch the same places"));
        assert!(next(&unknown, &[], AIR).action.contains("free air"));
    }

    /// What a field imitates is told from it by another side: with one rail, it is the object that turns.
    #[test]
    fn one_rail_has_the_object_turned() {
        let mut effects = reports(&["strain_stiffening"]);
        effects[0].ambiguous_with = vec![crate::STIFFNESS_FIELD.to_owned()];
        let verdict = verdict(VerdictKind::NotDiagnosable, &["strain_stiffening"]);
        let action = |arm| next(&verdict, &effects, arm).action;
        assert!(action(RAIL).contains("turn the object"));
        assert!(action(STAGE).contains("from another side"));
    }
}
