mod compensator;
mod parameter;
mod probe;

pub(crate) use compensator::slides;
pub use compensator::{Compensator, Sample, Site, Touch};
pub use parameter::{Parameter, Role};
pub(crate) use parameter::{check, per_joint};
pub(crate) use probe::Arm;
pub use probe::Probe;

use crate::{Campaign, GapError, STIFFNESS_FIELD};
use vsf_core::CoreError;

/// A gain of log evidence (nats) below which nothing is looked into further.
pub(crate) const EVIDENT: f64 = 12.0;

/// What an effect acts on; it decides how much has to be computed anew when a parameter moves. Methods of its
/// [`Compensator`] that reach deeper are not called: `springs` is for effects on springs and contact, `joints`,
/// `motion`, `contact` and `object_shift` for those on contact alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Acts {
    /// Adds torques, or scales those of the field: contacts and springs stay.
    Torques,
    /// Changes the springs of the touched points; contacts stay.
    Springs,
    /// Changes joint positions or their motion, the object's place or the contact model: contacts change.
    Contact,
}

/// What a recording must hold for an effect to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// Points that are touched.
    Contact,
    /// A joint that turns against gravity: without one, weight never shows.
    Weight,
    /// At least two moving joints.
    Joints,
    /// At least two touches of the same points.
    Retouch,
    /// Motion in which nothing is touched, or at least two joints: to a single joint that touches all the time,
    /// a constant torque is a surface that lies elsewhere.
    FreeMotion,
}

/// Whether the parameters of an effect are relative to which points are touched and how far they are displaced.
pub(crate) fn follows_contact(effect: &dyn Effect) -> bool {
    effect.acts() > Acts::Torques || effect.needs().contains(&Need::Contact)
}

/// How what an effect adds to the torques may stray from what its parameters say: a random walk per joint. A diagnosis
/// tries walks of 0, 0.1 and 0.3 times these sizes.
#[derive(Debug, Clone, PartialEq)]
pub struct RandomWalk {
    /// Standard deviation (N m or N) after a second, per joint, of a walk that begins with the session.
    pub of_session: Vec<f64>,
    /// The same of one that begins anew with every sequence.
    pub of_sequence: Vec<f64>,
}

impl RandomWalk {
    /// Checks that it is one of `joints` joints.
    pub(crate) fn check(&self, joints: usize) -> Result<(), GapError> {
        for sizes in [&self.of_session, &self.of_sequence] {
            CoreError::check_len("joints of a random walk", sizes.len(), joints)?;
            CoreError::check_finite("random walk", sizes)?;
        }
        Ok(())
    }
}

/// A candidate cause of the gap: a change of the nominal model with parameters, of which
/// amplitudes at zero leave the model as it is.
pub trait Effect: Send + Sync {
    /// Its name in the catalogue.
    fn name(&self) -> &str;

    /// What it is, for people who read a diagnosis: one phrase that names its parameters in backquotes, one of each
    /// joint as `` `c_<joint>` ``.
    fn summary(&self) -> &str;

    /// What it acts on.
    fn acts(&self) -> Acts;

    /// What a recording must hold for it to show.
    fn needs(&self) -> &[Need];

    /// Its parameters at a site, amplitudes first or mixed with shapes.
    fn parameters(&self, site: &Site) -> Vec<Parameter>;

