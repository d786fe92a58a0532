//! Scenes that are put together from parts: robots at hand, shapes of one's own.

use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;
use vsf_contact::{LinkSdf, Sdf, SdfSample};
use vsf_core::{Belief, ContactModel, Contacts, Noise, Observation, UpdateReport};
use vsf_data::{Dataset, RobotRef, Sequence, Table, TorqueKind};
use vsf_filter::FieldPrior;
use vsf_pipeline::{
    EstimatorSpec, FilterSpec, Hyper, PipelineError, PriorShape, Scene, SceneOptions, Trace,
    estimate, estimate_from, estimate_online, external_torques,
};
use vsf_robots::{RobotModel, UrdfOptions};

/// A pendulum with a ball at its end.
const ARM: &str = r#"<robot name="own"><link name="base"/><joint name="shoulder" type="revolute">
<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
<link name="arm"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.02"/></geometry></collision></link></robot>"#;

fn robot() -> RobotModel {
    RobotModel::from_urdf_str(ARM, ".", &UrdfOptions::default()).unwrap()
}

fn points() -> Vec<Point3<f64>> {
    let at = |i: usize, j: usize| Point3::new(0.48 + 0.01 * i as f64, 0.01 * j as f64, -0.05);
    (0..5).flat_map(|i| (0..3).map(move |j| at(i, j))).collect()
}

/// Swings down onto the points; the readings of its actuator, which hold its weight.
fn measured() -> Dataset {
    let q: Vec<f64> = (0..60).map(|k| 0.002 * f64::from(k)).collect();
    let time = (0..60).map(|k| 0.5 * f64::from(k)).collect();
    let table = |data: Vec<f64>| Table::new(1, data).unwrap();
    let weight = q.iter().map(|q| -2.0 * 9.81 * 0.3 * q.cos()).collect();
    let sequence = Sequence::new("s", time, table(q), table(weight));
    Dataset {
        torque_kind: TorqueKind::Measured,
        ..Dataset::new(
            RobotRef::resolve("own", ".".as_ref()).unwrap(),
            vec![sequence],
        )
    }
}

/// A robot that is in no file has its recordings read as what they are.
#[test]
fn a_robot_at_hand_takes_measured_torques() {
    let data = measured();
    let scene = Scene::with_robot(&data, robot(), points(), &SceneOptions::default()).unwrap();
    scene.check_recording(&data).unwrap();
    assert_eq!(scene.torque_kind(), TorqueKind::Measured);
    let external = external_torques(&scene, &data.sequences[0]).unwrap();
    // It moves slowly: what is left of its own weight is the inertia at 4 mrad/s.
    assert!(external.data().iter().all(|tau| tau.abs() < 1e-3));
    // It stands where the recording says.
    let raised = Dataset {
        base_pose: Isometry3::translation(0.0, 0.0, 1.0),
        ..measured()
    };
    for scene in [
        Scene::with_robot(&raised, robot(), points(), &SceneOptions::default()).unwrap(),
        Scene::in_air(&raised, robot()).unwrap(),
    ] {
        assert_eq!(scene.robot().base_pose().translation.z, 1.0);
    }
    let named = Dataset {
        joints: Some(vec!["elbow".to_owned()]),
        ..measured()
    };
    for found in [
        Scene::with_robot(&named, robot(), points(), &SceneOptions::default()),
        Scene::in_air(&named, robot()),
    ] {
        assert!(matches!(
            found,
            Err(PipelineError::JointMismatch { column: 1, .. })
        ));
    }
    let plain = Scene::new(robot(), points(), &SceneOptions::default()).unwrap();
    assert!(matches!(
        plain.check_recording(&data),
        Err(PipelineError::OtherScene {
            what: "torque_kind"
        })
    ));
}

/// A ball in closed form.
struct Ball;

impl Sdf for Ball {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        let from = p_B - Point3::new(0.5, 0.0, 0.0);
        SdfSample {
            distance: from.norm() - 0.02,
            normal: from.normalize(),
        }
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let half = Vector3::repeat(0.02);
        let center = Point3::new(0.5, 0.0, 0.0);
        (center - half, center + half)
    }
}

fn contacts(scene: &Scene, q: f64) -> Contacts {
    let mut posture = scene.robot().posture();
    scene.robot().update_posture(&[q], &mut posture).unwrap();
    let (mut contact, mut out) = (scene.contact_model().unwrap(), Contacts::new());
    contact.step(scene.rest(), &posture, &mut out).unwrap();
    out
}

