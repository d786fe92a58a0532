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

/// A gain of log evidence (nats) below which nothing is examined further.
pub(crate) const EVIDENT: f64 = 12.0;

/// The deepest part of the model that an effect acts on.
///
/// It decides how much has to be recomputed when a parameter changes. Methods of the effect's [`Compensator`] that reach
/// deeper are not called: `springs` is called only for effects on springs and contact; `joints`, `motion`, `contact` and
/// `object_shift` only for effects on contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Acts {
    /// Adds torques, or scales those of the field. Contacts and springs stay the same.
    Torques,
    /// Changes the springs of the touched points. Contacts stay the same.
    Springs,
    /// Changes joint positions or motion, the place of the object, or the contact parameters. Contacts change.
    Contact,
}

/// What a recording must hold for an effect to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// Points that are touched.
    Contact,
    /// A joint that turns against gravity; otherwise weight never shows.
    Weight,
    /// At least two moving joints.
    Joints,
    /// At least two touches of the same points.
    Retouch,
    /// Motion in which nothing is touched, or at least two joints. To a single joint that touches all the time, a constant
    /// torque looks like a surface that lies elsewhere.
    FreeMotion,
}

/// Whether the parameters of an effect depend on which points are touched and how far they are displaced.
pub(crate) fn follows_contact(effect: &dyn Effect) -> bool {
    effect.acts() > Acts::Torques || effect.needs().contains(&Need::Contact)
}

/// How the torques of an effect may stray from what its parameters say: a random walk per joint.
///
/// A diagnosis tries walks of 0, 0.1 and 0.3 times these sizes.
#[derive(Debug, Clone, PartialEq)]
pub struct RandomWalk {
    /// Standard deviation (N m or N) after one second, per joint, of a walk that starts with the session.
    pub of_session: Vec<f64>,
    /// The same for a walk that starts anew with every sequence.
    pub of_sequence: Vec<f64>,
}

impl RandomWalk {
    /// Checks that the walk has the right form for `joints` joints.
    pub(crate) fn check(&self, joints: usize) -> Result<(), GapError> {
        for sizes in [&self.of_session, &self.of_sequence] {
            CoreError::check_len("joints of a random walk", sizes.len(), joints)?;
            CoreError::check_finite("random walk", sizes)?;
        }
        Ok(())
    }
}

/// A candidate cause of the gap: a parametrized change of the nominal model.
///
/// With all amplitudes at zero, the model is unchanged.
pub trait Effect: Send + Sync {
    /// Its name in the catalogue.
    fn name(&self) -> &str;

    /// What the effect is, for readers of a diagnosis.
    ///
    /// One phrase that names its parameters in backquotes; those that each joint has are written `` `c_<joint>` ``.
    fn summary(&self) -> &str;

    /// What it acts on.
    fn acts(&self) -> Acts;

    /// What a recording must hold for the effect to show.
    fn needs(&self) -> &[Need];

    /// Its parameters at a site; amplitudes and shapes may be mixed.
    fn parameters(&self, site: &Site) -> Vec<Parameter>;

    /// Starting points of the search, each with values for all parameters.
    ///
    /// Shapes are at plausible values. Amplitudes are ignored: they start at zero. The default is one start with every
    /// shape in the middle of its bounds.
    fn starts(&self, site: &Site) -> Vec<Vec<f64>> {
        let middle = |p: Parameter| match p.role {
            Role::Amplitude => 0.0,
            Role::Shape => 0.5 * (p.bounds[0] + p.bounds[1]),
        };
        vec![self.parameters(site).into_iter().map(middle).collect()]
    }

    /// Indices of the amplitudes that may act in the start `start`; the others stay at zero.
    ///
    /// By default, all may act. An effect of many parts of which few act at once has one start for each set: every
    /// amplitude that may act costs evidence, and so does the choice between several sets. There is at least one index;
    /// indices increase and refer to amplitudes. An amplitude that no start lets act never acts.
    fn acting(&self, site: &Site, start: usize) -> Vec<usize> {
        let _ = start;
        let parameters = self.parameters(site);
        let amplitude = |&i: &usize| parameters[i].role == Role::Amplitude;
        (0..parameters.len()).filter(amplitude).collect()
    }

