use crate::description::{Description, JointDescription, LinkDescription};
use crate::tree::MAX_LINKS;
use crate::unread::unread;
use crate::{JointKind, JointLimits, RobotError, RobotModel, capsules, file, mesh, resource, tags};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use urdf_rs::{Geometry, JointType};
use vsf_core::{CoreError, Shape, TriMesh};

/// Far beyond any URDF, which has 4 or 5 levels.
const MAX_NESTING: usize = 100;
/// Largest file that is read \[bytes\], far beyond any URDF.
const MAX_LENGTH: u64 = 64 << 20;
/// Most bytes and elements that are searched, element by element, for what is broken.
const MOST_SEARCHED: usize = 16 << 20;
const MOST_CHILDREN: usize = 10_000;
/// Far beyond any robot, also one of many small balls.
const MAX_SHAPES: usize = 10_000;

/// How to treat `<mesh>` collision shapes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Meshes {
    /// Read the mesh files. The default.
    #[default]
    Load,
    /// Leave these shapes out, for kinematics and dynamics without the mesh files.
    Skip,
}

/// Largest angle of an origin (rad), two full turns: larger ones can only be degrees.
const MOST_TURNED: f64 = 4.0 * std::f64::consts::PI;

/// How to read a URDF.
///
/// ```
/// use std::collections::BTreeMap;
/// use vsf_robots::UrdfOptions;
/// let options = UrdfOptions {
///     packages: BTreeMap::from([("my_arm_description".into(), "/opt/my_arm_description".into())]),
///     ..UrdfOptions::default()
/// };
/// # assert!(options.joint_order.is_none());
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct UrdfOptions {
    /// Folders of packages, by the names used in `package://` addresses. Default: none.
    pub packages: BTreeMap<String, PathBuf>,
    /// Whether meshes of collision shapes are read. Default: [`Meshes::Load`].
    pub meshes: Meshes,
    /// Names of all moving joints in the order of joint vectors, each once. Default: chain order,
    /// depth-first from the root, branches in the order of the file.
    pub joint_order: Option<Vec<String>>,
}

impl RobotModel {
    /// Reads a URDF file. Relative mesh paths are relative to the file's folder.
    ///
    /// Joint axes may have any nonzero length. The model has no limit where the file states none, or states
    /// 0 for the effort, the velocity, or both ends of the range. The `length` of a `<capsule>` is that of
    /// its cylindrical part, without the half ball at each end.
    ///
    /// # Errors
    /// Every kind of [`RobotError`] except those about vectors, postures and workspaces: a file that
    /// cannot be read, text that is not URDF, joints and links that do not form one tree,
    /// unsupported joints, numbers out of range, meshes that are missing or broken. Messages name
    /// the link, joint or file.
    pub fn from_urdf_file(
        path: impl AsRef<Path>,
        options: &UrdfOptions,
    ) -> Result<Self, RobotError> {
        let path = path.as_ref();
        let text = text_of(path)?;
        let dir = path.parent().unwrap_or(Path::new(""));
        read(&text, dir, options, &path.display().to_string())
    }

    /// Reads URDF text. Relative mesh paths are relative to `dir`. See [`RobotModel::from_urdf_file`].
    ///
    /// ```
    /// use vsf_robots::{RobotModel, UrdfOptions};
    /// let text = r#"<robot name="slide">
    ///   <link name="rail"/><link name="cart"/>
    ///   <joint name="x" type="prismatic">
    ///     <parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
    ///   </joint>
    /// </robot>"#;
    /// let robot = RobotModel::from_urdf_str(text, ".", &UrdfOptions::default())?;
    /// assert_eq!(robot.joints()[0].name(), "x");
    /// # Ok::<(), vsf_robots::RobotError>(())
    /// ```
    ///
    /// # Errors
    /// As [`RobotModel::from_urdf_file`].
    pub fn from_urdf_str(
        text: &str,
        dir: impl AsRef<Path>,
        options: &UrdfOptions,
    ) -> Result<Self, RobotError> {
        read(text, dir.as_ref(), options, "URDF text")
    }
}

/// The text of a file.
pub(crate) fn text_of(path: &Path) -> Result<String, RobotError> {
    String::from_utf8(file::read(path, MAX_LENGTH)?).map_err(|_| RobotError::Read {
        path: path.to_owned(),
        source: Error::new(ErrorKind::InvalidData, "it is not UTF-8 text"),
    })
}

