//! The search on the train sequences: screening, then finalists that are fitted together with the field.

use crate::base::Base;
use crate::diagnose::DiagnosisStep;
use crate::effect::check_declaration;
use crate::evidence::Spread;
use crate::fitted::Fitted;
use crate::judge::{Hypothesis, named_from};
use crate::limits::{Limit, limits};
use crate::plain::Plainly;
use crate::refine::Refined;
use crate::screen::{Screened, Tangent, best_of, log_mean_exp, screen};
use crate::sets::Combination;
use crate::spread_search::{CONTACT, JOINT};
use crate::{Acts, Campaign, Effect, GapError, Model};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Number of effects that are fitted together with the field after screening.
const FINALISTS: usize = 6;
/// An effect with at least this gain (nats) explains so much that the stiffness may vary less than it seemed.
const MUCH: f64 = 50.0;
/// An effect this far below the best one in screening (nats) is no finalist, unless it moves contacts ([`LITTLE`]).
const HOPELESS: f64 = 400.0;
/// Screening says little about effects that move contacts. All of them are fitted if one of them leads, or if the leader
/// gains no more than this (nats).
const LITTLE: f64 = 400.0;

/// Why an effect cannot be tested although the recording meets its needs.
const UNSEEN: &str = "a small effect of this kind changes none of the train readings";

/// Result of the search.
pub(crate) struct Search<'a> {
    /// The nominal model, fitted.
    pub(crate) nominal: Fitted<'a>,
    /// Stiffness of the nominal model per rest point (N/m), not negative.
    pub(crate) field: Vec<f64>,
    /// The spread that suits the nominal model best.
    pub(crate) spread: Spread,
    /// The log evidence of the nominal model (nats, without constants).
    pub(crate) base: f64,
    /// A uniform stiffness, alone and with effects.
    pub(crate) plainly: Plainly,
    /// The effects that the recording can show, best first.
    pub(crate) candidates: Vec<Candidate>,
    /// Models with several effects, shorter ones first.
    pub(crate) combinations: Vec<Combination>,
    /// Whether a trial will require that models close most of the gap. Roughness that effects remove then does not count
    /// against them.
    proven: bool,
    /// The effects that the recording cannot show, each with the reason.
    pub(crate) untestable: Vec<(Arc<dyn Effect>, String)>,
    /// Derivatives of the torques at the starts of all effects.
    pub(crate) tangents: Vec<Tangent>,
    /// The size from which each effect shows, by name.
    pub(crate) limits: BTreeMap<String, Vec<Limit>>,
}

/// An effect, as far as the search has tested it.
pub(crate) struct Candidate {
    pub(crate) effect: Arc<dyn Effect>,
    /// Result of screening at its best start, and the gain there (nats).
    pub(crate) found: Screened,
    pub(crate) screened: f64,
    /// The model with this effect alone, if it was fitted.
    pub(crate) refined: Option<Refined>,
}

/// The reference that effects are compared with.
pub(crate) struct Standard {
    /// Log evidence of the nominal model.
    pub(crate) base: f64,
    /// The spread that suits the nominal model best, within the lattice of the stiffness.
    pub(crate) spread: Spread,
    /// An effect with at least this log evidence gets a spread of its own.
    much: f64,
}

impl Candidate {
    /// Gain of log evidence (nats); from screening if the effect was not fitted.
    pub(crate) fn score(&self, base: f64) -> f64 {
        match &self.refined {
            Some(refined) => refined.log_evidence - base,
            None => self.screened,
        }
    }
}

