//! Models of several effects: further effects are searched in what single ones leave.

use crate::effect::EVIDENT;
use crate::evidence::Spread;
use crate::judge::{is_form_of, required_gain, required_gain_beside};
use crate::refine::Refined;
use crate::screen::{Tangent, log_mean_exp, screen};
use crate::search::{Candidate, Standard, best_starts};
use crate::spread_search::CONTACT;
use crate::{Acts, Campaign, Effect, GapError, Model};
use rayon::prelude::*;
use std::sync::Arc;

/// Number of further effects that are tried beside those found, in the order of screening; in free air, where a fit is
/// fast, more are tried.
///
/// Screening promises little for effects that move contacts, whatever they gain. Beside an effect that shows in the air,
/// which they do not imitate, all of them are tried if contact stays rough.
const FURTHER: usize = 4;
const FURTHER_IN_AIR: usize = 6;
/// Models of each length that are extended further, and further effects kept for each in free air.
const KEPT: usize = 3;
const BRANCHES: usize = 2;
/// Most effects in a model.
const MOST_EFFECTS: usize = 4;

/// A model with several effects.
pub(crate) struct Combination {
    pub(crate) refined: Refined,
    /// Whether each effect (with contact, the last one) gains more than what errors in the forms of the others may explain.
    /// If not, all together have to explain nearly all that the longest accepted part of them leaves.
    pub(crate) earned: bool,
}

/// A model with one more effect, and that effect.
struct Further {
    refined: Refined,
    effect: Arc<dyn Effect>,
}

/// Adds a model to others, replacing one with the same effects that does worse. Whether a set of effects earned its place
/// is not checked again for every way to it.
fn add(models: &mut Vec<Combination>, new: Combination) {
    let is_same = |m: &&mut Combination| m.refined.model.has_effects_of(&new.refined.model);
    match models.iter_mut().find(is_same) {
        Some(same) => {
            same.earned |= new.earned;
            if new.refined.log_evidence > same.refined.log_evidence {
                same.refined = new.refined;
            }
        }
        None => models.push(new),
    }
}

/// Replaces the models of candidates by better fits of the same single effects.
fn keep_better(candidates: &mut [Candidate], singles: Vec<Combination>) {
    for Combination { refined, .. } in singles {
        let is_of = |c: &&mut Candidate| refined.model.has(c.effect.name());
        let better = |c: &&mut Candidate| {
            let own = c.refined.as_ref();
            own.is_none_or(|own| own.log_evidence < refined.log_evidence)
        };
        if let Some(candidate) = candidates.iter_mut().find(is_of).filter(better) {
            candidate.refined = Some(refined);
        }
    }
}

/// The gain of a model (nats) beyond what is reached without any effect.
fn margin(refined: &Refined, base: f64, rough: f64) -> f64 {
    refined.log_evidence - base - required_gain_of(&refined.model, rough)
}

/// The gain that all effects of a model need together.
fn required_gain_of(model: &Model, rough: f64) -> f64 {
    let effects = model.parts.iter();
    effects.map(|(e, _)| required_gain(e.as_ref(), rough)).sum()
}

fn best_first<T>(models: &mut [T], worth: impl Fn(&T) -> f64) {
    models.sort_by(|a, b| worth(b).total_cmp(&worth(a)));
}

impl Campaign {
    /// Models of several effects, shorter ones first.
    ///
    /// Effects in them that were not fitted alone are fitted alone afterward; with contact, those that would earn a place
    /// beside the best one.
    ///
    /// # Errors
    /// Those of fits: rows that contact cannot take; covariances that are not positive definite.
    pub(crate) fn combinations(
        &self,
        tangents: &[Tangent],
        candidates: &mut [Candidate],
        standard: &Standard,
    ) -> Result<Vec<Combination>, GapError> {
        let touches = |c: &Candidate| c.refined.as_ref().is_some_and(|r| r.touches);
        if candidates.first().is_some_and(touches) {
            self.sets_in_contact(tangents, candidates, standard)
        } else {
            self.sets_in_air(tangents, candidates, standard)
        }
    }

