//! Collision shapes of the Kinova Gen3: unions of primitives, fitted to the maker's link meshes.
//!
//! The straight ends of a link are cylinders that stop flush at the joint faces. The shapes of the
//! bend between them were added one by one where the mesh stuck out most, and exchanged while that
//! helped. Each time all parameters were refitted by least squares, from several random starts, to
//! signed distances at points on the mesh and 2 to 8 mm outside it. Bends are symmetric about the
//! yz-plane, as the links are. Lengths are rounded to 0.1 mm.
//!
//! The table gives the deviation over the outer surface (mesh points whose outward directions are free
//! by more than 15 %) as median / 90th percentile / maximum in millimeters. Parts that a neighboring
//! link hides (joint faces, collars and the cup on top of the base) are not counted.
//!
//! | link | shapes | mesh to shapes | shapes to mesh |
//! | --- | --- | --- | --- |
//! | `Base_Link` | 2 | 0.07 / 0.21 / 6.7 | 0.07 / 0.21 / 3.0 |
//! | `Shoulder_Link` | 6 | 0.31 / 1.32 / 3.5 | 0.36 / 1.52 / 4.1 |
//! | `HalfArm1_Link` | 6 | 0.43 / 1.58 / 5.3 | 0.48 / 1.80 / 6.0 |
//! | `HalfArm2_Link` | 6 | 0.63 / 1.82 / 5.4 | 0.61 / 1.88 / 6.2 |
//! | `ForeArm_Link` | 7 | 0.36 / 1.21 / 4.6 | 0.40 / 1.40 / 5.7 |
//! | `SphericalWrist1_Link` | 6 | 0.25 / 1.16 / 3.5 | 0.31 / 1.46 / 5.6 |
//! | `SphericalWrist2_Link` | 6 | 0.34 / 1.16 / 3.2 | 0.35 / 1.35 / 4.1 |
//! | `Bracelet_Link` | 3 | 0.05 / 0.31 / 1.9 | 0.05 / 0.34 / 0.6 |
//! | last four | 22 | 0.24 / 1.06 / 4.6 | 0.24 / 1.21 / 5.7 |
//!
//! The collars inside the neighboring links, the screw holes and the buttons are left out.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use vsf_core::Shape;

