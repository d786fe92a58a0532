use crate::{CoreError, RestPoints};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// A triangle mesh: vertices in meters and faces as triples of vertex indices.
///
/// The mesh may be open: contact models tell inside from outside by the winding number. Clones
/// share vertices and faces.
#[derive(Debug, Clone, PartialEq)]
pub struct TriMesh {
    vertices: Arc<[Point3<f64>]>,
    faces: Arc<[[u32; 3]]>,
    source: Option<String>,
}

impl TriMesh {
    /// Creates a mesh from its vertices (m) and faces.
    ///
    /// # Errors
    /// A vertex that is not finite, a face index out of range, or a mesh without faces.
    pub fn new(vertices: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Result<Self, CoreError> {
        for (index, v) in vertices.iter().enumerate() {
            if let Some(&value) = v.iter().find(|c| !c.is_finite()) {
                return Err(CoreError::NotFinite {
                    what: "mesh vertices",
                    index,
                    value,
                });
            }
        }
        if faces.is_empty() {
            return Err(CoreError::TooFew {
                what: "mesh faces",
                got: 0,
                least: 1,
            });
        }
        for &i in faces.iter().flatten() {
            if i as usize >= vertices.len() {
                return Err(CoreError::OutOfRange {
                    what: "mesh face vertex",
                    index: i as usize,
                    len: vertices.len(),
                });
            }
        }
        Ok(Self {
            vertices: vertices.into(),
            faces: faces.into(),
            source: None,
        })
    }

    /// Sets the name of the file that the mesh comes from, for messages.
    #[must_use]
    pub fn with_source(self, source: impl Into<String>) -> Self {
        let source = Some(source.into());
        Self { source, ..self }
    }

    /// Name of the file that the mesh comes from, if it is known.
    pub fn source(&self) -> Option<&str> {
        self.source.as_deref()
    }

    /// Vertices (m).
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Faces, counter-clockwise when seen from outside.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }
}

/// The shape of a body in its own frame, centered on the origin.
///
/// Lengths are in meters, at most 1e6. Lengths that must be positive are at least 1e-9.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Shape {
    /// A ball.
    Sphere {
        /// Radius, > 0.
        radius: f64,
    },
    /// A capsule: a ball swept along a segment of the z axis.
    Capsule {
        /// Radius of the ball, > 0.
        radius: f64,
        /// Half the length of the segment, >= 0.
        half_length: f64,
    },
    /// A cone with round ends: a ball swept along a segment of the z axis while its radius changes
    /// linearly.
    RoundCone {
        /// Radius at `-half_length`, > 0.
        radius_bottom: f64,
        /// Radius at `+half_length`, > 0.
        radius_top: f64,
        /// Half the length of the segment, with `2 half_length > |radius_top - radius_bottom|`.
        half_length: f64,
    },
    /// A cylinder along z, optionally with rounded edges.
    Cylinder {
        /// Outer radius, > 0.
        radius: f64,
        /// Half the outer height, > 0.
        half_length: f64,
        /// Rounding radius of the edges, 0 for sharp ones; at most `radius` and `half_length`.
        rounding: f64,
    },
    /// A box, optionally with rounded edges.
    Box {
        /// Half the outer edge lengths, each > 0.
        half_extents: Vector3<f64>,
        /// Rounding radius of the edges, 0 for sharp ones; at most the smallest half extent.
        rounding: f64,
    },
    /// A triangle mesh. Its size is not checked here, but where distances to it are computed.
    Mesh(TriMesh),
}

/// Smallest radius or half extent of a body (m). Its square does not underflow.
const SMALLEST: f64 = 1e-9;

impl Shape {
    /// Checks that all lengths lie in the ranges documented at the variants.
    ///
    /// # Errors
    /// [`CoreError::Parameter`] names the first value out of range.
    pub fn check(&self) -> Result<(), CoreError> {
        fn check(
            name: &'static str,
            value: f64,
            ok: bool,
            range: &'static str,
        ) -> Result<(), CoreError> {
            if ok && value <= RestPoints::FARTHEST {
                Ok(())
            } else {
                Err(CoreError::Parameter { name, value, range })
            }
        }
        let positive = |name, v: f64| check(name, v, v >= SMALLEST, "1e-9 m to 1e6 m");
        match *self {
            Self::Sphere { radius } => positive("sphere radius", radius),
            Self::Capsule {
                radius,
                half_length,
            } => {
                positive("capsule radius", radius)?;
                check(
                    "capsule half length",
                    half_length,
                    half_length >= 0.0,
                    "0 m to 1e6 m",
                )
            }
            Self::RoundCone {
                radius_bottom,
                radius_top,
                half_length,
            } => {
                positive("round cone bottom radius", radius_bottom)?;
                positive("round cone top radius", radius_top)?;
                check(
                    "round cone half length",
                    half_length,
                    2.0 * half_length > (radius_top - radius_bottom).abs(),
                    "more than half the difference of the radii, up to 1e6 m",
                )
            }
            Self::Cylinder {
                radius,
                half_length,
                rounding,
            } => {
                positive("cylinder radius", radius)?;
                positive("cylinder half length", half_length)?;
                check(
                    "cylinder rounding",
                    rounding,
                    rounding >= 0.0 && rounding <= radius.min(half_length),
                    "between 0 and the smaller of radius and half length",
                )
            }
            Self::Box {
                half_extents,
                rounding,
            } => {
                for v in half_extents.iter() {
                    positive("box half extent", *v)?;
                }
                check(
                    "box rounding",
                    rounding,
                    rounding >= 0.0 && rounding <= half_extents.min(),
                    "between 0 and the smallest half extent",
                )
            }
            Self::Mesh(_) => Ok(()),
        }
    }
}

/// A collision shape fixed to a link of a robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Collider {
    /// Index of the link.
    pub link: usize,
    /// Pose of the shape in the link frame.
    pub X_LS: Isometry3<f64>,
    /// The shape.
    pub shape: Shape,
}