/// Parses a URDF text, with checks that the parser lacks; `origin` names the text in messages.
pub(crate) fn parse(text: &str, origin: &str) -> Result<urdf_rs::Robot, RobotError> {
    let invalid = |reason: String| RobotError::Urdf {
        origin: origin.to_owned(),
        reason,
    };
    // The parser would skip macros and their links without a word.
    if text.contains("<xacro:") {
        return Err(invalid("it holds xacro macros; expand them first".into()));
    }
    // Entities can make a short text huge, and hide elements from the count of levels.
    if text.contains("<!ENTITY") {
        return Err(invalid(
            "it declares entities; write out what they stand for".into(),
        ));
    }
    if tags::bad_prefix(text) {
        return Err(invalid(
            "a name in it begins with ':', or it declares the prefix xmlns; neither is XML".into(),
        ));
    }
    let depth = tags::depth(text);
    if depth > MAX_NESTING {
        return Err(invalid(format!(
            "its elements are nested {depth} deep, at most {MAX_NESTING} are read"
        )));
    }
    if let Some((line, problem)) = tags::unbalanced(text) {
        return Err(invalid(format!("line {line}: {problem}")));
    }
    let robot = urdf_rs::read_from_string(text).map_err(|e| {
        invalid(match unplaced(&e) {
            Some(reason) => first_broken(text).unwrap_or(reason),
            None => e.to_string(),
        })
    })?;
    for (tag, value) in tags::values(text, QUATERNION) {
        let line = || tags::line(text, tags::place(text, tag));
        if !knows_quaternions(&robot) {
            return Err(invalid(format!(
                "line {}: {QUATERNION} counts from <robot version=\"1.1\"> on; state the version, or write rpy",
                line()
            )));
        }
        let squares = value
            .split_whitespace()
            .map(|v| v.parse::<f64>().map(|v| v * v));
        let square: f64 = squares.sum::<Result<_, _>>().unwrap_or(f64::INFINITY);
        if square.is_nan() || (square - 1.0).abs() > MOST_STRETCHED {
            return Err(invalid(format!(
                "line {}: {QUATERNION}=\"{value}\" is no rotation; x y z w must be of length 1",
                line()
            )));
        }
    }
    let shapes = robot.links.iter().map(|l| l.collision.len()).sum();
    for (what, got, max) in [
        ("links of a robot", robot.links.len(), MAX_LINKS),
        ("collision shapes of a robot", shapes, MAX_SHAPES),
    ] {
        if got > max {
            return Err(RobotError::Core(CoreError::TooMany { what, got, max }));
        }
    }
    Ok(robot)
}

/// How far the squared length of a printed quaternion may be from 1.
const MOST_STRETCHED: f64 = 1e-2;
/// Attribute that the parser ignores in URDF versions before 1.1 and in texts that state no version.
const QUATERNION: &str = "quat_xyzw";

fn knows_quaternions(robot: &urdf_rs::Robot) -> bool {
    let stated = robot
        .version
        .as_deref()
        .and_then(|v| v.trim().split_once('.'));
    let number = |part: &str| part.parse::<u32>().ok();
    let version = stated.and_then(|(major, minor)| Some((number(major)?, number(minor)?)));
    version.is_some_and(|v| v >= (1, 1))
}

/// The parser's message for an error that it gives no line for.
fn unplaced(error: &urdf_rs::UrdfError) -> Option<String> {
    let says = error.to_string();
    says.strip_prefix("custom: ").map(str::to_owned)
}

/// Line of the first link or joint that cannot be read, and the reason. The parser does not give the line.
fn first_broken(text: &str) -> Option<String> {
    let mut left = MOST_SEARCHED;
    for child in tags::children(text).iter().take(MOST_CHILDREN) {
        let alone = child.alone();
        left = left.checked_sub(alone.len())?;
        if let Err(error) = urdf_rs::read_from_string(&alone) {
            let (name, line, reason) = (child.name(), child.line(text), unplaced(&error)?);
            return Some(format!("<{name}> of line {line}: {reason}"));
        }
    }
    None
}

fn read(
    text: &str,
    dir: &Path,
    options: &UrdfOptions,
    origin: &str,
) -> Result<RobotModel, RobotError> {
    let robot = parse(text, origin)?;
    let mut meshes = MeshFiles::default();
    let description = Description {
        name: robot.name,
        links: robot
            .links
            .iter()
            .map(|l| link(l, dir, options, &mut meshes))
            .collect::<Result<_, _>>()?,
        joints: robot
            .joints
            .into_iter()
            .map(joint)
            .collect::<Result<_, _>>()?,
        unread: unread(text),
    };
    RobotModel::assemble(description, options.joint_order.as_deref())
}

/// Meshes that have been read, by file and scale: shapes may share them.
type MeshFiles = HashMap<(PathBuf, [u64; 3]), TriMesh>;

