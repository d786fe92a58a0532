use crate::effect::{Need, Site};
use crate::known_contacts::KnownContacts;
use crate::noise::{JointNoise, NoiseFloor};
use crate::rounding::Rounding;
use crate::{ContactLog, GapError, Model, Motion, effect::slides};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::sync::Arc;
use vsf_data::{Dataset, Sequence};
use vsf_pipeline::{Scene, SceneOptions, robot_of};

/// A recording, prepared for diagnosis.
///
/// A clone shares sequences, points, link shapes and known contacts.
#[derive(Clone)]
pub struct Campaign {
    name: String,
    pub(crate) site: Site,
    pub(crate) scene: Scene,
    /// The scene in which fields are estimated, if it is another one.
    fields: Option<Scene>,
    /// Whether the contact threshold was left open, so that the readings may determine it.
    pub(crate) threshold_is_free: bool,
    /// Sequences that the model is fitted to, in session order.
    pub(crate) train: Arc<[Motion]>,
    /// Sequences that check it.
    pub(crate) test: Arc<[Motion]>,
    pub(crate) noise: Vec<JointNoise>,
    /// Whether the noise of a joint was read in contact, for want of readings in the air other than zero.
    pub(crate) noise_is_bound: bool,
    /// Joints whose readings are rounded by more than their noise.
    pub(crate) rounded: Vec<(usize, Rounding)>,
    /// Whether the last train sequence is held out for the check, for want of a test split.
    pub(crate) held_out: bool,
    touched: Touched,
    /// Whether the train sequences contain free motion.
    moves_free: bool,
    /// Contacts of the train and test sequences.
    contacts: Arc<[KnownContacts]>,
}

impl std::fmt::Debug for Campaign {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ids = |motions: &[Motion]| motions.iter().map(|m| m.id.clone()).collect::<Vec<_>>();
        f.debug_struct("Campaign")
            .field("name", &self.name)
            .field("scene", &self.scene)
            .field("train", &ids(&self.train))
            .field("test", &ids(&self.test))
            .field("noise", &self.noise)
            .finish_non_exhaustive()
    }
}

/// A point is touched again if it was let go and pressed anew by this share of its deepest touch.
const ANEW: f64 = 0.2;

/// Fewest samples without contact that count as free motion.
pub(crate) const FREE: usize = 16;

/// What the train sequences touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Touched {
    Nothing,
    /// Every point at most once.
    Once,
    /// Some point again after it was let go.
    Again,
}

impl Touched {
    /// From the train sequences and their logs.
    fn of(points: usize, train: &[Motion], logs: &[Arc<ContactLog>]) -> Self {
        #[derive(Clone, Copy, Default)]
        struct Depth {
            most: f64,
            least_since: f64,
            row: usize,
        }
        let mut depths = vec![Depth::default(); points];
        let mut touched = Self::Nothing;
        let touches = (train.iter().zip(logs))
            .flat_map(|(m, log)| m.touches.iter().map(|rows| &log.contacts[rows.clone()]));
        // All points are let off between two touches.
        let rows = touches
            .enumerate()
            .flat_map(|(k, contacts)| contacts.iter().map(move |c| (k, c)));
        for (row, contacts) in rows.enumerate().map(|(row, (k, c))| (row + k, c)) {
            for (&p, u) in contacts.points().iter().zip(contacts.displacements()) {
                let (depth, u) = (&mut depths[p as usize], u.norm());
                if depth.row + 1 < row {
                    depth.least_since = 0.0;
                }
                let let_off = depth.least_since < (1.0 - ANEW) * depth.most;
                if let_off && u > depth.least_since + ANEW * depth.most {
                    touched = Self::Again;
                }
                depth.least_since = depth.least_since.min(u);
                if u >= depth.most {
                    (depth.most, depth.least_since) = (u, u);
                }
                depth.row = row;
                touched = touched.max(Self::Once);
            }
        }
        touched
    }
}

