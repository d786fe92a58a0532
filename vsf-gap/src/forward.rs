use crate::campaign::goes_on;
use crate::effect::{Acts, Compensator, Effect, RandomWalk, Sample, Touch, check, follows_contact};
use crate::{Campaign, GapError, Motion, Site};
use nalgebra::{Matrix3, Point3, Vector3};
use std::sync::Arc;
use vsf_contact::ContactConfig;
use vsf_core::{ContactModel, Contacts, CoreError, JointScrew, Observation, Posture};
use vsf_data::TorqueKind;
use vsf_pipeline::{Scene, SceneContact};
use vsf_robots::DynamicsWorkspace;

/// Effects with their parameters: a model of the recording.
#[derive(Clone, Default)]
pub struct Model {
    /// The effects in it and their parameters.
    pub parts: Vec<(Arc<dyn Effect>, Vec<f64>)>,
}

impl Model {
    /// The nominal model with one effect added.
    pub fn of(effect: &Arc<dyn Effect>, theta: &[f64]) -> Self {
        Self {
            parts: vec![(effect.clone(), theta.to_vec())],
        }
    }

    /// This model with one more effect.
    #[must_use]
    pub fn with(&self, effect: &Arc<dyn Effect>, theta: &[f64]) -> Self {
        let mut model = self.clone();
        model.parts.push((effect.clone(), theta.to_vec()));
        model
    }

    /// Whether parameters of any of the effects are relative to the contact that they were found in, such as the
    /// distance from which on points are touched.
    pub fn follows_contact(&self) -> bool {
        self.parts
            .iter()
            .any(|(effect, _)| follows_contact(effect.as_ref()))
    }

    /// The deepest that any of the effects acts.
    pub fn acts(&self) -> Acts {
        let acts = self.parts.iter().map(|(effect, _)| effect.acts());
        acts.max().unwrap_or(Acts::Torques)
    }

    /// The compensators, in order.
    ///
    /// # Errors
    /// Parameters of another number, not finite, or that an effect cannot take.
    pub fn compensators(&self, site: &Site) -> Result<Vec<Box<dyn Compensator>>, GapError> {
        let make = |(effect, theta): &(Arc<dyn Effect>, Vec<f64>)| {
            check(effect.name(), theta, effect.parameters(site).len())?;
            Ok(Box::new(Declared {
                acts: effect.acts(),
                inner: effect.compensator(site, theta)?,
            }) as Box<dyn Compensator>)
        };
        self.parts.iter().map(make).collect()
    }

    /// How its effects stray from what their parameters say.
    ///
    /// # Errors
    /// Walks of another number of joints or not finite.
    pub(crate) fn random_walks(&self, site: &Site) -> Result<Vec<RandomWalk>, GapError> {
        let walk = |(effect, theta): &(Arc<dyn Effect>, Vec<f64>)| {
            let walk = effect.random_walk(site, theta)?;
            let checked = walk.check(site.joints()).map(|()| walk);
            Some(checked.map_err(|e| GapError::Model {
                effect: effect.name().to_owned(),
                problem: e.to_string(),
            }))
        };
        self.parts.iter().filter_map(walk).collect()
    }

    /// The names of its effects, in one text.
    fn name(&self) -> String {
        let names: Vec<&str> = self.parts.iter().map(|(e, _)| e.name()).collect();
        names.join(" and ")
    }
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let parts = self.parts.iter().map(|(e, theta)| (e.name(), theta));
        f.debug_map().entries(parts).finish()
    }
}

/// A compensator that does no more than its effect says it [acts](Effect::acts) on: contacts are shared between
/// models by that.
struct Declared {
    acts: Acts,
    inner: Box<dyn Compensator>,
}

impl Compensator for Declared {
    fn begin_sequence(&mut self, sequence: &str) {
        self.inner.begin_sequence(sequence);
    }

    fn begin_touch(&mut self) {
        self.inner.begin_touch();
    }

    fn joints(&mut self, sample: &Sample<'_>, q: &mut [f64]) {
        if self.acts == Acts::Contact {
            self.inner.joints(sample, q);
        }
    }

    fn motion(&mut self, sample: &Sample<'_>, qd: &mut [f64], qdd: &mut [f64]) {
        if self.acts == Acts::Contact {
            self.inner.motion(sample, qd, qdd);
        }
    }

