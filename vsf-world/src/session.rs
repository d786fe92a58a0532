//! Simulates a session: the arm touches the object, sequence after sequence.

use crate::arm::{Arm, JOINTS, JointVector, Touch, WorldCapsule};
use crate::effect::Effect;
use crate::motion::{RATE_HZ, SESSION_STEP_S, Trajectory};
use crate::object::{Meeting, Object, Physics};
use crate::sensor::{Rows, add};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Share of its remaining way that a deflection covers in a step. It follows the load of the previous step; the full way
/// would oscillate.
const FOLLOW: f64 = 0.5;

/// Joint torques of the touch alone: no weight, no friction, no noise. Every `stride`-th sample is simulated and returned.
pub(crate) fn touch_torques(
    object: &mut dyn Object,
    base: &Isometry3<f64>,
    friction: f64,
    plan: &[Trajectory],
    effects: &[Effect],
    stride: usize,
) -> Vec<Rows> {
    object.reset(&Physics::new(friction, effects));
    let mut arm = Arm::new(*base);
    let mut ball = None;
    for effect in effects {
        match effect {
            Effect::GeometryPadding { padding_m } => arm = arm.padded(*padding_m),
            Effect::SecondObject { .. } => ball = Ball::place(effect, &mut arm, plan),
            _ => {}
        }
    }
    let mut out = Vec::with_capacity(plan.len());
    for (s, sequence) in plan.iter().enumerate() {
        let placed = placement(object, effects, s);
        let mut run = Run {
            arm: &mut arm,
            effects,
            placed,
            shift: Vector3::zeros(),
            deflection: [0.0; JOINTS],
            dt: stride as f64 / RATE_HZ,
        };
        out.push(run.sequence(object, ball.as_ref(), sequence, stride));
        object.recover(SESSION_STEP_S - sequence.q.len() as f64 / RATE_HZ);
    }
    out
}

/// Pose of the object in sequence `s`, relative to its stated pose.
fn placement(object: &dyn Object, effects: &[Effect], s: usize) -> Isometry3<f64> {
    let [low, high] = object.bounds();
    let center = nalgebra::center(&low, &high).coords;
    let mut placed = Isometry3::identity();
    for effect in effects {
        if let Effect::RegistrationOffset {
            per_sequence_m,
            turn_rad,
        } = effect
        {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * turn_rad[s]);
            let to = Vector3::from(per_sequence_m[s]) + center - turn * center;
            placed = Isometry3::from_parts(Translation3::from(to), turn);
        }
    }
    placed
}

struct Run<'a> {
    arm: &'a mut Arm,
    effects: &'a [Effect],
    placed: Isometry3<f64>,
    /// Shift of the object as a whole \[m\].
    shift: Vector3<f64>,
    /// Deflection of the links from the encoder angles \[rad\].
    deflection: JointVector,
    dt: f64,
}

