use thiserror::Error;
use vsf_core::CoreError;

/// What can be wrong with images, features, samples and models.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VisionError {
    /// Numbers that do not fit: not finite, out of range, of another length.
    #[error(transparent)]
    Core(#[from] CoreError),
    /// A model is asked before it has learned.
    #[error("{by} has not been fitted; call `fit` first")]
    NotFitted {
        /// The type.
        by: &'static str,
    },
    /// Features that a model has not learned from.
    #[error("the model was fitted on the features {expected:?}, these are {got:?}")]
    Features {
        /// Names of the columns it was fitted on.
        expected: Vec<String>,
        /// Names of the columns given.
        got: Vec<String>,
    },
    /// Two features of the same name.
    #[error("two features are named {name:?}")]
    Duplicate {
        /// The name.
        name: String,
    },
    /// What is touched is not what the camera sees.
    #[error(
        "camera/: of the {touched} touched points {seen} lie on or shortly behind the surface that is seen, at \
         least 2 are needed; check world_from_camera, depth_scale and the images, and that the field is of this \
         recording"
    )]
    Unseen {
        /// Touched points.
        touched: usize,
        /// Those where something is probably seen.
        seen: usize,
    },
    /// What is touched is seen, but the readings tell next to nothing of it.
    #[error(
        "of {told} of the touched points in sight the readings tell anything, at least 2 are needed: touches are too \
         light for their noise, or the prior is too sure"
    )]
    Untold {
        /// Those of which they do.
        told: usize,
    },
    /// A text that is no learned prior.
    #[error("not a learned prior in JSON: {problem}")]
    Json {
        /// What is wrong, and where in the text.
        problem: String,
    },
}

impl VisionError {
    /// Whether touched points in sight are too few, or tell too little, to guess others from: touch alone is left.
    pub fn is_blind(&self) -> bool {
        matches!(self, Self::Unseen { .. } | Self::Untold { .. })
    }
}
