use thiserror::Error;
use vsf_core::CoreError;

/// Errors of the shapes and options that signed distance fields are made from.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ContactError {
    /// A shape or an option is out of range.
    #[error(transparent)]
    Core(#[from] CoreError),
    /// The shape of one collider cannot be used.
    #[error("collider {collider} (on link {link}): {source}")]
    Collider {
        /// Position in the list of colliders.
        collider: usize,
        /// The link that it is fixed to.
        link: usize,
        /// What is wrong with it.
        source: Box<ContactError>,
    },
    /// There is no closed form for this kind of shape.
    #[error("signed distances of a {shape} are not supported in closed form; bake it into a grid")]
    UnsupportedShape {
        /// The kind of shape.
        shape: &'static str,
    },
    /// A mesh has no extent: every face is degenerate.
    #[error("the mesh has no area: all of its {faces} faces are degenerate; check its units")]
    EmptyMesh {
        /// Number of faces.
        faces: usize,
    },
    /// A mesh is too small, or reaches too far from its origin, for accurate distances.
    #[error(
        "the mesh spans {extent:e} m and reaches {farthest:e} m from its origin; it must span at least \
         1e-6 m and reach no farther than 1e6 m: check its units and scale"
    )]
    MeshSize {
        /// Diagonal of its bounding box \[m\].
        extent: f64,
        /// Largest coordinate \[m\].
        farthest: f64,
    },
    /// A grid of the chosen resolution does not fit in memory.
    #[error(
        "a grid of spacing {resolution} m needs {nodes} nodes, more than the allowed {max}; \
         choose a coarser resolution or raise `max_nodes`, or check the units of the mesh"
    )]
    GridTooLarge {
        /// Spacing \[m\].
        resolution: f64,
        /// Number of nodes needed.
        nodes: u64,
        /// [`GridOptions::max_nodes`](crate::GridOptions::max_nodes).
        max: usize,
    },
}

impl From<ContactError> for CoreError {
    fn from(error: ContactError) -> Self {
        match error {
            ContactError::Core(core) => core,
            other => Self::other(other),
        }
    }
}
