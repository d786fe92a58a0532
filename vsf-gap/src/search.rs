//! The search on the train sequences: screening, finalists that are fitted with the field, pairs.

use crate::diagnose::Step;
use crate::effect::{EVIDENT, check_effect};
use crate::evidence::Spread;
use crate::nominal::{CONTACT, Fitted, JOINT};
use crate::plain::Plainly;
use crate::refine::Refined;
use crate::screen::{Screened, Tangent, best_of, log_mean_exp, screen};
use crate::verdict::{Hypothesis, needed_beside, threshold};
use crate::{Acts, Campaign, Effect, GapError, Model};
use rayon::prelude::*;
use std::sync::Arc;

/// Effects that are fitted together with the field after screening.
const FINALISTS: usize = 6;
/// Second effects that are tried beside the best one; in free air, where a fit takes a moment, more.
const SECONDS: usize = 2;
const SECONDS_IN_AIR: usize = 6;
/// From this gain on (nats) an effect explains so much that the stiffness may vary less than it seemed.
const MUCH: f64 = 50.0;
/// An effect that screening puts so far below the best (nats) is no finalist.
const HOPELESS: f64 = 400.0;

/// What the search found.
pub(crate) struct Search<'a> {
    /// The nominal model, fitted.
    pub(crate) nominal: Fitted<'a>,
    /// Its stiffness per rest point (N/m), not negative.
    pub(crate) field: Vec<f64>,
    /// The spread that suits it best.
    pub(crate) spread: Spread,
    /// The log evidence of the nominal model (nats, without constants).
    pub(crate) base: f64,
    /// One stiffness everywhere, alone and with effects.
    pub(crate) plainly: Plainly,
    /// The effects that the recording can show, best first.
    pub(crate) candidates: Vec<Candidate>,
    /// Models of two of them: the best one whose second effect earned it, or in free air, without such a one, all
    /// that may do.
    pub(crate) pairs: Vec<Pair>,
    /// The effects that it cannot show, and why.
    pub(crate) untestable: Vec<(Arc<dyn Effect>, String)>,
    /// The changes that effects make at their starts.
    pub(crate) tangents: Vec<Tangent>,
}

/// The best single effect and another one.
pub(crate) struct Pair {
    pub(crate) refined: Refined,
    /// Whether the second gains more than what may be wrong with the form of the first. Else it has to explain
    /// nearly all that the first one leaves.
    pub(crate) earned: bool,
}

/// An effect, as far as the search came with it.
pub(crate) struct Candidate {
    pub(crate) effect: Arc<dyn Effect>,
    /// What screening found at its best start, and the gain there (nats).
    pub(crate) found: Screened,
    screened: f64,
    /// The model with it alone, if it was fitted.
    pub(crate) refined: Option<Refined>,
}

/// What effects are measured against.
struct Standard {
    /// Log evidence of the nominal model.
    base: f64,
    /// The spread that suits it best, within the lattice of the stiffness.
    spread: Spread,
    /// From this log evidence on an effect gets a spread of its own.
    much: f64,
}

impl Candidate {
    /// Gain of log evidence (nats); in screening if it was not fitted.
    pub(crate) fn score(&self, base: f64) -> f64 {
        match &self.refined {
            Some(refined) => refined.log_evidence - base,
            None => self.screened,
        }
    }
}

impl Search<'_> {
    /// All models that were fitted, pairs if they `stand`. `proven` if a trial will demand that they close most of
    /// the gap: roughness that effects take away does not count against them then.
    pub(crate) fn hypotheses(
        &self,
        proven: bool,
        stand: impl Fn(&Pair) -> Result<bool, GapError>,
    ) -> Result<Vec<Hypothesis<'_>>, GapError> {
        let mut pairs = Vec::new();
        for pair in &self.pairs {
            if stand(pair)? {
                pairs.push(&pair.refined);
            }
        }
        let alone = |name: &str| Some(self.alone(name)?.log_evidence - self.base);
        let single = self.candidates.iter().filter_map(|c| c.refined.as_ref());
        Ok((single.chain(pairs))
            .map(|refined| {
                let rough = match proven {
                    true => self.spread.contact.min(refined.spread.contact),
                    false => self.spread.contact,
                };
                Hypothesis::new(refined, self.base, rough, alone)
            })
            .collect())
    }

    /// The model of the first effect of a pair alone.
    pub(crate) fn first_of(&self, pair: &Pair) -> Option<&Refined> {
        let (first, _) = pair.refined.model.parts.first()?;
        self.alone(first.name())
    }

    /// The model of one effect, if it was fitted.
    fn alone(&self, name: &str) -> Option<&Refined> {
        let of = self.candidates.iter().find(|c| c.effect.name() == name)?;
        of.refined.as_ref()
    }

    /// The energy of the readings over windows that the nominal model leaves.
    pub(crate) fn left(&self) -> f64 {
        let predicted = self.nominal.predicted(&self.field);
        let readings = self.nominal.readings.iter();
        readings.zip(&predicted).map(|(y, p)| (y - p).powi(2)).sum()
    }

    /// The share of their energy that it leaves.
    pub(crate) fn share_left(&self) -> f64 {
        let energy: f64 = self.nominal.readings.iter().map(|y| y * y).sum();
        self.left() / energy.max(f64::MIN_POSITIVE)
    }
}

