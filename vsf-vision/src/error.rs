use thiserror::Error;
use vsf_core::CoreError;

/// What can be wrong with images, features, samples or models.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VisionError {
    /// Invalid numbers: not finite, out of range, or of another length.
    #[error(transparent)]
    Core(#[from] CoreError),
    /// A model was used before it was fitted.
    #[error("{by} has not been fitted; call `fit` first")]
    NotFitted {
        /// Type of the model.
        by: &'static str,
    },
    /// Features other than those that a model was fitted on.
    #[error("the model was fitted on the features {expected:?}, these are {got:?}")]
    Features {
        /// Names of the columns it was fitted on.
        expected: Vec<String>,
        /// Names of the columns given.
        got: Vec<String>,
    },
    /// Two features have the same name.
    #[error("two features are named {name:?}")]
    Duplicate {
        /// The name.
        name: String,
    },
    /// The touched points are not where the camera sees the object.
    #[error(
        "camera/: of the {touched} touched points {seen} lie on or shortly behind the surface that is seen, at \
         least 2 are needed; check world_from_camera, depth_scale and the images, and that the field is of this \
         recording"
    )]
    Unseen {
        /// Number of touched points.
        touched: usize,
        /// Number of those at which the object is probably seen.
        seen: usize,
    },
    /// Touched points are seen, but the readings say next to nothing about them.
    #[error(
        "of {told} of the touched points in sight the readings tell anything, at least 2 are needed: touches are too \
         light for their noise, or the prior is too sure"
    )]
    Untold {
        /// Number of points about which the readings say something.
        told: usize,
    },
    /// The text is not a learned prior.
    #[error("not a learned prior in JSON: {problem}")]
    Json {
        /// What is wrong, and where in the text.
        problem: String,
    },
}

impl VisionError {
    /// Whether touched points in sight are too few, or say too little, to predict other points from. Only
    /// the touches themselves can then be used.
    pub fn is_blind(&self) -> bool {
        matches!(self, Self::Unseen { .. } | Self::Untold { .. })
    }
}
