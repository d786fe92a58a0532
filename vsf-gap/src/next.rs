use crate::report::EffectReport;
use crate::verdict::{Kind, Verdict};
use serde::{Deserialize, Serialize};

/// What to record next.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextExperiment {
    /// What to do.
    pub action: String,
    /// What it would tell.
    pub why: String,
}

/// An experiment and the effects that answer to it in a way of their own.
struct Experiment {
    action: &'static str,
    /// Whether it needs nothing to touch.
    in_air: bool,
    /// Effects and how they answer: equal letters look alike.
    answers: &'static [(&'static str, char)],
}

/// What each experiment tells apart. Effects that are not listed do not answer.
const EXPERIMENTS: [Experiment; 9] = [
    Experiment {
        action: "hold the deepest point of a touch for 5 s",
        in_air: false,
        answers: &[
            ("stress_relaxation", 'r'),
            ("torque_drift", 'd'),
            ("viscoelastic", 'v'),
        ],
    },
    Experiment {
        action: "unload as slowly as loaded, over the same path",
        in_air: false,
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
        in_air: false,
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
        in_air: false,
        answers: &[
            ("plastic_set", 'p'),
            ("damage_softening", 'd'),
            ("registration_offset", 'r'),
            ("torque_drift", 't'),
        ],
    },
    Experiment {
        action: "push a known place deeper than before",
        in_air: false,
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
        in_air: false,
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
        action: "move every joint to and fro in free air, at two speeds",
        in_air: true,
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
        in_air: true,
        answers: &[("torque_drift", 'd'), ("torque_bias", 'b')],
    },
    Experiment {
        action: "carry a known payload through several postures",
        in_air: true,
        answers: &[
            ("payload", 'p'),
            ("gravity_tilt", 'g'),
            ("inertial_error", 'i'),
            ("torque_gain", 't'),
        ],
    },
];

/// The experiment that tells most of the surviving candidates apart, weighed by their
/// probabilities; of an arm `in_air`, one that needs nothing to touch.
pub(crate) fn next_experiment(
    verdict: &Verdict,
    effects: &[EffectReport],
    in_air: bool,
) -> NextExperiment {
    let survivors: Vec<&EffectReport> = (effects.iter())
        .filter(|e| e.testable && verdict.effect_set_95.contains(&e.effect))
        .collect();
    // Effects that are named together are no rivals.
    let named = |e: &EffectReport| verdict.effects.contains(&e.effect);
    let told = |experiment: &Experiment| {
        let answer = |name: &str| {
            experiment
                .answers
                .iter()
                .find(|(n, _)| *n == name)
                .map_or('-', |(_, a)| *a)
        };
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
        .filter(|e| e.in_air || !in_air)
        .map(|e| (told(e), e))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(told, _)| *told > 0.0);
    let in_field = |e: &&EffectReport| named(e) && e.is_like_field();
    let undecided = verdict.kind == Kind::NotDiagnosable;
    if let Some(effect) = effects.iter().find(in_field).filter(|_| undecided) {
        return NextExperiment {
            action: "touch the same object from another side, as deep".to_owned(),
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
    match (best, verdict.kind) {
        (Some((_, experiment)), _) => NextExperiment {
            action: experiment.action.to_owned(),
            why: format!("it tells {} apart", names()),
        },
        (None, Kind::Unknown) => NextExperiment {
            action: "move one joint at a time, slowly, through its range in free air".to_owned(),
            why: "none of the effects looked for explains it; so it shows on which joint, and whether it \
                  follows position, speed or time"
                .to_owned(),
        },
        (None, Kind::NoGap) if in_air => NextExperiment {
            action: "move every joint through its range, at two speeds, with and without a known payload".to_owned(),
            why: "nothing is missing so far; this shows effects that these motions could not".to_owned(),
        },
        (None, Kind::NoGap) => NextExperiment {
            action: "push, hold, unload and touch again at two speeds, deeper the second time"
                .to_owned(),
            why: "nothing is missing so far; this shows effects that these touches could not"
                .to_owned(),
        },
        (None, _) => NextExperiment {
            action: "repeat one touch, or a motion in free air, in other postures".to_owned(),
            why: format!("it checks {} on data that the model has not seen", names()),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_air_is_not_told_to_touch() {
        let nothing = Verdict {
            effects: Vec::new(),
            kind: Kind::NoGap,
            probability: 1.0,
            effect_set_95: Vec::new(),
        };
        let no_gap = next_experiment(&nothing, &[], true).action;
        let actions = (EXPERIMENTS.iter().filter(|e| e.in_air)).map(|e| e.action);
        for action in actions.chain([no_gap.as_str()]) {
            let touches = ["touch", "push", "deep", "load as"]
                .iter()
                .any(|w| action.contains(w));
            assert!(!touches, "{action}");
        }
        assert!(
            next_experiment(&nothing, &[], false)
                .action
                .contains("touch")
        );
    }
}
