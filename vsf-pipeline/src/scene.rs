use crate::robot::{check_joints, placed};
use crate::{PipelineError, SceneContact, reading_unit, robot_of};
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use vsf_contact::{
    CellContact, Cells, ContactConfig, ContactError, GridOptions, LinkGrid, LinkSdf, StickSlip,
    link_sdfs,
};
use vsf_core::{CoreError, RestPoints, Shape};
use vsf_data::{ContactParameters, Dataset, TorqueKind};
use vsf_robots::RobotModel;

/// Gravity where nothing else is said (m/s²), world frame.
const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// Contact threshold that suits an estimation, as a share of the spacing of the points.
const SUITED: f64 = 0.8;
/// Least contact threshold (m) where it is chosen or fitted, not given.
pub const LEAST_THRESHOLD: f64 = 1e-4;
/// Largest threshold (m) that is chosen by the spacing of points.
const LARGEST_SUITED: f64 = 1e-2;

/// Options of a [`Scene`]; the defaults fit most recordings.
#[derive(Debug, Clone)]
pub struct SceneOptions {
    /// Parameters of contact.
    pub contact: ContactConfig,
    /// Sub-points per edge of the cube that a rest point stands for, 1 to 8, default 2.
    ///
    /// With 2, contact moves 8 sub-points per rest point and takes their mean ([`CellContact`]). With 1 it
    /// moves only the rest points, as the paper does, at an eighth of the cost.
    ///
    /// All cubes have the edge [`RestPoints::spacing`]. In an uneven cloud they overlap where points are
    /// dense and leave gaps where points are sparse, so that readings are divided unevenly between points;
    /// use 1 there, or points on a lattice. A cloud whose spacing is 0 (a single place) has no sub-points.
    pub subdivision: usize,
    /// How collision meshes are converted to distance grids.
    pub grid: GridOptions,
    /// Names of the links that may touch; `None` (default) means all with collision shapes.
    pub links: Option<Vec<String>>,
    /// Folders for `package://` names in the URDF.
    pub packages: BTreeMap<String, PathBuf>,
}

impl SceneOptions {
    /// The defaults, but with the contact parameters that the torques of a recording were computed with, if
    /// they were computed ([`Dataset::contact`]). With other parameters, such as the default ones, the
    /// difference would appear as a model error.
    ///
    /// ```
    /// # use vsf_pipeline::{Scene, SceneOptions};
    /// # fn demo(dataset: &vsf_data::Dataset) -> Result<Scene, vsf_pipeline::PipelineError> {
    /// Scene::open(dataset, &SceneOptions::of(dataset))
    /// # }
    /// ```
    pub fn of(dataset: &Dataset) -> Self {
        let own = Self::default();
        match &dataset.contact {
            Some(contact) => own.with_contact_of(contact),
            None => own,
        }
    }

    /// Replaces the contact parameters by those that a field was estimated with, or a corrected model found
    /// with. A scene in which they are to predict needs them.
    ///
    /// ```
    /// # use vsf_pipeline::{Scene, SceneOptions};
    /// # fn demo(dataset: &vsf_data::Dataset, field: &vsf_data::StiffnessField)
    /// # -> Result<Scene, vsf_pipeline::PipelineError> {
    /// let own = SceneOptions::default();
    /// let options = match &field.contact {
    ///     Some(contact) => own.with_contact_of(contact),
    ///     None => own,
    /// };
    /// Scene::with_points(dataset, field.points.clone(), &options)
    /// # }
    /// ```
    #[must_use]
    pub fn with_contact_of(self, field: &ContactParameters) -> Self {
        let ContactParameters {
            threshold,
            friction,
            slip_step,
            max_slip_iterations,
            padding,
            adhesion,
            subdivision,
            ref links,
        } = *field;
        Self {
            contact: ContactConfig {
                threshold,
                friction,
                slip_step,
                max_slip_iterations,
                padding,
                adhesion,
                parallel: self.contact.parallel,
            },
            subdivision,
            links: links.clone(),
            ..self
        }
    }
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self {
            contact: ContactConfig::default(),
            subdivision: 2,
            grid: GridOptions::default(),
            links: None,
            packages: BTreeMap::new(),
        }
    }
}