impl Search<'_> {
    /// All models that were fitted. A model of several effects is included if it earned its place, or if the whole
    /// `completes` the longest part of it that is included.
    pub(crate) fn hypotheses(
        &self,
        completes: impl Fn(&Refined, &Refined) -> Result<bool, GapError>,
    ) -> Result<Vec<Hypothesis<'_>>, GapError> {
        let mut models: Vec<&Refined> = (self.candidates.iter())
            .filter_map(|c| c.refined.as_ref())
            .collect();
        for Combination { refined, earned } in &self.combinations {
            let within = models.iter().filter(|m| m.model.is_part_of(&refined.model));
            let part = within.max_by(|a, b| {
                let length = |m: &Refined| m.model.parts.len();
                (length(a).cmp(&length(b))).then(a.log_evidence.total_cmp(&b.log_evidence))
            });
            let stands = match part {
                Some(part) if !earned => completes(part, refined)?,
                _ => *earned,
            };
            if stands {
                models.push(refined);
            }
        }
        Ok((models.into_iter())
            .map(|refined| self.hypothesis(refined))
            .collect())
    }

    /// A model as a hypothesis; see [`Search::hypotheses`].
    pub(crate) fn hypothesis<'a>(&self, refined: &'a Refined) -> Hypothesis<'a> {
        let rough = if self.proven {
            self.spread.contact.min(refined.spread.contact)
        } else {
            self.spread.contact
        };
        let alone = |name: &str| Some(self.alone(name)?.log_evidence - self.base);
        Hypothesis::new(refined, self.base, rough, alone)
    }

    /// The model of one effect, if it was fitted.
    fn alone(&self, name: &str) -> Option<&Refined> {
        let of = self.candidates.iter().find(|c| c.effect.name() == name)?;
        of.refined.as_ref()
    }

    /// Energy of the readings over windows that the nominal model leaves.
    pub(crate) fn left(&self) -> f64 {
        let predicted = self.nominal.predicted(&self.field);
        let readings = self.nominal.readings.iter();
        readings.zip(&predicted).map(|(y, p)| (y - p).powi(2)).sum()
    }

    /// Share of the energy of the readings that the nominal model leaves.
    pub(crate) fn share_left(&self) -> f64 {
        let energy: f64 = self.nominal.readings.iter().map(|y| y * y).sum();
        self.left() / energy.max(f64::MIN_POSITIVE)
    }
}

/// Sorts candidates by their gains. Fitted candidates come before the others.
fn best_first(candidates: &mut [Candidate], base: f64) {
    candidates.sort_by(|a, b| {
        let fitted = |c: &Candidate| c.refined.is_some();
        (fitted(b).cmp(&fitted(a))).then(b.score(base).total_cmp(&a.score(base)))
    });
}

