//! Turns a touch recording, or a stream of joint states, into a stiffness field and its prediction errors.
//!
//! The steps that the `vsf` command runs:
//!
//! 1. [`Scene::open`] combines robot, link shapes and rest points of a recording.
//! 2. Checks report what looks wrong. [`scene_warnings`], [`motion_warnings`], [`touch_warnings`],
//!    [`reading_warnings`] and [`view_warnings`] check a recording, [`health_warnings`] an online
//!    estimation, [`fit_warnings`] an estimation from all readings at once, and [`field_warnings`] either.
//! 3. [`Scene::trace`] runs the contact model over a sequence once. Contacts never depend on the belief, so
//!    the resulting observations serve every estimator.
//! 4. [`choose_hyper`] chooses prior and noise from the train sequences, [`choose_contact`] the contact
//!    model too. [`estimate`] runs an estimator over the sequences; [`estimate_with_vision`] also predicts
//!    untouched points from a camera image. [`Estimate::to_field`] stores the field, [`StoredEstimate::of`]
//!    reads it back.
//! 5. [`predict`] and [`evaluate`] compare a field with sequences. [`Baseline`]s are for comparison.
//! 6. An [`Experiment`] repeats the experiments of the paper on a recording: [`table1`],
//!    [`Experiment::errors`], [`Experiment::curve`], [`update_speed`].
//! 7. [`stiff_regions`] finds regions of a field that are stiffer than the rest.
//! 8. [`simulate`] turns a field and a joint trajectory into readings.
//! 9. A [`live::Node`] estimates while samples arrive.

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod approach;
mod baseline;
mod bench;
mod error;
mod estimate;
mod evaluate;
mod experiment;
mod hyper;
pub mod live;
mod memory;
mod paper;
mod priors;
mod readings;
mod regions;
mod robot;
mod scene;
mod scene_contact;
mod simulate;
mod soak;
mod stored;
mod table1;
mod trace;
mod vision;
mod warning;

pub use approach::Approach;
pub use baseline::{Baseline, MlpConfig};
pub use bench::{BenchOptions, BenchReport, LOADED_STEPS, Loaded, StageTimes, bench};
pub use error::PipelineError;
pub use estimate::{
    Estimate, EstimatorSpec, FilterSpec, estimate, estimate_from, estimate_online, estimate_with,
};
pub use evaluate::{
    Calibration, Evaluation, JointError, SequenceError, SequencePrediction, evaluate, predict,
    score,
};
pub use experiment::Experiment;
pub use hyper::{
    Candidate, ContactChoice, Hyper, HyperChoice, HyperMethod, PriorShape, choose_contact,
    choose_hyper, closer_thresholds,
};
pub use memory::ProcessMemory;
pub use paper::{
    Method, MethodErrors, Overlap, OverlapShares, Spread, TrainedOn, UpdateSpeed, UpdateTime,
    UpdateTimes, update_speed, update_times,
};
pub use priors::{PriorRow, compare_priors};
pub use readings::{
    check_readable, check_torques, derivatives_of, external_torques, rigid_body_torques, unwound,
};
pub use regions::{RegionOptions, StiffRegion, StiffRegions, stiff_regions};
pub use robot::{load_robot, reading_unit, robot_of};
pub use scene::{LEAST_THRESHOLD, Scene, SceneOptions};
pub use scene_contact::SceneContact;
pub use simulate::{add_noise, simulate};
pub use soak::{SoakOptions, SoakReport, SoakTenth, soak};
pub use stored::StoredEstimate;
pub use table1::{Table1Cell, Table1Row, table1};
pub use trace::Trace;
pub use vision::{VisionCandidate, VisionEstimate, VisionSpec, estimate_with_vision, rgbd_view};
pub use warning::{
    Outliers, PipelineWarning, Saturation, field_warnings, fit_warnings, health_warnings,
    motion_warnings, reading_warnings, saturated_joints, scene_warnings, touch_warnings,
    view_warnings,
};