/// How far grids of meshes reach beyond the surface that points rest on, at least (m).
const SPARE: f64 = 0.01;

/// A robot and the points that it touches (none in free air): all that contact needs. Clones share robot,
/// points and link shapes.
#[derive(Clone)]
pub struct Scene {
    robot: Arc<RobotModel>,
    rest: Arc<RestPoints>,
    gravity: Vector3<f64>,
    torque_kind: TorqueKind,
    tare_samples: usize,
    grids: Vec<LinkGrid>,
    links: Arc<[LinkSdf]>,
    /// Names of the links that may touch, if some were chosen.
    choice: Option<Vec<String>>,
    contact: ContactConfig,
    subdivision: usize,
    /// What the points stand for; `None` where they are moved alone.
    cells: Option<Cells>,
}

impl fmt::Debug for Scene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Scene")
            .field("robot", &self.robot.name())
            .field("points", &self.rest.len())
            .finish_non_exhaustive()
    }
}

impl Scene {
    /// Opens the scene of a recording, with the contact parameters of `options`. For a recording computed
    /// with parameters of its own, use [`SceneOptions::of`].
    ///
    /// # Errors
    /// No rest points, what [`Dataset::check`] refuses, an unknown or unreadable robot, joints that
    /// contradict the robot, no collision shapes, or parameters out of range.
    pub fn open(dataset: &Dataset, options: &SceneOptions) -> Result<Self, PipelineError> {
        let points = dataset
            .rest_points
            .clone()
            .or_else(|| Some(dataset.field.as_ref()?.points.clone()));
        Self::with_points(dataset, points.ok_or(PipelineError::NoPoints)?, options)
    }

    /// Opens the scene of a recording with other rest points than its own, such as those of a field.
    ///
    /// # Errors
    /// As [`Scene::open`].
    pub fn with_points(
        dataset: &Dataset,
        points: Vec<Point3<f64>>,
        options: &SceneOptions,
    ) -> Result<Self, PipelineError> {
        dataset.check()?;
        let robot = robot_of(dataset, &options.packages)?;
        Self::new(robot, points, options).map(|scene| scene.with_readings_of(dataset))
    }

    /// Creates the scene of a recording from a robot that is already loaded, such as one from the text of a
    /// URDF ([`RobotModel::from_urdf_str`]), and rest points.
    ///
    /// The robot is placed where it stood. Torques and gravity are those of the recording. The recording's
    /// robot name and the packages of the options are ignored.
    ///
    /// # Errors
    /// What [`Dataset::check`] refuses, joints that contradict the robot, no rest points, no collision
    /// shapes, or parameters out of range.
    pub fn with_robot(
        dataset: &Dataset,
        robot: RobotModel,
        points: Vec<Point3<f64>>,
        options: &SceneOptions,
    ) -> Result<Self, PipelineError> {
        dataset.check()?;
        let robot = placed(dataset, robot)?;
        Self::new(robot, points, options).map(|scene| scene.with_readings_of(dataset))
    }

    /// The same scene, with gravity and torques as a recording has them.
    fn with_readings_of(self, dataset: &Dataset) -> Self {
        Self {
            gravity: dataset.gravity,
            torque_kind: dataset.torque_kind,
            tare_samples: dataset.tare_samples,
            ..self
        }
    }

