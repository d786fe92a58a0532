//! Data of the Kinova Gen3 with seven joints.
//!
//! Joint frames and inertial parameters are those of the manufacturer's description. The capsules were fitted for this
//! world; recordings say so in their `robot/robot.urdf`.

use crate::arm::JOINTS;
use std::fmt::Write;

/// A moving or fixed part of the arm, with the joint that carries it.
pub(crate) struct Link {
    pub name: &'static str,
    /// Mass \[kg\], center of mass \[m\], and `[ixx, ixy, ixz, iyy, iyz, izz]` about it.
    pub mass: f64,
    pub com: [f64; 3],
    pub inertia: [f64; 6],
    pub capsules: &'static [Capsule],
}

/// A capsule of a link: ends and radius \[m\] in the frame of the link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Capsule {
    pub a: [f64; 3],
    pub b: [f64; 3],
    pub radius: f64,
}

const fn capsule(a: [f64; 3], b: [f64; 3], radius: f64) -> Capsule {
    Capsule { a, b, radius }
}

/// The base and the seven moving links, from the base to the hand.
pub(crate) const LINKS: [Link; JOINTS + 1] = [
    Link {
        name: "Base_Link",
        mass: 1.697,
        com: [-0.000648, -0.000166, 0.084487],
        inertia: [0.004622, 9e-6, 6e-5, 0.004495, 9e-6, 0.002079],
        capsules: &[capsule([0.0, 0.0, 0.046], [0.0, 0.0, 0.128], 0.0462)],
    },
    Link {
        name: "Shoulder_Link",
        mass: 1.3773,
        com: [-2.3e-5, -0.010364, -0.07336],
        inertia: [0.00457, 1e-6, 2e-6, 0.004831, 0.000448, 0.001409],
        capsules: &[capsule([0.0, -0.001, -0.03], [0.0, -0.011, -0.118], 0.0452)],
    },
    Link {
        name: "HalfArm1_Link",
        mass: 1.1636,
        com: [-4.4e-5, -0.09958, -0.013278],
        inertia: [0.011088, 5e-6, 0.0, 0.001072, -0.000691, 0.011255],
        capsules: &[
            capsule([0.0, -0.004, -0.016], [0.0, -0.118, -0.019], 0.0405),
            capsule([0.0, -0.118, -0.019], [0.0, -0.198, -0.0075], 0.0438),
        ],
    },
    Link {
        name: "HalfArm2_Link",
        mass: 1.1636,
        com: [-4.4e-5, -0.006641, -0.117892],
        inertia: [0.010932, 0.0, -7e-6, 0.011127, 0.000606, 0.001043],
        capsules: &[
            capsule([0.0, -0.002, -0.026], [0.0, -0.009, -0.132], 0.0410),
            capsule([0.0, -0.009, -0.132], [0.0, -0.008, -0.204], 0.0436),
        ],
    },
    Link {
        name: "ForeArm_Link",
        mass: 0.9302,
        com: [-1.8e-5, -0.075478, -0.015006],
        inertia: [0.008147, -1e-6, 0.0, 0.000631, -0.0005, 0.008316],
        capsules: &[
            capsule([0.0, -0.003, -0.022], [0.0, -0.106, -0.019], 0.0385),
            capsule([0.0, -0.106, -0.019], [0.0, -0.199, -0.0068], 0.0357),
        ],
    },
    Link {
        name: "SphericalWrist1_Link",
        mass: 0.6781,
        com: [1e-6, -0.009432, -0.063883],
        inertia: [0.001596, 0.0, 0.0, 0.001607, 0.000256, 0.000399],
        capsules: &[capsule(
            [0.0, -0.006, -0.022],
            [0.0, -0.013, -0.101],
            0.0342,
        )],
    },
    Link {
        name: "SphericalWrist2_Link",
        mass: 0.6781,
        com: [1e-6, -0.045483, -0.00965],
        inertia: [0.001641, 0.0, 0.0, 0.00041, -0.000278, 0.001641],
        capsules: &[capsule(
            [0.0, -0.008, -0.019],
            [0.0, -0.091, -0.003],
            0.0348,
        )],
    },
    Link {
        name: "Bracelet_Link",
        mass: 0.5006,
        com: [-0.000281, -0.011402, -0.029798],
        inertia: [0.000587, 3e-6, 3e-6, 0.000369, 0.000118, 0.000609],
        capsules: &[
            capsule([0.0, 0.0, -0.026], [0.0, 0.0, -0.034], 0.0368),
            capsule([0.021, -0.006, -0.0475], [0.002, 0.022, -0.0495], 0.0192),
            capsule([-0.021, 0.006, -0.0475], [-0.002, -0.022, -0.0495], 0.0188),
        ],
    },
];

/// Pose of joint `j + 1` in the frame of link `j`, `xyz` \[m\] and `rpy` \[rad\]. The joint turns link `j + 1` about its z
/// axis. Angles are rounded as in the manufacturer's description.
#[allow(clippy::approx_constant)]
pub(crate) const JOINT_FRAMES: [([f64; 3], [f64; 3]); JOINTS] = [
    ([0.0, 0.0, 0.15643], [3.1416, 0.0, 0.0]),
    ([0.0, 0.005375, -0.12838], [1.5708, 0.0, 0.0]),
    ([0.0, -0.21038, -0.006375], [-1.5708, 0.0, 0.0]),
    ([0.0, 0.006375, -0.21038], [1.5708, 0.0, 0.0]),
    ([0.0, -0.20843, -0.006375], [-1.5708, 0.0, 0.0]),
    ([0.0, 0.00017505, -0.10593], [1.5708, 0.0, 0.0]),
    ([0.0, -0.10593, -0.00017505], [-1.5708, 0.0, 0.0]),
];