/// Sorts candidates by what they gain; those that were fitted come before the others.
fn best_first(candidates: &mut [Candidate], base: f64) {
    candidates.sort_by(|a, b| {
        let fitted = |c: &Candidate| c.refined.is_some();
        (fitted(b).cmp(&fitted(a))).then(b.score(base).total_cmp(&a.score(base)))
    });
}

/// The best start of every effect, best first.
fn best_starts(tangents: &[Tangent], screened: &[Screened], base: f64) -> Vec<Candidate> {
    let mut best: Vec<Candidate> = Vec::new();
    for s in screened {
        let effect = &tangents[s.tangent].effect;
        let gain = s.log_evidence - base;
        match best.iter_mut().find(|c| c.effect.name() == effect.name()) {
            Some(c) if c.screened >= gain => {}
            Some(c) => (c.screened, c.found) = (gain, s.clone()),
            None => best.push(Candidate {
                effect: effect.clone(),
                found: s.clone(),
                screened: gain,
                refined: None,
            }),
        }
    }
    best.sort_by(|a, b| b.screened.total_cmp(&a.screened));
    best
}

impl Campaign {
    /// Searches the effects for what explains the train sequences.
    ///
    /// # Errors
    /// Effects whose parameters or starts cannot be, rows that contact cannot take, covariances that
    /// are not positive definite.
    pub(crate) fn search(
        &self,
        effects: &[Arc<dyn Effect>],
        progress: &mut impl FnMut(Step),
    ) -> Result<Search<'_>, GapError> {
        progress(Step::Nominal);
        let model = Model::default();
        let mut nominal = self.fitted(&model, &self.train)?;
        let stiffness = nominal.best_stiffness(CONTACT[1], JOINT[1])?;
        let field = self.non_negative(&nominal, &stiffness)?;
        let spreads = nominal.roughness(&stiffness);

        progress(Step::Screen);
        let mut untestable = Vec::new();
        let mut tangents: Vec<Tangent> = Vec::new();
        for (k, effect) in effects.iter().enumerate() {
            if effects[..k].iter().any(|e| e.name() == effect.name()) {
                return Err(GapError::Model {
                    effect: effect.name().to_owned(),
                    problem: "there are two effects of this name; rename one, or leave it out"
                        .to_owned(),
                });
            }
            match effect.untestable(self) {
                Some(reason) => untestable.push((effect.clone(), reason)),
                None => {
                    check_effect(effect.as_ref(), &self.site)?;
                    tangents.extend(self.tangents(&model, &nominal, &field, effect)?);
                }
            }
        }
        let torques = nominal.predicted(&field);
        let screening = screen(&nominal, &[&torques], &tangents, &spreads)?;
        let screened_base = log_mean_exp(&screening.nominal);
        let mut candidates = best_starts(&tangents, &screening.candidates, screened_base);
        let shown = candidates.iter().map(|c| &c.effect);
        let plainly = self.plainly(&nominal, shown)?;
        let smoothest = spreads[best_of(&screening.nominal)];
        let raised = nominal.raised(&smoothest)?;
        let spreads = nominal.roughness(&raised);
        // Stiffness is not negative, in any model that is compared.
        let (field, _) = self.field(&mut nominal, &raised)?;
        let without: Vec<f64> = (spreads.par_iter())
            .map(|s| nominal.log_evidence(s))
            .collect::<Result<_, _>>()?;
        let base = log_mean_exp(&without);
        let spread = spreads[best_of(&without)];

        progress(Step::Finalists);
        // Effects are fitted within the lattice first: so is what they are measured against.
        let nominal_there = match raised == smoothest {
            true => base,
            false => screened_base,
        };
        let standard = Standard {
            base,
            spread: Spread {
                contact: spread.contact,
                joint: spread.joint,
                ..smoothest
            },
            much: MUCH + nominal_there,
        };
        self.finalists(&tangents, &mut candidates, &standard)?;