    /// Starting points of the search, each with all parameters: shapes at plausible values,
    /// amplitudes ignored (they start at zero). One start with the middle of every shape's bounds
    /// by default.
    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let middle = |p: Parameter| match p.role {
            Role::Amplitude => 0.0,
            Role::Shape => 0.5 * (p.bounds[0] + p.bounds[1]),
        };
        vec![self.parameters(site).into_iter().map(middle).collect()]
    }

    /// Indices of the amplitudes that may act from the start of this index; the others stay at zero. By default
    /// all may. An effect of many parts, of which few act at once, has a start for each: every amplitude that
    /// may act costs evidence, and so does the choice between several sets of them. Indices increase, and are of
    /// amplitudes, one at least; an amplitude that no start lets act never does.
    fn acting(&self, site: &Site, start: usize) -> Vec<usize> {
        let _ = start;
        let parameters = self.parameters(site);
        let amplitude = |&i: &usize| parameters[i].role == Role::Amplitude;
        (0..parameters.len()).filter(amplitude).collect()
    }

    /// The effect with parameters `theta`, in the order of [`Effect::parameters`]. With the same parameters it is always the
    /// same: contacts under it are remembered.
    ///
    /// # Errors
    /// Parameters of another number, or that the robot cannot take.
    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError>;

    /// How it strays from what parameters `theta` say; not at all by default. What strays is no sign of another cause.
    fn random_walk(&self, _site: &Site, _theta: &[f64]) -> Option<RandomWalk> {
        None
    }

    /// About the largest gain of log evidence (nats) that it reaches in recordings where it does not act,
    /// because the nominal model is not quite right and bends to it; it has to gain more to be named. By
    /// default 12, or 15 if it reshapes springs or contact; those bend more easily.
    fn null_gain(&self) -> f64 {
        match self.acts() {
            Acts::Torques => EVIDENT,
            Acts::Springs | Acts::Contact => 15.0,
        }
    }

    /// Whether, by where surfaces are, how they stick or which way they push, it decides which points are touched, where to and
    /// how; false by default. Each such choice is another model: one that predicts other sequences worse, or makes them less
    /// likely, is not named. Where contact is rough the best of many gains hundreds of nats though none is right: there it
    /// has to close much of the gap on them, or to gain as much on them, nearly, as on those that it was fitted to.
    fn chooses_contacts(&self) -> bool {
        false
    }

    /// Whether it may be why nothing is touched at all, as where the object lies elsewhere than its points; false by default.
    fn may_prevent_touch(&self) -> bool {
        false
    }

    /// Whether it scales the torques of contact joint by joint; false by default. So do errors of the place where the
    /// force acts, above all at joints that it hardly turns: where contact is rough, such an effect has to gain as many
    /// times more as one that chooses contacts.
    fn scales_contact(&self) -> bool {
        false
    }

    /// Whether it goes by the torques that were read ([`Sample::reading`](crate::Sample::reading), or the
    /// [force](crate::Sample::force_W) behind them); false by default. Where none
    /// were, as of motions that are planned, it does nothing.
    fn follows_reading(&self) -> bool {
        false
    }

    /// Name of an effect of which it is a more general form, if there is one: it has to explain more than
    /// what is wrong with the form of that one, or to show what it adds to it ([`Effect::exceeds`]).
    fn extends(&self) -> Option<&str> {
        None
    }

    /// Whether fitted `parameters` with values `theta`, of standard deviations `sd` now and `prior_sd` before, show beyond
    /// doubt what it adds to the effect that it [extends](Effect::extends): by several deviations, by too
    /// much for a mere fault in the form of that one, and by what the data say. Amplitudes that may not act
    /// ([`Effect::acting`]) have deviations of 0. Never, by default.
    fn exceeds(
        &self,
        _parameters: &[Parameter],
        _theta: &[f64],
        _sd: &[f64],
        _prior_sd: &[f64],
    ) -> bool {
        false
    }

    /// How it answers to an experiment, by a name, usually its own: of effects that answer by the same name the
    /// experiment does not tell which one acts. `None`, the default, if it does not show in it more than elsewhere.
    ///
    /// A diagnosis proposes the experiment that tells most of what it leaves open.
    fn response(&self, probe: Probe) -> Option<&str> {
        let _ = probe;
        None
    }

    /// Why the campaign cannot show it, `None` when it can.
    fn untestable(&self, campaign: &Campaign) -> Option<String> {
        let may_touch = self.may_prevent_touch() && !campaign.site.rest.is_empty();
        (self.needs().iter())
            .filter(|need| !(may_touch && **need == Need::Contact))
            .find_map(|need| campaign.lacks(*need))
    }
}

impl std::fmt::Debug for dyn Effect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Effect({:?})", self.name())
    }
}

/// The sets of amplitudes that may act together, of the starts of an effect, smallest first.
pub(crate) fn acting_sets(effect: &dyn Effect, site: &Site) -> Vec<Vec<usize>> {
    let starts = 0..effect.starts(site).len();
    let mut sets: Vec<_> = starts.map(|k| effect.acting(site, k)).collect();
    sets.sort_by_key(Vec::len);
    sets
}

