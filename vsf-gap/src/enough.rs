use crate::{Campaign, GapError, Motion};
use vsf_data::TorqueKind;

/// Consecutive samples that the noise is read from, and the number of such runs that suffice.
const SHORTEST_RUN: usize = 4;
const FEWEST_RUNS: usize = 8;
/// Most joints: every pair may be coupled, and all pairs are held at once.
const MOST_JOINTS: usize = 48;
/// Most means over windows. Each sequence has at least one per joint, and matrices of this size squared are factored.
const MOST_MEANS: usize = 5200;
/// A joint that moves by less than this (rad or m) stands still.
const STILL: f64 = 1e-3;

/// Checks that the train sequences have readings, can tell noise from a gap and a gap from a constant, and that there are
/// no more joints and sequences than a diagnosis can handle.
pub(crate) fn enough(campaign: &Campaign) -> Result<(), GapError> {
    let joints = campaign.site.joints();
    if joints > MOST_JOINTS {
        return Err(GapError::TooMuch {
            what: "joints",
            problem: format!(
                "the robot has {joints}, a diagnosis takes {MOST_JOINTS} at most; make joints that stand still fixed ones"
            ),
        });
    }
    for (split, motions) in [("train", &campaign.train), ("test", &campaign.test)] {
        if motions.len() * joints > MOST_MEANS {
            return Err(GapError::TooMuch {
                what: "sequences",
                problem: format!(
                    "the {split} split has {}, a diagnosis takes {} at most of {joints} joints; put several touches into a \
                     sequence (touch_starts), or choose some (--train and --test of the command)",
                    motions.len(),
                    MOST_MEANS / joints
                ),
            });
        }
    }
    if campaign.train.is_empty() {
        return Err(GapError::TooLittle {
            what: "train sequences",
            problem: "there are none; give the recording a train split".to_owned(),
        });
    }
    let is_read = |m: &Motion| match campaign.site.torque_kind {
        TorqueKind::External => m.reading.data().iter().any(|r| *r != 0.0),
        TorqueKind::Measured => m.reading != m.load,
    };
    if !campaign.train.iter().any(is_read) {
        return Err(GapError::TooLittle {
            what: "torques of the train sequences",
            problem: "all are zero, as of planned motions; record what the joints feel".to_owned(),
        });
    }
    let runs: usize = (campaign.train.iter())
        .map(|m| (m.len() + 1).saturating_sub(SHORTEST_RUN))
        .sum();
    if runs < FEWEST_RUNS {
        return Err(GapError::TooLittle {
            what: "train samples",
            problem: format!(
                "noise is read from {SHORTEST_RUN} samples in a row, of which there are {runs} in the train sequences \
                 and {FEWEST_RUNS} are needed; record longer sequences"
            ),
        });
    }
    let rows = || campaign.train.iter().flat_map(|m| m.q.iter());
    let range = |j: usize| {
        let (low, high) = rows().fold((f64::MAX, f64::MIN), |(low, high), q| {
            (low.min(q[j]), high.max(q[j]))
        });
        high - low
    };
    if (0..campaign.site.joints()).all(|j| range(j) < STILL) {
        return Err(GapError::TooLittle {
            what: "motion in the train sequences",
            problem: format!(
                "no joint moves by {STILL} rad (or m), so that any constant explains the readings; record motion"
            ),
        });
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::fmt::Write;
    use vsf_data::{Dataset, RobotRef, Sequence, Table};
    use vsf_pipeline::SceneOptions;

    /// A thousand pokes, each a sequence, make a covariance of 392 MB.
    #[test]
    fn very_many_sequences_are_refused() {
        let robot = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
        let of = |count: usize| {
            let sequence = |k: usize| {
                let rows: Vec<f64> = (0..30).map(|i| 0.01 * f64::from(i)).collect();
                let table = || Table::new(3, rows.clone()).unwrap();
                let time = (0..10).map(f64::from).collect();
                Sequence::new(k.to_string(), time, table(), table())
            };
            let mut dataset = Dataset::new(robot.clone(), (0..=count).map(sequence).collect());
            dataset.splits.test = dataset.splits.train.split_off(count);
            enough(&Campaign::open(&dataset, &SceneOptions::default()).unwrap())
        };
        of(MOST_MEANS / 3).unwrap();
        let error = of(MOST_MEANS / 3 + 1).unwrap_err().to_string();
        assert!(
            error.contains("has 1734, a diagnosis takes 1733 at most of 3 joints"),
            "{error}"
        );
    }

    /// Every pair of joints may be coupled: of 250 joints that is 93 GB of places to start from.
    #[test]
    fn arms_of_very_many_joints_are_refused() {
        for joints in [MOST_JOINTS, MOST_JOINTS + 1, 250] {
            let mut urdf = String::from("<robot name='snake'><link name='l0'/>");
            for j in 0..joints {
                let (child, axis) = (j + 1, ["1 0 0", "0 1 0"][j % 2]);
                write!(
                    urdf,
                    "<link name='l{child}'><inertial><origin xyz='0.1 0 0'/><mass value='0.1'/>
                     <inertia ixx='1e-4' iyy='1e-4' izz='1e-4' ixy='0' ixz='0' iyz='0'/></inertial></link>
                     <joint name='j{j}' type='continuous'><parent link='l{j}'/><child link='l{child}'/>
                     <origin xyz='0.2 0 0'/><axis xyz='{axis}'/></joint>"
                )
                .unwrap();
            }
            urdf += "</robot>";
            let folder = tempfile::tempdir().unwrap();
            std::fs::write(folder.path().join("snake.urdf"), urdf).unwrap();
            let table = || {
                let sweep = (0..40 * joints).map(|k| 0.01 * (k / joints) as f64);
                Table::new(joints, sweep.collect()).unwrap()
            };
            let sequence = |id: &str| {
                let time = (0..40).map(f64::from).collect();
                Sequence::new(id, time, table(), table())
            };
            let robot = RobotRef::resolve("snake.urdf", folder.path()).unwrap();
            let dataset = Dataset::new(robot, vec![sequence("0"), sequence("1")]);
            let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
            let result = enough(&campaign);
            if joints == MOST_JOINTS {
                result.unwrap();
            } else {
                let error = result.unwrap_err().to_string();
                assert!(
                    error.contains(&format!("has {joints}, a diagnosis takes 48")),
                    "{error}"
                );
            }
        }
    }
}
