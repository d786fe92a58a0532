use crate::Site;
use crate::effect::slides;
use crate::report::EffectReport;
use crate::verdict::{Verdict, VerdictKind};
use serde::{Deserialize, Serialize};

/// What to record next.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextExperiment {
    /// What to do.
    pub action: String,
    /// What it would tell.
    pub why: String,
}

/// What an experiment asks of the arm.
#[derive(Clone, Copy, PartialEq)]
enum Asks {
    Nothing,
    /// Something to touch.
    Touch,
    /// The same place in another posture.
    Posture,
    /// The same place along another axis: what is left to an arm that only slides.
    Axis,
    /// A weight that joints feel differently from posture to posture.
    Weight,
}

/// What an arm can be asked for.
#[derive(Clone, Copy)]
pub(crate) struct Arm {
    joints: usize,
    turns: bool,
    touches: bool,
}

impl Arm {
    pub(crate) fn of(site: &Site) -> Self {
        Self {
            joints: site.joints(),
            turns: (0..site.joints()).any(|j| !slides(site, j)),
            touches: !site.rest.is_empty(),
        }
    }

    fn can(self, asks: Asks) -> bool {
        match asks {
            Asks::Nothing => true,
            Asks::Touch => self.touches,
            Asks::Posture => self.touches && self.turns && self.joints > 1,
            Asks::Axis => self.touches && !self.turns && self.joints > 1,
            Asks::Weight => self.turns,
        }
    }
}

/// An experiment and the effects that answer to it in a way of their own.
struct Experiment {
    action: &'static str,
    asks: Asks,
    /// Effects and how they answer: equal letters look alike.
    answers: &'static [(&'static str, char)],
}

impl Experiment {
    fn answer(&self, effect: &str) -> Option<char> {
        let mut answers = self.answers.iter();
        answers.find(|(e, _)| *e == effect).map(|(_, a)| *a)
    }
}

/// What each experiment tells apart. Effects that are not listed do not answer.
const EXPERIMENTS: [Experiment; 10] = [
    Experiment {
        action: "hold the deepest point of a touch for 5 s",
        asks: Asks::Touch,
        answers: &[
            ("stress_relaxation", 'r'),
            ("torque_drift", 'd'),
            ("viscoelastic", 'v'),
        ],
    },
    Experiment {
        action: "unload as slowly as loaded, over the same path",
        asks: Asks::Touch,
        answers: &[
            ("contact_friction", 'f'),
            ("joint_load_friction", 'l'),
            ("joint_coulomb_friction", 'c'),
            ("plastic_set", 'p'),
            ("damage_softening", 's'),
            ("adhesion", 'a'),
        ],
    },
    Experiment {
        action: "repeat a touch at twice the speed",
        asks: Asks::Touch,
        answers: &[
            ("viscoelastic", 'v'),
            ("latency", 'l'),
            ("joint_viscous_friction", 'j'),
            ("inertia_drag", 'i'),
            ("joint_stribeck_friction", 's'),
            ("stress_relaxation", 'r'),
        ],
    },
    Experiment {
        action: "touch the same place again, as deep as before",
        asks: Asks::Touch,
        answers: &[
            ("plastic_set", 'p'),
            ("damage_softening", 'd'),
            ("registration_offset", 'r'),
            ("torque_drift", 't'),
        ],
    },
    Experiment {
        action: "push a known place deeper than before",
        asks: Asks::Touch,
        answers: &[
            ("strain_stiffening", 's'),
            ("spatial_coupling", 'c'),
            ("joint_elasticity", 'e'),
            ("object_base_motion", 'b'),
            ("geometry_padding", 'g'),
        ],
    },
    Experiment {
        action: "touch a known place in another posture of the arm",
        asks: Asks::Posture,
        answers: &[
            ("encoder_offset", 'e'),
            ("registration_offset", 'r'),
            ("torque_gain", 'g'),
            ("joint_elasticity", 'k'),
            ("anisotropy", 'a'),
            ("object_base_motion", 'b'),
            ("geometry_padding", 'p'),
            ("gravity_tilt", 't'),
            ("torque_bias", 'o'),
            ("payload", 'w'),
        ],
    },
    Experiment {
        action: "push a known place along another axis",
        asks: Asks::Axis,
        answers: &[
            // Where the links are is where the object is not.
            ("encoder_offset", 'r'),
            ("registration_offset", 'r'),
            ("torque_gain", 'g'),
            ("joint_elasticity", 'k'),
            ("anisotropy", 'a'),
            ("object_base_motion", 'b'),
            ("geometry_padding", 'p'),
            ("torque_bias", 'o'),
        ],
    },
    Experiment {
        action: "move every joint to and fro in free air, at two speeds",
        asks: Asks::Nothing,
        answers: &[
            ("joint_coulomb_friction", 'c'),
            ("joint_viscous_friction", 'v'),
            ("joint_stribeck_friction", 's'),
            ("joint_coupling", 'k'),
            ("torque_bias", 'b'),
            ("latency", 'l'),
            ("inertial_error", 'i'),
        ],
    },
    Experiment {
        action: "wait 30 s in free air and read again in the same posture",
        asks: Asks::Nothing,
        answers: &[("torque_drift", 'd'), ("torque_bias", 'b')],
    },
    Experiment {
        action: "carry a known payload through several postures",
        asks: Asks::Weight,
        answers: &[
            ("payload", 'p'),
            ("gravity_tilt", 'g'),
            ("inertial_error", 'i'),
            ("torque_gain", 't'),
        ],
    },
];

