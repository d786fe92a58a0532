//! Diagnosis of the sim-to-real gap: *where* it lies, *which* unmodeled effect causes it, *how far*
//! it closes once that effect is added, checked on sequences that no model was fitted to. What is named has to stand
//! that check, so that the share that a named effect closes is a little optimistic.
//!
//! The nominal model of a recording is `tau = W K`: contacts give the columns `W`, the stiffness `K`
//! is estimated (of an arm in free air, the rigid body alone). An [`Effect`] changes it to
//! `tau = G W K + a` with other contacts, springs `W`, gains `G` and torques `a`, by parameters
//! `theta` that are zero in the nominal model. A field with a stiffness per point absorbs much of what
//! effects do, so that they are judged by what it cannot absorb:
//!
//! 1. Readings are averaged over windows, of long recordings with contact over short ones from all
//!    over them. Noise comes from differences of neighboring samples, second ones as a rule.
//! 2. The readings are Gaussian with the covariance of noise, of the stiffness (single points, a part
//!    that is smooth over 4 cm, a common level) and of the model's own roughness (of forces at the
//!    contact and the place where they act, of joints, of effects that wander). The stiffness is integrated out.
//! 3. **Screening**: the evidence with every effect, linear in its amplitudes, whose prior is an effect
//!    of 30 % of the torque. Roughness is averaged over, so that an effect must explain better than
//!    "something rough acts here".
//! 4. **Finalists** are fitted together with the field by Gauss-Newton steps on the evidence, contacts
//!    simulated anew, from several starts where an effect moves surfaces. Those that explain much get a
//!    spread of the stiffness of their own: that of the nominal model makes up for what it lacks.
//! 5. A second effect is added if it earns its place, and the first is kept only if the second does
//!    not do as well alone. A third and a fourth may follow, if none before can be spared. With contact, too, others that
//!    explain nearly as much as the first are tried in its place.
//! 6. **Verdict**: evidence beyond what the effect gains where nothing acts, as probabilities. The test sequences have a
//!    veto: given the train sequences, which leave its parameters uncertain, an effect may not make them less likely, and it
//!    may predict them worse only with twice the evidence that it needs, one that chooses other contacts not at all.
//!    Something rough that no effect explains, or that remains in free motion where no effect closes half of the gap, is *unknown*, and so is a cause whose
//!    model leaves innovations that are not white, and one beside sensors that look saturated; several effects that fit alike are *not diagnosable*, and
//!    so is one that with a single stiffness everywhere explains what the field shows, as stiffening does of
//!    an object that grows stiff with depth.
//! 7. **How far** is measured on the test sequences, with field and effect fitted to train; where something is touched, with
//!    fields as one estimates them outside of a diagnosis, with the effect and without. A corrected model that predicts
//!    them worse is not given out.
//! 8. What differs from sequence to sequence, as the place of an object that is put back, shows where
//!    sequences touch the same places and cannot be known of others: if nothing else explains most of the gap,
//!    it is fitted with the first half of every test sequence, and checked on the second halves.
//!
//! [`diagnose`] runs all of it. Time is dominated by the contact that effects change, some hundred runs
//! over the train sequences, some ten over the test sequences, and by some hundred factorizations of some 1300 rows, twice as many at most.
//! Couplings of joints take columns that grow with the square of their number.
//!
//! Rejected: choosing by the fit's error. On recordings without effect the best wrong effect fits much
//! better and predicts worse.
//!
//! # Reference
//! M. C. Kennedy, A. O'Hagan, "Bayesian calibration of computer models", J. R. Stat. Soc. B 63(3),
//! 2001, doi:10.1111/1467-9868.00294, for the model's own roughness beside the parameters.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod alike;
mod base;
mod bootstrap;
mod campaign;
mod closure;
mod contact;
mod corrected;
mod design;
mod diagnose;
mod doubts;
mod effect;
pub mod effects;
mod enough;
mod error;
mod estimated;
mod evidence;
mod fitted;
mod gauge;
mod halves;
mod judge;
mod known_contacts;
mod lever;
mod limits;
mod links;
mod live;
mod locate;
mod model;
mod model_file;
mod model_terms;
mod motion;
mod next;
mod noise;
mod notes;
mod online;
mod oscillation;
mod outliers;
mod phase;
mod plain;
mod predictive;
mod refine;
mod report;
mod report_file;
mod response;
mod rival;
mod rounding;
mod saturation;
mod screen;
mod search;
mod sets;
mod spread_search;
mod start;
mod trial;
mod verdict;
mod windows;

pub use campaign::Campaign;
pub use closure::Residuals;
pub use contact::{ContactLog, center};
pub use corrected::Corrected;
pub use diagnose::{DiagnosisStep, diagnose};
pub use effect::{
    Acts, Compensator, Effect, Need, Parameter, Probe, RandomWalk, Role, Sample, Site, Touch,
    check_declaration,
};
pub use error::GapError;
pub use estimated::Estimated;
pub use limits::Limit;
pub use live::LiveCorrector;
pub use locate::{LocatedShare, Location, Place, Region};
pub use model::Model;
pub use model_file::{EffectEntry, ModelFile};
pub use model_terms::ModelTerms;
pub use motion::Motion;
pub use next::NextExperiment;
pub use noise::JointNoise;
pub use online::{Corrector, JointState};
pub use phase::Phase;
pub use report::{
    Diagnosis, EffectReport, Gap, MeanErrors, Outcome, ParameterEstimate, Roughness,
    STIFFNESS_FIELD,
};
pub use verdict::{Verdict, VerdictKind};
