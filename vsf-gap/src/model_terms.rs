use crate::campaign::goes_on;
use crate::{Campaign, Compensator, ContactLog, GapError, Model, Motion, Sample, Touch};
use nalgebra::Vector3;
use std::sync::Arc;
use vsf_core::{CoreError, Observation};

/// What a model predicts about one sample, given its contacts.
#[derive(Debug, Clone)]
pub struct ModelTerms {
    /// Spring displacements of the touched points (m, world), which the stiffness multiplies.
    pub springs: Vec<Vector3<f64>>,
    /// Gain of the field's torque per joint.
    pub gains: Vec<f64>,
    /// Torques that do not depend on the stiffness (N m or N).
    pub torques: Vec<f64>,
}

impl Campaign {
    /// Computes springs, gains and torques of a model over sequences whose contacts are known.
    ///
    /// Sequences are in session order, since what an effect does to the object persists from one sequence to the next.
    /// `visit` receives the index of the sequence, the row, the touch and the terms. Torques are relative to their mean
    /// over the tare samples, as the readings are.
    ///
    /// # Errors
    /// Parameters that an effect cannot take; contacts that do not belong to the sequences; effects whose springs, gains or
    /// torques are not finite.
    pub fn predict(
        &self,
        model: &Model,
        motions: &[&Motion],
        logs: &[Arc<ContactLog>],
        mut visit: impl FnMut(usize, usize, &Touch<'_>, &ModelTerms),
    ) -> Result<(), GapError> {
        let d = self.site.joints();
        CoreError::check_len("contacts of sequences", logs.len(), motions.len())?;
        for (motion, log) in motions.iter().zip(logs) {
            motion.check(d)?;
            log.check(&self.site, motion)?;
        }
        let mut effects = model.compensator(&self.site)?;
        let mut out = ModelTerms::new(d);
        for (s, (motion, log)) in motions.iter().zip(logs).enumerate() {
            if !goes_on(motions, s) {
                effects.begin_sequence(&motion.id);
            }
            let touch = |row| log.touch(&self.site, row);
            let tared = motion.tare.min(motion.len());
            let mut begin: Vec<ModelTerms> = Vec::with_capacity(tared);
            let mut offset = vec![0.0; d];
            for range in &motion.touches {
                effects.begin_touch();
                for row in range.clone() {
                    let sample = log.felt(motion.sample(row, range.start, log.forces[row]), row);
                    out.step(&mut *effects, &sample, &touch(row))
                        .map_err(|e| GapError::Model {
                            effect: model.name(),
                            problem: format!("sequence {} row {row}: {e}", motion.id),
                        })?;
                    if !log.rigid.is_empty() {
                        let rigid = &log.rigid[row * d..][..d];
                        out.torques.iter_mut().zip(rigid).for_each(|(t, r)| *t += r);
                    }
                    if row < tared {
                        add(&mut offset, &out.torques, 1.0 / tared as f64);
                        begin.push(out.clone());
                        if row + 1 < tared {
                            continue;
                        }
                        for (row, terms) in begin.iter_mut().enumerate() {
                            add(&mut terms.torques, &offset, -1.0);
                            visit(s, row, &touch(row), terms);
                        }
                    } else {
                        add(&mut out.torques, &offset, -1.0);
                        visit(s, row, &touch(row), &out);
                    }
                }
            }
        }
        Ok(())
    }
}

/// `to += times x`.
fn add(to: &mut [f64], x: &[f64], times: f64) {
    to.iter_mut().zip(x).for_each(|(t, x)| *t += times * x);
}

impl ModelTerms {
    /// Empty terms for a robot with this many joints.
    pub(crate) fn new(joints: usize) -> Self {
        Self {
            springs: Vec::new(),
            gains: vec![1.0; joints],
            torques: vec![0.0; joints],
        }
    }

    /// The columns `G W` with a reading.
    pub(crate) fn observation(
        &self,
        touch: &Touch<'_>,
        reading: &[f64],
        obs: &mut Observation<f64>,
    ) -> Result<(), CoreError> {
        let points = touch.contacts.points();
        obs.rebuild(touch.rest.len(), points, reading, |k, out| {
            self.column(touch, k, out)
        })
    }

    /// Computes the terms from the effects.
    ///
    /// # Errors
    /// Terms that are not finite.
    pub(crate) fn step(
        &mut self,
        effects: &mut dyn Compensator,
        sample: &Sample<'_>,
        touch: &Touch<'_>,
    ) -> Result<(), CoreError> {
        self.springs.clear();
        self.springs
            .extend_from_slice(touch.contacts.displacements());
        self.gains.fill(1.0);
        self.torques.fill(0.0);
        effects.springs(sample, touch, &mut self.springs);
        effects.gains(sample, touch, &mut self.gains);
        effects.torques(sample, touch, &mut self.torques);
        CoreError::check_finite("gains of the model", &self.gains)?;
        CoreError::check_finite("torques of the model", &self.torques)?;
        (self.springs.iter())
            .try_for_each(|s| CoreError::check_finite("springs of the model", s.as_slice()))
    }