    /// Creates a scene without a recording, from a robot that is already loaded, such as one from the text
    /// of a URDF ([`RobotModel::from_urdf_str`]). It must be placed in the world.
    ///
    /// Gravity is (0, 0, -9.81) m/s², and torques are external and need no tare. The packages of the
    /// options are ignored. For a recording use [`Scene::with_robot`].
    ///
    /// ```
    /// use vsf_core::nalgebra::Point3;
    /// use vsf_pipeline::{Scene, SceneOptions};
    /// let robot = vsf_robots::cartesian_stage(0.01)?;
    /// let points = (0..9).map(|i| Point3::new(0.01 * f64::from(i), 0.0, -0.02)).collect();
    /// let scene = Scene::new(robot, points, &SceneOptions::default())?;
    /// let contact = scene.contact_model()?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// No rest points, no collision shapes, or parameters out of range.
    pub fn new(
        robot: impl Into<Arc<RobotModel>>,
        points: Vec<Point3<f64>>,
        options: &SceneOptions,
    ) -> Result<Self, PipelineError> {
        let robot = robot.into();
        if points.is_empty() {
            return Err(PipelineError::NoPoints);
        }
        options.contact.check()?;
        let rest = Arc::new(RestPoints::new(points)?);
        let spacing = rest.spacing();
        let cells = if options.subdivision == 1 || spacing == 0.0 {
            None
        } else {
            Some(Cells::new(&rest, spacing, options.subdivision)?)
        };
        let chosen = chosen_links(&robot, options.links.as_deref())?;
        let colliders: Vec<_> = robot
            .colliders()
            .iter()
            .filter(|c| chosen[c.link])
            .cloned()
            .collect();
        if colliders.is_empty() {
            return Err(PipelineError::NoShapes {
                robot: robot.name().to_owned(),
                reason: "its URDF has no <collision> shapes on the links that may touch".to_owned(),
            });
        }
        let choice = options.links.as_deref().and_then(|l| choice(&robot, l));
        // Grids reach beyond where points are touched, with a padding that is looked for.
        let grid = GridOptions {
            margin: options.grid.margin.max(options.contact.level() + SPARE),
            ..options.grid.clone()
        };
        let shape = |collider: usize| match &colliders[collider].shape {
            Shape::Mesh(mesh) => mesh.source().map(|file| format!("mesh {file}")),
            _ => None,
        };
        let shapes = link_sdfs(&colliders, &grid).map_err(|e| match e {
            ContactError::Collider {
                link,
                source,
                collider,
            } => PipelineError::LinkShape {
                robot: robot.name().to_owned(),
                link: robot.links()[link].name().to_owned(),
                shape: shape(collider).unwrap_or_else(|| "a collision shape".to_owned()),
                source: *source,
            },
            other => other.into(),
        })?;
        Ok(Self {
            robot,
            rest,
            gravity: GRAVITY,
            torque_kind: TorqueKind::External,
            tare_samples: 0,
            grids: shapes.grids,
            links: shapes.links.into(),
            choice,
            contact: options.contact,
            subdivision: options.subdivision,
            cells,
        })
    }

    /// Creates the scene of a recording in which the arm moves in free air: without points, and without
    /// link shapes. The robot is placed where it stood.
    ///
    /// # Errors
    /// What [`Dataset::check`] refuses, or joints that contradict the robot.
    pub fn in_air(dataset: &Dataset, robot: RobotModel) -> Result<Self, PipelineError> {
        dataset.check()?;
        let options = SceneOptions::default();
        Ok(Self {
            robot: placed(dataset, robot)?.into(),
            rest: Arc::new(RestPoints::new(Vec::new())?),
            gravity: dataset.gravity,
            torque_kind: dataset.torque_kind,
            tare_samples: dataset.tare_samples,
            grids: Vec::new(),
            links: Arc::new([]),
            choice: None,
            contact: options.contact,
            subdivision: options.subdivision,
            cells: None,
        })
    }

    /// Checks that this scene belongs to a recording: the robot has the same joints and stands where it
    /// stood, and torques and gravity have the same meaning.
    ///
    /// Points may differ, such as those of a field, and the scene may omit the tare
    /// ([`Scene::without_tare`]).
    ///
    /// # Errors
    /// [`PipelineError::OtherScene`], or joints that contradict the robot.
    pub fn check_recording(&self, dataset: &Dataset) -> Result<(), PipelineError> {
        check_joints(dataset, &self.robot)?;
        let differs = [
            ("base_pose", *self.robot.base_pose() != dataset.base_pose),
            ("gravity", self.gravity != dataset.gravity),
            ("torque_kind", self.torque_kind != dataset.torque_kind),
        ];
        match differs.into_iter().find(|(_, differs)| *differs) {
            Some((what, _)) => Err(PipelineError::OtherScene { what }),
            None => Ok(()),
        }
    }

