//! What goes wrong while an arm touches, with every estimator: nothing of it may spoil a field.

#![allow(clippy::unwrap_used)]

use std::sync::Arc;
use vsf::contact::{ContactConfig, StickSlip, link_sdfs};
use vsf::core::nalgebra::Point3;
use vsf::core::{Belief, Estimator, Noise, Prediction, RestPoints, Session};
use vsf::filter::{
    CovarianceFilter, DiagonalKalman, DualReplay, InformationFilter, MemoryReplay, RobustLoss,
    RobustNoise,
};
use vsf::robots::{JointTorques, RobotModel, planar_arm};

const NOISE_SD: f64 = 0.01;
const STEPS: usize = 30;
/// Turn of the first joint that presses the arm 1.5 cm deep into the block.
const DEEPEST: f64 = 0.07;

type AnySession = Session<StickSlip, JointTorques, Box<dyn Estimator<Scalar = f64>>>;

/// An arm of 0.9 m in so many links, along x, and a block above its end.
struct Arm {
    robot: RobotModel,
    rest: Arc<RestPoints>,
    contact: StickSlip,
}

impl Arm {
    fn new(joints: usize) -> Self {
        let block = (0..100).map(|i| {
            let at = |from: f64, k: usize| from + 0.015 * k as f64;
            Point3::new(at(0.75, i % 5), at(-0.02, i / 25), at(0.045, i / 5 % 5))
        });
        Self::at(joints, block.collect())
    }

    /// With these points in place of the block.
    fn at(joints: usize, points: Vec<Point3<f64>>) -> Self {
        let robot = planar_arm(joints, 0.9 / joints as f64, 0.03).unwrap();
        let links = link_sdfs(robot.colliders(), &Default::default()).unwrap();
        Self {
            contact: StickSlip::new(links.links, ContactConfig::default()).unwrap(),
            rest: Arc::new(RestPoints::new(points).unwrap()),
            robot,
        }
    }

    fn session(&self, estimator: Box<dyn Estimator<Scalar = f64>>, sd: f64) -> AnySession {
        let noise = Noise::uniform(self.robot.joint_count(), sd).unwrap();
        let (chains, rest) = (self.robot.chains().clone(), self.rest.clone());
        let contact = self.contact.clone();
        Session::new(chains, rest, contact, JointTorques::new(noise), estimator).unwrap()
    }

    /// A session of every estimator; the prior and the deviation of the noise are given.
    fn sessions(&self, mean: f64, sd: f64, noise_sd: f64) -> Vec<(&'static str, AnySession)> {
        let prior = || Belief::<f64>::uniform(self.rest.len(), mean, sd).unwrap();
        let replay =
            || MemoryReplay::new(DiagonalKalman::new(prior()), Default::default()).unwrap();
        let robust = RobustNoise::new(replay(), RobustLoss::HUBER).unwrap();
        let all: [(_, Box<dyn Estimator<Scalar = f64>>); 6] = [
            ("diagonal", Box::new(DiagonalKalman::new(prior()))),
            (
                "dual",
                Box::new(DualReplay::new(prior(), Default::default()).unwrap()),
            ),
            ("replay", Box::new(replay())),
            ("robust", Box::new(robust)),
            (
                "covariance",
                Box::new(CovarianceFilter::new(prior()).unwrap()),
            ),
            (
                "information",
                Box::new(InformationFilter::new(prior()).unwrap()),
            ),
        ];
        all.map(|(name, e)| (name, self.session(e, noise_sd)))
            .into()
    }

    /// Predicted torques of a push by the first joint to `turn`, step by step, of a field of this
    /// stiffness.
    fn torques(&self, stiffness: f64, turn: f64) -> Vec<Vec<f64>> {
        let belief = Belief::uniform(self.rest.len(), stiffness, 1e-9).unwrap();
        let mut known = self.session(Box::new(DiagonalKalman::new(belief)), NOISE_SD);
        self.predicted(&mut known, turn)
    }

