use crate::CoreError;
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::HashSet;
use std::sync::Arc;

/// For every link, the moving joints between the base and that link, in order.
///
/// A force on the link loads exactly these joints.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LinkChains {
    joints: usize,
    chains: Vec<Vec<u32>>,
    still: Vec<Vec<u32>>,
}

impl LinkChains {
    /// Creates the chains of a robot with `joints` moving joints; `chains[l]` lists those that move link `l`.
    ///
    /// # Errors
    /// A joint index out of range, a joint that occurs twice in a chain, or more than `u32::MAX` joints.
    pub fn new(joints: usize, chains: Vec<Vec<u32>>) -> Result<Self, CoreError> {
        if joints > u32::MAX as usize {
            return Err(CoreError::TooMany {
                what: "joints",
                got: joints,
                max: u32::MAX as usize,
            });
        }
        for chain in &chains {
            let mut seen = HashSet::new();
            for &j in chain {
                if j as usize >= joints {
                    return Err(CoreError::OutOfRange {
                        what: "joint",
                        index: j as usize,
                        len: joints,
                    });
                }
                if !seen.insert(j) {
                    return Err(CoreError::Repeated {
                        what: "in the chain of a link, joint",
                        index: j as usize,
                    });
                }
            }
        }
        let others = |chain: &Vec<u32>| {
            let joints = 0..joints as u32;
            joints.filter(|j| !chain.contains(j)).collect()
        };
        Ok(Self {
            joints,
            still: chains.iter().map(others).collect(),
            chains,
        })
    }

    /// Number of moving joints, `d`.
    pub fn joint_count(&self) -> usize {
        self.joints
    }

    /// Number of links.
    pub fn link_count(&self) -> usize {
        self.chains.len()
    }

    /// Joints that move `link`.
    ///
    /// # Panics
    /// If `link` is out of range.
    pub fn chain(&self, link: usize) -> &[u32] {
        &self.chains[link]
    }

    /// Joints that do not move `link`.
    ///
    /// # Panics
    /// If `link` is out of range.
    pub fn still(&self, link: usize) -> &[u32] {
        &self.still[link]
    }
}

/// The axis of a joint as a screw in world coordinates.
///
/// Unit joint velocity moves a point `p` with the velocity `angular x p + linear`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointScrew {
    /// Unit axis of a revolute joint, zero for a prismatic one.
    pub angular: Vector3<f64>,
    /// `origin x axis` of a revolute joint (m), the unit axis of a prismatic one.
    pub linear: Vector3<f64>,
}

impl JointScrew {
    /// The screw of a joint that turns about the unit vector `axis_W` through `origin_W`.
    pub fn revolute(axis_W: Vector3<f64>, origin_W: Point3<f64>) -> Self {
        Self {
            angular: axis_W,
            linear: origin_W.coords.cross(&axis_W),
        }
    }

    /// The screw of a joint that slides along the unit vector `axis_W`.
    pub fn prismatic(axis_W: Vector3<f64>) -> Self {
        Self {
            angular: Vector3::zeros(),
            linear: axis_W,
        }
    }

    /// Velocity of a point per unit of joint velocity (m): the joint's column of the point's Jacobian.
    pub fn velocity_at(&self, p_W: &Point3<f64>) -> Vector3<f64> {
        self.angular.cross(&p_W.coords) + self.linear
    }
}

/// The poses of all links and joint axes of a robot, for one vector of joint positions.
///
/// Robot models (`vsf-robots`) write it; contact models and sensors read it. It is reused from step
/// to step without allocating.
#[derive(Debug, Clone)]
pub struct Posture {
    written: bool,
    q: Vec<f64>,
    poses: Vec<Isometry3<f64>>,
    screws: Vec<JointScrew>,
    chains: Arc<LinkChains>,
}

impl Posture {
    /// Creates an unwritten posture with all links at the world origin, to be written by a robot model.
    pub fn new(chains: Arc<LinkChains>) -> Self {
        let still = JointScrew::prismatic(Vector3::zeros());
        Self {
            written: false,
            q: vec![0.0; chains.joint_count()],
            poses: vec![Isometry3::identity(); chains.link_count()],
            screws: vec![still; chains.joint_count()],
            chains,
        }
    }

