use crate::description::{Description, JointDescription, LinkDescription};
use crate::{JointKind, JointLimits, RobotError, RobotModel, kinova_gen3_shapes};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// Name, mass (kg), center of mass (m), inertia xx, xy, xz, yy, yz, zz about it (kg m^2).
type LinkRow = (&'static str, f64, [f64; 3], [f64; 6]);

#[rustfmt::skip]
const LINKS: [LinkRow; 8] = [
    ("Base_Link",            1.697,  [-0.000648, -0.000166, 0.084487],   [0.004622, 9e-6, 6e-5, 0.004495, 9e-6, 0.002079]),
    ("Shoulder_Link",        1.3773, [-2.3e-5, -0.010364, -0.07336],     [0.00457, 1e-6, 2e-6, 0.004831, 0.000448, 0.001409]),
    ("HalfArm1_Link",        1.1636, [-4.4e-5, -0.09958, -0.013278],     [0.011088, 5e-6, 0.0, 0.001072, -0.000691, 0.011255]),
    ("HalfArm2_Link",        1.1636, [-4.4e-5, -0.006641, -0.117892],    [0.010932, 0.0, -7e-6, 0.011127, 0.000606, 0.001043]),
    ("ForeArm_Link",         0.9302, [-1.8e-5, -0.075478, -0.015006],    [0.008147, -1e-6, 0.0, 0.000631, -0.0005, 0.008316]),
    ("SphericalWrist1_Link", 0.6781, [1e-6, -0.009432, -0.063883],       [0.001596, 0.0, 0.0, 0.001607, 0.000256, 0.000399]),
    ("SphericalWrist2_Link", 0.6781, [1e-6, -0.045483, -0.00965],        [0.001641, 0.0, 0.0, 0.00041, -0.000278, 0.001641]),
    ("Bracelet_Link",        0.5006, [-0.000281, -0.011402, -0.029798],  [0.000587, 3e-6, 3e-6, 0.000369, 0.000118, 0.000609]),
];

/// Position in the parent link (m), roll (rad), range to either side (rad; infinite: none),
/// largest torque (N m). Joint k connects links k - 1 and k; all turn about their z axis.
type JointRow = ([f64; 3], f64, f64, f64);

/// Quarter and half turns have five digits, as in the maker's table.
#[expect(clippy::approx_constant, reason = "the published value")]
const QUARTER: f64 = 1.5708;
#[expect(clippy::approx_constant, reason = "the published value")]
const HALF: f64 = 3.1416;

#[rustfmt::skip]
const JOINTS: [JointRow; 7] = [
    ([0.0, 0.0, 0.15643],          HALF,     f64::INFINITY, 39.0),
    ([0.0, 0.005375, -0.12838],    QUARTER,  2.41,          39.0),
    ([0.0, -0.21038, -0.006375],   -QUARTER, f64::INFINITY, 39.0),
    ([0.0, 0.006375, -0.21038],    QUARTER,  2.66,          39.0),
    ([0.0, -0.20843, -0.006375],   -QUARTER, f64::INFINITY, 9.0),
    ([0.0, 0.00017505, -0.10593],  QUARTER,  2.23,          9.0),
    ([0.0, -0.10593, -0.00017505], -QUARTER, f64::INFINITY, 9.0),
];

const MAX_SPEED: f64 = 0.8727;

/// The Kinova Gen3 arm, without vision module and gripper.
///
/// It has 7 joints, `Actuator1` to `Actuator7`. The links are `world` (the mounting plate),
/// `Base_Link`, `Shoulder_Link`, `HalfArm1_Link`, `HalfArm2_Link`, `ForeArm_Link`,
/// `SphericalWrist1_Link`, `SphericalWrist2_Link`, `Bracelet_Link`, and the tool frame
/// `EndEffector_Link`.
///
/// Kinematics and inertias are published by the maker (Kinova, *KINOVA Gen3 Ultra lightweight robot
/// user guide*, and its ROS description GEN3_URDF_V12). Quarter turns are rounded as in that source.
/// Collision shapes are primitives that approximate the maker's meshes.
///
/// # Errors
/// None in practice: the values are constants that tests check.
pub fn kinova_gen3() -> Result<RobotModel, RobotError> {
    let mut links = vec![LinkDescription::frame("world")];
    links.extend(LINKS.iter().map(|&(name, mass, com, inertia)| {
        let [xx, xy, xz, yy, yz, zz] = inertia;
        LinkDescription {
            mass,
            X_LI: Isometry3::from(Vector3::from(com)),
            inertia_I: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            ..LinkDescription::frame(name)
        }
    }));
    links.push(LinkDescription::frame("EndEffector_Link"));
    for (name, X_LS, shape) in kinova_gen3_shapes::shapes() {
        let link = links.iter_mut().find(|l| l.name == name);
        let link = link.ok_or_else(|| RobotError::MissingLink {
            joint: "collision shapes".to_owned(),
            link: name.to_owned(),
        })?;
        link.shapes.push((X_LS, shape));
    }

    let mut joints = vec![fixed(
        "Fix_world",
        "world",
        LINKS[0].0,
        Isometry3::identity(),
    )];
    for (k, &(xyz, roll, range, effort)) in JOINTS.iter().enumerate() {
        joints.push(JointDescription {
            name: format!("Actuator{}", k + 1),
            kind: Some(if range.is_finite() {
                JointKind::Revolute
            } else {
                JointKind::Continuous
            }),
            parent: LINKS[k].0.into(),
            child: LINKS[k + 1].0.into(),
            X_PJ: offset(xyz, roll),
            axis_J: Vector3::z(),
            limits: JointLimits {
                lower: -range,
                upper: range,
                effort,
                velocity: MAX_SPEED,
            },
        });
    }
    let flange = offset([0.0, 0.0, -0.061525], PI);
    joints.push(fixed("EndEffector", LINKS[7].0, "EndEffector_Link", flange));
    RobotModel::assemble(
        Description {
            name: "kinova_gen3".into(),
            links,
            joints,
            unread: Vec::new(),
        },
        None,
    )
}

fn offset(xyz: [f64; 3], roll: f64) -> Isometry3<f64> {
    Isometry3::from_parts(
        Vector3::from(xyz).into(),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), roll),
    )
}

fn fixed(name: &str, parent: &str, child: &str, X_PJ: Isometry3<f64>) -> JointDescription {
    JointDescription {
        name: name.into(),
        kind: None,
        parent: parent.into(),
        child: child.into(),
        X_PJ,
        axis_J: Vector3::z(),
        limits: JointLimits::NONE,
    }
}