impl Campaign {
    /// Prepares a recording with the contact parameters of the options.
    ///
    /// If the torques of the recording were computed in a contact of their own, take the options from [`SceneOptions::of`].
    /// Without rest points, or those of a stored field, the arm is taken to move in free air. Without a test split, the
    /// last train sequence is held out for the check if there are two or more.
    ///
    /// # Errors
    /// A robot, scene, torques or motions that cannot be read; rows that contact cannot take.
    pub fn open(dataset: &Dataset, options: &SceneOptions) -> Result<Self, GapError> {
        let scene = if dataset.rest_points.is_none() && dataset.field.is_none() {
            Scene::in_air(dataset, robot_of(dataset, &options.packages)?)?
        } else {
            Scene::open(dataset, options)?
        };
        Self::in_scene(dataset, scene)
    }

    /// [`Campaign::open`] with a scene that already exists.
    ///
    /// # Errors
    /// What [`Scene::check_recording`] refuses; torques or motions that cannot be read; rows that contact cannot take.
    pub fn in_scene(dataset: &Dataset, scene: Scene) -> Result<Self, GapError> {
        dataset.check()?;
        scene.check_recording(dataset)?;
        let mut train: Vec<&str> = dataset.splits.train.iter().map(String::as_str).collect();
        let mut test: Vec<&str> = dataset.splits.test.iter().map(String::as_str).collect();
        let held_out = test.is_empty() && train.len() > 1;
        if held_out {
            test.extend(train.pop());
        }
        let mut site = Site {
            robot: scene.robot().clone(),
            rest: scene.rest().clone(),
            gravity: scene.gravity(),
            torque_kind: scene.torque_kind(),
            friction: scene.contact().friction,
            sequences: Vec::new(),
            duration: 1.0,
            sequence_duration: 1.0,
        };
        let (mut trained, mut tested) = (Vec::new(), Vec::new());
        let mut recorded = Vec::new();
        let mut clock: Option<Clock> = None;
        for sequence in &dataset.sequences {
            let known = |ids: &[&str]| ids.contains(&sequence.id.as_str());
            if !known(&train) && !known(&test) {
                continue;
            }
            let now = Clock::at(clock, sequence);
            let motion = Motion::of(&scene, sequence, now.origin)?;
            clock = Some(Clock {
                end: motion.clock.last().copied().unwrap_or(now.end),
                ..now
            });
            site.sequences.push(sequence.id.clone());
            if known(&train) {
                trained.push(motion);
                recorded.push(sequence);
            } else {
                tested.push(motion);
            }
        }
        site.duration = clock.map_or(1.0, |c| c.end.max(1.0));
        let length = |m: &Motion| m.clock.last().map_or(0.0, |end| end - m.begin());
        let lengths = trained.iter().chain(&tested).map(length);
        site.sequence_duration = match lengths.sum::<f64>() / site.sequences.len().max(1) as f64 {
            mean if mean > 0.0 => mean,
            _ => site.duration,
        };
        let mut campaign = Self {
            name: dataset.name.clone(),
            site,
            scene,
            fields: None,
            threshold_is_free: false,
            contacts: KnownContacts::of_none(trained.len() + tested.len()),
            train: trained.into(),
            test: tested.into(),
            noise: Vec::new(),
            noise_is_bound: false,
            rounded: Vec::new(),
            held_out,
            touched: Touched::Nothing,
            moves_free: false,
        };
        let motions: Vec<&Motion> = campaign.train.iter().collect();
        let logs = campaign.contact_logs(&Model::default(), &motions)?;
        let mut floor = NoiseFloor::of(&motions, &logs, campaign.site.joints());
        for (j, noise) in floor.joints.iter_mut().enumerate() {
            let rounding = Rounding::of(&recorded, j).filter(|r| r.lasts(noise));
            if let Some(rounding) = rounding {
                *noise = rounding.with(noise);
                campaign.rounded.push((j, rounding));
            }
        }
        campaign.noise = floor.joints;
        campaign.noise_is_bound = floor.is_bound;
        campaign.take_in(&logs);
        Ok(campaign)
    }

