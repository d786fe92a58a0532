//! Another contact threshold as an alternative to effects. The threshold is a choice of the model, not a cause.

use crate::contact::contact_config;
use crate::effect::EVIDENT;
use crate::effects::GeometryPadding;
use crate::notes::mm;
use crate::refine::Refined;
use crate::search::{Candidate, Search};
use crate::trial::Judgment;
use crate::{Campaign, Effect, GapError, Model};
use std::borrow::Cow;
use vsf_contact::ContactConfig;
use vsf_pipeline::Scene;

/// Named effects have to gain this many times as much as the other contact.
const TIMES: f64 = 2.0;

/// The model without the effects that are relative to contact, with another contact threshold.
pub(crate) struct Rival {
    /// Contact thresholds (m): the rival's, and that of the search.
    thresholds: [f64; 2],
    /// Names of its remaining effects.
    beside: Vec<String>,
    /// Gain of the other contact beside them (nats), and the gain that is reached by chance.
    gain: f64,
    null_gain: f64,
    /// Gain of the named effects that are relative to the contact (nats).
    of_effects: f64,
    /// Gain that these effects reach without acting (nats).
    null_gain_of_effects: f64,
    /// Names of these effects.
    effects: Vec<String>,
}

/// Another scene, its gain (nats), and the gain that is reached by chance.
struct Other {
    scene: Scene,
    gain: f64,
    null_gain: f64,
}

impl Other {
    fn says(&self) -> f64 {
        self.gain - self.null_gain
    }
}

impl Rival {
    /// Whether the effects cannot be told from the rival. Where another contact gains much, contact is described so roughly
    /// that effects have to gain twice as much, beyond their null gain.
    pub(crate) fn outdoes(&self) -> bool {
        self.of_effects < TIMES * (self.gain - self.null_gain) + self.null_gain_of_effects
    }

    /// The effects that cannot be told from the rival.
    pub(crate) fn effects(&self) -> &[String] {
        &self.effects
    }

    /// Note about the rival, for the reader of the diagnosis.
    pub(crate) fn told(&self) -> String {
        let [own, searched] = self.thresholds.map(mm);
        let without = if self.beside.is_empty() {
            "without any effect".to_owned()
        } else {
            format!("beside {}", self.beside.join(" and "))
        };
        let gains = format!(
            "a contact threshold of {own} instead of {searched} raises the log evidence of the train sequences by {:.0} \
             nats {without}, {} at {searched} by {:.0}",
            self.gain,
            self.effects.join(" and "),
            self.of_effects,
        );
        if self.outdoes() {
            format!(
                "{gains}. The threshold is a choice of the model, not a cause, and acts as thicker links do: effects are \
                 searched at {own}, and paddings are relative to that"
            )
        } else {
            format!("{gains}, which is more than twice as much beyond what either gains by chance")
        }
    }
}

