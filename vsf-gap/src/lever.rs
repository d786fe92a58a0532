use crate::windows::Windows;
use crate::{Campaign, ContactLog, center};
use faer::Mat;
use std::sync::Arc;

/// Error of the place where the contact force acts (m) when the force is wrong by all of its size: about the thickness of a
/// link.
const PLACE: f64 = 0.1;
/// Columns of [`Campaign::lever`]: of a force, and of a shift of its place, along each axis.
pub(crate) const LEVERS: usize = 6;

impl Campaign {
    /// The joint torques of contact errors, over windows.
    ///
    /// Per axis of the world, there are three columns for a force as large as that of the window, and three for a shift of
    /// the place where that force acts, by [`PLACE`]. What contact leaves unexplained is of this form, whatever its cause.
    pub(crate) fn lever(&self, logs: &[Arc<ContactLog>], windows: &Windows) -> Mat<f64> {
        let d = windows.joints;
        let mut lever = Mat::zeros(windows.rows(), LEVERS);
        for (i, w) in windows.list.iter().enumerate() {
            let log = &logs[w.sequence];
            let share = 1.0 / w.rows.len() as f64;
            for row in w.rows.clone() {
                let touch = log.touch(&self.site, row);
                let Some((link, p)) = center(&touch) else {
                    continue;
                };
                let force = log.forces[row];
                for &j in touch.posture.chains().chain(link) {
                    let j = j as usize;
                    let screw = &touch.posture.screws()[j];
                    let of_force = force.norm() * screw.velocity_at(&p);
                    // f . (omega x shift), linear in the shift.
                    let of_place = PLACE * force.cross(&screw.angular);
                    for axis in 0..3 {
                        lever[(i * d + j, axis)] += share * of_force[axis];
                        lever[(i * d + j, 3 + axis)] += share * of_place[axis];
                    }
                }
            }
        }
        lever
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::{Model, Motion};
    use nalgebra::{Point3, Vector3};
    use vsf_data::{Dataset, RobotRef, Sequence, Table};
    use vsf_pipeline::SceneOptions;

    /// An arm in the vertical plane lifts into points, with its last link or the one before. To the joints that carry the
    /// link, which turn about -y, a force that acts further along x is a moment of its z component, one further along z of
    /// its x component, whichever joint it is; the others feel nothing. As many samples as it takes for windows of several.
    #[test]
    fn val_levers_are_forces_and_moments() {
        let arm = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
        let rows = 1000;
        let of = |k: i32, most: f64| most * f64::from(k) / f64::from(rows);
        for (from, carried) in [(0.65, 3), (0.35, 2)] {
            let sweep = (0..rows).flat_map(|k| [of(k, 0.25), 0.0, 0.0]);
            let torques = (0..rows).flat_map(|k| [-0.06, -0.04, -0.01].map(|t| of(k, 60.0 * t)));
            let time = (0..rows).map(|k| f64::from(k) / 500.0).collect();
            let table = |values: Vec<f64>| Table::new(3, values).unwrap();
            let [sweep, torques] = [sweep.collect(), torques.collect()].map(table);
            let points = (0..20).map(|k| Point3::new(from + 0.01 * f64::from(k), 0.0, 0.06));
            let dataset = Dataset {
                rest_points: Some(points.collect()),
                ..Dataset::new(arm.clone(), vec![Sequence::new("0", time, sweep, torques)])
            };
            let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
            let motions: Vec<&Motion> = campaign.train.iter().collect();
            let logs = campaign.contact_logs(&Model::default(), &motions).unwrap();
            let windows = campaign.windows(&motions);
            let lever = campaign.lever(&logs, &windows);
            let mut pushes = 0;
            for (i, w) in windows.list.iter().enumerate() {
                assert!(w.rows.len() > 1);
                let mut expected = [[0.0; LEVERS]; 3];
                let mut force = Vector3::zeros();
                for row in w.rows.clone() {
                    let share = 1.0 / w.rows.len() as f64;
                    let touch = logs[0].touch(&campaign.site, row);
                    let Some((_, p)) = center(&touch) else {
                        continue;
                    };
                    let f = logs[0].forces[row];
                    force += share * f;
                    for (j, expected) in expected.iter_mut().enumerate().take(carried) {
                        let axis = touch.posture.link_poses()[j + 1].translation.vector;
                        let arm = p.coords - axis;
                        // The arm turns from x to z.
                        let by_force = [-arm.z, 0.0, arm.x].map(|v| f.norm() * v);
                        let by_place = [f.z, 0.0, -f.x].map(|v| PLACE * v);
                        let all = by_force.into_iter().chain(by_place);
                        expected
                            .iter_mut()
                            .zip(all)
                            .for_each(|(e, v)| *e += share * v);
                    }
                }
                for (j, expected) in expected.iter().enumerate() {
                    for (l, expected) in expected.iter().enumerate() {
                        let found = lever[(3 * i + j, l)];
                        assert!(
                            (found - expected).abs() < 1e-12,
                            "{j} {l}: {found} {expected}"
                        );
                    }
                }
                pushes += usize::from(force.norm() > 0.01);
            }
            assert!(pushes > 3, "{pushes}");
        }
    }

    /// A stage does not turn: where a force acts, it does not feel.
    #[test]
    fn a_stage_has_no_moments() {
        let stage = RobotRef::resolve("cartesian_stage", ".".as_ref()).unwrap();
        let table = |values: Vec<f64>| Table::new(3, values).unwrap();
        let path = (0..40)
            .flat_map(|k| [0.0, 0.0, 0.01 - 5e-4 * f64::from(k)])
            .collect();
        let forces = (0..40)
            .flat_map(|k| [0.0, 0.1, 0.1 * f64::from(k)])
            .collect();
        let time = (0..40).map(|k| f64::from(k) / 100.0).collect();
        let dataset = Dataset {
            rest_points: Some(vec![Point3::origin(), Point3::new(0.003, 0.0, 0.0)]),
            ..Dataset::new(
                stage,
                vec![Sequence::new("0", time, table(path), table(forces))],
            )
        };
        let campaign = Campaign::open(&dataset, &SceneOptions::default()).unwrap();
        let motions: Vec<&Motion> = campaign.train.iter().collect();
        let logs = campaign.contact_logs(&Model::default(), &motions).unwrap();
        let windows = campaign.windows(&motions);
        let lever = campaign.lever(&logs, &windows);
        let size = |l: usize| lever.col_as_slice(l).iter().map(|v| v.abs()).sum::<f64>();
        assert!((0..3).all(|l| size(l) > 0.1) && (3..LEVERS).all(|l| size(l) == 0.0));
    }
}