/// Checks what an effect says of itself and of its parameters at a site, as a diagnosis does before it begins. What
/// its compensators do is not looked at; `check_effect` of the crate `vsf-testkit` does that, in tests.
///
/// # Errors
/// [`GapError::Model`] for names, null gains, bounds, scales, joints, sequences or starts that cannot be.
pub fn check_declaration(effect: &dyn Effect, site: &Site) -> Result<(), GapError> {
    let wrong = |problem: String| {
        Err(GapError::Model {
            effect: effect.name().to_owned(),
            problem,
        })
    };
    if effect.name().is_empty() || effect.name() == STIFFNESS_FIELD {
        return wrong("its name is empty, or that of the field; give it another".to_owned());
    }
    let null_gain = effect.null_gain();
    if !(null_gain.is_finite() && null_gain >= 0.0) {
        return wrong(format!(
            "its null gain is {null_gain:?}; it must be >= 0 and finite"
        ));
    }
    let parameters = effect.parameters(site);
    for (k, p) in parameters.iter().enumerate() {
        let (name, [lo, hi]) = (&p.name, p.bounds);
        let holds_zero = p.role == Role::Shape || lo <= 0.0 && hi > 0.0;
        if !(lo.is_finite() && hi.is_finite() && lo < hi && holds_zero) {
            return wrong(format!(
                "the bounds of parameter {name:?} are {lo:?} .. {hi:?}; they must increase, and hold 0 and \
                 more for amplitudes"
            ));
        }
        if !(p.scale > 0.0 && p.scale.is_finite()) {
            let scale = p.scale;
            return wrong(format!(
                "the scale of parameter {name:?} is {scale:?}; it must be > 0"
            ));
        }
        if p.joint.is_some_and(|j| j >= site.joints())
            || p.sequence.is_some_and(|s| s >= site.sequences.len())
        {
            return wrong(format!(
                "parameter {name:?} is of a joint or sequence that there is not"
            ));
        }
        let is_share = p.role == Role::Amplitude && p.joint.is_some() && lo > -1.0;
        if p.scales_field && !is_share {
            return wrong(format!(
                "parameter {name:?} scales torques of the field: it must be an amplitude of a joint, of more than -1"
            ));
        }
        if parameters[..k].iter().any(|q| q.name == *name) {
            return wrong(format!("there are two parameters {name:?}"));
        }
    }
    let mut scaled: Vec<Option<usize>> = (parameters.iter())
        .filter(|p| p.scales_field)
        .map(|p| p.joint)
        .collect();
    scaled.sort_unstable();
    if !scaled.is_empty() && !(scaled.iter().copied()).eq((0..site.joints()).map(Some)) {
        return wrong(
            "it scales the torques of the field of some joints alone, or twice".to_owned(),
        );
    }
    if parameters.iter().all(|p| p.role == Role::Shape) {
        return wrong("none of its parameters is an amplitude".to_owned());
    }
    let starts = effect.starts(site);
    if starts.is_empty() {
        return wrong("it has no start".to_owned());
    }
    for (k, start) in starts.into_iter().enumerate() {
        let acting = effect.acting(site, k);
        let acts = |i: &usize| (parameters.get(*i)).is_some_and(|p| p.role == Role::Amplitude);
        if acting.is_empty() || !acting.iter().all(acts) || !acting.is_sorted_by(|a, b| a < b) {
            return wrong(format!(
                "from start {k} the parameters {acting:?} may act; they must be indices of amplitudes, increasing, \
                 one at least"
            ));
        }
        check(effect.name(), &start, parameters.len())?;
        if let Some(walk) = effect.random_walk(site, &start)
            && let Err(e) = walk.check(site.joints())
        {
            return wrong(format!("from start {k}: {e}"));
        }
        let out = |(p, t): &(&Parameter, &f64)| {
            p.role == Role::Shape && !(p.bounds[0]..=p.bounds[1]).contains(*t)
        };
        if let Some((p, t)) = parameters.iter().zip(&start).find(out) {
            let name = &p.name;
            return wrong(format!(
                "a start has {t:?} for parameter {name:?}, out of its bounds"
            ));
        }
    }
    Ok(())
}