    /// The same scene with other link shapes, such as distance functions of your own, each in the frame of
    /// its link.
    ///
    /// # Errors
    /// No shape, or a link that the robot does not have.
    pub fn with_link_shapes(&self, links: Vec<LinkSdf>) -> Result<Self, PipelineError> {
        let robot = self.robot.name();
        if links.is_empty() {
            let (robot, reason) = (robot.to_owned(), "none were given".to_owned());
            return Err(PipelineError::NoShapes { robot, reason });
        }
        let len = self.robot.link_count();
        if let Some(LinkSdf { link: index, .. }) = links.iter().find(|l| l.link >= len) {
            let (what, index) = ("link", *index);
            return Err(CoreError::OutOfRange { what, index, len }.into());
        }
        Ok(Self {
            links: links.into(),
            grids: Vec::new(),
            ..self.clone()
        })
    }

    /// The same scene without taring: readings are tared already, or wanted as the sensor gives them.
    #[must_use]
    pub fn without_tare(self) -> Self {
        Self {
            tare_samples: 0,
            ..self
        }
    }

    /// The same scene with other parameters of contact.
    ///
    /// # Errors
    /// Parameters out of range.
    pub fn with_contact(&self, contact: ContactConfig) -> Result<Self, PipelineError> {
        contact.check()?;
        Ok(Self {
            contact,
            ..self.clone()
        })
    }

    /// The same scene without sub-points: contact takes a fraction of the time and is less accurate.
    #[must_use]
    pub fn without_subdivision(&self) -> Self {
        Self {
            subdivision: 1,
            cells: None,
            ..self.clone()
        }
    }

    /// The robot, placed in the world.
    pub fn robot(&self) -> &Arc<RobotModel> {
        &self.robot
    }

    /// The rest points.
    pub fn rest(&self) -> &Arc<RestPoints> {
        &self.rest
    }

    /// Gravity (m/s²), world frame.
    pub fn gravity(&self) -> Vector3<f64> {
        self.gravity
    }

    /// Whether torques of the recording are external or measured.
    pub fn torque_kind(&self) -> TorqueKind {
        self.torque_kind
    }

    /// Number of samples at the start of each sequence that tare the sensor.
    pub fn tare_samples(&self) -> usize {
        self.tare_samples
    }

    /// Quality of the distance grids computed from meshes.
    pub fn grids(&self) -> &[LinkGrid] {
        &self.grids
    }

    /// Creates a new contact model of this scene; link shapes and sub-points are shared.
    ///
    /// # Errors
    /// None in practice: the parameters have been checked.
    pub fn contact_model(&self) -> Result<SceneContact, PipelineError> {
        let points = StickSlip::new(self.links.clone(), self.contact)?;
        Ok(match &self.cells {
            None => SceneContact::Points(points),
            Some(cells) => SceneContact::Cells(CellContact::new(points, cells.clone())),
        })
    }

    /// The same scene with a contact threshold that suits the spacing of its points, for estimating a
    /// field.
    ///
    /// The threshold is 0.8 of [`RestPoints::spacing`], rounded to a hundredth of a millimeter, from 0.1 mm
    /// to 1 cm. A cloud without spacing keeps its threshold. A point stands for its surroundings, up to
    /// half a spacing away along an edge and 0.87 of one along a diagonal.
    ///
    /// The paper's 2 mm leave gaps between points 1 cm apart, where a thin link or twig passes unfelt. The
    /// share of the spacing was chosen on recordings of plants (1 cm) and of silicone (1.5 and 2.5 mm).
    /// With 0.65 and with 0.8, errors are smaller than with 2 mm, or as small, in all recordings where
    /// touched places are touched again.
    ///
    /// # Errors
    /// A negative padding whose size is that of the threshold or more.
    pub fn with_suited_threshold(&self) -> Result<Self, PipelineError> {
        let spacing = self.rest.spacing();
        let threshold = if spacing > 0.0 {
            ((SUITED * spacing * 1e5).round() / 1e5).clamp(LEAST_THRESHOLD, LARGEST_SUITED)
        } else {
            self.contact.threshold
        };
        self.with_contact(ContactConfig {
            threshold,
            ..self.contact
        })
    }