    /// The effect with parameters `theta`, in the order of [`Effect::parameters`].
    ///
    /// The same parameters must always give the same compensator, since contacts under it are cached.
    ///
    /// # Errors
    /// A wrong number of parameters, or parameters that the robot cannot take.
    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError>;

    /// How the effect may stray from what the parameters `theta` say; by default not at all.
    ///
    /// Such straying is not taken for a sign of another cause.
    fn random_walk(&self, _site: &Site, _theta: &[f64]) -> Option<RandomWalk> {
        None
    }

    /// About the largest gain of log evidence (nats) that the effect reaches in recordings where it does not act.
    ///
    /// It reaches such gains because the nominal model is not quite right and the effect bends to its errors. It has to
    /// gain more to be named. The default is 12, or 15 for effects on springs or contact, which bend more easily.
    fn null_gain(&self) -> f64 {
        match self.acts() {
            Acts::Torques => EVIDENT,
            Acts::Springs | Acts::Contact => 15.0,
        }
    }

    /// Whether the effect decides which points are touched and how they are displaced, by where surfaces are, how they
    /// stick or which way they push. False by default.
    ///
    /// Each such choice is another model. If it predicts other sequences worse, or makes them less likely, it is not named.
    /// Where contact is rough, the best of many choices gains hundreds of nats though none is right. There, the effect also
    /// has to close much of the gap on the test sequences, or to gain at least half as much per sample on them as on those
    /// that it was fitted to.
    fn chooses_contacts(&self) -> bool {
        false
    }

    /// Whether the effect may be the reason that nothing is touched at all, for example because the object lies elsewhere
    /// than its points. False by default.
    fn may_prevent_touch(&self) -> bool {
        false
    }

    /// Whether the effect scales the contact torques joint by joint. False by default.
    ///
    /// Errors of the place where the force acts do the same, above all at joints that the force hardly turns. Where contact
    /// is rough, such an effect therefore has to gain as many times more as one that chooses contacts.
    fn scales_contact(&self) -> bool {
        false
    }

    /// Whether the effect depends on the measured torques ([`Sample::reading`](crate::Sample::reading), or the
    /// [force](crate::Sample::force_W) behind them). False by default.
    ///
    /// Without measured torques, as for planned motions, it does nothing.
    fn follows_reading(&self) -> bool {
        false
    }

    /// Name of the effect that this one generalizes, if there is one.
    ///
    /// The general form has to explain more than what is wrong with the form of its special case, or to show what it adds
    /// to it ([`Effect::exceeds`]).
    fn extends(&self) -> Option<&str> {
        None
    }

    /// Whether fitted `parameters` show beyond doubt what the effect adds to the one that it [extends](Effect::extends).
    /// False by default.
    ///
    /// `theta` are the fitted values, `sd` their standard deviations, and `prior_sd` those of the prior. "Beyond doubt"
    /// means by several standard deviations, by too much for a mere error in the form of the special case, and determined
    /// by the data. Amplitudes that may not act ([`Effect::acting`]) have deviations of 0.
    fn exceeds(
        &self,
        _parameters: &[Parameter],
        _theta: &[f64],
        _sd: &[f64],
        _prior_sd: &[f64],
    ) -> bool {
        false
    }

    /// The name under which the effect responds to an experiment, usually its own name.
    ///
    /// The experiment cannot tell effects with the same response name apart. `None`, the default, means that the effect
    /// shows in the experiment no more than elsewhere. A diagnosis proposes the experiment that resolves most of what it
    /// leaves open.
    fn response(&self, probe: Probe) -> Option<&str> {
        let _ = probe;
        None
    }

    /// Why the campaign cannot show the effect; `None` if it can.
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

/// The sets of amplitudes that may act together, from the starts of an effect, smallest first.
pub(crate) fn acting_sets(effect: &dyn Effect, site: &Site) -> Vec<Vec<usize>> {
    let starts = 0..effect.starts(site).len();
    let mut sets: Vec<_> = starts.map(|k| effect.acting(site, k)).collect();
    sets.sort_by_key(Vec::len);
    sets
}

/// Checks the declaration of an effect and of its parameters at a site, as a diagnosis does before it begins.
///
/// The behavior of its compensators is not checked. For that, call `check_effect` of the crate `vsf-testkit` in a test.
///
/// # Errors
/// [`GapError::Model`] for invalid names, null gains, bounds, scales, joints, sequences or starts.
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