    fn contact(&self, config: &mut ContactConfig) {
        if self.acts == Acts::Contact {
            self.inner.contact(config);
        }
    }

    fn object_shift(&mut self, sample: &Sample<'_>) -> Vector3<f64> {
        match self.acts {
            Acts::Contact => self.inner.object_shift(sample),
            Acts::Springs | Acts::Torques => Vector3::zeros(),
        }
    }

    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        if self.acts >= Acts::Springs {
            self.inner.springs(sample, touch, springs);
        }
    }

    fn gains(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, gains: &mut [f64]) {
        self.inner.gains(sample, touch, gains);
    }

    fn torques(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        self.inner.torques(sample, touch, tau);
    }
}

/// Where the robot was and what it touched, at every sample of a sequence.
#[derive(Debug, Clone)]
pub struct ContactLog {
    /// Postures, in the frame of the object.
    pub postures: Vec<Posture>,
    /// Contacts.
    pub contacts: Vec<Contacts>,
    /// Force on the robot that explains the readings best (N, world).
    pub forces: Vec<Vector3<f64>>,
    /// What the rigid body adds to the reading because the links are not where the recording has
    /// them (N m or N); empty where the readings leave it out.
    pub rigid: Vec<f64>,
    /// Positions, velocities and accelerations of all joints as the links moved, row after row.
    pub moved: Vec<f64>,
}

impl ContactLog {
    /// The sample of a row with the motion of the links.
    fn felt<'a>(&'a self, sample: Sample<'a>, row: usize) -> Sample<'a> {
        let d = sample.q.len();
        let (q, rest) = self.moved[3 * d * row..][..3 * d].split_at(d);
        let (qd, qdd) = rest.split_at(d);
        Sample {
            q,
            qd,
            qdd,
            ..sample
        }
    }

    /// Checks that it has a row for every sample, of the site's robot and points.
    pub(crate) fn check(&self, site: &Site, motion: &Motion) -> Result<(), CoreError> {
        let (n, d) = (motion.len(), site.joints());
        for rows in [self.postures.len(), self.contacts.len(), self.forces.len()] {
            CoreError::check_len("contacts of a sequence", rows, n)?;
        }
        if !self.rigid.is_empty() {
            CoreError::check_len("rigid-body torques of a sequence", self.rigid.len(), n * d)?;
        }
        CoreError::check_len(
            "motion of the links in a sequence",
            self.moved.len(),
            3 * n * d,
        )?;
        let links = site.robot.link_count();
        for posture in &self.postures {
            CoreError::check_len("joints of a posture", posture.screws().len(), d)?;
            CoreError::check_len("links of a posture", posture.link_poses().len(), links)?;
        }
        (self.contacts.iter().zip(&self.postures))
            .try_for_each(|(contacts, posture)| contacts.check_fits(&site.rest, posture))
    }
}

/// The contact of one robot with one object, step by step, as a model has it.
pub(crate) struct ContactDriver {
    model: SceneContact,
    force: Vector3<f64>,
    links: Links,
}

impl Campaign {
    /// Runs contact over a sequence.
    ///
    /// # Errors
    /// A motion of other joints or whose parts differ in length, parameters of contact out of range, rows
    /// that contact cannot take.
    pub fn contact_log(&self, model: &Model, motion: &Motion) -> Result<ContactLog, GapError> {
        motion.check(self.site.joints())?;
        let mut compensators = model.compensators(&self.site)?;
        let mut driver = ContactDriver::new(&self.site, &self.scene, &compensators)?;
        let mut log = ContactLog {
            postures: Vec::with_capacity(motion.len()),
            contacts: Vec::with_capacity(motion.len()),
            forces: Vec::with_capacity(motion.len()),
            rigid: Vec::new(),
            moved: Vec::with_capacity(3 * motion.len() * self.site.joints()),
        };
        let rigid = self.site.torque_kind == TorqueKind::Measured;
        let mut workspace = self.site.robot.dynamics_workspace();
        let mut posture = self.site.robot.posture();
        let mut contacts = Contacts::new();
        compensators
            .iter_mut()
            .for_each(|c| c.begin_sequence(&motion.id));
        for touch in &motion.touches {
            driver.reset();
            compensators.iter_mut().for_each(|c| c.begin_touch());
            for row in touch.clone() {
                let sample = motion.sample(row, touch.start, driver.force);
                driver.step(
                    &self.site,
                    &mut compensators,
                    &sample,
                    &mut posture,
                    &mut contacts,
                )?;
                if rigid {
                    let change =
                        driver
                            .links()
                            .rigid_change(&self.site, &sample, &mut workspace)?;
                    log.rigid.extend(change);
                }
                log.moved.extend(driver.links().all());
                log.postures.push(posture.clone());
                log.contacts.push(contacts.clone());
                log.forces.push(driver.force);
            }
        }
        Ok(log)
    }
}