    /// Makes a diagnosis report the errors of fields in the contact in which one estimates them
    /// ([`Scene::with_suited_threshold`]), for models that do not [follow the contact](Model::follows_contact).
    ///
    /// Effects are still looked for in the scene's own contact, for which the constants of the judgment were calibrated.
    /// If another threshold explains more than half as much as the effects, the search is repeated with that one.
    /// If surfaces are drawn in by more than the threshold that suits the points, fields keep the scene's contact.
    #[must_use]
    pub fn with_suited_fields(self) -> Self {
        let suited = self.scene.with_suited_threshold().ok();
        Self {
            fields: suited.filter(|s| s.contact() != self.scene.contact()),
            threshold_is_free: true,
            ..self
        }
    }

    /// The campaign in the contact of [`Campaign::with_suited_fields`], to estimate fields in; `None` if that is no other
    /// contact.
    ///
    /// The noise of the readings is taken to be the same.
    pub fn suited(&self) -> Option<Self> {
        Some(self.in_contact_of(self.fields.clone()?))
    }

    /// The campaign in a scene that differs in contact alone, to estimate fields in.
    pub(crate) fn in_contact_of(&self, scene: Scene) -> Self {
        Self {
            scene,
            fields: None,
            ..self.with_sequences(self.train.clone(), self.test.clone())
        }
    }

    /// The campaign in such a scene, to look for effects in. What is touched is determined anew, and the contact counts as
    /// chosen.
    ///
    /// # Errors
    /// Rows that contact cannot take.
    pub(crate) fn to_search_in(&self, scene: Scene) -> Result<Self, GapError> {
        let mut other = Self {
            threshold_is_free: false,
            ..self.in_contact_of(scene)
        };
        let motions: Vec<&Motion> = other.train.iter().collect();
        let logs = other.contact_logs(&Model::default(), &motions)?;
        other.take_in(&logs);
        Ok(other)
    }

    /// Determines what the train sequences touch, from their logs.
    fn take_in(&mut self, logs: &[Arc<ContactLog>]) {
        let free = (logs.iter().flat_map(|l| &l.contacts)).filter(|c| c.is_empty());
        self.moves_free = free.count() >= FREE;
        self.touched = Touched::of(self.site.rest.len(), &self.train, logs);
    }

    /// Name of the recording; empty if it has none.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The robot and the object.
    pub fn site(&self) -> &Site {
        &self.site
    }

    /// The scene, which gives the contacts; for an arm in free air it has no points.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Noise of each joint's reading, per sample of the train sequences.
    pub fn noise(&self) -> &[JointNoise] {
        &self.noise
    }

    /// Whether the noise of a joint is only an upper bound.
    ///
    /// It is if it had to be read in contact, because there are no readings in the air other than zero.
    pub fn noise_is_bound(&self) -> bool {
        self.noise_is_bound
    }

    /// The sequences that the model is fitted to, in session order.
    pub fn train(&self) -> &[Motion] {
        &self.train
    }

    /// The sequences that check the model.
    pub fn test(&self) -> &[Motion] {
        &self.test
    }

    /// Contacts of several sequences under a model.
    ///
    /// Contacts are cached for the sequences of this campaign or of a clone, if the very same objects are passed and not
    /// copies. The cache holds those of the nominal model, which all models share whose effects leave contacts as they are,
    /// and those of the last few other models.
    ///
    /// # Errors
    /// As [`Campaign::contact_log`].
    pub fn contact_logs(
        &self,
        model: &Model,
        motions: &[&Motion],
    ) -> Result<Vec<Arc<ContactLog>>, GapError> {
        // Contacts that are known would hide parameters that effects refuse.
        model.compensator(&self.site)?;
        let log = |motion: &&Motion| {
            let run = || self.contact_log(model, motion);
            let own = self.train.iter().chain(self.test.iter());
            let mut known = own.zip(&*self.contacts);
            match known.find(|(own, _)| std::ptr::eq(*own, *motion)) {
                Some((_, known)) => known.of(model, run),
                None => run().map(Arc::new),
            }
        };
        motions.par_iter().map(log).collect()
    }

