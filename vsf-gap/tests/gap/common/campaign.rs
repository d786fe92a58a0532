//! Campaigns from rows that a test writes by hand.

use nalgebra::{Point3, Vector3};
use vsf_data::{Dataset, RobotRef, Sequence, Table, TorqueKind};
use vsf_gap::{Campaign, Model};
use vsf_pipeline::{Scene, SceneOptions};
use vsf_robots::{RobotModel, UrdfOptions};

/// A plate that faces down, on three linear axes; its lower face is at the joint positions.
const PLATE: &str = "<robot name='plate'><link name='l0'/>
    <joint name='x' type='prismatic'><axis xyz='1 0 0'/><parent link='l0'/><child link='l1'/>
    <limit lower='-1' upper='1' effort='1' velocity='1'/></joint><link name='l1'/>
    <joint name='y' type='prismatic'><axis xyz='0 1 0'/><parent link='l1'/><child link='l2'/>
    <limit lower='-1' upper='1' effort='1' velocity='1'/></joint><link name='l2'/>
    <joint name='z' type='prismatic'><axis xyz='0 0 1'/><parent link='l2'/><child link='l3'/>
    <limit lower='-1' upper='1' effort='1' velocity='1'/></joint>
    <link name='l3'><collision><origin xyz='0 0 0.1'/>
    <geometry><box size='0.4 0.4 0.2'/></geometry></collision></link></robot>";

/// Samples per second.
pub const RATE: f64 = 100.0;

/// Joint positions and torques of one sequence.
pub type Rows = Vec<Reading>;

/// Joint positions and torques of one sample.
pub type Reading = (Vec<f64>, Vec<f64>);

fn dataset(
    robot: RobotRef,
    kind: TorqueKind,
    points: Option<&[[f64; 3]]>,
    rows: &[Rows],
) -> Dataset {
    let sequence = |(id, rows): (usize, &Rows)| {
        let table = |part: fn(&Reading) -> &Vec<f64>| {
            let all = rows.iter().flat_map(|row| part(row).clone()).collect();
            Table::new(part(&rows[0]).len(), all).unwrap()
        };
        let time = (0..rows.len()).map(|k| k as f64 / RATE).collect();
        Sequence::new(
            id.to_string(),
            time,
            table(|row| &row.0),
            table(|row| &row.1),
        )
    };
    let sequences: Vec<_> = rows.iter().enumerate().map(sequence).collect();
    Dataset {
        torque_kind: kind,
        gravity: Vector3::new(0.0, 0.0, -super::GRAVITY),
        rest_points: points.map(|p| p.iter().map(|p| Point3::from(*p)).collect()),
        ..Dataset::new(robot, sequences)
    }
}

/// The plate presses rest points; contact as in the paper.
pub fn plate(points: &[[f64; 3]], rows: &[Rows]) -> Campaign {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plate.urdf");
    std::fs::write(&path, PLATE).unwrap();
    let options = SceneOptions {
        subdivision: 1,
        ..SceneOptions::default()
    };
    let dataset = dataset(
        RobotRef::resolve("plate.urdf", folder.path()).unwrap(),
        TorqueKind::External,
        Some(points),
        rows,
    );
    Campaign::open(&dataset, &options).unwrap()
}

/// The built-in planar arm moves in free air; its readings are those of the actuators.
pub fn free_arm(rows: &[Rows]) -> Campaign {
    free_arm_tared(rows, 0)
}

/// An arm of one link in free air, [`free_arm_tared`] for the rest.
pub fn free_link_tared(rows: &[Rows], tare_samples: usize) -> Campaign {
    let robot = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
    let dataset = Dataset {
        tare_samples,
        ..dataset(robot, TorqueKind::Measured, None, rows)
    };
    let robot = vsf_robots::planar_arm(1, 0.3, 0.03).unwrap();
    Campaign::in_scene(&dataset, Scene::in_air(&dataset, robot).unwrap()).unwrap()
}

/// Two jaws, neither of which carries the other, in free air.
pub fn free_jaws(rows: &[Rows]) -> Campaign {
    let jaw = |name: &str| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="0 0 0.05"/><mass value="0.2"/>
              <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
            <joint name="turns_{name}" type="revolute"><parent link="palm"/><child link="{name}"/><axis xyz="0 1 0"/>
              <limit lower="-2" upper="2" effort="10" velocity="10"/></joint>"#
        )
    };
    let urdf = format!(
        r#"<robot name="jaws"><link name="palm"/>{}{}</robot>"#,
        jaw("left"),
        jaw("right")
    );
    let robot = RobotModel::from_urdf_str(&urdf, ".", &UrdfOptions::default()).unwrap();
    let named = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
    let dataset = dataset(named, TorqueKind::Measured, None, rows);
    Campaign::in_scene(&dataset, Scene::in_air(&dataset, robot).unwrap()).unwrap()
}

/// [`free_arm`] whose readings are relative to their mean over the first samples.
pub fn free_arm_tared(rows: &[Rows], tare_samples: usize) -> Campaign {
    let robot = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
    let dataset = Dataset {
        tare_samples,
        ..dataset(robot, TorqueKind::Measured, None, rows)
    };
    Campaign::open(&dataset, &SceneOptions::default()).unwrap()
}

/// Torques of all sequences, train before test, each with a fresh object, where every point has the
/// stiffness `k` (N/m).
pub fn torques(campaign: &Campaign, model: &Model, k: f64) -> Vec<f64> {
    let stiffness = vec![k; campaign.site().rest.len()];
    let mut all = Vec::new();
    let mut out = vec![0.0; campaign.site().joints()];
    for motion in campaign.train().iter().chain(campaign.test()) {
        let logs = campaign.contact_logs(model, &[motion]).unwrap();
        let visit = |_, _, touch: &vsf_gap::Touch<'_>, terms: &vsf_gap::ModelTerms| {
            terms.apply(touch, &stiffness, &mut out);
            all.extend_from_slice(&out);
        };
        campaign.predict(model, &[motion], &logs, visit).unwrap();
    }
    all
}