impl Motion {
    /// A sample of a touch that began at row `first`.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn sample(&self, row: usize, first: usize, force_W: Vector3<f64>) -> Sample<'_> {
        let dt = match row > first {
            true => self.clock[row] - self.clock[row - 1],
            false => 0.0,
        };
        Sample {
            clock: self.clock[row],
            dt,
            q: &self.q[row],
            qd: &self.qd[row],
            qdd: &self.qdd[row],
            reading: &self.smooth[row],
            load: &self.load[row],
            force_W,
        }
    }
}

impl ContactDriver {
    /// Contact as the compensators have it.
    ///
    /// # Errors
    /// Parameters of contact out of range.
    pub fn new(
        site: &Site,
        scene: &Scene,
        compensators: &[Box<dyn Compensator>],
    ) -> Result<Self, GapError> {
        Ok(Self {
            model: scene
                .with_contact(contact_config(scene, compensators))?
                .contact_model()?,
            force: Vector3::zeros(),
            links: Links::new(site.joints()),
        })
    }

    /// The force (N, world) behind the last reading.
    pub fn force(&self) -> Vector3<f64> {
        self.force
    }

    /// Motion of the links in the last step.
    pub(crate) fn links(&self) -> &Links {
        &self.links
    }

    /// Forgets all contacts.
    pub fn reset(&mut self) {
        self.model.reset();
        self.force = Vector3::zeros();
    }

    /// One sample: link positions, place of the object, contacts, and the force behind the reading.
    ///
    /// # Errors
    /// A row that robot or contact cannot take.
    pub fn step(
        &mut self,
        site: &Site,
        compensators: &mut [Box<dyn Compensator>],
        sample: &Sample<'_>,
        posture: &mut Posture,
        contacts: &mut Contacts,
    ) -> Result<(), GapError> {
        self.links.place(site, compensators, sample, posture)?;
        self.model.step(&site.rest, posture, contacts)?;
        let touch = Touch {
            rest: &site.rest,
            posture,
            contacts,
        };
        self.force = force_behind(&touch, sample.reading);
        Ok(())
    }
}

/// Motion of the links, which is not always what the recording has.
pub(crate) struct Links {
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
}

impl Links {
    /// Of a robot with this many joints.
    pub(crate) fn new(joints: usize) -> Self {
        Self {
            q: vec![0.0; joints],
            qd: vec![0.0; joints],
            qdd: vec![0.0; joints],
        }
    }

    /// Moves the links as the compensators have it, in the frame of the object.
    ///
    /// # Errors
    /// Positions that the robot cannot take.
    pub(crate) fn place(
        &mut self,
        site: &Site,
        compensators: &mut [Box<dyn Compensator>],
        sample: &Sample<'_>,
        posture: &mut Posture,
    ) -> Result<(), GapError> {
        self.q.copy_from_slice(sample.q);
        self.qd.copy_from_slice(sample.qd);
        self.qdd.copy_from_slice(sample.qdd);
        for c in compensators.iter_mut() {
            c.joints(sample, &mut self.q);
            c.motion(sample, &mut self.qd, &mut self.qdd);
        }
        site.robot.update_posture(&self.q, posture)?;
        let shifts = compensators.iter_mut().map(|c| c.object_shift(sample));
        let shift: Vector3<f64> = shifts.sum();
        if shift != Vector3::zeros() {
            translate(posture, &-shift);
        }
        Ok(())
    }

