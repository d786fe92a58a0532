//! The robot, its poses over time, and what it touches.

use super::cloud::Cloud;
use super::numbers::{Numbers, check_near};
use super::shapes::{Surface, surfaces};
use serde::Serialize;
use vsf::core::nalgebra::{Point3, Vector3};
use vsf::core::{Contacts, CoreError, Posture};
use vsf::data::Sequence;
use vsf::pipeline::{Scene, external_torques};
use vsf::robots::RobotModel;

/// Most link poses and most contacts in a page.
const POSES: usize = 60_000;
const CONTACTS: usize = 250_000;

/// A robot and what it did.
#[derive(Serialize)]
pub struct Motion {
    robot: Robot,
    sequences: Vec<Track>,
    /// One of so many samples is shown.
    every: usize,
    /// Unit of the loads.
    unit: &'static str,
}

#[derive(Serialize)]
struct Robot {
    name: String,
    /// The parent of each link, below 0 for the root.
    parents: Vec<i64>,
    surfaces: Vec<Surface>,
}

/// One sequence, sample by sample.
#[derive(Serialize)]
struct Track {
    id: String,
    /// Since the first sample [s].
    time: Numbers,
    /// Of each link x, y, z and quaternion x, y, z, w.
    poses: Numbers,
    /// Points in contact, drawn or not.
    counts: Numbers,
    /// First contact of each sample, and the end of the last.
    starts: Numbers,
    /// The touched points, as numbers of drawn ones, and their displacements [m].
    points: Numbers,
    shifts: Numbers,
    /// Norm of the external torques; empty where nothing can be touched.
    loads: Numbers,
}

/// A [`Track`] before it is packed.
#[derive(Default)]
struct Frames {
    time: Vec<f64>,
    poses: Vec<f64>,
    counts: Vec<u32>,
    contacts: Vec<Vec<(u32, Vector3<f64>)>>,
    loads: Vec<f64>,
}

/// The robot among the points of a scene.
pub fn in_scene(
    scene: &Scene,
    sequences: &[&Sequence],
    cloud: &Cloud,
    done: impl Fn(),
) -> anyhow::Result<Motion> {
    let mut every = every(scene.robot(), sequences);
    let mut all: Vec<Frames> = Vec::new();
    let mut held = 0;
    for &sequence in sequences {
        let torques = external_torques(scene, sequence)?;
        // Of a planned motion what is left would be the weight of the arm.
        let is_felt = !sequence.is_unmeasured();
        let mut frames = Frames::default();
        let norm = |row: &[f64]| row.iter().map(|t| t * t).sum::<f64>().sqrt();
        scene.follow(sequence, |row, posture, contacts| {
            if row % every == 0 {
                frames.push(scene.robot(), posture, cloud.origin_W)?;
                frames.time.push(sequence.time[row]);
                frames.touch(contacts, cloud);
                let load = if is_felt { norm(&torques[row]) } else { 0.0 };
                frames.loads.push(load);
                held += frames.contacts.last().map_or(0, Vec::len);
                // Far too many contacts: half of the samples.
                if held > 2 * CONTACTS {
                    all.iter_mut().chain([&mut frames]).for_each(|f| f.thin(2));
                    held = all.iter().chain([&frames]).map(Frames::held).sum();
                    every *= 2;
                }
            }
            Ok(())
        })?;
        all.push(frames);
        done();
    }
    // Too many contacts: fewer samples.
    let further = held.div_ceil(CONTACTS).max(1);
    all.iter_mut().for_each(|f| f.thin(further));
    let unit = scene.error_unit();
    Motion::new(scene.robot(), sequences, all, every * further, unit)
}

/// The robot alone.
pub fn in_air(
    robot: &RobotModel,
    sequences: &[&Sequence],
    origin_W: Point3<f64>,
) -> anyhow::Result<Motion> {
    let every = every(robot, sequences);
    let mut posture = robot.posture();
    let mut all = Vec::new();
    for &sequence in sequences {
        let mut frames = Frames::default();
        for row in (0..sequence.len()).step_by(every) {
            robot
                .update_posture(&sequence.angles[row], &mut posture)
                .and_then(|()| frames.push(robot, &posture, origin_W))
                .map_err(|e| anyhow::anyhow!("sequence {} row {row}: {e}", sequence.id))?;
            frames.time.push(sequence.time[row]);
        }
        all.push(frames);
    }
    Motion::new(robot, sequences, all, every, "")
}

