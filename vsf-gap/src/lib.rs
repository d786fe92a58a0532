//! Diagnosis of the sim-to-real gap: where it lies, which unmodelled effect causes it, how far it
//! closes.

#![forbid(unsafe_code)]

mod campaign;
mod corrected;
mod diagnose;
mod locate;
mod next;
mod verdict;
mod closure;
mod effect;
pub mod effects;
mod error;
mod forward;

pub use campaign::{Campaign, Motion};
pub use effect::{Acts, Compensator, Effect, Need, Parameter, Role, Sample, Site, Touch};
pub use error::GapError;
pub use model_file::{EffectEntry, ModelFile};
pub use online::Corrector;
pub use corrected::Corrected;
pub use forward::{ContactLog, Model, Prediction, centre, velocity_columns};
mod evidence;
mod nominal;
mod model_file;
mod noise;
mod online;
mod phase;
mod refine;
mod response;
mod screen;
mod windows;
pub use evidence::*;
pub use nominal::*;
pub use noise::*;
pub use phase::*;
pub use closure::*;
pub use diagnose::*;
pub use locate::*;
pub use next::*;
pub use verdict::{Kind, Verdict};
pub use refine::*;
pub use screen::*;
pub use windows::*;
