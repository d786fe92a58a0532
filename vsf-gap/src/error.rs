use thiserror::Error;
use vsf_core::CoreError;
use vsf_data::DataError;
use vsf_pipeline::PipelineError;
use vsf_robots::RobotError;

/// Error of a diagnosis.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GapError {
    /// A number of parameters that does not fit the effect.
    #[error("effect {effect} takes {expected} parameters, got {got}")]
    Parameters {
        /// Name of the effect.
        effect: String,
        /// Parameters given.
        got: usize,
        /// Parameters it has.
        expected: usize,
    },
    /// A parameter that is NaN or infinite.
    #[error("effect {effect}: parameter {index} is {value}")]
    NotFinite {
        /// Name of the effect.
        effect: String,
        /// Index of the parameter, from 0.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// An effect name that is not in the catalogue.
    #[error("no effect {name:?}; there are {known}")]
    UnknownEffect {
        /// The name given.
        name: String,
        /// The known names.
        known: String,
    },
    /// A parameter that an effect does not have or that is missing from a model, or an effect whose own parameters or
    /// starts are invalid.
    #[error("effect {effect}: {problem}")]
    Model {
        /// Name of the effect.
        effect: String,
        /// What is wrong.
        problem: String,
    },
    /// A file that is not a corrected model, or the model of another robot.
    #[error("corrected model: {0}")]
    ModelFile(String),
    /// A file that is not a diagnosis, or one with impossible numbers.
    #[error("{0}")]
    Report(String),
    /// Too little data for a diagnosis.
    #[error("{what}: {problem}")]
    TooLittle {
        /// What is too little.
        what: &'static str,
        /// How much there is, and what to do.
        problem: String,
    },
    /// More than a diagnosis can handle.
    #[error("{what}: {problem}")]
    TooMuch {
        /// What is too much.
        what: &'static str,
        /// How much there is, and what to do.
        problem: String,
    },
    /// A scene and a site of different campaigns.
    #[error("the scene has other {what} than the site; take both from one campaign")]
    OtherScene {
        /// What differs.
        what: &'static str,
    },
    /// A sample whose time is not after that of the previous one.
    #[error(
        "the clock goes on by {dt:?} s; within a touch it has to increase, begin a touch after a gap"
    )]
    TimeBackwards {
        /// The time step (s).
        dt: f64,
    },
    /// A sequence that is not part of the campaign's session.
    #[error(
        "sequence {id:?} is no part of the session; take those of Campaign::session or parts of them"
    )]
    UnknownSequence {
        /// Its ID.
        id: String,
    },
    /// Robot, scene or contact.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// Estimation.
    #[error(transparent)]
    Core(#[from] CoreError),
    /// The robot model.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The recording.
    #[error(transparent)]
    Data(#[from] DataError),
}