    /// Writes the column `-G J(q, p + u)^T s` of contact `k` to `out`, one number per joint (m², or m for prismatic
    /// joints).
    ///
    /// # Panics
    /// If there is no such contact, if its point is not among the rest points, or if `out` is too short.
    pub fn column(&self, touch: &Touch<'_>, k: usize, out: &mut [f64]) {
        let contacts = touch.contacts;
        let point = contacts.points()[k] as usize;
        let p = touch.rest.positions()[point] + contacts.displacements()[k];
        let link = contacts.links()[k] as usize;
        touch
            .posture
            .joint_torques(link, &p, &-self.springs[k], out);
        out.iter_mut().zip(&self.gains).for_each(|(w, g)| *w *= g);
    }

    /// Writes the torques `G W K + a` for a stiffness per rest point to `out`.
    ///
    /// # Panics
    /// If a touched point is not among the rest points or has no stiffness, or if `out` is shorter than one torque per
    /// joint.
    pub fn apply(&self, touch: &Touch<'_>, stiffness: &[f64], out: &mut [f64]) {
        let contacts = touch.contacts;
        let none = Vector3::zeros();
        let (mut moment, mut force) = (none, none);
        let out = &mut out[..self.torques.len()];
        out.fill(0.0);
        for (k, (&p, u)) in (contacts.points().iter())
            .zip(contacts.displacements())
            .enumerate()
        {
            let pull = self.springs[k] * -stiffness[p as usize];
            let place = touch.rest.positions()[p as usize] + u;
            moment += place.coords.cross(&pull);
            force += pull;
            // Neighbors are mostly on one link, whose joints then feel them together.
            let link = contacts.links()[k];
            if contacts.links().get(k + 1) != Some(&link) {
                (touch.posture).add_torques(link as usize, &moment, &force, out);
                (moment, force) = (none, none);
            }
        }
        let model = self.gains.iter().zip(&self.torques);
        (out.iter_mut().zip(model)).for_each(|(t, (gain, torque))| *t = gain * *t + torque);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use vsf_core::{Contacts, RestPoints};
    use vsf_robots::planar_arm;

    /// Against the sum of all columns, over links that take turns and links with a run of points.
    #[test]
    fn apply_is_the_sum_of_the_columns() {
        let robot = planar_arm(4, 0.3, 0.03).unwrap();
        let mut posture = robot.posture();
        (robot.update_posture(&[0.3, -0.8, 1.1, 0.4], &mut posture)).unwrap();
        let wave = |k: f64| Vector3::new(k.sin(), (2.0 * k).cos(), (3.0 * k).sin());
        let places = (0..90).map(|k| Point3::from(0.5 * wave(0.7 * f64::from(k))));
        let rest = RestPoints::new(places.collect()).unwrap();
        let (mut contacts, mut springs) = (Contacts::new(), Vec::new());
        for k in (0..90).step_by(2) {
            let joint = if k < 40 { k / 2 % 4 } else { k / 30 };
            let link = robot.joints()[joint as usize].child() as u32;
            let u = 0.01 * wave(f64::from(k));
            contacts.push(k, link, u, Vector3::z()).unwrap();
            springs.push(0.02 * wave(0.3 * f64::from(k)));
        }
        let touch = Touch {
            rest: &rest,
            posture: &posture,
            contacts: &contacts,
        };
        let terms = ModelTerms {
            springs,
            gains: vec![1.0, 0.9, 1.2, -0.5],
            torques: vec![0.1, 0.0, -2.0, 0.3],
        };
        let stiffness: Vec<f64> = (0..90).map(|k| f64::from(k * 37 % 11)).collect();
        let mut found = [f64::NAN; 4];
        terms.apply(&touch, &stiffness, &mut found);
        let mut expected = terms.torques.clone();
        let mut sizes: Vec<f64> = expected.iter().map(|t| t.abs()).collect();
        let mut column = [0.0; 4];
        for (k, &p) in contacts.points().iter().enumerate() {
            terms.column(&touch, k, &mut column);
            add(&mut expected, &column, stiffness[p as usize]);
            add(&mut sizes, &column.map(f64::abs), stiffness[p as usize]);
        }
        for (j, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert!(expected.abs() > 1e-3 * sizes[j], "{j}: {expected}");
            let gap = (found - expected).abs();
            assert!(gap <= 1e-12 * sizes[j], "{j}: {found} {expected}");
        }
    }
}
