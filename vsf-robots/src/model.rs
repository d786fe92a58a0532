use crate::RobotError;
use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};
use std::f64::consts::TAU;
use std::sync::Arc;
use vsf_core::{Collider, LinkChains, RestPoints};

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis, within limits; position in rad, effort in N m.
    Revolute,
    /// Turns about its axis without position limits.
    Continuous,
    /// Slides along its axis; position in m, effort in N.
    Prismatic,
}

/// Limits of a joint as stated by the robot's maker. They are for information: the model enforces none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Lower position limit (rad or m); minus infinity where neither is stated, 0 where only the upper one is.
    pub lower: f64,
    /// Upper position limit (rad or m); infinity where neither is stated, 0 where only the lower one is.
    pub upper: f64,
    /// Largest torque or force (N m or N); infinity where none is stated.
    pub effort: f64,
    /// Largest speed (rad/s or m/s); infinity where none is stated.
    pub velocity: f64,
}

impl JointLimits {
    /// No limits.
    pub const NONE: Self = Self {
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
        effort: f64::INFINITY,
        velocity: f64::INFINITY,
    };
}

/// A moving joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    pub(crate) name: String,
    pub(crate) kind: JointKind,
    pub(crate) child: usize,
    pub(crate) limits: JointLimits,
}

impl Joint {
    /// Name of the joint.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// How the joint moves.
    pub fn kind(&self) -> JointKind {
        self.kind
    }

    /// Index of the child link.
    pub fn child(&self) -> usize {
        self.child
    }

    /// Limits of the joint.
    pub fn limits(&self) -> &JointLimits {
        &self.limits
    }

    /// Change of the joint's position from one value to another (rad or m).
    ///
    /// For a continuous joint whole turns do not count: the change is within half a turn.
    pub fn change(&self, from: f64, to: f64) -> f64 {
        let change = to - from;
        match self.kind {
            JointKind::Continuous => change - TAU * (change / TAU).round(),
            JointKind::Revolute | JointKind::Prismatic => change,
        }
    }
}

/// How a link moves relative to its parent; `joint` is the index of the joint.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Motion {
    Fixed,
    Revolute {
        joint: usize,
        axis_J: Unit<Vector3<f64>>,
    },
    Prismatic {
        joint: usize,
        axis_J: Unit<Vector3<f64>>,
    },
}

impl Motion {
    pub fn joint(&self) -> Option<usize> {
        match *self {
            Self::Fixed => None,
            Self::Revolute { joint, .. } | Self::Prismatic { joint, .. } => Some(joint),
        }
    }
}

/// A rigid body of the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    pub(crate) X_PJ: Isometry3<f64>,
    pub(crate) motion: Motion,
    pub(crate) mass: f64,
    pub(crate) com_L: Point3<f64>,
    /// About the center of mass, in the axes of the link.
    pub(crate) inertia_L: Matrix3<f64>,
}

impl Link {
    /// Name of the link.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Index of the parent link, smaller than the link's own; `None` for the root.
    pub fn parent(&self) -> Option<usize> {
        self.parent
    }

    /// Mass (kg), 0 if the description gives none.
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// Center of mass (m) in the link frame.
    pub fn com_L(&self) -> &Point3<f64> {
        &self.com_L
    }
}

/// A robot placed in the world: a tree of rigid links, connected by joints with at most one coordinate each.
///
/// The model is immutable and `Sync`; the state lies in buffers of the caller. Links are in
/// depth-first order, so that a parent precedes its children. The [crate documentation](crate) describes
/// the order of joints.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotModel {
    pub(crate) name: String,
    pub(crate) links: Vec<Link>,
    pub(crate) joints: Vec<Joint>,
    pub(crate) colliders: Vec<Collider>,
    pub(crate) chains: Arc<LinkChains>,
    pub(crate) X_WB: Isometry3<f64>,
    pub(crate) unread: Vec<String>,
}

impl RobotModel {
    /// Name of the robot.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Unknown elements and attributes of the URDF's links and joints, which have no effect.
    ///
    /// Each is given with its line, up to the first 100. Names with a prefix are not checked, nor is the content of visuals
    /// and extensions.
    pub fn unread(&self) -> &[String] {
        &self.unread
    }

    /// Number of moving joints, `d`.
    pub fn joint_count(&self) -> usize {
        self.joints.len()
    }

    /// Moving joints, in the order of joint vectors. Fixed joints are not included.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Number of links, including those behind fixed joints.
    pub fn link_count(&self) -> usize {
        self.links.len()
    }