#[test]
fn shapes_of_ones_own_touch_as_those_of_the_robot() {
    let scene = Scene::new(robot(), points(), &SceneOptions::default()).unwrap();
    let arm = scene.robot().link_index("arm").unwrap();
    let own = |link: usize| {
        let sdf = Arc::new(Ball);
        scene.with_link_shapes(vec![LinkSdf { link, sdf }])
    };
    let [theirs, ours] = [&scene, &own(arm).unwrap()].map(|s| contacts(s, 0.08));
    assert!(!theirs.is_empty());
    assert_eq!(theirs.points(), ours.points());
    for (a, b) in theirs.displacements().iter().zip(ours.displacements()) {
        assert!((a - b).norm() < 1e-9, "{a} {b}");
    }
    assert!(own(9).is_err());
    assert!(matches!(
        scene.with_link_shapes(Vec::new()),
        Err(PipelineError::NoShapes { .. })
    ));
}

/// A noise beside a trace is what a copy of the trace with that noise has, to the bit.
#[test]
fn online_estimates_take_a_noise_beside_the_trace() {
    let scene = Scene::new(robot(), points(), &SceneOptions::default()).unwrap();
    let trace = scene.trace(&measured().sequences[0]).unwrap();
    let noise = Noise::uniform(1, 0.3).unwrap();
    let run = |trace: &Trace, noise: Option<&Noise>| {
        let prior = Belief::<f64>::uniform(scene.rest().len(), 1.0, 5.0).unwrap();
        let mut filter = FilterSpec::replay()
            .build::<f64>(prior.into(), None)
            .unwrap();
        let mut seen = Vec::new();
        let see = |obs: &Observation<f64>, report: &UpdateReport| seen.push((obs.clone(), *report));
        estimate_online(&mut *filter, trace, noise, see).unwrap();
        (filter.belief().clone(), seen)
    };
    let copy = trace.with_noise(&noise).unwrap();
    assert_eq!(run(&trace, Some(&noise)), run(&copy, None));
    assert_ne!(run(&trace, None).0, run(&copy, None).0);
    let prior = Belief::<f64>::uniform(scene.rest().len(), 1.0, 5.0).unwrap();
    let mut filter = (FilterSpec::replay().build::<f64>(prior.into(), None)).unwrap();
    let foreign = Noise::uniform(2, 0.3).unwrap();
    let refused = estimate_online(&mut *filter, &trace, Some(&foreign), |_, _| {});
    assert!(matches!(
        refused,
        Err(PipelineError::Sequence { row: 0, .. })
    ));
}

/// An earlier field as the prior: where nothing is touched it stays, and a prior of no mean is the ordinary one.
#[test]
fn estimates_go_on_from_an_earlier_field() {
    let scene = Scene::new(robot(), points(), &SceneOptions::default()).unwrap();
    let trace: Trace = scene.trace(&measured().sequences[0]).unwrap();
    let touched = trace.observations.iter().any(|o| !o.is_empty());
    assert!(touched);
    let len = scene.rest().len();
    let earlier = Belief::new(vec![7.0; len], vec![4.0; len]).unwrap();
    let found = estimate_from(
        FieldPrior::from(earlier),
        std::slice::from_ref(&trace),
        &EstimatorSpec::Batch,
        &[0.5],
        |_| {},
    )
    .unwrap();
    let left = (0..len).filter(|p| !found.touched[*p]);
    assert!(left.clone().count() > 0);
    for p in left {
        assert_eq!(found.belief.mean()[p], 7.0);
    }
    let (prior_sd, shape) = (2.0, PriorShape::default());
    let hyper = Hyper {
        prior_sd,
        shape,
        noise_sd: vec![0.5],
    };
    let traces = std::slice::from_ref(&trace);
    let plain = estimate(scene.rest(), traces, &EstimatorSpec::Batch, &hyper, |_| {}).unwrap();
    let prior = shape
        .prior_about(scene.rest(), prior_sd, vec![0.0; len])
        .unwrap();
    let same = estimate_from(prior, traces, &EstimatorSpec::Batch, &[0.5], |_| {}).unwrap();
    assert_eq!(plain.belief, same.belief);
}
