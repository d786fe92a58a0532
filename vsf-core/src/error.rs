use std::error::Error;
use std::sync::Arc;
use thiserror::Error as ThisError;

/// What can be wrong with data handed to the shared types or to an implementation of a seam.
#[derive(Debug, Clone, PartialEq, ThisError)]
#[non_exhaustive]
pub enum CoreError {
    /// A number that must be finite is NaN or infinite.
    #[error("{what}[{index}] is {value}; every value must be finite")]
    NotFinite {
        /// The array, in the words of the caller.
        what: &'static str,
        /// Position in the array.
        index: usize,
        /// The offending value.
        value: f64,
    },
    /// Two arrays that belong together differ in length.
    #[error("{what} has length {got}, expected {expected}")]
    Length {
        /// The array, in the words of the caller.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length that fits the rest of the data.
        expected: usize,
    },
    /// Fewer elements than it takes.
    #[error("{got} {what}, at least {least} are needed")]
    TooFew {
        /// Of what.
        what: &'static str,
        /// How many there are.
        got: usize,
        /// How many it takes.
        least: usize,
    },
    /// An index points outside its array.
    #[error("{what} {index} is out of range, there are {len}")]
    OutOfRange {
        /// What the index counts.
        what: &'static str,
        /// The index.
        index: usize,
        /// Number of elements.
        len: usize,
    },
    /// An index occurs twice where each may once.
    #[error("{what} {index} occurs twice")]
    Repeated {
        /// What the index counts.
        what: &'static str,
        /// The index.
        index: usize,
    },
    /// Point indices of an observation or of contacts are not strictly increasing.
    #[error("point indices must be strictly increasing: index {index} follows {previous}")]
    Unordered {
        /// The earlier index.
        previous: usize,
        /// The index that is not larger.
        index: usize,
    },
    /// A rest point lies farther away than anything that a robot touches.
    #[error("rest point {index} has the coordinate {value:e} m, beyond 1e6 m; check units")]
    TooFar {
        /// Index of the point.
        index: usize,
        /// The coordinate.
        value: f64,
    },
    /// A parameter lies outside its range.
    #[error("{name} = {value:?} is out of range: {range}")]
    Parameter {
        /// Name of the parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The allowed range, in words.
        range: &'static str,
    },
    /// A matrix that must be symmetric positive definite is not.
    #[error(
        "{what} is not positive definite (pivot {pivot} is {value:e}); \
         check variances and noise for zeros, huge ratios or overflow"
    )]
    NotPositiveDefinite {
        /// The matrix, in the words of the caller.
        what: &'static str,
        /// Row at which the factorization failed.
        pivot: usize,
        /// The pivot found there.
        value: f64,
    },
    /// The result would not be finite in the numbers that are computed with.
    #[error("{what} would overflow: check units and scale of the inputs")]
    Overflow {
        /// The quantity that overflowed.
        what: &'static str,
    },
    /// An index structure cannot hold so many elements.
    #[error("{what}: {got} are more than the {max} that are supported")]
    TooMany {
        /// The collection.
        what: &'static str,
        /// Its size.
        got: usize,
        /// The largest supported size.
        max: usize,
    },
    /// Matrices for which the process gets no memory.
    #[error(
        "{what}: {got} need {:.1} GB at least, which this process does not get; take fewer points, a smaller contact \
         threshold or an estimator without correlations",
        *bytes as f64 / 1e9
    )]
    OutOfMemory {
        /// The collection.
        what: &'static str,
        /// Its size.
        got: usize,
        /// What it takes.
        bytes: usize,
    },
    /// A posture that no robot model has written yet: all of its links lie at the world origin.
    #[error("the posture was never written; let RobotModel::update_posture write it first")]
    UnwrittenPosture,
    /// A posture of another robot than the rest was made for: another number of joints or links, or other chains.
    #[error(
        "the posture belongs to another robot ({joints} joints, {links} links; expected are {expected_joints} joints and \
         {expected_links} links in the same chains): make it by RobotModel::posture of that robot"
    )]
    ForeignPosture {
        /// Joints of the posture.
        joints: usize,
        /// Links of the posture.
        links: usize,
        /// Joints of the robot.
        expected_joints: usize,
        /// Links of the robot.
        expected_links: usize,
    },
    /// An implementation of a seam cannot do what was asked; its state is unchanged.
    #[error("{what} is not supported by {by}")]
    Unsupported {
        /// What was asked for.
        what: &'static str,
        /// Type name of the implementation.
        by: &'static str,
    },
    /// An implementation of a seam failed for a reason of its own: [`CoreError::other`].
    #[error(transparent)]
    Other(OtherError),
}

/// An error of another crate, shared by the copies of a [`CoreError`]. Two are equal that say the same.
#[derive(Debug, Clone)]
pub struct OtherError(Arc<dyn Error + Send + Sync>);

impl OtherError {
    /// The error itself, to look at as what it is (`downcast_ref`).
    pub fn get(&self) -> &(dyn Error + Send + Sync + 'static) {
        &*self.0
    }
}

impl std::fmt::Display for OtherError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl Error for OtherError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.source()
    }
}

impl PartialEq for OtherError {
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}

impl CoreError {
    /// An error of an implementation's own, or its text.
    ///
    /// ```
    /// use vsf_core::CoreError;
    ///
    /// let error = CoreError::other("the gauge does not answer");
    /// assert_eq!(error.to_string(), "the gauge does not answer");
    /// let CoreError::Other(own) = CoreError::other(std::fmt::Error) else { unreachable!() };
    /// assert!(own.get().is::<std::fmt::Error>());
    /// ```
    pub fn other(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Other(OtherError(error.into().into()))
    }

    /// Checks that every value of `values` is finite.
    ///
    /// # Errors
    /// [`CoreError::NotFinite`] names the first offender.
    pub fn check_finite(what: &'static str, values: &[f64]) -> Result<(), Self> {
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(index) => Err(Self::NotFinite {
                what,
                index,
                value: values[index],
            }),
        }
    }

    /// Checks a length.
    ///
    /// # Errors
    /// [`CoreError::Length`] when `got != expected`.
    pub fn check_len(what: &'static str, got: usize, expected: usize) -> Result<(), Self> {
        if got == expected {
            Ok(())
        } else {
            Err(Self::Length {
                what,
                got,
                expected,
            })
        }
    }
}
