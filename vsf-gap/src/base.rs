//! The nominal model, against which effects are measured.

use crate::evidence::Spread;
use crate::fitted::Fitted;
use crate::screen::{best_of, log_mean_exp};
use crate::spread_search::{CONTACT, JOINT};
use crate::{Campaign, GapError, Model};
use rayon::prelude::*;

/// The nominal model, without negative stiffness, of one campaign.
pub(crate) struct Base {
    /// Its stiffness per rest point (N/m).
    pub(crate) field: Vec<f64>,
    /// The spread of the stiffness that suits best, within the lattice or beyond it.
    pub(crate) raised: Spread,
    /// The same spread with the roughness that suits best.
    pub(crate) spread: Spread,
    /// Log evidence, averaged over roughness (nats, without constants).
    pub(crate) log_evidence: f64,
}

impl Campaign {
    /// The nominal model under the best spread within the lattice. Points whose stiffness comes out negative are removed
    /// from `nominal`.
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

    /// The log evidence of a model with its parameters as they are.
    ///
    /// # Errors
    /// Rows that contact cannot take; parameters that an effect cannot take; a covariance that is not positive definite.
    pub(crate) fn log_evidence(&self, model: &Model) -> Result<f64, GapError> {
        let mut fitted = self.fitted(model, self.train.iter())?;
        let stiffness = fitted.best_stiffness(CONTACT[1], JOINT[1])?;
        let spreads = fitted.roughness(&stiffness);
        let smoothest = spreads[best_of(&evidence(&fitted, &spreads)?)];
        Ok(self.base(&mut fitted, &smoothest)?.log_evidence)
    }
}

/// Log evidence at each spread.
fn evidence(nominal: &Fitted<'_>, spreads: &[Spread]) -> Result<Vec<f64>, GapError> {
    (spreads.par_iter())
        .map(|s| nominal.log_evidence(s))
        .collect()
}