    /// A sample with the motion of the links.
    pub(crate) fn felt<'a>(&'a self, sample: &Sample<'a>) -> Sample<'a> {
        Sample {
            q: &self.q,
            qd: &self.qd,
            qdd: &self.qdd,
            ..*sample
        }
    }

    /// Positions, then velocities, then accelerations.
    pub(crate) fn all(&self) -> impl Iterator<Item = f64> + '_ {
        self.q.iter().chain(&self.qd).chain(&self.qdd).copied()
    }

    /// What the reading of the actuators changes by (N m or N) because the links do not move as the
    /// recording has it.
    ///
    /// # Errors
    /// Motions that the robot cannot take.
    pub(crate) fn rigid_change<'a>(
        &self,
        site: &Site,
        sample: &Sample<'a>,
        workspace: &'a mut DynamicsWorkspace,
    ) -> Result<impl Iterator<Item = f64> + 'a, GapError> {
        let (q, qd, qdd) = (&self.q, &self.qd, &self.qdd);
        let of_links = (site.robot).inverse_dynamics(q, qd, qdd, &site.gravity, workspace)?;
        Ok(sample.load.iter().zip(of_links).map(|(r, l)| r - l))
    }
}

/// The parameters of contact as the compensators have them.
pub(crate) fn contact_config(
    scene: &Scene,
    compensators: &[Box<dyn Compensator>],
) -> ContactConfig {
    let mut config = *scene.contact();
    compensators.iter().for_each(|c| c.contact(&mut config));
    config
}

/// Moves a robot as a whole.
fn translate(posture: &mut Posture, by: &Vector3<f64>) {
    let (_, poses, screws) = posture.parts_mut();
    for pose in poses {
        pose.translation.vector += by;
    }
    for screw in screws {
        *screw = JointScrew {
            angular: screw.angular,
            linear: screw.linear + by.cross(&screw.angular),
        };
    }
}

/// The middle of the contact, and the link with most of the touched points.
///
/// # Panics
/// If a touched point is none of the rest points.
pub fn centre(touch: &Touch<'_>) -> Option<(usize, Point3<f64>)> {
    let contacts = touch.contacts;
    let n = contacts.len();
    if n == 0 {
        return None;
    }
    let place = |(&p, u): (&u32, &Vector3<f64>)| touch.rest.positions()[p as usize].coords + u;
    let sum: Vector3<f64> = (contacts.points().iter())
        .zip(contacts.displacements())
        .map(place)
        .sum();
    let links = contacts.links().iter().copied();
    let most = contacts
        .links()
        .iter()
        .copied()
        .max()
        .map_or(0, |l| l as usize + 1);
    let link = (0..most as u32).max_by_key(|l| links.clone().filter(|m| m == l).count())?;
    Some((link as usize, Point3::from(sum / n as f64)))
}

/// The columns of the Jacobian of a point on a link: the velocity (m per unit of joint speed) that
/// each joint gives it.
pub(crate) fn velocity_columns(
    posture: &Posture,
    link: usize,
    p: &Point3<f64>,
    out: &mut [Vector3<f64>],
) {
    out.fill(Vector3::zeros());
    for &j in posture.chains().chain(link) {
        let s = &posture.screws()[j as usize];
        out[j as usize] = s.angular.cross(&p.coords) + s.linear;
    }
}

/// The force at the middle of the contact whose joint torques come closest to the reading, a
/// little towards zero where the arm feels a direction badly.
fn force_behind(touch: &Touch<'_>, reading: &[f64]) -> Vector3<f64> {
    let Some((link, p)) = centre(touch) else {
        return Vector3::zeros();
    };
    let (mut jjt, mut jt) = (Matrix3::zeros(), Vector3::zeros());
    for &j in touch.posture.chains().chain(link) {
        let s = &touch.posture.screws()[j as usize];
        let v = s.angular.cross(&p.coords) + s.linear;
        jjt += v * v.transpose();
        jt += v * reading[j as usize];
    }
    let damped = jjt + Matrix3::identity() * (1e-2 * jjt.trace());
    damped
        .cholesky()
        .map_or_else(Vector3::zeros, |c| c.solve(&jt))
}

