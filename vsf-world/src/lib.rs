//! An independent simulated world that generates labeled recordings.
//!
//! A Kinova Gen3 pushes into a soft object while one effect, two or none disturb what is recorded. From each [`CaseSpec`],
//! [`generate`] makes a recording without a hint of the cause, and a [`Label`] with the ground truth. They serve to test
//! anything that claims to find the cause.
//!
//! ```no_run
//! # fn main() -> Result<(), vsf_world::WorldError> {
//! for (i, spec) in vsf_world::draw_cases(20, 1).iter().enumerate() {
//!     let label = vsf_world::generate(spec, format!("case_{i:03}").as_ref())?;
//!     println!("{i}: {:?}, changes the torques by {:.2}", spec.effects, label.ratio_test);
//! }
//! # Ok(())
//! # }
//! ```
//!
//! It shares no code with the models that it tests: it has its own kinematics, its own contact, and its own forms of every
//! effect, which differ from those of textbooks. A model that is tested on data of its own making proves nothing.
//!
//! There are two kinds of objects ([`Kind`]): a soft body of irregular nodes on springs, tied to their neighbors, and
//! plants of rigid segments on torsional springs. Plants have an inherent damping of 20 ms, bodies have none. A session has
//! six sequences, which begin 20 s apart, although the time stamps of each begin at zero. The first four are for training,
//! the last two for test. They touch two places in turn, each time in another posture.
//!
//! On cases without effect, a plain stiffness field estimated by `vsf estimate` leaves about a tenth of the torques of the
//! test sequences for bodies, and a third for plants.
//!
//! Rejected: a rigid-body engine. It would be a dependency larger than this workspace, for a motion that is quasi-static.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod arm;
mod body;
mod case;
mod effect;
mod effect_draw;
mod effect_scale;
mod error;
mod gen3;
mod generate;
mod label;
mod material;
mod motion;
mod nodes;
mod object;
mod plant;
mod plant_contact;
mod reach;
mod sensor;
mod session;
mod springs;
mod strength;
#[cfg(test)]
mod tests;

pub use arm::{Arm, JOINTS, JointVector, Touch};
pub use case::{CaseSpec, Class, Kind, Level, draw_cases};
pub use effect::{EFFECTS, Effect, UNKNOWN_EFFECTS};
pub use error::WorldError;
pub use generate::{MAKER, generate};
pub use label::{AppliedEffect, Label, TruthShare};
pub use motion::{Phase, Protocol, RATE_HZ, SAMPLES, SEQUENCES, SESSION_STEP_S};