/// The best start of every effect, best first.
pub(crate) fn best_starts(
    tangents: &[Tangent],
    screened: &[Screened],
    base: f64,
) -> Vec<Candidate> {
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
    /// Searches the effects that explain the train sequences. For `proven`, see [`Search`].
    ///
    /// # Errors
    /// Effects with invalid parameters or starts; rows that contact cannot take; covariances that are not positive
    /// definite.
    pub(crate) fn search(
        &self,
        effects: &[Arc<dyn Effect>],
        proven: bool,
        progress: &mut dyn FnMut(DiagnosisStep),
    ) -> Result<Search<'_>, GapError> {
        progress(DiagnosisStep::Nominal);
        let model = Model::default();
        let mut nominal = self.fitted(&model, self.train.iter())?;
        let stiffness = nominal.best_stiffness(CONTACT[1], JOINT[1])?;
        let field = self.non_negative(&nominal, &stiffness)?;
        let spreads = nominal.roughness(&stiffness);

        progress(DiagnosisStep::Screen);
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
                    check_declaration(effect.as_ref(), &self.site)?;
                    let own = self.tangents(&model, &nominal, &field, effect)?;
                    if own.iter().any(Tangent::shows) {
                        tangents.extend(own)
                    } else {
                        untestable.push((effect.clone(), UNSEEN.to_owned()))
                    }
                }
            }
        }
        if let Some((effect, reason)) = untestable
            .first()
            .filter(|_| untestable.len() == effects.len())
        {
            return Err(GapError::TooLittle {
                what: "effects that this recording can show",
                problem: format!(
                    "none of those that were asked for acts here: {}: {reason}; look for others",
                    effect.name()
                ),
            });
        }
        let torques = nominal.predicted(&field);
        let screening = screen(&nominal, &[&torques], &tangents, &spreads)?;
        let screened_base = log_mean_exp(&screening.nominal);
        let mut candidates = best_starts(&tangents, &screening.candidates, screened_base);
        let shown = candidates.iter().map(|c| &c.effect);
        let plainly = self.plainly(&nominal, shown)?;
        let smoothest = spreads[best_of(&screening.nominal)];
        let Base {
            field,
            raised,
            spread,
            log_evidence: base,
        } = self.base(&mut nominal, &smoothest)?;
        let limits = (candidates.iter().map(|c| c.effect.as_ref()))
            .map(|effect| {
                let required_gain = named_from(effect, spread.contact, nominal.touched);
                let found = limits(effect, &self.site, &tangents, &screening, required_gain);
                (effect.name().to_owned(), found)
            })
            .collect();

        progress(DiagnosisStep::Finalists);
        // Effects are fitted within the lattice first: so is what they are measured against.
        let nominal_there = if raised == smoothest {
            base
        } else {
            screened_base
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

        progress(DiagnosisStep::Sets);
        let mut combinations = self.combinations(&tangents, &mut candidates, &standard)?;
        best_first(&mut candidates, base);
        if !nominal.touched {
            let models = candidates.iter_mut().filter_map(|c| c.refined.as_mut());
            for refined in models.chain(combinations.iter_mut().map(|c| &mut c.refined)) {
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
            combinations,
            proven,
            untestable,
            tangents,
            limits,
        })
    }

    /// Fits the most promising candidates, and sorts all.
    fn finalists(
        &self,
        tangents: &[Tangent],
        candidates: &mut [Candidate],
        standard: &Standard,
    ) -> Result<(), GapError> {
        let base = standard.base;
        // What screening promises most may come to nothing: the others are measured against what it keeps.
        if let Some((first, others)) = candidates.split_first_mut() {
            self.fit_alone(first, tangents, standard)?;
            let leader = first.score(base);
            let moves = |c: &Candidate| c.effect.acts() == Acts::Contact;
            let all_that_move = moves(first) || leader < LITTLE;
            (others.par_iter_mut().enumerate()).try_for_each(|(rank, candidate)| {
                let near = rank + 1 < FINALISTS && candidate.screened > leader - HOPELESS;
                if near || all_that_move && moves(candidate) {
                    self.fit_alone(candidate, tangents, standard)?;
                }
                Ok::<(), GapError>(())
            })?;
        }
        // A more general form is measured against the one that it extends, however little screening promises of that.
        let general = candidates.iter().filter(|c| c.refined.is_some());
        let extended: Vec<String> = general
            .filter_map(|c| c.effect.extends().map(str::to_owned))
            .collect();
        candidates.par_iter_mut().try_for_each(|candidate| {
            if candidate.refined.is_none() && extended.iter().any(|e| e == candidate.effect.name())
            {
                self.fit_alone(candidate, tangents, standard)
            } else {
                Ok(())
            }
        })?;
        best_first(candidates, base);
        Ok(())
    }

    /// Fits the nominal model with the effect of a candidate alone, starting from the result of screening.
    pub(crate) fn fit_alone(
        &self,
        candidate: &mut Candidate,
        tangents: &[Tangent],
        standard: &Standard,
    ) -> Result<(), GapError> {
        let found = &candidate.found;
        let tangent = &tangents[found.tangent];
        let start = self.start(&Model::default(), tangent, found, &standard.spread)?;
        let refined = self.refine(&start, tangent.prior(&self.site), &found.spread)?;
        candidate.refined = Some(if refined.log_evidence > standard.much {
            self.with_own_spread(refined, &start)?
        } else {
            refined
        });
        Ok(())
    }
}
