//! Robots from URDF: kinematics, rigid-body dynamics, and joint-torque sensing.
//!
//! A [`RobotModel`] is immutable and created once, from a URDF file or by a built-in constructor.
//! Everything that changes from step to step lies in buffers that the caller owns: a
//! [`vsf_core::Posture`] for kinematics and a [`DynamicsWorkspace`] for dynamics. Once these buffers
//! exist, neither kinematics nor dynamics allocates.
//!
//! | task | item |
//! | --- | --- |
//! | read a robot | [`RobotModel::from_urdf_file`], [`RobotModel::from_urdf_str`], [`builtin()`] |
//! | link poses and joint axes | [`RobotModel::update_posture`] |
//! | Jacobian of a point on a link | [`jacobian`]; torques of a force: [`vsf_core::Posture::joint_torques`] |
//! | gravity torques | [`RobotModel::gravity_torques`] |
//! | inverse dynamics, mass matrix | [`RobotModel::inverse_dynamics`], [`RobotModel::mass_matrix`] |
//! | collision shapes | [`RobotModel::colliders`] |
//! | torques as observations of stiffness | [`JointTorques`] |
//!
//! By default joints are numbered in chain order: depth-first from the root, with branches in the order
//! of the file. [`UrdfOptions::joint_order`] sets another order by name. Gravity is never implied: it is
//! an argument of every dynamics call that depends on it. Units are SI; a prismatic joint has positions
//! in meters and "torques" in newtons.
//!
//! ```
//! use vsf_core::nalgebra::{Point3, Vector3};
//! let robot = vsf_robots::kinova_gen3()?;
//! let q = [0.0, 0.9, 0.0, 0.7, 0.0, 0.4, 0.0];
//!
//! let mut posture = robot.posture();
//! robot.update_posture(&q, &mut posture)?;
//! let hand = robot.link_index("EndEffector_Link")?;
//! let p_W = Point3::from(posture.link_poses()[hand].translation.vector);
//!
//! // 10 N pushing down on the hand load the joints by J^T f ...
//! let mut tau_ext = [0.0; 7];
//! posture.joint_torques(hand, &p_W, &Vector3::new(0.0, 0.0, -10.0), &mut tau_ext);
//! // ... and the actuators hold the arm's own weight.
//! let mut workspace = robot.dynamics_workspace();
//! let tau_hold = robot.gravity_torques(&q, &Vector3::new(0.0, 0.0, -9.81), &mut workspace)?;
//! assert!(tau_ext[1].abs() > 1.0 && tau_hold[1].abs() > 1.0);
//! # Ok::<(), vsf_robots::RobotError>(())
//! ```
//!
//! Rejected: the `k` kinematics crate (unmaintained); forming Jacobians in the
//! real-time path (columns `-J^T u` need one cross product per point); mimic, floating, planar and
//! spherical joints (an observation needs one torque per coordinate; the error names the joint).

#![forbid(unsafe_code)]
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod builtin;
mod bundle;
mod capsules;
mod description;
mod dynamics;
mod error;
mod file;
mod joint_torques;
mod kinematics;
mod kinova_gen3;
mod kinova_gen3_shapes;
mod mesh;
mod model;
mod resource;
mod tags;
mod tree;
mod unread;
mod urdf;

pub use builtin::{BUILTIN_NAMES, builtin, cartesian_stage, planar_arm};
pub use bundle::urdf_bundle;
pub use dynamics::DynamicsWorkspace;
pub use error::RobotError;
pub use joint_torques::JointTorques;
pub use kinematics::jacobian;
pub use kinova_gen3::kinova_gen3;
pub use model::{Joint, JointKind, JointLimits, Link, RobotModel};
pub use urdf::{Meshes, UrdfOptions};