    /// Links, in depth-first order from the root.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// Index of the link called `name`.
    ///
    /// # Errors
    /// [`RobotError::UnknownLink`] lists the existing names.
    pub fn link_index(&self, name: &str) -> Result<usize, RobotError> {
        self.links
            .iter()
            .position(|l| l.name == name)
            .ok_or_else(|| RobotError::UnknownLink {
                name: name.to_owned(),
                known: self.links.iter().map(|l| l.name.clone()).collect(),
            })
    }

    /// Index of the moving joint called `name`.
    ///
    /// # Errors
    /// [`RobotError::UnknownJoint`] lists the existing names.
    pub fn joint_index(&self, name: &str) -> Result<usize, RobotError> {
        self.joints
            .iter()
            .position(|j| j.name == name)
            .ok_or_else(|| RobotError::UnknownJoint {
                name: name.to_owned(),
                known: self.joints.iter().map(|j| j.name.clone()).collect(),
            })
    }

    /// Index of the link that is moved by most joints, the last one if there are several.
    ///
    /// This is the end effector of an arm, whatever the order of its joints.
    pub fn end_effector(&self) -> usize {
        let links = 0..self.links.len();
        links
            .max_by_key(|&l| self.chains.chain(l).len())
            .unwrap_or(0)
    }

    /// Index of the last joint that moves the [end effector](Self::end_effector); `None` without moving joints.
    pub fn last_joint(&self) -> Option<usize> {
        let chain = self.chains.chain(self.end_effector());
        chain.last().map(|j| *j as usize)
    }

    /// Index of the child link of the [last joint](Self::last_joint); 0, the root link, if no joint moves.
    pub fn last_link(&self) -> usize {
        self.last_joint().map_or(0, |j| self.joints[j].child())
    }

    /// Collision shapes, grouped by link in the order of links.
    ///
    /// A `<cylinder>` with a `<sphere>` of its radius at each end (to 1 um) becomes one
    /// [`vsf_core::Shape::Capsule`].
    pub fn colliders(&self) -> &[Collider] {
        &self.colliders
    }

    /// Which joints move which link.
    pub fn chains(&self) -> &Arc<LinkChains> {
        &self.chains
    }

    /// Moving links without mass, in link order. Dynamics treat them as massless.
    ///
    /// A URDF link without `<inertial>` has mass 0, which is right for a tool frame and wrong for a body.
    /// If this list contains a body, torques computed by the model lack its weight.
    pub fn links_without_inertia(&self) -> impl Iterator<Item = &Link> {
        self.links
            .iter()
            .enumerate()
            .filter(|(l, link)| link.mass == 0.0 && !self.chains.chain(*l).is_empty())
            .map(|(_, link)| link)
    }

    /// Links whose inertia is physically impossible, in link order.
    ///
    /// One principal moment is larger than the sum of the other two, by more than 2 % to allow for rounded numbers. The
    /// URDF is then likely wrong. Dynamics use the inertia as it is, so computed torques are off in fast motion.
    pub fn links_with_impossible_inertia(&self) -> impl Iterator<Item = &Link> {
        self.links.iter().filter(|link| {
            let inertia = &link.inertia_L;
            // Scaled to 1, so that the eigenvalue iteration stays in range.
            let scale = inertia.amax().max(f64::MIN_POSITIVE);
            let moments = (inertia / scale).symmetric_eigenvalues();
            2.0 * moments.max() > 1.01 * moments.sum()
        })
    }

    /// Pose of the root link in the world, `X_WB`. Default: identity.
    pub fn base_pose(&self) -> &Isometry3<f64> {
        &self.X_WB
    }

    /// Places the robot with its root link at `X_WB` in the world.
    ///
    /// ```
    /// use vsf_core::nalgebra::Isometry3;
    /// let robot = vsf_robots::kinova_gen3()?.with_base_pose(Isometry3::translation(0.0, 0.0, 0.7))?;
    /// let mut posture = robot.posture();
    /// robot.update_posture(&[0.0; 7], &mut posture)?;
    /// assert_eq!(posture.link_poses()[0].translation.z, 0.7);
    /// # Ok::<(), vsf_robots::RobotError>(())
    /// ```
    ///
    /// # Errors
    /// [`RobotError::Pose`] when the pose is not finite or farther than 1e6 m from the world's origin.
    pub fn with_base_pose(mut self, X_WB: Isometry3<f64>) -> Result<Self, RobotError> {
        if !is_near(&X_WB) {
            return Err(RobotError::Pose {
                what: "base pose",
                name: self.name,
            });
        }
        self.X_WB = X_WB;
        Ok(self)
    }
}

/// Whether a pose is finite and within [`RestPoints::FARTHEST`] of the origin.
pub(crate) fn is_near(X: &Isometry3<f64>) -> bool {
    let near = |v: &f64| v.abs() <= RestPoints::FARTHEST;
    X.translation.vector.iter().all(near) && X.rotation.coords.iter().all(|v| v.is_finite())
}