/// Link, centers of the two end faces in the link frame, radius, rounding of the edges, in meters.
type CylinderRow = (&'static str, [f64; 3], [f64; 3], f64, f64);

#[rustfmt::skip]
const CYLINDERS: [CylinderRow; 23] = [
    ("Base_Link",            [0.0, 0.0, 0.0], [0.0, 0.0, 0.1708], 0.0459, 0.0),
    ("Shoulder_Link",        [0.0, 0.0, -0.0437], [0.0, 0.0, -0.0144], 0.0457, 0.0),
    ("Shoulder_Link",        [0.0, -0.0362, -0.1283], [0.0, 0.0198, -0.1283], 0.0458, 0.0),
    ("Shoulder_Link",        [0.0, -0.0139, -0.1665], [0.0, -0.0183, -0.1214], 0.0323, 0.0084),
    ("HalfArm1_Link",        [0.0, 0.0, -0.0432], [0.0, 0.0, -0.0144], 0.0456, 0.0),
    ("HalfArm1_Link",        [0.0, -0.2248, -0.0064], [0.0, -0.1781, -0.0064], 0.0458, 0.0),
    ("HalfArm2_Link",        [0.0, 0.0, -0.0501], [0.0, 0.0, -0.0144], 0.0449, 0.0),
    ("HalfArm2_Link",        [0.0, -0.0322, -0.2102], [0.0, 0.0208, -0.2102], 0.0457, 0.0),
    ("HalfArm2_Link",        [0.0, -0.0474, -0.2134], [0.0, 0.0104, -0.2133], 0.0432, 0.0233),
    ("ForeArm_Link",         [0.0, 0.0, -0.0455], [0.0, 0.0, -0.0144], 0.0452, 0.0),
    ("ForeArm_Link",         [0.0, -0.2209, -0.0064], [0.0, -0.1709, -0.0064], 0.0348, 0.0),
    ("SphericalWrist1_Link", [0.0, 0.0, -0.0344], [0.0, 0.0, -0.0125], 0.0348, 0.0),
    ("SphericalWrist1_Link", [0.0, -0.0338, -0.1059], [0.0, 0.0126, -0.1059], 0.0349, 0.0),
    ("SphericalWrist1_Link", [0.0, 0.0006, -0.1081], [0.0, -0.0513, -0.102], 0.0355, 0.0261),
    ("SphericalWrist1_Link", [0.0, -0.0166, -0.0619], [0.0, -0.0392, -0.0565], 0.0228, 0.0),
    ("SphericalWrist1_Link", [0.0, 0.0062, -0.0484], [0.0, -0.004, -0.0078], 0.0336, 0.0177),
    ("SphericalWrist2_Link", [0.0, 0.0, -0.0363], [0.0, 0.0, -0.0124], 0.0347, 0.0),
    ("SphericalWrist2_Link", [0.0, -0.1184, -0.0004], [0.0, -0.0659, -0.0004], 0.0347, 0.0),
    ("SphericalWrist2_Link", [0.0, -0.0053, -0.0509], [0.0, 0.001, -0.0036], 0.0353, 0.0238),
    ("SphericalWrist2_Link", [0.0, -0.0446, -0.0406], [0.0, -0.038, -0.0176], 0.0257, 0.0119),
    ("Bracelet_Link",        [0.0, 0.0, -0.0644], [0.0, 0.0, -0.0318], 0.0374, 0.0),
    ("Bracelet_Link",        [0.0, 0.0, -0.0644], [0.0, 0.0, -0.0243], 0.0364, 0.0),
    ("Bracelet_Link",        [0.0, 0.0, -0.0644], [0.0, 0.0, -0.0125], 0.0353, 0.0),
];

/// Link, center and radius of the ball at one end in the link frame, and at the other end, in meters.
type RoundConeRow = (&'static str, [f64; 3], f64, [f64; 3], f64);

#[rustfmt::skip]
const ROUND_CONES: [RoundConeRow; 7] = [
    ("HalfArm1_Link",        [0.0052, 0.0002, -0.0534], 0.0038, [0.0148, -0.1584, -0.015], 0.0298),
    ("HalfArm1_Link",        [-0.0052, 0.0002, -0.0534], 0.0038, [-0.0148, -0.1584, -0.015], 0.0298),
    ("HalfArm1_Link",        [0.0, -0.0333, -0.0489], 0.0001, [0.0, -0.1808, -0.0073], 0.0449),
    ("HalfArm2_Link",        [0.0054, -0.049, -0.2024], 0.0001, [0.0086, -0.0062, -0.0497], 0.0356),
    ("HalfArm2_Link",        [-0.0054, -0.049, -0.2024], 0.0001, [-0.0086, -0.0062, -0.0497], 0.0356),
    ("ForeArm_Link",         [0.0076, -0.0875, -0.034], 0.0157, [0.0023, -0.1677, -0.0076], 0.0323),
    ("ForeArm_Link",         [-0.0076, -0.0875, -0.034], 0.0157, [-0.0023, -0.1677, -0.0076], 0.0323),
];

/// Link, center in the link frame, rotation about x (rad), half extents, rounding of the edges; lengths in meters.
type BoxRow = (&'static str, [f64; 3], f64, [f64; 3], f64);

#[rustfmt::skip]
const BOXES: [BoxRow; 12] = [
    ("Base_Link",            [-0.02, 0.0, 0.0475], 0.0, [0.026, 0.031, 0.0475], 0.003),
    ("Shoulder_Link",        [0.0, -0.0301, -0.095], 1.517, [0.0451, 0.0505, 0.0102], 0.0102),
    ("Shoulder_Link",        [0.0, -0.0052, -0.0377], -1.0648, [0.0454, 0.0215, 0.039], 0.0215),
    ("Shoulder_Link",        [0.0, -0.0308, -0.094], 1.5339, [0.034, 0.0684, 0.015], 0.015),
    ("HalfArm1_Link",        [0.0, -0.0409, -0.0365], 1.5023, [0.0367, 0.0132, 0.0771], 0.0132),
    ("HalfArm2_Link",        [0.0, -0.0241, -0.1075], 1.4567, [0.0376, 0.0923, 0.0129], 0.0129),
    ("ForeArm_Link",         [0.0, -0.0148, -0.0418], 1.5143, [0.0353, 0.0106, 0.0485], 0.0106),
    ("ForeArm_Link",         [0.0, -0.107, -0.0295], 1.3428, [0.0312, 0.0106, 0.0531], 0.0106),
    ("ForeArm_Link",         [0.0, -0.0395, -0.039], 1.4891, [0.0258, 0.0144, 0.0565], 0.0144),
    ("SphericalWrist1_Link", [0.0, -0.0279, -0.0674], -0.3235, [0.0325, 0.0096, 0.0366], 0.0096),
    ("SphericalWrist2_Link", [0.0, -0.0388, -0.0284], 1.2393, [0.0326, 0.0086, 0.0339], 0.0086),
    ("SphericalWrist2_Link", [0.0, -0.0688, -0.0032], -1.2696, [0.0278, 0.0341, 0.0137], 0.0137),
];

/// Pose of a shape whose axis of symmetry runs from `a` to `b`, and half the length between them.
fn along(a: [f64; 3], b: [f64; 3]) -> (Isometry3<f64>, f64) {
    let (a, b) = (Point3::from(a), Point3::from(b));
    let axis = b - a;
    let rotation = UnitQuaternion::rotation_between(&Vector3::z(), &axis)
        .unwrap_or_else(|| UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.0));
    let center = a + axis / 2.0;
    (
        Isometry3::from_parts(center.into(), rotation),
        axis.norm() / 2.0,
    )
}

/// Shapes with the name of their link and their pose in the link frame, `X_LS`.
pub(crate) fn shapes() -> Vec<(&'static str, Isometry3<f64>, Shape)> {
    let cylinders = CYLINDERS.iter().map(|&(link, a, b, radius, rounding)| {
        let (X_LS, half_length) = along(a, b);
        let shape = Shape::Cylinder {
            radius,
            half_length,
            rounding,
        };
        (link, X_LS, shape)
    });
    let cones = ROUND_CONES
        .iter()
        .map(|&(link, a, radius_bottom, b, radius_top)| {
            let (X_LS, half_length) = along(a, b);
            let shape = Shape::RoundCone {
                radius_bottom,
                radius_top,
                half_length,
            };
            (link, X_LS, shape)
        });
    let boxes = BOXES
        .iter()
        .map(|&(link, center, roll, half_extents, rounding)| {
            let turn = UnitQuaternion::from_euler_angles(roll, 0.0, 0.0);
            let shape = Shape::Box {
                half_extents: half_extents.into(),
                rounding,
            };
            (link, Isometry3::from_parts(center.into(), turn), shape)
        });
    cylinders.chain(cones).chain(boxes).collect()
}
