use crate::evidence::Spread;
use crate::refine::Refined;
use crate::{Acts, Effect};
use serde::{Deserialize, Serialize};

/// A gain of log evidence (nats) below which nothing is looked into further.
pub(crate) const EVIDENT: f64 = 12.0;
/// Nats for one e-fold of probability. Models are never quite right, so that evidence overstates
/// what it knows; measured as the value that makes stated probabilities come true.
const TEMPERATURE: f64 = 10.0;
/// Roughness of contact, and how many times more effects of contact gain from there on.
const ROUGHNESS: [(f64, f64); 2] = [(0.1, 1.6), (0.3, 3.0)];
/// A gain of so many thresholds is clear.
const CLEAR: f64 = 2.0;
/// Roughness of joints from which on something acts that the model does not have.
const ROUGH: f64 = 0.15;
/// A hypothesis is named when it has at least this probability.
const NAMED: f64 = 0.3;
/// An answer of more effects than this is none.
const MOST_ALIKE: usize = 5;
/// Weight of "no gap" beside one for every effect.
const NO_GAP: f64 = 3.0;

/// What a diagnosis concludes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The named effects explain the gap.
    Effects,
    /// Nothing is missing from the nominal model that these data could show.
    NoGap,
    /// Something acts that is not in the catalogue.
    Unknown,
    /// Something acts, but these data fit too many effects alike.
    NotDiagnosable,
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// The effects named; empty for no gap.
    pub effects: Vec<String>,
    /// What kind of answer it is.
    pub kind: Kind,
    /// Its probability.
    pub probability: f64,
    /// The smallest set of effects that holds the truth with 95 % probability.
    pub effect_set_95: Vec<String>,
}

/// A model that was fitted, as a hypothesis.
pub(crate) struct Hypothesis {
    effects: Vec<String>,
    gain: f64,
    threshold: f64,
    spread: Spread,
}

impl Hypothesis {
    /// `base` is the log evidence of the nominal model, `rough` its roughness of contact.
    pub(crate) fn new(refined: &Refined, base: f64, rough: f64) -> Self {
        let parts = &refined.model.parts;
        Self {
            effects: parts.iter().map(|(e, _)| e.name().to_owned()).collect(),
            gain: refined.log_evidence - base,
            threshold: parts
                .iter()
                .map(|(e, _)| threshold(e.as_ref(), rough))
                .sum(),
            spread: refined.spread,
        }
    }

    /// Whether the evidence is so clear that predicting the checked sequences no better, as when they
    /// touch other places, does not refute it.
    pub(crate) fn is_clear(&self) -> bool {
        self.gain > CLEAR * self.threshold
    }
}

/// The gain of log evidence (nats) that an effect reaches where it does not act, because the
/// nominal model is not quite right and bends to it: about the largest one in recordings without
/// effect of worlds with other physics. Effects that reshape contact bend most, and all that act on
/// contact bend more where contact itself is rough.
pub(crate) fn threshold(effect: &dyn Effect, rough: f64) -> f64 {
    let smooth = match effect.name() {
        "anisotropy" => 30.0,
        "contact_friction"
        | "geometry_padding"
        | "damage_softening"
        | "encoder_offset"
        | "registration_offset" => 25.0,
        "object_base_motion" | "joint_elasticity" => 20.0,
        _ => match effect.acts() {
            Acts::Torques => return EVIDENT,
            Acts::Springs | Acts::Contact => 15.0,
        },
    };
    let times = ROUGHNESS.iter().rfind(|(from, _)| rough >= *from);
    smooth * times.map_or(1.0, |(_, times)| *times)
}

/// A verdict and the probability of every effect that was fitted.
pub(crate) struct Judged {
    pub(crate) verdict: Verdict,
    pub(crate) probabilities: Vec<(String, f64)>,
    /// Probability of no gap.
    pub(crate) none: f64,
}

/// Weighs the hypotheses against each other and against no gap. `nominal` is the log evidence of
/// the nominal model at each of `spreads`.
pub(crate) fn judge(hypotheses: &[Hypothesis], nominal: &[f64], spreads: &[Spread]) -> Judged {
    let weight = |h: &Hypothesis| (h.gain - h.threshold) / TEMPERATURE;
    let top = hypotheses.iter().map(weight).fold(0.0_f64, f64::max);
    let weights: Vec<f64> = hypotheses.iter().map(|h| (weight(h) - top).exp()).collect();
    let none = NO_GAP * (-top).exp();
    let total = none + weights.iter().sum::<f64>();
    let mut probabilities: Vec<(String, f64)> = Vec::new();
    for (h, w) in hypotheses.iter().zip(&weights) {
        for effect in &h.effects {
            match probabilities.iter_mut().find(|(e, _)| e == effect) {
                Some((_, p)) => *p += w / total,
                None => probabilities.push((effect.clone(), w / total)),
            }
        }
    }
    probabilities.sort_by(|a, b| b.1.total_cmp(&a.1));
    let best = (0..hypotheses.len()).max_by(|a, b| weights[*a].total_cmp(&weights[*b]));
    // What hypotheses leave out, from the likeliest on.
    let mut order: Vec<usize> = (0..hypotheses.len()).collect();
    order.sort_by(|a, b| weights[*b].total_cmp(&weights[*a]));
    let mut effect_set_95: Vec<String> = Vec::new();
    let mut covered = none / total;
    for i in order {
        if covered >= 0.95 {
            break;
        }
        covered += weights[i] / total;
        for effect in &hypotheses[i].effects {
            if !effect_set_95.contains(effect) {
                effect_set_95.push(effect.clone());
            }
        }
    }
    let at = |x: &[f64]| (0..x.len()).max_by(|a, b| x[*a].total_cmp(&x[*b]));
    let nominal_rough = at(nominal).is_some_and(|i| spreads[i].joint >= ROUGH);
    let (kind, effects, probability) = match best {
        Some(i) if weights[i] / total >= none / total => {
            let (h, p) = (&hypotheses[i], weights[i] / total);
            if h.spread.joint >= ROUGH {
                (Kind::Unknown, h.effects.clone(), p)
            } else if p >= NAMED && effect_set_95.len() <= MOST_ALIKE {
                (Kind::Effects, h.effects.clone(), p)
            } else {
                (Kind::NotDiagnosable, h.effects.clone(), p)
            }
        }
        _ if nominal_rough => (Kind::Unknown, Vec::new(), none / total),
        _ => (Kind::NoGap, Vec::new(), none / total),
    };
    Judged {
        verdict: Verdict {
            effects,
            kind,
            probability,
            effect_set_95,
        },
        probabilities,
        none: none / total,
    }
}