    /// Combines the best single effect with each one that earns a place beside it, and so on from the best of these sets.
    ///
    /// Other effects that explain about as much are tried in place of the first, since what is beside it may have bent its
    /// form. Each is combined with the effects that earned a place beside the best one.
    fn sets_in_contact(
        &self,
        tangents: &[Tangent],
        candidates: &mut [Candidate],
        standard: &Standard,
    ) -> Result<Vec<Combination>, GapError> {
        let (base, rough) = (standard.base, standard.spread.contact);
        let alone = candidates.iter().filter_map(|c| c.refined.as_ref());
        let evident = alone.filter(|r| r.log_evidence - base > EVIDENT);
        let mut shorter: Vec<Refined> = evident.cloned().collect();
        let effects: Vec<_> = candidates.iter().map(|c| c.effect.clone()).collect();
        let mut found = Vec::new();
        for _ in 1..MOST_EFFECTS {
            best_first(&mut shorter, |r| margin(r, base, rough));
            let most = shorter.first().map_or(0.0, |r| r.log_evidence - base);
            shorter.retain(|r| is_form_of(r.log_evidence - base, most));
            shorter.truncate(KEPT);
            let (mut further, mut longer) = (effects.clone(), Vec::new());
            for (rank, before) in shorter.iter().enumerate() {
                let models =
                    self.beside(before, &further, &found, tangents, candidates, standard)?;
                if rank == 0 {
                    further = models.iter().map(|m| m.effect.clone()).collect();
                }
                for Further { refined, .. } in models {
                    let earned = true;
                    add(&mut longer, Combination { refined, earned });
                }
                if further.is_empty() {
                    break;
                }
            }
            // Of several, what stopped at a bound stands for something else, and further effects would take what it could not.
            let free = longer.iter().filter(|c| !c.refined.is_stopped(true));
            shorter = free.map(|c| c.refined.clone()).collect();
            found.append(&mut longer);
        }
        Ok(found)
    }

    /// A model with each of `further` effects that earn a place beside its own; `shorter` sets are known.
    fn beside(
        &self,
        before: &Refined,
        further: &[Arc<dyn Effect>],
        shorter: &[Combination],
        tangents: &[Tangent],
        candidates: &mut [Candidate],
        standard: &Standard,
    ) -> Result<Vec<Further>, GapError> {
        let (base, rough) = (standard.base, standard.spread.contact);
        let gain = before.log_evidence - base;
        let nominal = Model::default();
        let in_air = self.gain_in_air(&before.model, &nominal, &before.spread)?;
        let (in_contact, shows_in_air) = (gain - in_air.clamp(0.0, gain), in_air > EVIDENT);
        // Where contact comes out as smooth as can be told, surfaces are where they should be. Beside several it takes too long.
        let rough_contact = shows_in_air && before.spread.contact > CONTACT[0];
        let parts = before.model.parts.len();
        let all_that_move = rough_contact && parts == 1;
        let mut found = Vec::new();
        for longer in self.extended(before, further, rough, all_that_move)? {
            let Further { refined, effect } = &longer;
            let gained = refined.log_evidence - before.log_evidence;
            // Each of the forms before may be wrong by that share of all.
            let gains_beside = |gain: f64| {
                let of_all = parts as f64 * gain;
                gained > required_gain_beside(effect.as_ref(), of_all, rough)
            };
            let is_of_contact = || {
                let own = self.gain_in_air(&refined.model, &before.model, &refined.spread)?;
                Ok::<_, GapError>(own <= EVIDENT)
            };
            // What shows in contact alone does not mend forms in the air.
            if !(gains_beside(gain) || gains_beside(in_contact) && is_of_contact()?) {
                continue;
            }
            // Backward: on its own it must not do as well, nor may one of the others be spared.
            let name = effect.name();
            if let Some(alone) = candidates.iter_mut().find(|c| c.effect.name() == name) {
                if alone.refined.is_none() {
                    self.fit_alone(alone, tangents, standard)?;
                }
                let gained = refined.log_evidence - base - alone.score(base);
                if gained <= required_gain_of(&before.model, rough) {
                    continue;
                }
                // Where all show in contact alone, one that says nothing by itself mends the forms of the others.
                if !shows_in_air && alone.score(base) <= required_gain(effect.as_ref(), rough) {
                    continue;
                }
            }
            if parts == 1 || self.needs_those_before(refined, rough, shorter)? {
                found.push(longer);
            }
        }
        Ok(found)
    }

