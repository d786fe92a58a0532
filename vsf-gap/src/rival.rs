//! Another contact as a rival of effects: from where on points are touched is a choice of the model, not a cause.

use crate::evidence::Spread;
use crate::judge::threshold;
use crate::nominal::{CONTACT, Fitted, JOINT};
use crate::notes::number;
use crate::refine::Refined;
use crate::screen::{best_of, log_mean_exp};
use crate::search::Search;
use crate::trial::Judgement;
use crate::{Campaign, GapError, Model};
use rayon::prelude::*;

/// Named effects have to gain so many times what another contact does.
const CLEAR: f64 = 2.0;

/// The nominal model, without negative stiffness, as effects are measured against it.
pub(crate) struct Base {
    /// Its stiffness per rest point (N/m).
    pub(crate) field: Vec<f64>,
    /// The spread of the stiffness that suits best, within the lattice or beyond.
    pub(crate) raised: Spread,
    /// The same with the roughness that suits best.
    pub(crate) spread: Spread,
    /// Log evidence, roughness averaged (nats, without constants).
    pub(crate) log_evidence: f64,
}

/// Another contact that explains as much as the effects that were named.
pub(crate) struct Rival {
    /// From where on points are touched (m) in it, and in the contact that was searched.
    thresholds: [f64; 2],
    /// What it gains (nats).
    gain: f64,
    /// What the effects gain that it does without.
    outdone: f64,
    /// The names of these.
    effects: String,
}

impl Campaign {
    /// The nominal model by the best spread within the lattice.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn base(
        &self,
        nominal: &mut Fitted<'_>,
        smoothest: &Spread,
    ) -> Result<Base, GapError> {
        let raised = nominal.raised(smoothest)?;
        let spreads = nominal.roughness(&raised);
        // Stiffness is not negative, in any model that is compared.
        let (field, _) = self.field(nominal, &raised)?;
        let all = evidence(nominal, &spreads)?;
        Ok(Base {
            field,
            raised,
            spread: spreads[best_of(&all)],
            log_evidence: log_mean_exp(&all),
        })
    }

    /// The log evidence of the nominal model.
    ///
    /// # Errors
    /// Rows that contact cannot take, a covariance that is not positive definite.
    fn log_evidence(&self) -> Result<f64, GapError> {
        let mut nominal = self.fitted(&Model::default(), &self.train)?;
        let stiffness = nominal.best_stiffness(CONTACT[1], JOINT[1])?;
        let spreads = nominal.roughness(&stiffness);
        let smoothest = spreads[best_of(&evidence(&nominal, &spreads)?)];
        Ok(self.base(&mut nominal, &smoothest)?.log_evidence)
    }
}

/// At each spread.
fn evidence(nominal: &Fitted<'_>, spreads: &[Spread]) -> Result<Vec<f64>, GapError> {
    (spreads.par_iter())
        .map(|s| nominal.log_evidence(s))
        .collect()
}

impl Rival {
    /// Why effects are looked for in it.
    pub(crate) fn why(&self) -> String {
        let [own, searched] = self.thresholds.map(|t| number(1e3 * t));
        format!(
            "points that are touched from {own} mm before the surface on, instead of {searched} mm, explain the train sequences \
             better by {:.0} nats without any effect; {} with {searched} mm by {:.0}. From where on points are touched is a \
             choice of the model, not a cause: effects are looked for with {own} mm",
            self.gain, self.effects, self.outdone,
        )
    }
}

impl Search<'_> {
    /// The contact in which one estimates fields, if it explains the train sequences without effects as well as those
    /// named effects do that are relative to the contact: where it explains much, contact is described so roughly that
    /// these have to gain twice as much, and what says nothing yet.
    /// `campaign` is the one that was searched.
    ///
    /// # Errors
    /// Rows that contact cannot take, a covariance that is not positive definite.
    pub(crate) fn rival(
        &self,
        campaign: &Campaign,
        judgement: &Judgement<'_>,
    ) -> Result<Option<Rival>, GapError> {
        let named = judgement.named.as_ref().map(|t| t.refined);
        let Some(named) = named.filter(|r| r.model.follows_contact()) else {
            return Ok(None);
        };
        let Some(suited) = campaign.suited() else {
            return Ok(None);
        };
        let gain = suited.log_evidence()? - self.base;
        let (following, others) = named.model.by_contact();
        let needed: f64 = (following.parts.iter())
            .map(|(e, _)| threshold(e.as_ref(), self.spread.contact))
            .sum();
        let before = self.fitted(&others).map_or(self.base, |m| m.log_evidence);
        let outdone = named.log_evidence - before;
        Ok(
            (gain > 0.0 && outdone < CLEAR * gain + needed).then(|| Rival {
                thresholds: [&suited, campaign].map(|c| c.scene().contact().threshold),
                gain,
                outdone,
                effects: following.name(),
            }),
        )
    }

    /// What was fitted of the effects of a model, together and of no others.
    fn fitted(&self, of: &Model) -> Option<&Refined> {
        let mut all = (self.candidates.iter().filter_map(|c| c.refined.as_ref()))
            .chain(self.combinations.iter().map(|c| &c.refined));
        all.find(|m| m.model.is_part_of(of) && of.is_part_of(&m.model))
    }
}