/// What a model says about one sample, given its contacts.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Springs of the touched points (m, world): the stiffness multiplies them.
    pub springs: Vec<Vector3<f64>>,
    /// Gain of the field's torque per joint.
    pub gains: Vec<f64>,
    /// Torques that do not depend on the stiffness (N m or N).
    pub torques: Vec<f64>,
}

impl Campaign {
    /// Runs springs, gains and torques of a model over sequences whose contacts are known, in
    /// session order: what an effect does to the object lasts from one sequence to the next.
    /// `visit` is given the sequence's index, the row, what was touched and the prediction. Torques are
    /// relative to their mean over the samples of the tare, as the readings are.
    ///
    /// # Errors
    /// Parameters that an effect cannot take, contacts that are not of the sequences, effects whose springs, gains or
    /// torques are not finite.
    pub fn predict(
        &self,
        model: &Model,
        motions: &[&Motion],
        logs: &[Arc<ContactLog>],
        mut visit: impl FnMut(usize, usize, &Touch<'_>, &Prediction),
    ) -> Result<(), GapError> {
        let d = self.site.joints();
        CoreError::check_len("contacts of sequences", logs.len(), motions.len())?;
        for (motion, log) in motions.iter().zip(logs) {
            motion.check(d)?;
            log.check(&self.site, motion)?;
        }
        let mut compensators = model.compensators(&self.site)?;
        let mut out = Prediction::new(d);
        for (s, (motion, log)) in motions.iter().zip(logs).enumerate() {
            if !goes_on(motions, s) {
                compensators
                    .iter_mut()
                    .for_each(|c| c.begin_sequence(&motion.id));
            }
            let touch = |row: usize| Touch {
                rest: &self.site.rest,
                posture: &log.postures[row],
                contacts: &log.contacts[row],
            };
            let tared = motion.tare.min(motion.len());
            let mut begin: Vec<Prediction> = Vec::with_capacity(tared);
            let mut offset = vec![0.0; d];
            for range in &motion.touches {
                compensators.iter_mut().for_each(|c| c.begin_touch());
                for row in range.clone() {
                    let sample = log.felt(motion.sample(row, range.start, log.forces[row]), row);
                    out.step(&mut compensators, &sample, &touch(row))
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
                        for (row, prediction) in begin.iter_mut().enumerate() {
                            add(&mut prediction.torques, &offset, -1.0);
                            visit(s, row, &touch(row), prediction);
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

impl Prediction {
    /// Of nothing yet, for a robot with this many joints.
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

    /// Asks the compensators.
    ///
    /// # Errors
    /// What they answer is not finite.
    pub(crate) fn step(
        &mut self,
        compensators: &mut [Box<dyn Compensator>],
        sample: &Sample<'_>,
        touch: &Touch<'_>,
    ) -> Result<(), CoreError> {
        self.springs.clear();
        self.springs
            .extend_from_slice(touch.contacts.displacements());
        self.gains.fill(1.0);
        self.torques.fill(0.0);
        for c in compensators {
            c.springs(sample, touch, &mut self.springs);
            c.gains(sample, touch, &mut self.gains);
            c.torques(sample, touch, &mut self.torques);
        }
        CoreError::check_finite("gains of the model", &self.gains)?;
        CoreError::check_finite("torques of the model", &self.torques)?;
        (self.springs.iter())
            .try_for_each(|s| CoreError::check_finite("springs of the model", s.as_slice()))
    }

    /// The column `-G J(q, p + u)^T s` of contact `k`, written to `out`.
    ///
    /// # Panics
    /// If there is no such contact, or it is none of the rest points.
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

    /// The torques `G W K + a` of a stiffness per rest point, written to `out`.
    ///
    /// # Panics
    /// If a touched point is none of the rest points or has no stiffness, or `out` is not one torque per joint.
    pub fn apply(&self, touch: &Touch<'_>, stiffness: &[f64], out: &mut [f64]) {
        let d = self.gains.len();
        out.copy_from_slice(&self.torques);
        let mut column = vec![0.0; d];
        for (k, &p) in touch.contacts.points().iter().enumerate() {
            let stiffness = stiffness[p as usize];
            if stiffness != 0.0 {
                self.column(touch, k, &mut column);
                out.iter_mut()
                    .zip(&column)
                    .for_each(|(t, w)| *t += w * stiffness);
            }
        }
    }
}
