use thiserror::Error;
use vsf_data::DataError;

/// Why a case could not be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WorldError {
    /// A name that no effect of this world has.
    #[error("no effect is called {name:?}; the names are those of EFFECTS and UNKNOWN_EFFECTS")]
    UnknownEffect {
        /// The name as given.
        name: String,
    },
    /// An effect that the kind of world cannot show.
    #[error("{effect} cannot be shown by a world of kind {kind}; take springs")]
    NotInThisWorld {
        /// Name of the effect.
        effect: String,
        /// Kind of the world.
        kind: &'static str,
    },
    /// No posture of the arm reaches a place on the object from outside.
    #[error("seed {seed}: the arm reaches no place on the object; take another seed")]
    OutOfReach {
        /// Seed of the case.
        seed: u64,
    },
    /// No strength of an effect gives the torque change asked for.
    #[error(
        "seed {seed}: {effect} changes the torques by {reached:.3} of their RMS at most, {wanted:.3} \
         were asked for; take another seed"
    )]
    TooWeak {
        /// Seed of the case.
        seed: u64,
        /// Name of the effect.
        effect: String,
        /// Share that was reached.
        reached: f64,
        /// Share that was asked for.
        wanted: f64,
    },
    /// The nodes of a body could not be searched.
    #[error("the nodes of the body cannot be searched: {problem}")]
    Search {
        /// Why.
        problem: String,
    },
    /// The recording was refused or could not be written.
    #[error(transparent)]
    Data(#[from] DataError),
}
