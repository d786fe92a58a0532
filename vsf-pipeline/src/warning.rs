mod actuators;
mod air;
mod arm;
mod clock;
mod conventions;
mod fit;
mod gaps;
mod gravity;
mod joints;
mod jumps;
mod kind;
mod lag;
mod lost;
mod misread;
mod motion;
mod order;
mod readings;
mod saturation;
mod scale;
mod scene;
mod sensors;
mod spikes;
mod springs;
mod starts;
mod tare;
mod uncovered;
mod velocities;
mod weight;

pub use fit::{field_warnings, fit_warnings, health_warnings};
pub use kind::{Outliers, PipelineWarning};
pub use motion::motion_warnings;
pub use readings::reading_warnings;
pub use saturation::{Saturation, saturated_joints};
pub use scene::{scene_warnings, view_warnings};
pub use starts::touch_warnings;

use crate::PipelineError;
use vsf_core::Observation;
use vsf_robots::{Joint, JointKind};

/// What the checks of sequences refuse.
fn malformed(
    checked: impl Iterator<Item = (String, Result<(), PipelineError>)>,
) -> Vec<PipelineWarning> {
    let warning = |(sequence, check): (String, Result<_, PipelineError>)| {
        let problem = check.err()?.to_string();
        Some(PipelineWarning::Malformed { sequence, problem })
    };
    checked.filter_map(warning).collect()
}

/// Squared reading, over all joints.
fn energy(observation: &Observation<f64>) -> f64 {
    observation.reading().iter().map(|t| t * t).sum()
}

/// Unit of a joint's positions.
fn unit(joint: &Joint) -> &'static str {
    match joint.kind() {
        JointKind::Prismatic => "m",
        _ => "rad",
    }
}

/// ID and rows of a sequence.
type Rows<'a> = (&'a str, Vec<&'a [f64]>);

/// Values of column `j` that are `odd`.
fn outliers(
    joint: &Joint,
    j: usize,
    sequences: &[Rows],
    odd: impl Fn(f64) -> bool,
) -> Option<Outliers> {
    let mut found: Option<Outliers> = None;
    let mut total = 0;
    for (sequence, rows) in sequences {
        total += rows.len();
        let values = rows.iter().enumerate();
        let values = values.map(|(row, r)| (row, r[j]));
        for (row, value) in values.filter(|(_, v)| odd(*v)) {
            let entry = found.get_or_insert_with(|| Outliers {
                joint: joint.name().to_owned(),
                count: 0,
                total: 0,
                sequence: (*sequence).to_owned(),
                row,
                value,
            });
            entry.count += 1;
        }
    }
    found.map(|found| Outliers { total, ..found })
}
