//! Checks the arm against its readings: its mass, and what its joints can bear.

use super::{PipelineWarning, Rows, outliers};
use crate::{Scene, reading_unit};
use vsf_data::{Sequence, Table, TorqueKind};
use vsf_robots::{Joint, Link};

/// Readings above so many times what the joint can bear are of another unit.
const MOST_EFFORT: f64 = 10.0;

/// Reports what looks wrong with the arm. `rigid` are its rigid-body torques, sequence by sequence.
pub fn warnings(scene: &Scene, sequences: &[&Sequence], rigid: &[Table]) -> Vec<PipelineWarning> {
    let mut found = beyond_effort(scene, sequences, rigid);
    if scene.torque_kind() == TorqueKind::Measured {
        found.extend(weightless(scene));
        found.extend(impossible_inertia(scene));
    }
    found
}

/// Torques far beyond what joints can bear: that were read, or, of actuators, that the arm itself would take.
fn beyond_effort(scene: &Scene, sequences: &[&Sequence], rigid: &[Table]) -> Vec<PipelineWarning> {
    let ids = || sequences.iter().map(|s| s.id.as_str());
    let read: Vec<Rows> = ids()
        .zip(sequences.iter().map(|s| s.torques.iter().collect()))
        .collect();
    let own: Vec<Rows> = match scene.torque_kind() {
        TorqueKind::Measured => ids()
            .zip(rigid.iter().map(|r| r.iter().collect()))
            .collect(),
        _ => Vec::new(),
    };
    let of_joint = |(j, joint): (usize, &Joint)| {
        let (effort, unit) = (joint.limits().effort, reading_unit(joint));
        let strong = |tau: f64| tau.abs() > MOST_EFFORT * effort;
        let read =
            outliers(joint, j, &read, strong).map(|outliers| PipelineWarning::BeyondEffort {
                effort,
                unit,
                outliers,
            });
        read.or_else(|| {
            Some(PipelineWarning::HeavyArm {
                effort,
                unit,
                outliers: outliers(joint, j, &own, strong)?,
            })
        })
    };
    let joints = scene.robot().joints().iter().enumerate();
    joints.filter_map(of_joint).collect()
}

/// Bodies without mass, where their weight is needed; frames have no shape. Of an arm without any shapes, all bodies if
/// none has a mass.
fn weightless(scene: &Scene) -> Option<PipelineWarning> {
    let robot = scene.robot();
    let colliders = robot.colliders();
    let weighs =
        |(l, link): (usize, &Link)| link.mass() > 0.0 && !robot.chains().chain(l).is_empty();
    let is_light = !robot.links().iter().enumerate().any(weighs);
    let has_shape = |name: &str| (colliders.iter()).any(|c| robot.links()[c.link].name() == name);
    let links: Vec<&str> = (robot.links_without_inertia())
        .map(|link| link.name())
        .filter(|name| is_light && colliders.is_empty() || has_shape(name))
        .collect();
    (!links.is_empty()).then(|| PipelineWarning::Weightless {
        links: links.join(", "),
    })
}

/// Bodies whose inertia none can have.
fn impossible_inertia(scene: &Scene) -> Option<PipelineWarning> {
    let links: Vec<&str> = (scene.robot().links_with_impossible_inertia())
        .map(|link| link.name())
        .collect();
    (!links.is_empty()).then(|| PipelineWarning::ImpossibleInertia {
        links: links.join(", "),
    })
}
