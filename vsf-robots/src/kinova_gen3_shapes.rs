//! Collision shapes of the Kinova Gen3: capsules that approximate its links.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use vsf_core::Shape;

/// Name of the link, ends of the capsule's segment in the link frame [m], radius [m].
type Row = (&'static str, [f64; 3], [f64; 3], f64);

#[rustfmt::skip]
const CAPSULES: [Row; 23] = [
    ("Base_Link", [0.0, 0.0, 0.031], [0.0, 0.0, 0.047], 0.0455),
    ("Base_Link", [0.0, 0.0, 0.047], [0.0, 0.0, 0.142], 0.0462),
    ("Shoulder_Link", [0.0, -0.012, -0.133], [0.0, -0.015, -0.112], 0.0445),
    ("Shoulder_Link", [0.02, 0.0145, -0.024], [-0.014, 0.02, -0.024], 0.0263),
    ("Shoulder_Link", [0.015, -0.016, -0.035], [-0.0146, -0.014, -0.033], 0.0341),
    ("HalfArm1_Link", [0.0187, -0.0224, -0.0273], [0.0089, 0.0213, -0.0259], 0.0285),
    ("HalfArm1_Link", [-0.0189, 0.0095, -0.0272], [0.0065, -0.1245, -0.028], 0.0281),
    ("HalfArm1_Link", [0.0, -0.1669, -0.0106], [0.0, -0.1975, -0.0057], 0.0456),
    ("HalfArm2_Link", [-0.0058, -0.0322, -0.136], [0.02, 0.0004, -0.033], 0.0287),
    ("HalfArm2_Link", [-0.0035, -0.0083, -0.0485], [-0.0039, 0.0023, -0.0368], 0.0406),
    ("HalfArm2_Link", [0.0016, -0.0108, -0.2035], [0.0, -0.0099, -0.2134], 0.0456),
    ("ForeArm_Link", [-0.0009, -0.199, -0.0062], [0.0, -0.1621, -0.0091], 0.0347),
    ("ForeArm_Link", [-0.0008, 0.0074, -0.0258], [0.0, -0.0113, -0.0281], 0.0398),
    ("ForeArm_Link", [-0.0026, -0.0683, -0.0369], [0.009, -0.2033, -0.0005], 0.0261),
    ("SphericalWrist1_Link", [0.0185, -0.026, -0.0562], [-0.0188, -0.0262, -0.0556], 0.0149),
    ("SphericalWrist1_Link", [0.0033, 0.0004, -0.0224], [-0.0033, -0.0016, -0.0229], 0.0325),
    ("SphericalWrist1_Link", [0.0002, -0.0125, -0.1051], [0.0001, -0.0195, -0.1042], 0.037),
    ("SphericalWrist2_Link", [0.0051, -0.0029, -0.0242], [-0.0029, 0.003, -0.0247], 0.0319),
    ("SphericalWrist2_Link", [0.0197, -0.0506, -0.0264], [-0.0197, -0.0442, -0.0282], 0.0148),
    ("SphericalWrist2_Link", [0.0, -0.0958, 0.0], [0.0, -0.0872, 0.0], 0.0358),
    ("Bracelet_Link", [0.0227, -0.0011, -0.0496], [-0.0031, 0.0236, -0.05], 0.0189),
    ("Bracelet_Link", [0.0034, -0.0235, -0.049], [-0.0228, -0.0024, -0.0496], 0.0185),
    ("Bracelet_Link", [0.0, 0.0, -0.0285], [0.0, 0.0, -0.0305], 0.0367),
];

/// Shapes with the name of their link and their pose in the link frame, `X_LS`.
pub(crate) fn shapes() -> Vec<(&'static str, Isometry3<f64>, Shape)> {
    CAPSULES
        .iter()
        .map(|&(link, a, b, radius)| {
            let (a, b) = (Point3::from(a), Point3::from(b));
            let along = b - a;
            let rotation =
                UnitQuaternion::rotation_between(&Vector3::z(), &along).unwrap_or_else(|| {
                    UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.0)
                });
            let shape = Shape::Capsule {
                radius,
                half_length: along.norm() / 2.0,
            };
            (
                link,
                Isometry3::from_parts((a + along / 2.0).into(), rotation),
                shape,
            )
        })
        .collect()
}