/// Largest angle of a joint in either direction \[rad\]; infinite for continuous joints.
pub(crate) const LIMITS: [f64; JOINTS] = [
    f64::INFINITY,
    2.41,
    f64::INFINITY,
    2.66,
    f64::INFINITY,
    2.23,
    f64::INFINITY,
];

const EFFORT: [f64; JOINTS] = [39.0, 39.0, 39.0, 39.0, 9.0, 9.0, 9.0];

/// The arm as URDF text, with every capsule as one cylinder and two spheres.
pub(crate) fn urdf() -> String {
    let mut out = String::from(
        "<?xml version=\"1.0\"?>\n\
         <!-- Kinova Gen3 (7 joints): kinematics and inertials; collision shapes are capsules,\n     \
         each one cylinder and two spheres of the same radius. Lengths in meters. -->\n\
         <robot name=\"gen3_capsules\">\n  <link name=\"world\"/>\n",
    );
    let text = |v: &[f64; 3]| format!("{} {} {}", v[0], v[1], v[2]);
    for link in &LINKS {
        let [ixx, ixy, ixz, iyy, iyz, izz] = link.inertia;
        let _ = write!(
            out,
            "  <link name=\"{}\">\n    <inertial>\n      <origin xyz=\"{}\" rpy=\"0 0 0\"/>\n      \
             <mass value=\"{}\"/>\n      <inertia ixx=\"{ixx}\" ixy=\"{ixy}\" ixz=\"{ixz}\" \
             iyy=\"{iyy}\" iyz=\"{iyz}\" izz=\"{izz}\"/>\n    </inertial>\n",
            link.name,
            text(&link.com),
            link.mass
        );
        for (k, c) in link.capsules.iter().enumerate() {
            out.push_str(&collision(k, c));
        }
        out.push_str("  </link>\n");
    }
    out.push_str("  <link name=\"EndEffector_Link\"/>\n");
    joint(
        &mut out,
        "Fix_world",
        "fixed",
        ["world", LINKS[0].name],
        "0 0 0",
        "0 0 0",
        "",
    );
    for (j, (xyz, rpy)) in JOINT_FRAMES.iter().enumerate() {
        let (kind, range) = if LIMITS[j].is_finite() {
            (
                "revolute",
                format!("lower=\"-{0}\" upper=\"{0}\" ", LIMITS[j]),
            )
        } else {
            ("continuous", String::new())
        };
        let more = format!(
            "    <axis xyz=\"0 0 1\"/>\n    <limit {range}effort=\"{}\" velocity=\"0.8727\"/>\n",
            EFFORT[j]
        );
        joint(
            &mut out,
            &format!("Actuator{}", j + 1),
            kind,
            [LINKS[j].name, LINKS[j + 1].name],
            &text(xyz),
            &text(rpy),
            &more,
        );
    }
    let hand = [LINKS[JOINTS].name, "EndEffector_Link"];
    joint(
        &mut out,
        "EndEffector",
        "fixed",
        hand,
        "0 0 -0.061525",
        "3.141592654 0 0",
        "",
    );
    out.push_str("</robot>\n");
    out
}

fn joint(
    out: &mut String,
    name: &str,
    kind: &str,
    [parent, child]: [&str; 2],
    xyz: &str,
    rpy: &str,
    more: &str,
) {
    let _ = write!(
        out,
        "  <joint name=\"{name}\" type=\"{kind}\">\n    <origin xyz=\"{xyz}\" rpy=\"{rpy}\"/>\n    \
         <parent link=\"{parent}\"/>\n    <child link=\"{child}\"/>\n{more}  </joint>\n"
    );
}

fn collision(k: usize, c: &Capsule) -> String {
    let d: [f64; 3] = std::array::from_fn(|i| c.b[i] - c.a[i]);
    let mid: [f64; 3] = std::array::from_fn(|i| 0.5 * (c.a[i] + c.b[i]));
    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Rz(yaw) Ry(pitch) turns the cylinder's z axis into d.
    let pitch = (d[2] / length).clamp(-1.0, 1.0).acos();
    let yaw = d[1].atan2(d[0]);
    let r = c.radius;
    let part = |name: &str, p: &[f64; 3], rpy: String, shape: String| {
        format!(
            "    <collision name=\"capsule{k}_{name}\"><origin xyz=\"{:.12} {:.12} {:.12}\" rpy=\"{rpy}\"/>\
             <geometry><{shape}/></geometry></collision>\n",
            p[0], p[1], p[2]
        )
    };
    let zero = || "0 0 0".to_owned();
    let sphere = || format!("sphere radius=\"{r}\"");
    part(
        "side",
        &mid,
        format!("0 {pitch:.12} {yaw:.12}"),
        format!("cylinder radius=\"{r}\" length=\"{length:.12}\""),
    ) + &part("end0", &c.a, zero(), sphere())
        + &part("end1", &c.b, zero(), sphere())
}
