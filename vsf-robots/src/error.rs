use std::path::PathBuf;
use thiserror::Error;
use vsf_core::CoreError;

/// Errors of robot descriptions, of meshes, and of the numbers passed to a model.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RobotError {
    /// A file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// The text is not a URDF.
    #[error("{origin} is not a valid URDF: {reason}")]
    Urdf {
        /// The file, or `URDF text`.
        origin: String,
        /// What is wrong.
        reason: String,
    },
    /// The robot has no links.
    #[error("robot '{robot}' has no links")]
    NoLinks {
        /// Name of the robot.
        robot: String,
    },
    /// Two links, two joints, or two entries of a joint order have the same name.
    #[error("{what} '{name}' occurs twice; names must be unique")]
    DuplicateName {
        /// `link`, `joint` or `joint order entry`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A joint type without exactly one coordinate and one torque.
    #[error(
        "joint '{joint}' is {kind}, which is not supported; \
         use revolute, continuous, prismatic or fixed joints"
    )]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// `floating`, `planar` or `spherical`.
        kind: &'static str,
    },
    /// A joint that follows another one.
    #[error(
        "joint '{joint}' mimics joint '{leader}', which is not supported; \
         make it fixed, or independent and give its position"
    )]
    Mimic {
        /// The joint.
        joint: String,
        /// The joint it follows.
        leader: String,
    },
    /// A joint refers to a link that does not exist.
    #[error("joint '{joint}' connects link '{link}', which does not exist")]
    MissingLink {
        /// The joint, or the part of a built-in robot that refers to the link.
        joint: String,
        /// The missing link.
        link: String,
    },
    /// A link is the child of two joints.
    #[error("link '{link}' is the child of joints '{first}' and '{second}'; a link has one parent")]
    TwoParents {
        /// The link.
        link: String,
        /// The first joint.
        first: String,
        /// The second joint.
        second: String,
    },
    /// The links form several trees.
    #[error(
        "several root links: {}; connect them with joints to one tree",
        listed(roots)
    )]
    SeveralRoots {
        /// Links without a parent.
        roots: Vec<String>,
    },
    /// Joints form a closed loop.
    #[error("joint '{joint}' is part of a closed loop through link '{link}'; a robot is a tree")]
    Loop {
        /// A joint of the loop.
        joint: String,
        /// The child link of that joint.
        link: String,
    },
    /// The axis of a moving joint has no direction.
    #[error("the axis of joint '{joint}' is {axis:?}; it must be finite and not zero")]
    Axis {
        /// The joint.
        joint: String,
        /// The axis as given.
        axis: [f64; 3],
    },
    /// Limits of a joint are NaN or reversed.
    #[error(
        "joint '{joint}' has limits {lower:?} .. {upper:?}, effort {effort:?}, velocity {velocity:?}; \
             they must be numbers with lower <= upper and the others >= 0"
    )]
    Limits {
        /// The joint.
        joint: String,
        /// Lower position limit.
        lower: f64,
        /// Upper position limit.
        upper: f64,
        /// Largest torque or force.
        effort: f64,
        /// Largest speed.
        velocity: f64,
    },
    /// A pose is not finite, or farther away than 1e6 m.
    #[error("the {what} of '{name}' is not finite, or farther off than 1e6 m")]
    Pose {
        /// Which pose.
        what: &'static str,
        /// The link, joint or robot it belongs to.
        name: String,
    },
    /// An angle of an origin in a URDF is larger than two full turns, and so probably in degrees.
    #[error(
        "the origin of {what} '{name}' is turned by {angle} rad, more than two full turns; \
         angles of a URDF are in radians, not degrees"
    )]
    Degrees {
        /// What the origin belongs to.
        what: &'static str,
        /// The link or joint.
        name: String,
        /// The angle (rad).
        angle: f64,
    },
    /// A mass is not in 0 .. 1e9 kg.
    #[error("link '{link}' has mass {mass:?} kg; it must be in 0 .. 1e9")]
    Mass {
        /// The link.
        link: String,
        /// Its mass (kg).
        mass: f64,
    },
    /// A rotational inertia is not positive semidefinite, or exceeds 1e15 kg m².
    #[error(
        "the inertia of link '{link}' has the principal moment {moment:e} kg m^2; \
         all must be in 0 .. 1e15"
    )]
    Inertia {
        /// The link.
        link: String,
        /// Its smallest principal moment, or the entry out of range (kg m²).
        moment: f64,
    },
    /// A collision shape is out of range.
    #[error("a collision shape of link '{link}': {source}")]
    Shape {
        /// The link.
        link: String,
        /// What is wrong.
        source: CoreError,
    },
    /// A `package://` address names a package whose folder is unknown.
    #[error(
        "'{uri}': the folder of package '{package}' is not known; \
         add it to UrdfOptions::packages, or skip meshes with Meshes::Skip"
    )]
    UnknownPackage {
        /// The address.
        uri: String,
        /// The package.
        package: String,
    },
    /// An address that is neither `package://`, nor `file://`, nor a path.
    #[error("'{uri}' is not supported; use package://, file:// or a path")]
    UnsupportedUri {
        /// The address.
        uri: String,
    },
    /// A mesh cannot be used.
    #[error("mesh {}: {reason}", path.display())]
    Mesh {
        /// The mesh file.
        path: PathBuf,
        /// What is wrong and what to do.
        reason: String,
    },
    /// There is no link of this name.
    #[error("no link '{name}'; the links are {}", listed(known))]
    UnknownLink {
        /// The name.
        name: String,
        /// The names of all links.
        known: Vec<String>,
    },
    /// There is no moving joint of this name.
    #[error("no moving joint '{name}'; the moving joints are {}", listed(known))]
    UnknownJoint {
        /// The name.
        name: String,
        /// The names of all moving joints.
        known: Vec<String>,
    },
    /// A joint order leaves out moving joints.
    #[error(
        "the joint order leaves out {}; it must name every moving joint once",
        listed(missing)
    )]
    IncompleteJointOrder {
        /// The moving joints that are left out.
        missing: Vec<String>,
    },
    /// The workspace belongs to a robot with other links or joints.
    #[error(
        "this workspace was made for another robot; use RobotModel::dynamics_workspace of this one"
    )]
    ForeignWorkspace,
    /// Numbers are out of range or not finite, or there are too many or too few.
    #[error(transparent)]
    Core(#[from] CoreError),
}

/// Joins names for a message; only the first ones if there are many.
fn listed(names: &[String]) -> String {
    const MOST: usize = 30;
    match names.len().checked_sub(MOST) {
        None | Some(0) => names.join(", "),
        Some(more) => format!("{} and {more} more", names[..MOST].join(", ")),
    }
}