/// One of so many samples is enough for [`POSES`].
fn every(robot: &RobotModel, sequences: &[&Sequence]) -> usize {
    let samples: usize = sequences.iter().map(|s| s.len()).sum();
    (samples * robot.link_count()).div_ceil(POSES).max(1)
}

impl Motion {
    fn new(
        robot: &RobotModel,
        sequences: &[&Sequence],
        frames: Vec<Frames>,
        every: usize,
        unit: &'static str,
    ) -> anyhow::Result<Self> {
        let links: Vec<&str> = robot.links().iter().map(|l| l.name()).collect();
        let parent = |l: &vsf::robots::Link| l.parent().map_or(-1, |p| p as i64);
        Ok(Self {
            robot: Robot {
                name: robot.name().to_owned(),
                parents: robot.links().iter().map(parent).collect(),
                surfaces: surfaces(robot.colliders(), &links)?,
            },
            sequences: (sequences.iter().zip(frames))
                .map(|(sequence, frames)| frames.pack(&sequence.id))
                .collect(),
            every,
            unit,
        })
    }

    /// What the page leaves out.
    pub fn note(&self) -> Option<String> {
        let every = self.every;
        (every > 1).then(|| format!("One of {every} samples is shown."))
    }
}

impl Frames {
    fn push(
        &mut self,
        robot: &RobotModel,
        posture: &Posture,
        origin_W: Point3<f64>,
    ) -> Result<(), CoreError> {
        for (link, X_WL) in robot.links().iter().zip(posture.link_poses()) {
            let p_W = Point3::from(X_WL.translation.vector);
            check_near(&p_W, || format!("link {:?}", link.name())).map_err(CoreError::other)?;
            let p = p_W - origin_W;
            let q = X_WL.rotation.coords;
            self.poses.extend([p.x, p.y, p.z, q.x, q.y, q.z, q.w]);
        }
        Ok(())
    }

    fn touch(&mut self, contacts: &Contacts, cloud: &Cloud) {
        let all = contacts.points().iter().zip(contacts.displacements());
        let drawn = all.filter_map(|(&point, &u_W)| Some((cloud.place(point)?, u_W)));
        self.contacts.push(drawn.collect());
        self.counts.push(contacts.len() as u32);
    }

    /// Contacts of all samples.
    fn held(&self) -> usize {
        self.contacts.iter().map(Vec::len).sum()
    }

    /// Keeps one of `every` samples.
    fn thin(&mut self, every: usize) {
        let links = self.poses.len() / self.time.len().max(1);
        self.poses = (self.poses.chunks(links.max(1)).step_by(every))
            .flatten()
            .copied()
            .collect();
        fn kept<T>(values: &mut Vec<T>, every: usize) {
            *values = std::mem::take(values).into_iter().step_by(every).collect();
        }
        kept(&mut self.time, every);
        kept(&mut self.counts, every);
        kept(&mut self.contacts, every);
        kept(&mut self.loads, every);
    }

    fn pack(self, id: &str) -> Track {
        let first = self.time.first().copied().unwrap_or(0.0);
        let mut end = 0;
        let ends = self.contacts.iter().map(|c| {
            end += c.len() as u32;
            end
        });
        let starts = Numbers::u32([0].into_iter().chain(ends));
        let contacts = || self.contacts.iter().flatten();
        Track {
            id: id.to_owned(),
            time: Numbers::f32(self.time.iter().map(|t| t - first)),
            poses: Numbers::f32(self.poses.iter().copied()),
            counts: Numbers::u32(self.counts.iter().copied()),
            starts,
            points: Numbers::u32(contacts().map(|c| c.0)),
            shifts: Numbers::f32(contacts().flat_map(|c| [c.1.x, c.1.y, c.1.z])),
            loads: Numbers::f32(self.loads.iter().copied()),
        }
    }
}