    /// All sequences, in session order.
    pub fn session(&self) -> Vec<&Motion> {
        let mut all: Vec<&Motion> = self.train.iter().chain(self.test.iter()).collect();
        all.sort_by(|a, b| a.begin().total_cmp(&b.begin()));
        all
    }

    /// The campaign with every `by` samples averaged into one, never across two touches.
    ///
    /// # Errors
    /// None in practice: the tables keep their form.
    pub(crate) fn thinned(&self, by: usize) -> Result<Self, GapError> {
        let thinned = |motions: &[Motion]| -> Result<Vec<Motion>, GapError> {
            motions.iter().map(|m| m.thinned(by)).collect()
        };
        let (train, test) = (thinned(&self.train)?, thinned(&self.test)?);
        let samples = |motions: &[Motion]| motions.iter().map(Motion::len).sum::<usize>();
        // Touches end before a block is full. Rounded down: that takes noise for larger than it is, as it was when the
        // constants of the judgment were settled, and leaves room for contact that is run through means.
        let by = samples(&self.train) / samples(&train).max(1);
        Ok(Self {
            noise: self.noise.iter().map(|n| n.of_means(by)).collect(),
            ..self.with_sequences(train, test)
        })
    }

    /// The same campaign with coarser contact that takes less time ([`Scene::without_subdivision`]).
    pub(crate) fn rough(&self) -> Self {
        Self {
            scene: self.scene.without_subdivision(),
            ..self.with_sequences(self.train.clone(), self.test.clone())
        }
    }

    /// The same campaign with its sequences replaced.
    pub(crate) fn with_sequences(
        &self,
        train: impl Into<Arc<[Motion]>>,
        test: impl Into<Arc<[Motion]>>,
    ) -> Self {
        let (train, test) = (train.into(), test.into());
        Self {
            name: self.name.clone(),
            site: self.site.clone(),
            scene: self.scene.clone(),
            fields: self.fields.clone(),
            contacts: KnownContacts::of_none(train.len() + test.len()),
            train,
            test,
            noise: self.noise.clone(),
            rounded: self.rounded.clone(),
            ..*self
        }
    }