impl Search<'_> {
    /// The contact threshold that explains the train sequences better than that of the search, and its scene.
    ///
    /// Tried are the threshold of the fields, and the one that a fitted padding amounts to. `None` if the threshold was
    /// given, or if no named effect is relative to the contact. `campaign` is the one that was searched.
    ///
    /// # Errors
    /// Rows that contact cannot take; a covariance that is not positive definite.
    pub(crate) fn rival(
        &self,
        campaign: &Campaign,
        judgment: &Judgment<'_>,
    ) -> Result<Option<(Rival, Scene)>, GapError> {
        let named = judgment.named.as_ref().map(|t| t.refined);
        let follows = |r: &&Refined| campaign.threshold_is_free && r.model.follows_contact();
        let Some(named) = named.filter(follows) else {
            return Ok(None);
        };
        let together = named.model.by_contact();
        // A padding, which a threshold amounts to, beside all others, too: what else follows contact hides what that is worth.
        let padding = (together.0.parts.len() > 1 && together.0.has(GeometryPadding.name()))
            .then(|| named.model.parted(|e| e.name() == GeometryPadding.name()));
        let mut first = None;
        for (following, others) in std::iter::once(together).chain(padding) {
            let found = self.rival_of(campaign, named, &following, others)?;
            if found.as_ref().is_some_and(|(rival, _)| rival.outdoes()) {
                return Ok(found);
            }
            first = first.or(found);
        }
        Ok(first)
    }

    /// The rival of some effects of a named model, beside its others.
    ///
    /// # Errors
    /// As [`Search::rival`].
    fn rival_of(
        &self,
        campaign: &Campaign,
        named: &Refined,
        following: &Model,
        others: Model,
    ) -> Result<Option<(Rival, Scene)>, GapError> {
        let alone = self.with_only(campaign, named, &others)?;
        // As fitted beside the effects of contact, and alone: each contact takes what explains more in it.
        let fits: Vec<&Model> = [&others]
            .into_iter()
            .chain(alone.as_deref().map(|m| &m.model))
            .collect();
        let best = |campaign: &Campaign| -> Result<f64, GapError> {
            let of = |fit: &&Model| campaign.log_evidence(fit);
            let all: Vec<f64> = fits.iter().map(of).collect::<Result<_, _>>()?;
            Ok(all.into_iter().fold(f64::NEG_INFINITY, f64::max))
        };
        let here = best(campaign)?;
        // What effects gain counts what their parameters cost.
        let before = alone.as_deref().map_or(self.base, |m| m.log_evidence);
        let padded = if following.has(GeometryPadding.name()) {
            None
        } else {
            self.padded(campaign, alone.as_deref())?
        };
        let suited = match campaign.suited() {
            Some(c) => Some(Other {
                gain: best(&c)? - here,
                null_gain: 0.0,
                scene: c.scene,
            }),
            None => None,
        };
        let other = suited
            .into_iter()
            .chain(padded)
            .max_by(|a, b| a.says().total_cmp(&b.says()));
        let Some(other) = other.filter(|other| other.says() > EVIDENT) else {
            return Ok(None);
        };
        // How rough contact is, the other one tells.
        let null_gains = following.parts.iter().map(|(e, _)| e.null_gain());
        let rival = Rival {
            thresholds: [&other.scene, &campaign.scene].map(|s| s.contact().threshold),
            beside: names(&others),
            gain: other.gain,
            null_gain: other.null_gain,
            of_effects: named.log_evidence - before,
            null_gain_of_effects: null_gains.sum(),
            effects: names(following),
        };
        Ok(Some((rival, other.scene)))
    }

    /// A named model with only some of its effects, fitted anew; `None` if there are none.
    ///
    /// # Errors
    /// As [`Search::rival`].
    fn with_only(
        &self,
        campaign: &Campaign,
        named: &Refined,
        others: &Model,
    ) -> Result<Option<Cow<'_, Refined>>, GapError> {
        if others.parts.is_empty() {
            return Ok(None);
        }
        if let Some(found) = self.model_of(others) {
            return Ok(Some(Cow::Borrowed(found)));
        }
        let (model, prior) = named.without(|e| !others.has(e.name()));
        let fitted = campaign.refine(&model, prior, &named.spread)?;
        Ok(Some(Cow::Owned(fitted)))
    }

    /// The scene whose contact threshold includes a padding that is fitted beside the others; `None` if no padding shows.
    ///
    /// # Errors
    /// Parameters that the effect cannot take; rows that contact cannot take; a covariance that is not positive definite.
    fn padded(
        &self,
        campaign: &Campaign,
        others: Option<&Refined>,
    ) -> Result<Option<Other>, GapError> {
        let is_padding = |c: &&Candidate| c.effect.name() == GeometryPadding.name();
        let Some(candidate) = self.candidates.iter().find(is_padding) else {
            return Ok(None);
        };
        let padding = &candidate.effect;
        let (model, prior) =
            others.map_or_else(Default::default, |m| (m.model.clone(), m.prior.clone()));
        let before = others.map_or(self.base, |m| m.log_evidence);
        let fitted = match self.model_of(&model.with(padding, &[])) {
            Some(found) => Cow::Borrowed(found),
            None => {
                let tangent = &self.tangents[candidate.found.tangent];
                let spread = &others.map_or(self.spread, |m| m.spread);
                let start = campaign.start(&model, tangent, &candidate.found, spread)?;
                let prior = prior.and(tangent.prior(&campaign.site));
                Cow::Owned(campaign.refine(&start, prior, spread)?)
            }
        };
        let effects = fitted.model.compensator(&campaign.site)?;
        let nominal = *campaign.scene.contact();
        let level = contact_config(&campaign.scene, &*effects).level();
        let scene = campaign.scene.with_contact(ContactConfig {
            threshold: level - nominal.padding,
            ..nominal
        });
        // Surfaces that are moved out may be touched where they are.
        Ok(scene.ok().map(|scene| Other {
            scene,
            gain: fitted.log_evidence - before,
            null_gain: padding.null_gain(),
        }))
    }

    /// The fitted model with exactly the effects of `effects`, if there is one.
    fn model_of(&self, effects: &Model) -> Option<&Refined> {
        let mut all = (self.candidates.iter().filter_map(|c| c.refined.as_ref()))
            .chain(self.combinations.iter().map(|c| &c.refined));
        all.find(|m| m.model.has_effects_of(effects))
    }
}

