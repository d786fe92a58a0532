//! Evidence against an answer, however likely it is: in the test sequences, in the field and in the sensors.

use crate::alike::Likeness;
use crate::closure::noise_norm;
use crate::estimated::{Compared, Extent, FAR, NEARLY};
use crate::judge::Nominal;
use crate::notes::{as_good_as_silence, nothing_said_of, nothing_touched, opposite, told};
use crate::plain::Plain;
use crate::search::Search;
use crate::trial::{Judgment, Trial};
use crate::verdict::Findings;
use crate::{Acts, Campaign, GapError};
use vsf_pipeline::Saturation;

/// If the stiffness absorbs at least this share of its information, an effect may be what the field shows.
const TAKEN_UP: f64 = 0.95;

/// A campaign, what was found in it, and how it is checked.
pub(crate) struct Case<'a> {
    pub(crate) campaign: &'a Campaign,
    /// The campaign with fewer samples, as the search used it.
    pub(crate) thinned: &'a Campaign,
    pub(crate) search: &'a Search<'a>,
    pub(crate) likeness: &'a Likeness,
    pub(crate) trial: &'a Trial<'a>,
    pub(crate) nominal: &'a Nominal,
}

/// What was found to speak against the answer.
pub(crate) struct Doubts<'a> {
    /// Effects that, with one stiffness everywhere, explain what the field explains, best first, each with the share that
    /// it explains.
    pub(crate) in_field: Vec<(&'a Plain, f64)>,
    /// Whether it is open what the field shows.
    undecided: bool,
    saturated: Vec<Saturation>,
    /// Correlation with spring torques of what the named model leaves to the springs, if it is opposite to them.
    opposed: Option<f64>,
    /// Named effects none of whose parameters the readings determine.
    vague: Vec<String>,
    untouched: bool,
    /// The error of sensors that read zero (N m or N), if the named model does hardly better.
    silence: Option<f64>,
    stopped: bool,
}

impl<'a> Doubts<'a> {
    /// Looks for doubts, and compares the corrected model with the nominal one. Doubts may withdraw what the `judgment`
    /// names. `saturated` are sensors at the end of their range.
    ///
    /// # Errors
    /// Rows that contact cannot take; a covariance that is not positive definite.
    pub(crate) fn find(
        case: &Case<'a>,
        judgment: &mut Judgment<'_>,
        extent: Extent,
        saturated: Vec<Saturation>,
    ) -> Result<(Self, Compared), GapError> {
        let (campaign, nominal) = (case.campaign, case.nominal);
        let noise = noise_norm(&campaign.noise);
        let closed = extent.closed();
        judgment.worse = extent.worse();
        let in_field = if nominal.perfect {
            Vec::new()
        } else {
            case.in_field()?
        };
        let opposed = judgment.opposed().filter(|_| !nominal.perfect);
        let undecided = !in_field.is_empty() && opposed.is_none() && judgment.leaves_field(closed);
        if undecided {
            judgment.withdraw();
        }
        let compared = extent.told(judgment.corrected().is_some());
        // What a cause that is shown in the air leaves in contact is the field's.
        let corrected = judgment.corrected();
        let of_torques = corrected.is_some_and(|t| t.refined.model.acts() == Acts::Torques);
        let is_shown = of_torques && compared.is_shown_in_air(noise);
        let lasts = |_: &f64| closed < NEARLY && !is_shown;
        judgment.persistence = judgment.persistence.filter(lasts);
        let may_touch = nominal.touches || judgment.corrected().is_some_and(|t| t.refined.touches);
        let error = compared.after.error();
        let silence = case.trial.of_silence()?;
        let found = Self {
            undecided,
            saturated,
            opposed: opposed.filter(|_| closed < NEARLY || compared.is_worse_in_contact()),
            vague: judgment.vague(),
            untouched: !may_touch
                && !campaign.site.rest.is_empty()
                && compared.closed.fraction < NEARLY
                && error > FAR * noise,
            silence: Some(silence).filter(|s| judgment.is_silent(error, *s, nominal.touches)),
            stopped: judgment.is_stopped(nominal.touches)
                && compared.is_far(noise, nominal.touches),
            in_field,
        };
        Ok((found, compared))
    }

    /// The findings on which the answer is based. `hidden` are effects that may act without showing, each with its share.
    pub(crate) fn findings(
        &self,
        case: &Case<'_>,
        judgment: &Judgment<'_>,
        compared: &Compared,
        hidden: Vec<(String, f64)>,
    ) -> Findings {
        let closed = compared.closed.fraction;
        let like_field = self.in_field.iter().filter(|_| self.undecided);
        Findings {
            closed,
            in_field: like_field
                .map(|(p, _)| p.effect.name().to_owned())
                .collect(),
            hidden,
            refused: judgment.names_refused(),
            left_free: judgment.left_free.is_some(),
            lasts: judgment.persistence.is_some(),
            stopped: self.stopped,
            contradicted: case.trial.surprise.is_some(),
            silent: self.silence.is_some(),
            opposed: self.opposed.is_some(),
            vague: !self.vague.is_empty(),
            untouched: self.untouched,
            saturated: !self.saturated.is_empty() && !case.nominal.perfect && closed < NEARLY,
        }
    }

    /// Notes on the doubts, for the reader of the diagnosis.
    pub(crate) fn notes(&self, campaign: &Campaign, judgment: &Judgment<'_>) -> Vec<String> {
        let mut notes = Vec::new();
        notes.extend(self.untouched.then(nothing_touched));
        notes.extend(self.saturated.iter().map(|s| campaign.of_saturation(s)));
        if let (Some(likeness), Some(named)) = (self.opposed, &judgment.named) {
            notes.push(opposite(&named.effects, likeness));
        }
        notes.extend((!self.vague.is_empty()).then(|| nothing_said_of(&self.vague)));
        notes.extend(
            self.silence
                .map(|error| as_good_as_silence(campaign, error)),
        );
        let like_field = self.in_field.first().filter(|_| self.undecided);
        notes.extend(like_field.map(|(plain, share)| told(campaign, plain, *share)));
        notes
    }
}

impl<'a> Case<'a> {
    /// The effects that, with one stiffness everywhere, explain what the field explains, and that the field absorbs; each
    /// with the share that it explains.
    fn in_field(&self) -> Result<Vec<(&'a Plain, f64)>, GapError> {
        let search = self.search;
        let free = search.left();
        let mut found = (search.plainly).instead_of_field(self.thinned, &search.nominal, free)?;
        found.retain(|(plain, _)| {
            let absorbed = self.likeness.absorbed(plain.effect.name());
            absorbed.is_some_and(|share| share >= TAKEN_UP)
        });
        Ok(found)
    }
}