    /// Parameters of contact.
    pub fn contact(&self) -> &ContactConfig {
        &self.contact
    }

    /// The contact parameters to store with a field estimated in this scene, or with a model found in it.
    pub fn contact_parameters(&self) -> ContactParameters {
        let ContactConfig {
            threshold,
            friction,
            slip_step,
            max_slip_iterations,
            padding,
            adhesion,
            parallel: _,
        } = self.contact;
        ContactParameters {
            threshold,
            friction,
            slip_step,
            max_slip_iterations,
            padding,
            adhesion,
            subdivision: self.subdivision,
            links: self.choice.clone(),
        }
    }

    /// Converts contact parameters stored elsewhere to the form that
    /// [`contact_parameters`](Scene::contact_parameters) has for this robot. Names of links that cannot
    /// touch are dropped; if all that can touch are named, the choice becomes `None`.
    pub fn as_stored_here(&self, contact: &ContactParameters) -> ContactParameters {
        let links = contact.links.as_deref();
        ContactParameters {
            links: links.and_then(|names| choice(&self.robot, names)),
            ..contact.clone()
        }
    }

    /// Shapes of the links that may touch, each in the frame of its link; empty in free air.
    pub fn link_shapes(&self) -> &[LinkSdf] {
        &self.links
    }

    /// Sub-points per edge of the cube that a rest point stands for.
    pub fn subdivision(&self) -> usize {
        self.subdivision
    }

    /// Unit of the readings of joint `j`: `N m`, or `N` for a sliding joint.
    pub fn unit(&self, j: usize) -> &'static str {
        self.robot.joints().get(j).map_or("N m", reading_unit)
    }

    /// Unit of the error norm over all joints.
    pub fn error_unit(&self) -> &'static str {
        let all = |unit| (0..self.robot.joint_count()).all(|j| self.unit(j) == unit);
        match (all("N m"), all("N")) {
            (true, _) => "N m",
            (_, true) => "N",
            _ => "N m and N",
        }
    }
}

fn chosen_links(robot: &RobotModel, names: Option<&[String]>) -> Result<Vec<bool>, PipelineError> {
    let Some(names) = names else {
        return Ok(vec![true; robot.link_count()]);
    };
    let mut chosen = vec![false; robot.link_count()];
    for name in names {
        chosen[robot.link_index(name)?] = true;
    }
    Ok(chosen)
}

/// The names, in order, without those of links that have no shape; `None` where all that have one are named.
fn choice(robot: &RobotModel, names: &[String]) -> Option<Vec<String>> {
    let with_shape = robot
        .colliders()
        .iter()
        .map(|c| robot.links()[c.link].name());
    let with_shape: BTreeSet<&str> = with_shape.collect();
    let can_touch = |name: &str| with_shape.contains(name) || robot.link_index(name).is_err();
    let names: BTreeSet<&str> = names.iter().map(String::as_str).collect();
    let is_choice = !with_shape.is_subset(&names);
    let kept = names.into_iter().filter(|name| can_touch(name));
    is_choice.then(|| kept.map(str::to_owned).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn scene(spacing: f64, padding: f64) -> Scene {
        let robot = vsf_robots::cartesian_stage(0.01).unwrap();
        let points = (0..5).map(|i| Point3::new(spacing * f64::from(i), 0.0, 0.0));
        let contact = ContactConfig {
            padding,
            ..ContactConfig::default()
        };
        let options = SceneOptions {
            contact,
            ..SceneOptions::default()
        };
        Scene::new(robot, points.collect(), &options).unwrap()
    }

    #[test]
    fn suited_thresholds_follow_the_spacing() {
        for (spacing, threshold) in [
            (0.01, 0.008),
            (0.0, 0.002),
            (1.0, 0.01),
            (1e-5, 1e-4),
            (0.009_999_99, 0.008),
        ] {
            let suited = scene(spacing, 0.0).with_suited_threshold().unwrap();
            let found = suited.contact().threshold;
            assert_eq!(found, threshold, "{spacing}");
        }
        assert!(scene(0.001, -0.0015).with_suited_threshold().is_err());
    }
}