fn names(model: &Model) -> Vec<String> {
    let effects = model.parts.iter().map(|(e, _)| e.name().to_owned());
    effects.collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::effects;

    /// Gains as they were found: an encoder offset on a jointed plant, and pokes into a pad that nothing is wrong with.
    #[test]
    fn effects_have_to_gain_twice_as_much() {
        let of = |gain, of_effects, null_gain_of_effects| Rival {
            thresholds: [0.0032, 0.002],
            beside: Vec::new(),
            gain,
            null_gain: 0.0,
            of_effects,
            null_gain_of_effects,
            effects: vec!["encoder_offset".to_owned()],
        };
        for (rival, outdoes, says) in [
            (
                of(588.0, 1390.0, 25.0),
                false,
                "more than twice as much beyond",
            ),
            (of(595.0, 1185.0, 50.0), true, "searched at 3.200 mm"),
            (of(254.0, 356.0, 50.0), true, "searched at 3.200 mm"),
        ] {
            assert_eq!(rival.outdoes(), outdoes);
            let told = rival.told();
            assert!(told.contains(says), "{told}");
        }
        // What a padding gains by chance does not count.
        let padded = Rival {
            null_gain: 25.0,
            ..of(40.0, 90.0, 24.0)
        };
        assert!(!padded.outdoes() && of(40.0, 90.0, 24.0).outdoes());
        let beside = Rival {
            beside: vec!["payload".to_owned()],
            ..of(588.0, 1390.0, 25.0)
        };
        assert!(beside.told().contains("by 588 nats beside payload, "));
    }

    /// What the search did not pass by is fitted, and comes to the same, but for the roughness that it starts from.
    #[test]
    fn models_that_the_search_did_not_pass_are_fitted() {
        let campaign = Campaign::poked(0.15);
        let names = ["joint_coulomb_friction", "torque_bias", "geometry_padding"];
        let of = effects::named(&names.map(str::to_owned)).unwrap();
        let mut search = campaign.search(&of, false, &mut |_| {}).unwrap();
        let mut pairs = search.combinations.iter().map(|c| &c.refined);
        let pair = pairs.find(|r| !r.model.has(names[2])).unwrap().clone();
        let gains = |search: &Search<'_>| {
            let (_, others) = pair.model.parted(|e| e.name() == names[0]);
            let without = search.with_only(&campaign, &pair, &others);
            let padded = search.padded(&campaign, None);
            [
                without.unwrap().unwrap().log_evidence,
                padded.unwrap().unwrap().gain,
            ]
        };
        let found = gains(&search);
        search.combinations.clear();
        search.candidates.iter_mut().for_each(|c| c.refined = None);
        for (anew, found) in gains(&search).iter().zip(found) {
            assert!((anew - found).abs() < EVIDENT, "{anew} {found}");
        }
        let beside = search.padded(&campaign, Some(&pair));
        assert!(beside.unwrap().is_some());
    }
}