    /// Whether each effect of a model but the last gains what it needs, compared with the best of the `shorter` models
    /// without it and with a new fit.
    fn needs_those_before(
        &self,
        refined: &Refined,
        rough: f64,
        shorter: &[Combination],
    ) -> Result<bool, GapError> {
        let parts = &refined.model.parts;
        for (part, (effect, _)) in parts.iter().enumerate().rev().skip(1) {
            let without = self.refined_without(refined, part)?;
            let known = shorter
                .iter()
                .filter(|c| c.refined.model.has_effects_of(&without.model));
            let best = known.fold(without.log_evidence, |best, c| {
                best.max(c.refined.log_evidence)
            });
            let gained = refined.log_evidence - best;
            if gained <= required_gain(effect.as_ref(), rough) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// A model without the effect at index `part`, fitted anew.
    fn refined_without(&self, refined: &Refined, part: usize) -> Result<Refined, GapError> {
        let name = refined.model.parts[part].0.name();
        let (model, prior) = refined.without(|e| e.name() == name);
        self.refine(&model, prior, &refined.spread)
    }

    /// Gain of a model over another (nats) from the readings where neither touches anything, both as they are fitted. It is
    /// a log likelihood ratio, so the cost of parameters does not count. Of the spread, only what is not roughness is used.
    fn gain_in_air(&self, model: &Model, other: &Model, spread: &Spread) -> Result<f64, GapError> {
        let [own, others] = [model, other].map(|m| self.fitted(m, self.train.iter()));
        let (own, others) = (own?, others?);
        let mut rows = own.rows_in_air();
        let free = others.rows_in_air();
        rows.retain(|row| free.binary_search(row).is_ok());
        Ok(own.log_density_in(&rows, spread)? - others.log_density_in(&rows, spread)?)
    }

    /// The best models of each length, extended from the best shorter ones. Where a further effect makes an earlier one
    /// needless, models that do better than these are extended, too.
    fn sets_in_air(
        &self,
        tangents: &[Tangent],
        candidates: &mut [Candidate],
        standard: &Standard,
    ) -> Result<Vec<Combination>, GapError> {
        let (base, rough) = (standard.base, standard.spread.contact);
        let effects: Vec<_> = candidates.iter().map(|c| c.effect.clone()).collect();
        let alone = candidates.iter().filter_map(|c| c.refined.as_ref());
        let evident = alone.filter(|r| r.log_evidence - base > EVIDENT);
        let single = |refined: &Refined| Combination {
            refined: refined.clone(),
            earned: true,
        };
        let mut shorter: Vec<Combination> = evident.map(single).collect();
        let mut found = Vec::new();
        for length in 1..MOST_EFFECTS {
            let (mut longer, mut seen) = (Vec::new(), Vec::<Model>::new());
            loop {
                best_first(&mut shorter, |s| margin(&s.refined, base, rough));
                let best = shorter.iter().take(KEPT);
                let is_new =
                    |s: &&Combination| !seen.iter().any(|m| m.has_effects_of(&s.refined.model));
                let new: Vec<&Combination> = best.filter(is_new).collect();
                if new.is_empty() {
                    break;
                }
                let of_each: Vec<_> = (new.par_iter())
                    .map(|s| self.longer(s, &effects, base, rough))
                    .collect::<Result<_, GapError>>()?;
                seen.extend(new.iter().map(|s| s.refined.model.clone()));
                for (more, instead) in of_each {
                    more.into_iter().for_each(|model| add(&mut longer, model));
                    instead
                        .into_iter()
                        .for_each(|model| add(&mut shorter, model));
                }
            }
            if length == 1 {
                keep_better(candidates, std::mem::take(&mut shorter));
            }
            found.append(&mut shorter);
            shorter = longer;
            if shorter.is_empty() {
                break;
            }
        }
        found.append(&mut shorter);
        for candidate in candidates.iter_mut().filter(|c| c.refined.is_none()) {
            let name = candidate.effect.name();
            if found.iter().any(|c| c.refined.model.has(name)) {
                self.fit_alone(candidate, tangents, standard)?;
            }
        }
        Ok(found)
    }

    /// The best models with one more effect, in which no earlier effect can be spared; and models with as many effects as
    /// before that do better with the new one in place of another.
    fn longer(
        &self,
        shorter: &Combination,
        effects: &[Arc<dyn Effect>],
        base: f64,
        rough: f64,
    ) -> Result<(Vec<Combination>, Vec<Combination>), GapError> {
        let before = &shorter.refined;
        let mut models = self.extended(before, effects, rough, false)?;
        best_first(&mut models, |m| margin(&m.refined, base, rough));
        let gains = |whole: &Refined, further: &dyn Effect, rest: &Refined| {
            let required = required_gain_beside(further, rest.log_evidence - base, rough);
            whole.log_evidence - rest.log_evidence > required
        };
        let each_gains = |whole: &Refined| -> Result<bool, GapError> {
            for (part, (effect, _)) in whole.model.parts.iter().enumerate() {
                if !gains(whole, effect.as_ref(), &self.refined_without(whole, part)?) {
                    return Ok(false);
                }
            }
            Ok(true)
        };
        let (mut longer, mut instead) = (Vec::new(), Vec::new());
        for Further { refined, effect } in models {
            let mut earned = shorter.earned && gains(&refined, effect.as_ref(), before);
            let mut spared = 0;
            for part in 0..before.model.parts.len() {
                let without = self.refined_without(&refined, part)?;
                let of_part = refined.model.parts[part].0.as_ref();
                earned &= gains(&refined, of_part, &without);
                if refined.log_evidence - without.log_evidence > required_gain(of_part, rough) {
                    continue;
                }
                spared += 1;
                if without.log_evidence > before.log_evidence {
                    let earned = without.model.parts.len() == 1 || each_gains(&without)?;
                    let refined = without;
                    instead.push(Combination { refined, earned });
                }
            }
            if spared == 0 {
                longer.push(Combination { refined, earned });
                if longer.len() == BRANCHES {
                    break;
                }
            }
        }
        Ok((longer, instead))
    }

    /// A fitted model with one of some effects that it does not have, for the most promising ones that gain enough. If
    /// `all_that_move` is set, all effects that move contacts are tried.
    fn extended(
        &self,
        best: &Refined,
        effects: &[Arc<dyn Effect>],
        rough: f64,
        all_that_move: bool,
    ) -> Result<Vec<Further>, GapError> {
        let fitted = self.fitted(&best.model, self.train.iter())?;
        let mut others = Vec::new();
        for effect in effects.iter().filter(|e| !best.model.has(e.name())) {
            others.extend(self.tangents(&best.model, &fitted, &best.stiffness, effect)?);
        }
        let torques = fitted.predicted(&best.stiffness);
        let mut free = vec![torques.as_slice()];
        // With contact, the errors of its model would take more from a further effect than those before do.
        let in_air = !best.touches;
        if in_air {
            free.extend(best.free_columns());
        }
        let screening = screen(&fitted, &free, &others, &fitted.roughness(&best.spread))?;
        let without = log_mean_exp(&screening.nominal);
        let further = best_starts(&others, &screening.candidates, without);
        let moves = |c: &Candidate| c.effect.acts() == Acts::Contact;
        let tried = |(rank, c): &(usize, Candidate)| {
            if in_air {
                *rank < FURTHER_IN_AIR && c.screened > EVIDENT
            } else {
                *rank < FURTHER && c.screened > 0.0 || all_that_move && moves(c)
            }
        };
        let further: Vec<_> = further.into_iter().enumerate().filter(tried).collect();
        let mut models: Vec<Further> = (further.into_par_iter())
            .map(|(_, Candidate { effect, found, .. })| {
                let tangent = &others[found.tangent];
                let start = self.start(&best.model, tangent, &found, &best.spread)?;
                let prior = best.prior.clone().and(tangent.prior(&self.site));
                let refined = self.refine(&start, prior, &best.spread)?;
                Ok(Further { refined, effect })
            })
            .collect::<Result<_, GapError>>()?;
        models.retain(|Further { refined, effect }| {
            refined.log_evidence - best.log_evidence > required_gain(effect.as_ref(), rough)
        });
        Ok(models)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::effects;
    use crate::spread_search::JOINT;

    /// Of what a model gains in the air, contact has no part: not even where it begins elsewhere.
    #[test]
    fn a_gain_in_the_air_is_of_readings_where_neither_model_touches() {
        let campaign = Campaign::poked(0.0);
        let with = |name: &str, own: &str, value: f64| {
            let effect = effects::named(&[name.to_owned()]).unwrap().remove(0);
            let theta = effect.parameters(&campaign.site);
            let theta = theta
                .iter()
                .map(|p| if p.name == own { value } else { 0.0 });
            Model::of(&effect, &theta.collect::<Vec<_>>())
        };
        let nominal = Model::default();
        let fitted = campaign.fitted(&nominal, campaign.train.iter()).unwrap();
        let spread = fitted.best_stiffness(CONTACT[1], JOINT[1]).unwrap();
        let gain =
            |model: &Model, other: &Model| campaign.gain_in_air(model, other, &spread).unwrap();
        let bias = with("torque_bias", "b_1", 1.0);
        let wider = with("geometry_padding", "padding", 0.003);
        let of_wider = campaign.fitted(&wider, campaign.train.iter()).unwrap();
        assert!(of_wider.rows_in_air().len() < fitted.rows_in_air().len());
        assert_eq!(gain(&wider, &nominal), 0.0);
        assert!(gain(&bias, &nominal) > EVIDENT);
        assert_eq!(gain(&nominal, &bias), -gain(&bias, &nominal));
        assert_eq!(gain(&bias, &wider), -gain(&wider, &bias));
    }

    /// At one speed dry friction and a damper are the same: whichever leads, both are tried beside the bias.
    #[test]
    fn the_first_effect_of_a_pair_is_exchanged_for_others_that_explain_as_much() {
        let campaign = Campaign::poked(0.15);
        let friction = ["joint_coulomb_friction", "joint_viscous_friction"];
        let all = [friction[0], friction[1], "torque_bias"].map(str::to_owned);
        let of = effects::named(&all).unwrap();
        let search = campaign.search(&of, false, &mut |_| {}).unwrap();
        assert_ne!(search.candidates[0].effect.name(), "torque_bias");
        let beside_bias = |name: &&str| {
            let mut pairs = search.combinations.iter().map(|c| &c.refined.model);
            pairs.any(|m| m.has(name) && m.has("torque_bias"))
        };
        assert!(friction.iter().all(beside_bias));
    }

    /// It is one set, by whichever effect the search came to it first.
    #[test]
    fn of_two_ways_to_one_set_the_better_fit_stays() {
        let campaign = Campaign::poked(0.15);
        let of = effects::named(&["joint_coulomb_friction", "torque_bias"].map(str::to_owned));
        let search = campaign.search(&of.unwrap(), false, &mut |_| {}).unwrap();
        let pair = &search.combinations[0].refined;
        let way = |log_evidence: f64, turned: bool, earned: bool| {
            let mut refined = pair.clone();
            refined.log_evidence = log_evidence;
            if turned {
                refined.model.parts.reverse();
            }
            Combination { refined, earned }
        };
        let mut models = Vec::new();
        for (log_evidence, turned, earned) in
            [(5.0, false, false), (7.0, true, true), (6.0, false, false)]
        {
            add(&mut models, way(log_evidence, turned, earned));
        }
        assert_eq!(models.len(), 1);
        assert_eq!(models[0].refined.log_evidence, 7.0);
        assert!(models[0].earned);
        assert_ne!(
            models[0].refined.model.parts[0].0.name(),
            pair.model.parts[0].0.name()
        );
    }

    /// A damper beside dry friction takes some of its form at one speed, and can be spared once that is there.
    #[test]
    fn a_set_that_can_spare_an_effect_is_refused() {
        let campaign = Campaign::poked(0.15);
        let all = [
            "joint_viscous_friction",
            "torque_bias",
            "joint_coulomb_friction",
        ];
        let of = effects::named(&all.map(str::to_owned)).unwrap();
        let search = campaign.search(&of, false, &mut |_| {}).unwrap();
        let alone = |name: &str| {
            let mut of = search.candidates.iter();
            of.find(|c| c.effect.name() == name)
                .unwrap()
                .refined
                .clone()
                .unwrap()
        };
        let needs = |names: &[&str]| {
            let (mut model, mut prior) = (Model::default(), crate::refine::Prior::default());
            for refined in names.iter().map(|name| alone(name)) {
                model.parts.extend(refined.model.parts);
                prior = prior.and(refined.prior);
            }
            let refined = campaign.refine(&model, prior, &search.spread).unwrap();
            campaign
                .needs_those_before(&refined, search.spread.contact, &search.combinations)
                .unwrap()
        };
        assert!(needs(&["torque_bias", "joint_coulomb_friction"]));
        assert!(!needs(&all));
    }
}