impl Run<'_> {
    fn sequence(
        &mut self,
        object: &mut dyn Object,
        ball: Option<&Ball>,
        sequence: &Trajectory,
        stride: usize,
    ) -> Rows {
        let mut capsules = Vec::new();
        let mut touches = Vec::new();
        let mut old: Option<[Isometry3<f64>; JOINTS + 1]> = None;
        let mut rows = Rows::with_capacity(sequence.q.len() / stride + 1);
        for q in sequence.q.iter().step_by(stride) {
            let mut linked = *q;
            add(&mut linked, &self.deflection, 1.0);
            self.arm.set(&linked);
            let frame = Translation3::from(self.shift) * self.placed;
            let poses = self.arm.poses().map(|pose| frame.inverse() * pose);
            let before = old.unwrap_or(poses);
            let motion = std::array::from_fn(|l| poses[l] * before[l].inverse());
            old = Some(poses);
            self.arm.capsules(&mut capsules);
            for c in &mut capsules {
                c.a = frame.inverse_transform_point(&c.a);
                c.b = frame.inverse_transform_point(&c.b);
            }
            touches.clear();
            object.step(
                &Meeting {
                    capsules: &capsules,
                    motion: &motion,
                    dt: self.dt,
                },
                &mut touches,
            );
            let mut tau = [0.0; JOINTS];
            let mut push = Vector3::zeros();
            for touch in &mut touches {
                touch.point = frame * touch.point;
                touch.force = frame * touch.force;
                push -= touch.force;
                add(&mut tau, &self.arm.joint_torques(touch), 1.0);
            }
            if let Some(touch) = ball.and_then(|ball| ball.touch(self.arm)) {
                add(&mut tau, &self.arm.joint_torques(&touch), 1.0);
            }
            self.give_way(&tau, &push);
            rows.push(tau);
        }
        rows
    }

    /// Updates gear, drive and base deflections for the load of this step.
    fn give_way(&mut self, tau: &JointVector, push: &Vector3<f64>) {
        let mut bent = [0.0; JOINTS];
        let mut shift = Vector3::zeros();
        for effect in self.effects {
            match effect {
                Effect::JointElasticity {
                    compliance,
                    hardening_nm,
                } => {
                    for j in 0..JOINTS {
                        let ease = (1.0 + (tau[j] / hardening_nm).powi(2)).sqrt();
                        bent[j] += compliance[j] * tau[j] / ease;
                    }
                }
                Effect::Backlash { play } => {
                    for j in 0..JOINTS {
                        // The teeth are pressed together fully at 0.3 N m.
                        bent[j] += play[j] * (tau[j] / 0.3).tanh();
                    }
                }
                Effect::ObjectBaseMotion {
                    compliance,
                    hardening_n,
                } => {
                    let ease = (1.0 + (push.norm() / hardening_n).powi(2)).sqrt();
                    shift += push.component_mul(&Vector3::from(*compliance)) / ease;
                }
                _ => {}
            }
        }
        for (d, bent) in self.deflection.iter_mut().zip(bent) {
            *d += FOLLOW * (bent - *d);
        }
        self.shift += (shift - self.shift) * FOLLOW;
    }
}

/// A second soft object: a ball that one link runs into.
struct Ball {
    center: Point3<f64>,
    radius: f64,
    link: usize,
    stiffness: f64,
}

impl Ball {
    /// Places the ball in the way of the link, at its deepest posture in the last sequence.
    fn place(effect: &Effect, arm: &mut Arm, plan: &[Trajectory]) -> Option<Self> {
        const RADIUS: f64 = 0.05;
        let Effect::SecondObject {
            link,
            stiffness,
            reach_m,
            bearing,
        } = effect
        else {
            return None;
        };
        let sequence = plan.last()?;
        let deepest = sequence
            .phases
            .iter()
            .rposition(|p| *p == crate::Phase::Hold);
        let deepest = deepest.unwrap_or(sequence.q.len() / 2);
        arm.set(&sequence.q[deepest]);
        let capsule = own_capsule(arm, *link)?;
        let axis = (capsule.b - capsule.a).normalize();
        let side = axis
            .cross(&Vector3::new(bearing.cos(), bearing.sin(), 0.3))
            .normalize();
        let out = capsule.radius + RADIUS - reach_m;
        let center = nalgebra::center(&capsule.a, &capsule.b) + side * out;
        Some(Self {
            center,
            radius: RADIUS,
            link: *link,
            stiffness: *stiffness,
        })
    }

    fn touch(&self, arm: &Arm) -> Option<Touch> {
        let (d, n) = own_capsule(arm, self.link)?.distance(&self.center);
        let depth = self.radius - d;
        (depth > 0.0).then(|| Touch {
            link: self.link,
            point: self.center - n * d,
            force: -n * (self.stiffness * depth),
        })
    }
}

/// The first capsule of a link.
fn own_capsule(arm: &Arm, link: usize) -> Option<WorldCapsule> {
    let mut capsules = Vec::new();
    arm.capsules(&mut capsules);
    capsules.into_iter().find(|c| c.link == link)
}
