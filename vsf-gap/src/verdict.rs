use crate::evidence::Spread;
use crate::refine::Refined;
use crate::{Acts, Effect};
use serde::{Deserialize, Serialize};

/// A gain of log evidence (nats) below which nothing is looked into further.
pub(crate) const EVIDENT: f64 = 12.0;
/// Nats for one e-fold of probability. Models are never quite right, so that evidence overstates
/// what it knows; measured as the value that makes stated probabilities come true.
const TEMPERATURE: f64 = 10.0;
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
    pub(crate) fn new(refined: &Refined, base: f64) -> Self {
        let parts = &refined.model.parts;
        Self {
            effects: parts.iter().map(|(e, _)| e.name().to_owned()).collect(),
            gain: refined.log_evidence - base,
            threshold: parts.iter().map(|(e, _)| threshold(e.as_ref())).sum(),
            spread: refined.spread,
        }
    }
}

/// The gain of log evidence (nats) that an effect reaches where it does not act, because the
/// nominal model is not quite right and bends to it: about the largest one in recordings without
/// effect of worlds with other physics. Effects that reshape contact bend most.
pub(crate) fn threshold(effect: &dyn Effect) -> f64 {
    match effect.name() {
        "contact_friction" | "geometry_padding" | "anisotropy" => 45.0,
        "damage_softening" => 40.0,
        "registration_offset" => 30.0,
        "encoder_offset" | "strain_stiffening" => 25.0,
        "plastic_set" => 20.0,
        "joint_elasticity" | "spatial_coupling" => 15.0,
        _ => match effect.acts() {
            Acts::Torques => EVIDENT,
            Acts::Springs => 15.0,
            Acts::Contact => 25.0,
        },
    }
}

/// A verdict and the probability of every effect that was fitted.
pub(crate) struct Judged {
    pub(crate) verdict: Verdict,
    pub(crate) probabilities: Vec<(String, f64)>,
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
    }
}