        progress(Step::Pairs);
        let mut pairs = self.pairs(&tangents, &mut candidates, &standard)?;
        best_first(&mut candidates, base);
        if !nominal.touches() {
            let models = candidates.iter_mut().filter_map(|c| c.refined.as_mut());
            for refined in models.chain(pairs.iter_mut().map(|p| &mut p.refined)) {
                self.settle(refined)?;
            }
        }
        Ok(Search {
            nominal,
            field,
            spread,
            base,
            plainly,
            candidates,
            pairs,
            untestable,
            tangents,
        })
    }

    /// Fits the candidates that promise most, and sorts all.
    fn finalists(
        &self,
        tangents: &[Tangent],
        candidates: &mut [Candidate],
        standard: &Standard,
    ) -> Result<(), GapError> {
        let base = standard.base;
        let refine = |candidate: &mut Candidate| {
            let tangent = &tangents[candidate.found.tangent];
            candidate.refined = Some(self.refined(tangent, &candidate.found, standard)?);
            Ok::<f64, GapError>(candidate.score(base))
        };
        // What screening promises most may come to nothing: the others are measured against what it keeps.
        if let Some((first, others)) = candidates.split_first_mut() {
            let leader = refine(first)?;
            (others.par_iter_mut().enumerate()).try_for_each(|(rank, candidate)| {
                let moves = candidate.effect.acts() == Acts::Contact;
                let near = candidate.screened > leader - HOPELESS;
                if near && (rank + 1 < FINALISTS || moves && leader < HOPELESS) {
                    refine(candidate)?;
                }
                Ok::<(), GapError>(())
            })?;
        }
        best_first(candidates, base);
        Ok(())
    }

    /// The nominal model with one effect, fitted from what screening found of it.
    fn refined(
        &self,
        tangent: &Tangent,
        found: &Screened,
        standard: &Standard,
    ) -> Result<Refined, GapError> {
        let start = self.start(&Model::default(), tangent, found, &standard.spread)?;
        let refined = self.refine(&start, tangent.prior(&self.site), &found.spread)?;
        match refined.log_evidence > standard.much {
            true => self.with_own_spread(refined, &start),
            false => Ok(refined),
        }
    }

    /// Models of two effects, the best single one and another, see [`Search::pairs`]. Others that they take are fitted
    /// alone as well, if they are not yet.
    fn pairs(
        &self,
        tangents: &[Tangent],
        candidates: &mut [Candidate],
        standard: &Standard,
    ) -> Result<Vec<Pair>, GapError> {
        let (base, rough) = (standard.base, standard.spread.contact);
        let Some((leader, rest)) = candidates.split_first_mut() else {
            return Ok(Vec::new());
        };
        let first = &tangents[leader.found.tangent];
        let Some(best) = leader
            .refined
            .as_ref()
            .filter(|r| r.log_evidence - base > EVIDENT)
        else {
            return Ok(Vec::new());
        };
        let fitted = self.fitted(&best.model, &self.train)?;
        let mut others = Vec::new();
        for candidate in &*rest {
            let effect = &candidate.effect;
            others.extend(self.tangents(&best.model, &fitted, &best.stiffness, effect)?);
        }
        let torques = fitted.predicted(&best.stiffness);
        // With contact, the errors of its model would take more from the second effect than the first one's do.
        let in_air = !fitted.touches();
        let mut free = vec![torques.as_slice()];
        if in_air {
            free.extend(best.free_columns());
        }
        let screening = screen(&fitted, &free, &others, &fitted.roughness(&best.spread))?;
        let without = log_mean_exp(&screening.nominal);
        let mut seconds = best_starts(&others, &screening.candidates, without);
        seconds.retain(|c| c.screened > EVIDENT);
        seconds.truncate(match in_air {
            true => SECONDS_IN_AIR,
            false => SECONDS,
        });
        let mut found: Vec<Pair> = Vec::new();
        for second in seconds {
            let tangent = &others[second.found.tangent];
            let start = self.start(&best.model, tangent, &second.found, &best.spread)?;
            let prior = first.prior(&self.site).and(tangent.prior(&self.site));
            let refined = self.refine(&start, prior, &best.spread)?;
            let gained = refined.log_evidence - best.log_evidence;
            if gained <= threshold(tangent.effect.as_ref(), rough) {
                continue;
            }
            let needed = needed_beside(tangent.effect.as_ref(), best.log_evidence - base, rough);
            let earned = gained > needed;
            if !(earned || in_air) {
                continue;
            }
            // Backward: the second on its own must not do as well.
            let name = tangent.effect.name();
            if let Some(alone) = rest.iter_mut().find(|c| c.effect.name() == name) {
                if alone.refined.is_none() {
                    let tangent = &tangents[alone.found.tangent];
                    alone.refined = Some(self.refined(tangent, &alone.found, standard)?);
                }
                let gained = refined.log_evidence - base - alone.score(base);
                if gained <= threshold(first.effect.as_ref(), rough) {
                    continue;
                }
            }
            found.push(Pair { refined, earned });
        }
        found.sort_by(|a, b| b.refined.log_evidence.total_cmp(&a.refined.log_evidence));
        if let Some(best) = found.iter().position(|p| p.earned) {
            found = vec![found.swap_remove(best)];
        }
        Ok(found)
    }
}
