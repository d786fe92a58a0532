//! Kinematics, capsules and weight of the arm.

use crate::gen3::{JOINT_FRAMES, LINKS};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Number of joints of the arm.
pub const JOINTS: usize = 7;

/// One value per joint.
pub type JointVector = [f64; JOINTS];

/// A force of the environment on a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// The link that it acts on: 0 is the base, `j` the link that joint `j` (from 1) moves.
    pub link: usize,
    /// Point of application, world frame \[m\].
    pub point: Point3<f64>,
    /// Force on the robot, world frame \[N\].
    pub force: Vector3<f64>,
}

/// A mass attached to the arm, such as that of a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Mass {
    pub link: usize,
    pub center: Point3<f64>,
    pub mass: f64,
}

/// A capsule in world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct WorldCapsule {
    pub link: usize,
    pub a: Point3<f64>,
    pub b: Point3<f64>,
    pub radius: f64,
}

impl WorldCapsule {
    /// Signed distance of a point, negative inside, and the outward normal.
    pub fn distance(&self, p: &Point3<f64>) -> (f64, Vector3<f64>) {
        let axis = self.b - self.a;
        let t = (p - self.a).dot(&axis) / axis.norm_squared();
        let d = p - (self.a + axis * t.clamp(0.0, 1.0));
        let length = d.norm();
        let normal = if length > 1e-9 {
            d / length
        } else {
            Vector3::z()
        };
        (length - self.radius, normal)
    }
}

/// The arm at given joint angles.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    frames: [Isometry3<f64>; JOINTS],
    base: Isometry3<f64>,
    /// Added to the radius of each link's capsules \[m\].
    padding: [f64; JOINTS + 1],
    poses: [Isometry3<f64>; JOINTS + 1],
}

impl Arm {
    /// The arm on its base, with all joints at zero.
    pub fn new(base: Isometry3<f64>) -> Self {
        let frames = JOINT_FRAMES.map(|(xyz, [r, p, y])| {
            Isometry3::from_parts(
                Translation3::from(xyz),
                UnitQuaternion::from_euler_angles(r, p, y),
            )
        });
        let mut arm = Self {
            frames,
            base,
            padding: [0.0; JOINTS + 1],
            poses: [base; JOINTS + 1],
        };
        arm.set(&[0.0; JOINTS]);
        arm
    }

    /// The same arm with links thicker by `padding` \[m\].
    pub(crate) fn padded(mut self, padding: [f64; JOINTS + 1]) -> Self {
        self.padding = padding;
        self
    }

    /// Moves the joints to the angles `q` \[rad\].
    pub fn set(&mut self, q: &JointVector) {
        self.poses[0] = self.base;
        for (j, angle) in q.iter().enumerate() {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), *angle);
            self.poses[j + 1] = self.poses[j] * self.frames[j] * turn;
        }
    }

    /// World poses of the base and the links.
    pub fn poses(&self) -> &[Isometry3<f64>; JOINTS + 1] {
        &self.poses
    }

    /// Joint torques of a force on the robot, `J^T f`.
    pub fn joint_torques(&self, touch: &Touch) -> JointVector {
        std::array::from_fn(|j| {
            if j < touch.link {
                let pose = &self.poses[j + 1];
                let arm = touch.point.coords - pose.translation.vector;
                (pose.rotation * Vector3::z()).dot(&arm.cross(&touch.force))
            } else {
                0.0
            }
        })
    }

    /// Collects the capsules in world coordinates, in a fixed order.
    pub(crate) fn capsules(&self, out: &mut Vec<WorldCapsule>) {
        out.clear();
        for (link, (part, pose)) in LINKS.iter().zip(&self.poses).enumerate() {
            out.extend(part.capsules.iter().map(|c| WorldCapsule {
                link,
                a: pose * Point3::from(c.a),
                b: pose * Point3::from(c.b),
                radius: c.radius + self.padding[link],
            }));
        }
    }

    /// Potential energy of masses in the field `gravity` \[m/s^2\].
    pub(crate) fn potential(&self, masses: &[Mass], gravity: &Vector3<f64>) -> f64 {
        let height = |m: &Mass| (self.poses[m.link] * m.center).coords.dot(gravity);
        -masses.iter().map(|m| m.mass * height(m)).sum::<f64>()
    }
}

/// The masses of the links.
pub(crate) fn link_masses() -> [Mass; JOINTS + 1] {
    std::array::from_fn(|link| Mass {
        link,
        center: Point3::from(LINKS[link].com),
        mass: LINKS[link].mass,
    })
}

/// Joint torques of gravity for an arm at `q`: minus the gradient of the potential energy, by central differences.
pub(crate) fn weight_torques(
    arm: &mut Arm,
    q: &JointVector,
    masses: &[Mass],
    gravity: &Vector3<f64>,
) -> JointVector {
    const STEP: f64 = 1e-5;
    std::array::from_fn(|j| {
        let mut energy = |step: f64| {
            let mut moved = *q;
            moved[j] += step;
            arm.set(&moved);
            arm.potential(masses, gravity)
        };
        -(energy(STEP) - energy(-STEP)) / (2.0 * STEP)
    })
}