/// The experiment that tells most of the surviving candidates apart, weighed by their
/// probabilities, of those that the arm can do.
pub(crate) fn next_experiment(
    verdict: &Verdict,
    effects: &[EffectReport],
    arm: Arm,
) -> NextExperiment {
    let survivors: Vec<&EffectReport> = (effects.iter())
        .filter(|e| e.testable && verdict.effect_set_95.contains(&e.effect))
        .collect();
    // Effects that are named together are no rivals.
    let named = |e: &EffectReport| verdict.effects.contains(&e.effect);
    let told = |experiment: &Experiment| {
        let answer = |name: &str| experiment.answer(name);
        let mut sum = 0.0;
        for (i, a) in survivors.iter().enumerate() {
            for b in &survivors[i + 1..] {
                if answer(&a.effect) != answer(&b.effect) && !(named(a) && named(b)) {
                    sum += a.probability * b.probability;
                }
            }
        }
        sum
    };
    let best = (EXPERIMENTS.iter())
        .filter(|e| arm.can(e.asks))
        .map(|e| (told(e), e))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(told, _)| *told > 0.0);
    let in_field = |e: &&EffectReport| named(e) && e.is_like_field();
    let undecided = verdict.kind == VerdictKind::NotDiagnosable;
    if let Some(effect) = effects.iter().find(in_field).filter(|_| undecided) {
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
    let groups = |experiment: &Experiment| {
        let of = |e: &&EffectReport| experiment.answer(&e.effect);
        let mut groups: Vec<(Option<char>, Vec<&str>)> = Vec::new();
        for e in &survivors {
            match groups.iter_mut().find(|(answer, _)| *answer == of(e)) {
                Some((_, names)) => names.push(&e.effect),
                None => groups.push((of(e), vec![&e.effect])),
            }
        }
        let words = groups.iter().map(|(_, names)| names.join(", "));
        words.collect::<Vec<_>>().join(" from ")
    };
    match (best, verdict.kind) {
        (Some((_, experiment)), _) => NextExperiment {
            action: experiment.action.to_owned(),
            why: match verdict.kind {
                VerdictKind::NoGap => format!("of what may act without showing it tells {}", groups(experiment)),
                _ => format!("it tells {}", groups(experiment)),
            },
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

    fn verdict(kind: VerdictKind, effects: &[&str]) -> Verdict {
        let names: Vec<String> = effects.iter().map(|e| (*e).to_owned()).collect();
        Verdict {
            effects: names.iter().take(1).cloned().collect(),
            kind,
            probability: 0.5,
            effect_set_95: names,
            hidden: 0.0,
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
        let no_gap = next_experiment(&nothing, &[], AIR).action;
        let checked =
            next_experiment(&verdict(VerdictKind::Effects, &["payload"]), &[], AIR).action;
        let actions = (EXPERIMENTS.iter().filter(|e| AIR.can(e.asks))).map(|e| e.action);
        for action in actions.chain([no_gap.as_str(), &checked]) {
            let touches = ["touch", "push", "deep", "load as"]
                .iter()
                .any(|w| action.contains(w));
            assert!(!touches, "{action}");
        }
        assert!(
            next_experiment(&nothing, &[], STAGE)
                .action
                .contains("touch")
        );
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
            let next = |kind, of: &[&str], arm| next_experiment(&verdict(kind, of), &effects, arm);
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
            next_experiment(&verdict, &reports(&pair), arm).action
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

    /// What a field imitates is told from it by another side: with one rail, it is the object that turns.
    #[test]
    fn one_rail_has_the_object_turned() {
        let mut effects = reports(&["strain_stiffening"]);
        effects[0].ambiguous_with = vec![crate::STIFFNESS_FIELD.to_owned()];
        let verdict = verdict(VerdictKind::NotDiagnosable, &["strain_stiffening"]);
        let action = |arm| next_experiment(&verdict, &effects, arm).action;
        assert!(action(RAIL).contains("turn the object"));
        assert!(action(STAGE).contains("from another side"));
    }
}
