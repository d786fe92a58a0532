use crate::description::{Description, JointDescription, LinkDescription};
use crate::tree::MAX_LINKS;
use crate::{JointKind, JointLimits, RobotError, RobotModel, kinova_gen3};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};
use vsf_core::{CoreError, Shape};

/// Names of the built-in robots, as accepted by [`builtin()`].
pub const BUILTIN_NAMES: [&str; 3] = ["kinova_gen3", "cartesian_stage", "planar_arm"];

/// Creates the built-in robot called `name`; `None` for an unknown name.
///
/// The robots are [`kinova_gen3()`], [`cartesian_stage`] with a tip of 4 mm radius, and
/// [`planar_arm`] with 3 links of 0.3 m length and 0.03 m radius.
///
/// ```
/// let name = "planar_arm";
/// let robot = match vsf_robots::builtin(name) {
///     Some(robot) => robot?,
///     None => vsf_robots::RobotModel::from_urdf_file(name, &Default::default())?,
/// };
/// assert_eq!(robot.joint_count(), 3);
/// # Ok::<(), vsf_robots::RobotError>(())
/// ```
pub fn builtin(name: &str) -> Option<Result<RobotModel, RobotError>> {
    match name {
        "kinova_gen3" => Some(kinova_gen3()),
        "cartesian_stage" => Some(cartesian_stage(0.004)),
        "planar_arm" => Some(planar_arm(3, 0.3, 0.03)),
        _ => None,
    }
}

/// A probe on a three-axis linear stage.
///
/// The prismatic joints `stage_x`, `stage_y`, `stage_z` move along the world axes (range +-1 m, 100 N,
/// 1 m/s). The links are `link_0` without mass and `link_1` to `link_3` of 0.1 kg each. The tip on `link_3`
/// is a ball of `tip_radius` (1e-9 m to 1e6 m). The joint positions are the coordinates of its lowest point.
///
/// # Errors
/// A radius out of range.
pub fn cartesian_stage(tip_radius: f64) -> Result<RobotModel, RobotError> {
    let limits = JointLimits {
        lower: -1.0,
        upper: 1.0,
        effort: 100.0,
        velocity: 1.0,
    };
    let axes = [
        ("stage_x", Vector3::x()),
        ("stage_y", Vector3::y()),
        ("stage_z", Vector3::z()),
    ];
    let mut stage = Description {
        name: "cartesian_stage".into(),
        links: vec![LinkDescription::frame("link_0")],
        joints: Vec::new(),
        unread: Vec::new(),
    };
    for (k, (name, axis_J)) in axes.into_iter().enumerate() {
        let child = format!("link_{}", k + 1);
        stage.links.push(LinkDescription {
            mass: 0.1,
            inertia_I: Matrix3::identity() * 1e-4,
            ..LinkDescription::frame(&child)
        });
        stage.joints.push(JointDescription {
            name: name.into(),
            kind: Some(JointKind::Prismatic),
            parent: format!("link_{k}"),
            child,
            X_PJ: Isometry3::identity(),
            axis_J,
            limits,
        });
    }
    if let Some(tip) = stage.links.last_mut() {
        let ball = Shape::Sphere { radius: tip_radius };
        let center = Isometry3::translation(0.0, 0.0, tip_radius);
        tip.shapes.push((center, ball));
    }
    RobotModel::assemble(stage, None)
}

/// An arm that moves in the vertical x-z plane, for examples and tests.
///
/// It has `links` (1 to 998) capsules `link_1`, `link_2`, ... of `length` > 0 (m) from joint to joint
/// and `radius` > 0 (m), continuous joints `joint_1`, `joint_2`, ..., and a frame `tip` at the end. At
/// zero position the arm points along x; positive angles lift it toward z. Each link weighs as much as a
/// solid cylinder of its length and radius made of water (1000 kg/m^3).
///
/// # Errors
/// No links or more than 998, a length or radius that is not positive and finite, or a link larger than 1e6 m or heavier
/// than 1e9 kg.
pub fn planar_arm(links: usize, length: f64, radius: f64) -> Result<RobotModel, RobotError> {
    // The base and the tip are links as well.
    if !(1..=MAX_LINKS - 2).contains(&links) {
        return Err(CoreError::Parameter {
            name: "number of links",
            value: links as f64,
            range: "1 to 998",
        }
        .into());
    }
    for (name, value) in [("link length", length), ("link radius", radius)] {
        if !(value > 0.0 && value.is_finite()) {
            let range = "> 0 m and finite";
            return Err(CoreError::Parameter { name, value, range }.into());
        }
    }
    let mass = 1000.0 * PI * radius.powi(2) * length;
    let across = mass * (3.0 * radius.powi(2) + length.powi(2)) / 12.0;
    // The rod frame has its z along the link and sits in the middle.
    let X_LR = Isometry3::from_parts(
        Vector3::new(length / 2.0, 0.0, 0.0).into(),
        UnitQuaternion::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2),
    );
    let along = mass * radius.powi(2) / 2.0;
    let rod = LinkDescription {
        mass,
        X_LI: X_LR,
        inertia_I: Matrix3::from_diagonal(&Vector3::new(across, across, along)),
        shapes: vec![(
            X_LR,
            Shape::Capsule {
                radius,
                half_length: length / 2.0,
            },
        )],
        ..LinkDescription::frame("")
    };
    let mut arm = Description {
        name: "planar_arm".into(),
        links: vec![LinkDescription::frame("base")],
        joints: Vec::new(),
        unread: Vec::new(),
    };
    let mut parent = "base".to_owned();
    for k in 1..=links + 1 {
        let is_tip = k > links;
        let child = if is_tip {
            "tip".to_owned()
        } else {
            format!("link_{k}")
        };
        let start = if k == 1 { 0.0 } else { length };
        arm.joints.push(JointDescription {
            name: if is_tip {
                "tip_mount".to_owned()
            } else {
                format!("joint_{k}")
            },
            kind: (!is_tip).then_some(JointKind::Continuous),
            parent,
            child: child.clone(),
            X_PJ: Isometry3::translation(start, 0.0, 0.0),
            axis_J: -Vector3::y(),
            limits: JointLimits::NONE,
        });
        arm.links.push(if is_tip {
            LinkDescription::frame(&child)
        } else {
            LinkDescription {
                name: child.clone(),
                ..rod.clone()
            }
        });
        parent = child;
    }
    RobotModel::assemble(arm, None)
}
