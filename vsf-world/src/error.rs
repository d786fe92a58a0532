use thiserror::Error;
use vsf_data::DataError;

/// Why a case could not be generated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WorldError {
    /// A name that is not an effect of this world.
    #[error("no effect is called {name:?}; the names are those of EFFECTS and UNKNOWN_EFFECTS")]
    UnknownEffect {
        /// The given name.
        name: String,
    },
    /// An effect that this kind of world cannot show.
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
    /// No strength of an effect gives the requested torque change.
    #[error(
        "seed {seed}: {effect} changes the torques by {reached:.3} of their RMS at most, {wanted:.3} \
         were asked for; take another seed"
    )]
    TooWeak {
        /// Seed of the case.
        seed: u64,
        /// Name of the effect.
        effect: String,
        /// Largest share that was reached.
        reached: f64,
        /// Requested share.
        wanted: f64,
    },
    /// The search for neighbors among the nodes of a body failed.
    #[error("the nodes of the body cannot be searched: {problem}")]
    Search {
        /// The reason.
        problem: String,
    },
    /// The recording was refused or could not be written.
    #[error(transparent)]
    Data(#[from] DataError),
}