    fn predicted(&self, session: &mut AnySession, turn: f64) -> Vec<Vec<f64>> {
        let mut out = Prediction::default();
        session.begin_touch();
        let predict = |step| {
            session
                .predict(&self.posture(turn, step), &mut out)
                .unwrap();
            out.mean.clone()
        };
        (0..STEPS).map(predict).collect()
    }

    fn posture(&self, turn: f64, step: usize) -> vsf::core::Posture {
        let mut q = vec![0.0; self.robot.joint_count()];
        q[0] = turn * (step + 1) as f64 / STEPS as f64;
        let mut posture = self.robot.posture();
        self.robot.update_posture(&q, &mut posture).unwrap();
        posture
    }

    /// Pushes with these readings; `times` says how often each sample comes.
    fn push(
        &self,
        session: &mut AnySession,
        readings: &[Vec<f64>],
        times: impl Fn(usize) -> usize,
    ) {
        session.begin_touch();
        for (step, tau) in readings.iter().enumerate() {
            for _ in 0..times(step) {
                session.step(&self.posture(DEEPEST, step), tau).unwrap();
            }
        }
    }
}

fn norm(tau: &[f64]) -> f64 {
    tau.iter().map(|t| t * t).sum::<f64>().sqrt()
}

fn peak(torques: &[Vec<f64>]) -> f64 {
    torques.iter().map(|tau| norm(tau)).fold(0.0, f64::max)
}

/// Error of the predicted push, as a share of the largest torques.
fn error(arm: &Arm, session: &mut AnySession, truth: &[Vec<f64>]) -> f64 {
    let predicted = arm.predicted(session, DEEPEST);
    let off = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a - b).collect();
    let off: Vec<Vec<f64>> = predicted.iter().zip(truth).map(off).collect();
    peak(&off) / peak(truth)
}

#[test]
fn arms_of_one_joint_and_of_many() {
    for joints in [1, 2, 32] {
        let arm = Arm::new(joints);
        let truth = arm.torques(20.0, DEEPEST);
        assert!(peak(&truth) > 0.1);
        for (name, mut session) in arm.sessions(0.0, 30.0, NOISE_SD) {
            arm.push(&mut session, &truth, |_| 1);
            arm.push(&mut session, &truth, |_| 1);
            let error = error(&arm, &mut session, &truth);
            assert!(error < 0.05, "{joints} joints, {name}: {error}");
        }
    }
}

#[test]
fn no_points() {
    let arm = Arm::at(3, Vec::new());
    for (name, mut session) in arm.sessions(5.0, 30.0, NOISE_SD) {
        arm.push(&mut session, &vec![vec![0.1; 3]; STEPS], |_| 1);
        assert!(session.belief().is_empty(), "{name}");
        assert_eq!(peak(&arm.predicted(&mut session, DEEPEST)), 0.0, "{name}");
    }
}

/// What is far away changes nothing, however much of it there is.
#[test]
fn ten_million_points() {
    let near = Arm::new(3);
    let mut points = near.rest.positions().to_vec();
    let at = |k: usize| 0.01 * k as f64;
    points.extend(
        (0..10_000_000)
            .map(|i| Point3::new(1.0 + at(i % 200), at(i / 200 % 200), 1.0 + at(i / 40_000))),
    );
    let far = Arm::at(3, points);
    let truth = near.torques(20.0, DEEPEST);
    let [expected, found] = [near, far].map(|arm| {
        let prior = Belief::<f64>::uniform(arm.rest.len(), 0.0, 30.0).unwrap();
        let replay = MemoryReplay::new(DiagonalKalman::new(prior), Default::default()).unwrap();
        let mut session = arm.session(Box::new(replay), NOISE_SD);
        arm.push(&mut session, &truth, |_| 1);
        arm.predicted(&mut session, DEEPEST)
    });
    assert_eq!(expected, found);
}

#[test]
fn samples_that_are_lost_or_come_again() {
    let arm = Arm::new(3);
    let truth = arm.torques(20.0, DEEPEST);
    for (name, mut session) in arm.sessions(0.0, 30.0, NOISE_SD) {
        arm.push(&mut session, &truth, |step| [3, 0, 1, 0, 0, 2][step % 6]);
        arm.push(&mut session, &truth, |step| [0, 0, 1, 5, 0, 1][step % 6]);
        let error = error(&arm, &mut session, &truth);
        // Contact slips otherwise over longer ways, so that readings are not those of the same points.
        assert!(error < 0.25, "{name}: {error}");
    }
}

