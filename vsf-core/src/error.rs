use std::error::Error;
use std::sync::Arc;
use thiserror::Error as ThisError;

/// Errors of the shared types and of implementations of this crate's traits.
#[derive(Debug, Clone, PartialEq, ThisError)]
#[non_exhaustive]
pub enum CoreError {
    /// A number that must be finite is NaN or infinite.
    #[error("{what}[{index}] is {value}; every value must be finite")]
    NotFinite {
        /// The array, as the caller calls it.
        what: &'static str,
        /// Position in the array.
        index: usize,
        /// The offending value.
        value: f64,
    },
    /// Two arrays that belong together differ in length.
    #[error("{what} has length {got}, expected {expected}")]
    Length {
        /// The array, as the caller calls it.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length that fits the rest of the data.
        expected: usize,
    },
    /// There are fewer elements than needed.
    #[error("{got} {what}, at least {least} are needed")]
    TooFew {
        /// What the elements are.
        what: &'static str,
        /// How many there are.
        got: usize,
        /// How many are needed.
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
    /// An index occurs twice where each may occur only once.
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
    /// A rest point lies farther away than anything a robot can touch.
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
        /// The matrix, as the caller calls it.
        what: &'static str,
        /// Row at which the factorization failed.
        pivot: usize,
        /// The pivot found there.
        value: f64,
    },
    /// A result would not be finite in the number type used.
    #[error("{what} would overflow: check units and scale of the inputs")]
    Overflow {
        /// The quantity that overflowed.
        what: &'static str,
    },
    /// There are more elements than supported.
    #[error("{what}: {got} are more than the {max} that are supported")]
    TooMany {
        /// The collection.
        what: &'static str,
        /// Its size.
        got: usize,
        /// The largest supported size.
        max: usize,
    },
    /// The process cannot get the memory for some matrices.
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
        /// Memory needed, in bytes.
        bytes: usize,
    },
    /// No robot model has written the posture yet: all of its links lie at the world origin.
    #[error("the posture was never written; let RobotModel::update_posture write it first")]
    UnwrittenPosture,
    /// The posture belongs to another robot: the number of joints or links differs, or the chains differ.
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
    /// An implementation of one of the traits does not support the request; its state is unchanged.
    #[error("{what} is not supported by {by}")]
    Unsupported {
        /// What was asked for.
        what: &'static str,
        /// Type name of the implementation.
        by: &'static str,
    },
    /// An implementation of one of the traits failed for a reason of its own, see [`CoreError::other`].
    #[error(transparent)]
    Other(OtherError),
}

/// An error from outside this crate. Clones share it. Two errors are equal if their messages are.
#[derive(Debug, Clone)]
pub struct OtherError(Arc<dyn Error + Send + Sync>);

impl OtherError {
    /// The error itself, for example to downcast it with `downcast_ref`.
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
    /// Wraps an implementation's own error, or an error message.
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
    /// [`CoreError::NotFinite`] names the first value that is not.
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

    /// Checks that a length is as expected.
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