fn link(
    link: &urdf_rs::Link,
    dir: &Path,
    options: &UrdfOptions,
    meshes: &mut MeshFiles,
) -> Result<LinkDescription, RobotError> {
    let i = &link.inertial.inertia;
    let mut shapes = Vec::new();
    for collision in &link.collision {
        if let Some(shape) = shape(&collision.geometry, dir, options, meshes)? {
            let X_LS = pose(&collision.origin, "a collision shape of link", &link.name)?;
            shapes.push((X_LS, shape));
        }
    }
    capsules::merge(&mut shapes);
    Ok(LinkDescription {
        name: link.name.clone(),
        mass: link.inertial.mass.value,
        X_LI: pose(&link.inertial.origin, "the inertia of link", &link.name)?,
        inertia_I: Matrix3::new(
            i.ixx, i.ixy, i.ixz, //
            i.ixy, i.iyy, i.iyz, //
            i.ixz, i.iyz, i.izz,
        ),
        shapes,
    })
}

fn shape(
    geometry: &Geometry,
    dir: &Path,
    options: &UrdfOptions,
    meshes: &mut MeshFiles,
) -> Result<Option<Shape>, RobotError> {
    Ok(Some(match geometry {
        Geometry::Box { size } => Shape::Box {
            half_extents: Vector3::from(**size) / 2.0,
            rounding: 0.0,
        },
        Geometry::Cylinder { radius, length } => Shape::Cylinder {
            radius: *radius,
            half_length: length / 2.0,
            rounding: 0.0,
        },
        Geometry::Capsule { radius, length } => Shape::Capsule {
            radius: *radius,
            half_length: length / 2.0,
        },
        Geometry::Sphere { radius } => Shape::Sphere { radius: *radius },
        Geometry::Mesh { .. } if options.meshes == Meshes::Skip => return Ok(None),
        Geometry::Mesh { filename, scale } => {
            let path = resource::resolve(filename, dir, &options.packages)?;
            let scale = scale.map_or(Vector3::repeat(1.0), |s| Vector3::from(*s));
            let key = (path, <[f64; 3]>::from(scale).map(f64::to_bits));
            Shape::Mesh(match meshes.entry(key) {
                Entry::Occupied(read) => read.get().clone(),
                Entry::Vacant(place) => {
                    let mesh = mesh::load(&place.key().0, &scale)?;
                    place.insert(mesh).clone()
                }
            })
        }
    }))
}

fn joint(joint: urdf_rs::Joint) -> Result<JointDescription, RobotError> {
    if let Some(mimic) = joint.mimic {
        return Err(RobotError::Mimic {
            joint: joint.name,
            leader: mimic.joint,
        });
    }
    let unsupported = |joint, kind| Err(RobotError::UnsupportedJoint { joint, kind });
    let kind = match joint.joint_type {
        JointType::Revolute => Some(JointKind::Revolute),
        JointType::Continuous => Some(JointKind::Continuous),
        JointType::Prismatic => Some(JointKind::Prismatic),
        JointType::Fixed => None,
        JointType::Floating => return unsupported(joint.name, "floating"),
        JointType::Planar => return unsupported(joint.name, "planar"),
        JointType::Spherical => return unsupported(joint.name, "spherical"),
    };
    Ok(JointDescription {
        kind,
        X_PJ: pose(&joint.origin, "joint", &joint.name)?,
        axis_J: Vector3::from(*joint.axis.xyz),
        limits: limits(&joint.limit, kind),
        name: joint.name,
        parent: joint.parent.link,
        child: joint.child.link,
    })
}

/// Limits of a joint. The parser returns 0 for a limit that the file does not state.
fn limits(limit: &urdf_rs::JointLimit, kind: Option<JointKind>) -> JointLimits {
    let stated = |v: f64| if v == 0.0 { f64::INFINITY } else { v };
    let ranged = limit.lower != 0.0 || limit.upper != 0.0;
    let (lower, upper) = if ranged && kind != Some(JointKind::Continuous) {
        (limit.lower, limit.upper)
    } else {
        (JointLimits::NONE.lower, JointLimits::NONE.upper)
    };
    JointLimits {
        lower,
        upper,
        effort: stated(limit.effort),
        velocity: stated(limit.velocity),
    }
}

/// Converts the origin of `what` of the element `name`, with fixed-axis roll, pitch, yaw.
fn pose(
    pose: &urdf_rs::Pose,
    what: &'static str,
    name: &str,
) -> Result<Isometry3<f64>, RobotError> {
    let [roll, pitch, yaw] = *pose.rpy;
    if let Some(angle) = (pose.rpy.iter()).find(|a| a.is_finite() && a.abs() > MOST_TURNED) {
        return Err(RobotError::Degrees {
            what,
            name: name.to_owned(),
            angle: *angle,
        });
    }
    Ok(Isometry3::from_parts(
        Vector3::from(*pose.xyz).into(),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    ))
}
