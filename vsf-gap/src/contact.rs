use crate::links::Links;
use crate::{Campaign, Compensator, GapError, Model, Motion, Sample, Site, Touch};
use nalgebra::{Matrix3, Point3, Vector3};
use vsf_contact::ContactConfig;
use vsf_core::{ContactModel, Contacts, CoreError, Posture};
use vsf_data::TorqueKind;
use vsf_pipeline::{Scene, SceneContact};

/// Where the robot was and what it touched, at every sample of a sequence.
#[derive(Debug, Clone)]
pub struct ContactLog {
    /// Postures, in the frame of the object.
    pub postures: Vec<Posture>,
    /// Contacts.
    pub contacts: Vec<Contacts>,
    /// Force on the robot that explains the reading best (N, world), per sample.
    pub forces: Vec<Vector3<f64>>,
    /// Change of the rigid-body torque in the reading because the links are not where the recording has them (N m or N):
    /// all joints of every row. Empty if the readings do not include rigid-body torques.
    pub rigid: Vec<f64>,
    /// Motion of the links, per row: the positions (rad or m) of all joints, then the velocities, then the accelerations.
    pub moved: Vec<f64>,
}

impl ContactLog {
    /// Robot and contacts at a row.
    pub(crate) fn touch<'a>(&'a self, site: &'a Site, row: usize) -> Touch<'a> {
        Touch {
            rest: &site.rest,
            posture: &self.postures[row],
            contacts: &self.contacts[row],
        }
    }

    /// The sample of a row with the motion of the links.
    pub(crate) fn felt<'a>(&'a self, sample: Sample<'a>, row: usize) -> Sample<'a> {
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

    /// Checks that the log has a row for every sample, with the site's robot and points.
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

/// Step-by-step contact of one robot with one object, under a model.
#[derive(Clone)]
pub(crate) struct ContactDriver {
    model: SceneContact,
    force: Vector3<f64>,
    links: Links,
}

impl Campaign {
    /// Simulates contact over a sequence.
    ///
    /// # Errors
    /// A motion with another number of joints or with parts of different length; contact parameters out of range; rows that
    /// contact cannot take.
    pub fn contact_log(&self, model: &Model, motion: &Motion) -> Result<ContactLog, GapError> {
        motion.check(self.site.joints())?;
        let mut effects = model.compensator(&self.site)?;
        let mut driver = ContactDriver::new(&self.site, &self.scene, &*effects)?;
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
        effects.begin_sequence(&motion.id);
        for touch in &motion.touches {
            driver.reset();
            effects.begin_touch();
            for row in touch.clone() {
                let sample = motion.sample(row, touch.start, driver.force);
                driver.step(
                    &self.site,
                    &mut *effects,
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

impl ContactDriver {
    /// Contact under the effects.
    ///
    /// # Errors
    /// Contact parameters out of range.
    pub fn new(site: &Site, scene: &Scene, effects: &dyn Compensator) -> Result<Self, GapError> {
        Ok(Self {
            model: scene
                .with_contact(contact_config(scene, effects))?
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

    /// What was moved in the last step, whose contacts are `contacts`.
    pub(crate) fn moved<'a>(&'a self, contacts: &'a Contacts) -> &'a Contacts {
        self.model.moved(contacts)
    }

    /// Forgets all contacts.
    pub fn reset(&mut self) {
        self.model.reset();
        self.force = Vector3::zeros();
    }

    /// Processes one sample: link positions, place of the object, contacts, and the force behind the reading.
    ///
    /// # Errors
    /// A row that robot or contact cannot take.
    pub fn step(
        &mut self,
        site: &Site,
        effects: &mut dyn Compensator,
        sample: &Sample<'_>,
        posture: &mut Posture,
        contacts: &mut Contacts,
    ) -> Result<(), GapError> {
        self.links.place(site, effects, sample, posture)?;
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

/// The contact parameters under the effects.
pub(crate) fn contact_config(scene: &Scene, effects: &dyn Compensator) -> ContactConfig {
    let mut config = *scene.contact();
    effects.contact(&mut config);
    config
}

/// The link with most of the touched points, and the center of the contact (m, world).
///
/// Of several such links it is the last one. `None` if nothing is touched.
///
/// # Panics
/// If a touched point is not among the rest points.
pub fn center(touch: &Touch<'_>) -> Option<(usize, Point3<f64>)> {
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
    // Few links, and no buffer: control loops ask for it at every step.
    let links = contacts.links();
    let most = *links.iter().max()?;
    let link = (0..=most).max_by_key(|l| links.iter().filter(|m| *m == l).count())?;
    Some((link as usize, Point3::from(sum / n as f64)))
}

/// The force at the center of the contact whose joint torques come closest to the reading. It is shrunk slightly toward
/// zero in directions that the arm hardly feels.
fn force_behind(touch: &Touch<'_>, reading: &[f64]) -> Vector3<f64> {
    let Some((link, p)) = center(touch) else {
        return Vector3::zeros();
    };
    let (mut jjt, mut jt) = (Matrix3::zeros(), Vector3::zeros());
    for &j in touch.posture.chains().chain(link) {
        let v = touch.posture.screws()[j as usize].velocity_at(&p);
        jjt += v * v.transpose();
        jt += v * reading[j as usize];
    }
    let damped = jjt + Matrix3::identity() * (1e-2 * jjt.trace());
    damped
        .cholesky()
        .map_or_else(Vector3::zeros, |c| c.solve(&jt))
}