    /// Why the recording does not meet a need; `None` if it does.
    pub fn lacks(&self, need: Need) -> Option<String> {
        let site = &self.site;
        let lack = match need {
            Need::Contact => (
                self.touched < Touched::Once,
                if site.rest.is_empty() {
                    "nothing is touched: the recording has no points"
                } else {
                    "the train sequences touch no point"
                },
            ),
            Need::Joints => (site.joints() < 2, "the robot has one joint"),
            Need::Weight => (
                site.gravity == Vector3::zeros() || (0..site.joints()).all(|j| slides(site, j)),
                "no joint turns against gravity: weight is a constant load here, as torque_bias is",
            ),
            Need::Retouch => (
                self.touched < Touched::Again,
                "no point is touched twice in the train sequences",
            ),
            Need::FreeMotion => (
                site.joints() < 2 && !self.moves_free,
                "the only joint has fewer than 16 samples of free motion in the train sequences",
            ),
        };
        lack.0.then(|| lack.1.to_owned())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
impl Campaign {
    /// A ball on a stage comes down on nine points, 4 mm apart: of every sequence, the positions of its axes (m) and the forces
    /// that they read (N), a hundred a second.
    pub(crate) fn of_stage(sequences: &[Vec<[[f64; 3]; 2]>]) -> Self {
        let at = |k: i32| 0.004 * f64::from(k);
        let points = (0..9).map(|k| nalgebra::Point3::new(at(k % 3), at(k / 3), 0.0));
        Self::of_stage_with(Some(points.collect()), sequences)
    }

    /// The same with other points, or without.
    pub(crate) fn of_stage_with(
        rest_points: Option<Vec<nalgebra::Point3<f64>>>,
        sequences: &[Vec<[[f64; 3]; 2]>],
    ) -> Self {
        let sequence = |(k, rows): (usize, &Vec<[[f64; 3]; 2]>)| {
            let table = |part: usize| {
                let values = rows.iter().flat_map(|row| row[part]).collect();
                vsf_data::Table::new(3, values).unwrap()
            };
            let time = (0..rows.len()).map(|k| k as f64 / 100.0).collect();
            Sequence::new(k.to_string(), time, table(0), table(1))
        };
        let stage = vsf_data::RobotRef::resolve("cartesian_stage", ".".as_ref()).unwrap();
        let sequences = sequences.iter().enumerate().map(sequence).collect();
        let dataset = Dataset {
            rest_points,
            ..Dataset::new(stage, sequences)
        };
        Self::open(&dataset, &SceneOptions::default()).unwrap()
    }

    /// A ball comes down on points twice, at one speed, and up again; its first axis reads 1 N too much, whatever it touches,
    /// and the third has a friction (N).
    pub(crate) fn poked(friction: f64) -> Self {
        let row = |k: i32| {
            let height = 0.02 - 4e-4 * f64::from(60 - i32::abs(60 - k));
            let noise = 0.01 * f64::from(k * k % 13 - 6) / 6.0;
            let against = friction * f64::from((60 - k).signum());
            let force = [
                1.0 + noise,
                noise,
                against - 200.0 * height.min(0.0) - noise,
            ];
            [[0.004, 0.004, height], force]
        };
        let sequence: Vec<_> = (0..120).map(row).collect();
        Self::of_stage(&[sequence.clone(), sequence])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is pressed when a sequence ends, and when the next one begins, was let off between.
    #[test]
    fn points_are_let_off_between_sequences() {
        let row = |k: i32| [[0.004, 0.004 + 1e-5 * f64::from(k), -0.004], [0.0; 3]];
        let pressed: Vec<_> = (0..20).map(row).collect();
        let of = |sequences: &[Vec<_>]| Campaign::of_stage(sequences).lacks(Need::Retouch);
        assert!(of(std::slice::from_ref(&pressed)).is_some());
        // Of three, two train.
        assert_eq!(of(&[pressed.clone(), pressed.clone(), pressed]), None);
    }
}

/// Whether a motion is a further part of the same sequence as the previous one.
pub(crate) fn goes_on(motions: &[&Motion], k: usize) -> bool {
    k > 0 && motions[k - 1].id == motions[k].id
}

/// Start of the sequence of each motion, as far as the motions contain it (s).
pub(crate) fn sequence_begins(motions: &[&Motion]) -> Vec<f64> {
    let mut begins: Vec<f64> = Vec::with_capacity(motions.len());
    for (k, motion) in motions.iter().enumerate() {
        begins.push(if goes_on(motions, k) {
            begins[k - 1]
        } else {
            motion.begin()
        });
    }
    begins
}

/// The time stamp at which the session's clock is zero, and the current clock.
#[derive(Clone, Copy)]
struct Clock {
    origin: f64,
    end: f64,
}

impl Clock {
    /// The clock for the next sequence. Time stamps that continue are the session's; those that start anew start where the
    /// last sequence ended.
    fn at(last: Option<Self>, sequence: &Sequence) -> Self {
        let start = sequence.time.first().copied().unwrap_or(0.0);
        match last {
            Some(last) if start - last.origin >= last.end => last,
            Some(last) => Self {
                origin: start - last.end,
                ..last
            },
            None => Self {
                origin: start,
                end: 0.0,
            },
        }
    }
}