/// What was clipped is taken as it was read: the largest torques come out between the limit and the truth.
#[test]
fn sensors_that_saturate() {
    let arm = Arm::new(3);
    let truth = arm.torques(20.0, DEEPEST);
    let whole = peak(&truth);
    let most = 0.5 * whole;
    let clipped: Vec<Vec<f64>> = truth
        .iter()
        .map(|tau| tau.iter().map(|t| t.clamp(-most, most)).collect())
        .collect();
    // Dual replay has not come down yet after so few readings that contradict each other.
    let mut sessions = arm.sessions(0.0, 30.0, NOISE_SD);
    sessions.retain(|(name, _)| *name != "dual");
    for (name, mut session) in sessions {
        arm.push(&mut session, &clipped, |_| 1);
        arm.push(&mut session, &clipped, |_| 1);
        let predicted = arm.predicted(&mut session, DEEPEST);
        let highest = peak(&predicted);
        assert!(
            (most..whole).contains(&highest),
            "{name}: {highest} of {whole}"
        );
    }
}

#[test]
fn a_sequence_without_contact() {
    let arm = Arm::new(3);
    for (name, mut session) in arm.sessions(5.0, 30.0, NOISE_SD) {
        let before = session.belief().clone();
        for step in 0..STEPS {
            let report = session
                .step(&arm.posture(-DEEPEST, step), &[0.1; 3])
                .unwrap();
            assert_eq!(report.contacts, 0, "{name}");
        }
        assert_eq!(*session.belief(), before, "{name}");
        let predicted = arm.predicted(&mut session, -DEEPEST);
        assert!(predicted.iter().all(|tau| norm(tau) == 0.0), "{name}");
    }
}

#[test]
fn objects_that_are_not_there_and_objects_like_steel() {
    let arm = Arm::new(3);
    let nothing = vec![vec![0.0; 3]; STEPS];
    let guessed = peak(&arm.torques(20.0, DEEPEST));
    for (name, mut session) in arm.sessions(20.0, 30.0, NOISE_SD) {
        arm.push(&mut session, &nothing, |_| 1);
        arm.push(&mut session, &nothing, |_| 1);
        let left = peak(&arm.predicted(&mut session, DEEPEST));
        assert!(left < 0.05 * guessed, "{name}: {left} of {guessed}");
    }
    // Read by sensors for such forces, which have more noise, and as precisely as all else.
    for (scale, noise_sd) in [(1e9, 1e7), (1e5, NOISE_SD)] {
        let truth = arm.torques(20.0 * scale, DEEPEST);
        for (name, mut session) in arm.sessions(0.0, 30.0 * scale, noise_sd) {
            arm.push(&mut session, &truth, |_| 1);
            arm.push(&mut session, &truth, |_| 1);
            let error = error(&arm, &mut session, &truth);
            assert!(error < 0.05, "{name}: {error}");
        }
    }
}

/// Variances and noise that no double can hold together: a step is refused, or the field is one.
#[test]
fn stiffness_beyond_all_numbers() {
    let arm = Arm::new(3);
    let torques = arm.torques(20.0, DEEPEST);
    for scale in [1e12, 1e100, 1e150, 1e300] {
        for (name, mut session) in arm.sessions(0.0, 1e150_f64.min(scale), NOISE_SD) {
            session.begin_touch();
            for (step, tau) in torques.iter().enumerate() {
                let before = session.belief().clone();
                let tau: Vec<f64> = tau.iter().map(|t| t * scale).collect();
                let done = session.step(&arm.posture(DEEPEST, step), &tau);
                let belief = session.belief();
                if done.is_err() {
                    assert_eq!(*belief, before, "{name}");
                }
                Belief::new(belief.mean().to_vec(), belief.variance().to_vec()).unwrap();
            }
        }
    }
}
