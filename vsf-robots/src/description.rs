use crate::{JointKind, JointLimits};
use nalgebra::{Isometry3, Matrix3, Vector3};
use vsf_core::Shape;

/// A robot as described by its maker: unordered and unchecked. `RobotModel::assemble` makes a model
/// of it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Description {
    pub name: String,
    pub links: Vec<LinkDescription>,
    pub joints: Vec<JointDescription>,
    /// What was not understood.
    pub unread: Vec<String>,
}

#[derive(Debug, Clone)]
pub(crate) struct LinkDescription {
    pub name: String,
    pub mass: f64,
    /// Inertial frame I in the link: its origin is the center of mass.
    pub X_LI: Isometry3<f64>,
    /// Rotational inertia about the center of mass, in the axes of I.
    pub inertia_I: Matrix3<f64>,
    /// Collision shapes with their poses in the link frame.
    pub shapes: Vec<(Isometry3<f64>, Shape)>,
}

impl LinkDescription {
    /// A link without mass and shapes.
    pub fn frame(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            mass: 0.0,
            X_LI: Isometry3::identity(),
            inertia_I: Matrix3::zeros(),
            shapes: Vec::new(),
        }
    }
}

#[derive(Debug, Clone)]
pub(crate) struct JointDescription {
    pub name: String,
    /// `None` for a fixed joint.
    pub kind: Option<JointKind>,
    pub parent: String,
    pub child: String,
    /// Joint frame, which is the child's frame at zero position, in the parent link.
    pub X_PJ: Isometry3<f64>,
    /// In the joint frame, of any length but zero.
    pub axis_J: Vector3<f64>,
    pub limits: JointLimits,
}