    /// Joint positions, `d` values (rad or m).
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Poses of the links in world, `X_WL`.
    pub fn link_poses(&self) -> &[Isometry3<f64>] {
        &self.poses
    }

    /// Joint axes in world.
    pub fn screws(&self) -> &[JointScrew] {
        &self.screws
    }

    /// Which joints move which link.
    pub fn chains(&self) -> &Arc<LinkChains> {
        &self.chains
    }

    /// Joint positions, link poses and joint axes, for a robot model to write. This call marks the posture as
    /// written.
    pub fn parts_mut(&mut self) -> (&mut [f64], &mut [Isometry3<f64>], &mut [JointScrew]) {
        self.written = true;
        (&mut self.q, &mut self.poses, &mut self.screws)
    }

    /// Computes the joint torques `J(q, p)^T f` of a force `f_W` (N) on `link` at the world point `p_W`.
    ///
    /// They are written to `out` (length `d`; zero for joints that do not move the link). The
    /// Jacobian is never formed: this is [`Posture::add_torques`] of the moment `p x f`.
    ///
    /// # Panics
    /// If `link` is out of range or `out` is shorter than `d`.
    #[inline]
    pub fn joint_torques(
        &self,
        link: usize,
        p_W: &Point3<f64>,
        f_W: &Vector3<f64>,
        out: &mut [f64],
    ) {
        out[..self.screws.len()].fill(0.0);
        self.add_torques(link, &p_W.coords.cross(f_W), f_W, out);
    }

    /// Adds the joint torques of forces on `link` to `out` (length `d`).
    ///
    /// `f_W` (N) is the sum of the forces, `m_W` (N m) their moment about the world origin, the sum of all `p x f`.
    /// Each joint `j` that moves the link gets `angular_j . m + linear_j . f`.
    ///
    /// # Panics
    /// If `link` is out of range or `out` is shorter than `d`.
    #[inline]
    pub fn add_torques(
        &self,
        link: usize,
        m_W: &Vector3<f64>,
        f_W: &Vector3<f64>,
        out: &mut [f64],
    ) {
        for &j in self.chains.chain(link) {
            let s = &self.screws[j as usize];
            out[j as usize] += s.angular.dot(m_W) + s.linear.dot(f_W);
        }
    }

    /// Checks that the posture has been written, and that positions, poses and axes are finite.
    ///
    /// # Errors
    /// [`CoreError::UnwrittenPosture`], or [`CoreError::NotFinite`], which names the joint or link.
    pub fn check(&self) -> Result<(), CoreError> {
        if !self.written {
            return Err(CoreError::UnwrittenPosture);
        }
        CoreError::check_finite("joint position", &self.q)?;
        for (index, x) in self.poses.iter().enumerate() {
            let sum = x.translation.vector.sum() + x.rotation.coords.sum();
            if !sum.is_finite() {
                return Err(CoreError::NotFinite {
                    what: "pose of link",
                    index,
                    value: sum,
                });
            }
        }
        for (index, s) in self.screws.iter().enumerate() {
            let sum = s.angular.sum() + s.linear.sum();
            if !sum.is_finite() {
                return Err(CoreError::NotFinite {
                    what: "axis of joint",
                    index,
                    value: sum,
                });
            }
        }
        Ok(())
    }

    /// Checks that the posture belongs to the robot with these chains.
    ///
    /// # Errors
    /// [`CoreError::ForeignPosture`].
    pub fn check_robot(&self, chains: &Arc<LinkChains>) -> Result<(), CoreError> {
        if Arc::ptr_eq(&self.chains, chains) || self.chains == *chains {
            return Ok(());
        }
        Err(CoreError::ForeignPosture {
            joints: self.chains.joint_count(),
            links: self.chains.link_count(),
            expected_joints: chains.joint_count(),
            expected_links: chains.link_count(),
        })
    }
}
