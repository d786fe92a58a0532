//! Diagnosis of the sim-to-real gap: *where* it lies, *which* unmodeled effect causes it, and *how far* it closes once that
//! effect is in the model.
//!
//! How far the gap closes is measured on sequences that no model was fitted to. An effect is named only if it passes a check
//! on the same sequences, so the share that it closes is slightly optimistic.
//!
//! The nominal model of a recording is `tau = W K`. Contacts give the columns `W`, and the stiffness `K` is estimated. (For
//! an arm in free air, the nominal model is the rigid body alone.) An [`Effect`] changes it to `tau = G W K + a`, with
//! other contacts, springs `W`, gains `G` and torques `a`. Its parameters `theta` are zero in the nominal model. A field
//! with one stiffness per point absorbs much of what effects do, so effects are judged by what it cannot absorb:
//!
//! 1. Readings are averaged over windows. In long recordings with contact, the windows are short and spread over the whole
//!    recording. The noise is estimated from differences of neighboring samples, usually second differences.
//! 2. The readings are modeled as Gaussian. Their covariance is that of the noise, of the stiffness (single points, a part
//!    that is smooth over 4 cm, a common level) and of the model's own roughness (errors of the contact force and of the
//!    place where it acts, of joints, of effects that wander). The stiffness is integrated out.
//! 3. **Screening** computes the log evidence with every effect, linear in its amplitudes, under a prior in which the
//!    effect is 30 % of the torque. Roughness is averaged over, so an effect must explain more than "something rough acts
//!    here".
//! 4. **Finalists** are fitted together with the field by Gauss-Newton steps on the evidence, with contacts simulated anew.
//!    Effects that move surfaces are started from several points. Models that explain much get a stiffness spread of their
//!    own, since the spread of the nominal model makes up for what that model lacks.
//! 5. A second effect is added if it earns its place, and the first is kept only if the second does not do as well alone. A
//!    third and a fourth may follow, as long as none of the earlier ones can be spared. With contact, other effects that
//!    explain nearly as much as the first are tried in its place.
//! 6. **Verdict**: the evidence beyond what an effect gains where nothing acts is turned into probabilities. The test
//!    sequences have a veto. Given the train sequences, which leave its parameters uncertain, an effect may not make the
//!    test sequences less likely. It may predict them worse only with twice the evidence that it needs; an effect that
//!    chooses other contacts may not predict them worse at all. The cause is *unknown* if something rough is left that no
//!    effect explains, if roughness remains in free motion and no effect closes half of the gap, if the model of the cause
//!    leaves innovations that are not white, or if sensors look saturated. The cause is *not diagnosable* if several
//!    effects fit alike, or if an effect with one stiffness everywhere explains what the field shows, as stiffening does
//!    for an object that grows stiff with depth.
//! 7. **How far** is measured on the test sequences, with field and effect fitted to the train sequences. Where something
//!    is touched, the fields are those that one estimates outside of a diagnosis, with and without the effect. A corrected
//!    model that predicts the test sequences worse is not returned.
//! 8. What differs from sequence to sequence, such as the place of an object that is put back, shows where sequences touch
//!    the same places, and cannot be known for other sequences. If nothing else explains most of the gap, it is fitted with
//!    the first half of every test sequence and checked on the second halves.
//!
//! [`diagnose`] runs all of it. Most of the time goes into the contacts that effects change (some hundred runs over the
//! train sequences, some ten over the test sequences) and into some hundred factorizations of some 1300 rows, at most twice
//! as many. Couplings of joints take columns that grow with the square of the number of joints.
//!
//! Rejected: choosing by the error of the fit. On recordings without an effect, the best wrong effect fits much better and
//! predicts worse.
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
