mod actuators;
mod clock;
mod conventions;
mod gaps;
mod gravity;
mod jumps;
mod kind;
mod lag;
mod order;
mod readings;
mod saturation;
mod scale;
mod sensors;
mod spikes;
mod starts;
mod uncovered;
mod velocities;
mod weight;

pub use kind::{Outliers, PipelineWarning};
pub use readings::reading_warnings;
pub use saturation::{Saturation, saturated_joints};

use crate::readings::check_sequence;
use crate::{PipelineError, Scene, Trace, unwound};
use nalgebra::Point3;
use std::f64::consts::PI;
use vsf_contact::{LinkGrid, LinkSdf};
use vsf_core::{Belief, FilterHealth, Observation, RestPoints};
use vsf_data::Sequence;
use vsf_robots::{Joint, JointKind, RobotModel};
use vsf_vision::{RgbdView, Sight};

/// Joint limits are rounded in URDFs and met by controllers with a little overshoot (rad or m).
const LIMIT_SLACK: f64 = 1e-3;
/// Joints of arms turn no faster than this (rad/s).
const MOST_TURNING: f64 = 15.0;
/// No joint that counts in radians turns further than this from zero, or from its limits.
const MOST_TURNS: f64 = 4.0 * PI;
const MOST_BEYOND: f64 = PI;
/// Least share of the rest points near the surface that a camera sees.
const LEAST_NEAR: f64 = 0.01;
/// Most of the points near a mesh that may lie behind turned faces (good meshes: below 0.05 %), and
/// whose side may be a guess.
const MOST_TURNED: f64 = 0.005;
const MOST_UNSURE: f64 = 0.25;
/// No robot that touches soft things has a link of more meters.
const MOST_SIZE: f64 = 10.0;
/// From how far on points may be touched: share of the object, and spacings of points.
const MOST_REACH: f64 = 0.25;
const MOST_SPACINGS: f64 = 4.0;
/// Points come in clusters where the eighth nearest is so many times as far as the nearest.
const MOST_CLUSTERED: f64 = 20.0;
/// NIS per channel beyond which a filter knows nothing of its errors: diagonal filters reach 3 on good data.
const MOST_NIS: f64 = 30.0;
/// Share of the energy of the readings in contact below which a field explains nothing of them.
const LEAST_EXPLAINED: f64 = 0.02;
/// Share of the mean energy of sequences, of readings in contact, that one has at least to be judged on its own.
const LEAST_ENERGY: f64 = 0.1;

/// What looks wrong with the joint positions and velocities: degrees, positions outside the robot's limits,
/// jumps, missing samples, velocities that are not how fast positions change. Of sequences that [`Sequence::check`] refuses, or
/// with other joints than the robot's, only that.
pub fn motion_warnings(robot: &RobotModel, sequences: &[&Sequence]) -> Vec<PipelineWarning> {
    let checked = |s: &&Sequence| (s.id.clone(), check_sequence(robot, s));
    let malformed = malformed(sequences.iter().map(checked));
    if !malformed.is_empty() {
        return malformed;
    }
    let rows: Vec<Rows> = (sequences.iter())
        .map(|s| (s.id.as_str(), s.angles.iter().collect()))
        .collect();
    let beyond = |joint: &Joint, slack: f64| {
        let (lower, upper) = (joint.limits().lower - slack, joint.limits().upper + slack);
        move |q: f64| !(lower..=upper).contains(&q)
    };
    let of_joint = |(j, joint): (usize, &Joint)| {
        let turns = match joint.kind() {
            JointKind::Prismatic => false,
            JointKind::Revolute => true,
            // Goes on and on, if no faster than joints turn.
            JointKind::Continuous => sequences.iter().any(|s| top_speed(s, j) > MOST_TURNING),
        };
        let far = beyond(joint, MOST_BEYOND);
        if turns && let Some(found) = outliers(joint, j, &rows, |q| q.abs() > MOST_TURNS || far(q))
        {
            return Some(PipelineWarning::Degrees(found));
        }
        Some(PipelineWarning::OutsideLimits {
            lower: joint.limits().lower,
            upper: joint.limits().upper,
            unit: unit(joint),
            outliers: outliers(joint, j, &rows, beyond(joint, LIMIT_SLACK))?,
        })
    };
    let joints = robot.joints().iter().enumerate();
    let mut found: Vec<PipelineWarning> = joints.filter_map(of_joint).collect();
    if !(found.iter()).any(|w| matches!(w, PipelineWarning::Degrees(_))) {
        let jumps = || jumps::warning(robot, sequences);
        found.extend(clock::fast(robot, sequences).or_else(jumps));
    }
    found.extend(gaps::warning(sequences));
    let unwound: Vec<_> = sequences.iter().map(|s| unwound(robot, s)).collect();
    let clock = || clock::warning(robot, sequences);
    let still = || velocities::still(robot, &unwound);
    let fast = || jumps::speeds(robot, sequences);
    found.extend(
        velocities::warning(robot, &unwound)
            .or_else(still)
            .or_else(fast)
            .or_else(clock),
    );
    found
}

/// Most that a position changes from sample to sample, per time between them.
fn top_speed(sequence: &Sequence, j: usize) -> f64 {
    let speed = |k: usize| {
        let way = sequence.angles[k][j] - sequence.angles[k - 1][j];
        way.abs() / (sequence.time[k] - sequence.time[k - 1])
    };
    (1..sequence.len()).map(speed).fold(0.0, f64::max)
}

/// Unit of a joint's positions.
fn unit(joint: &Joint) -> &'static str {
    match joint.kind() {
        JointKind::Prismatic => "m",
        _ => "rad",
    }
}

/// Touches that begin inside of the object. Of sequences that [`Sequence::check`] refuses, or with other joints than the
/// robot's, only that.
pub fn touch_warnings(scene: &Scene, sequences: &[&Sequence]) -> Vec<PipelineWarning> {
    let checked = |s: &&Sequence| (s.id.clone(), check_sequence(scene.robot(), s));
    let malformed = malformed(sequences.iter().map(checked));
    if malformed.is_empty() {
        starts::warning(scene, sequences).into_iter().collect()
    } else {
        malformed
    }
}

/// What looks wrong with an online estimation: errors far beyond those it expects.
pub fn health_warnings(health: &FilterHealth) -> Vec<PipelineWarning> {
    let ratio = health.nis_ratio().filter(|ratio| *ratio > MOST_NIS);
    let warning = |ratio| PipelineWarning::Overconfident { ratio };
    ratio.map(warning).into_iter().collect()
}

/// What looks wrong with a field that was fitted to all readings at once: errors far beyond their noise. `traces` are
/// those that it has learned from; of ones that [`Trace::check`] refuses, only that.
pub fn fit_warnings(
    field: &Belief<f64>,
    noise_sd: &[f64],
    traces: &[Trace],
) -> Vec<PipelineWarning> {
    let of_trace = |t: &Trace| (t.id.clone(), t.check(field.len(), noise_sd.len()));
    let malformed = malformed(traces.iter().map(of_trace));
    if !malformed.is_empty() {
        return malformed;
    }
    let (mut squares, mut count) = (0.0, 0);
    in_contact(field, traces, |reading, predicted| {
        let errors = reading.iter().zip(predicted).zip(noise_sd);
        squares += errors
            .map(|((y, p), sd)| ((y - p) / sd).powi(2))
            .sum::<f64>();
        count += reading.len();
    });
    let ratio = squares / count.max(1) as f64;
    let misfit = (ratio > MOST_NIS).then_some(PipelineWarning::Misfit { ratio });
    misfit.into_iter().collect()
}

/// What looks wrong with any estimate: a field that explains nothing of the readings that it has learned from, or of some
/// of their sequences. `traces` are those; of ones that [`Trace::check`] refuses, only that.
pub fn field_warnings(field: &Belief<f64>, traces: &[Trace]) -> Vec<PipelineWarning> {
    let first = traces.iter().find_map(|t| t.observations.first());
    let channels = first.map_or(0, Observation::dim);
    let of_trace = |t: &Trace| (t.id.clone(), t.check(field.len(), channels));
    let malformed = malformed(traces.iter().map(of_trace));
    if !malformed.is_empty() {
        return malformed;
    }
    // What is left of each, and what it reads.
    let of_trace = |trace: &Trace| {
        let (mut left, mut all) = (0.0, 0.0);
        in_contact(field, std::slice::from_ref(trace), |reading, predicted| {
            let pairs = reading.iter().zip(predicted);
            left += pairs.map(|(y, p)| (y - p).powi(2)).sum::<f64>();
            all += reading.iter().map(|y| y * y).sum::<f64>();
        });
        (left, all)
    };
    let sums: Vec<(f64, f64)> = traces.iter().map(of_trace).collect();
    let total: f64 = sums.iter().map(|(_, all)| all).sum();
    let share = 1.0 - sums.iter().map(|(left, _)| left).sum::<f64>() / total;
    if share < LEAST_EXPLAINED {
        return vec![PipelineWarning::ExplainsNothing { share }];
    }
    let count = sums.iter().filter(|(_, all)| *all > 0.0).count() as f64;
    let judged = traces.iter().zip(&sums).filter_map(|(trace, (left, all))| {
        let share = 1.0 - left / all;
        (share < LEAST_EXPLAINED && *all * count >= LEAST_ENERGY * total).then_some((trace, share))
    });
    let missed: Vec<(&Trace, f64)> = judged.collect();
    let warning = missed
        .first()
        .map(|(trace, share)| PipelineWarning::ExplainsNothingOf {
            sequence: trace.id.clone(),
            share: *share,
            others: missed.len() - 1,
        });
    warning.into_iter().collect()
}

/// Shows `visit` every reading in contact, and what a field predicts of it.
fn in_contact(field: &Belief<f64>, traces: &[Trace], mut visit: impl FnMut(&[f64], &[f64])) {
    let mut predicted = Vec::new();
    let observations = traces.iter().flat_map(|t| &t.observations);
    for obs in observations.filter(|o| !o.is_empty()) {
        predicted.resize(obs.dim(), 0.0);
        obs.apply(field.mean(), &mut predicted);
        visit(obs.reading(), &predicted);
    }
}

/// The torques of springs of 1 N/m at every point that is touched.
fn springs(obs: &Observation<f64>) -> impl Iterator<Item = f64> {
    (0..obs.dim()).map(|j| obs.row(j).iter().sum())
}

/// Inner products of readings with what they are compared to.
#[derive(Default)]
struct Likeness {
    readings: f64,
    both: f64,
    others: f64,
}

impl Likeness {
    fn add(&mut self, reading: f64, other: f64) {
        self.readings += reading * reading;
        self.both += reading * other;
        self.others += other * other;
    }

    /// Readings per other, by least squares.
    fn slope(&self) -> f64 {
        self.both / self.others
    }

    /// Cosine of the angle between them, NaN where one is zero.
    fn correlation(&self) -> f64 {
        self.both / (self.readings * self.others).sqrt()
    }
}

/// What looks wrong with a view: a surface where there are no rest points.
pub fn view_warnings(rest: &RestPoints, view: &RgbdView) -> Vec<PipelineWarning> {
    let (points, reach) = (rest.len(), rest.spacing());
    let on_surface = |p: &&Point3<f64>| matches!(view.sight(p), Sight::Surface { behind, .. } if behind.abs() <= reach);
    let near = rest.positions().iter().filter(on_surface).count();
    let elsewhere = (near as f64) < LEAST_NEAR * points as f64;
    let warning = PipelineWarning::SurfaceElsewhere {
        near,
        points,
        reach,
    };
    elsewhere.then_some(warning).into_iter().collect()
}

/// What looks wrong with robot, points and the shapes that contact uses: words of a URDF that are not understood, points in
/// clusters, links far too large, points that are touched from afar, meshes with faces turned over or sides that are a guess.
pub fn scene_warnings(scene: &Scene) -> Vec<PipelineWarning> {
    let huge = |link: &LinkSdf| {
        let (low, high) = link.sdf.bounds();
        let size = (high - low).max();
        (size > MOST_SIZE).then(|| PipelineWarning::HugeLink {
            link: scene.robot().links()[link.link].name().to_owned(),
            size,
        })
    };
    let (low, high) = scene.rest().bounds();
    let spacing = scene.rest().spacing();
    let (level, size) = (scene.contact().level(), (high - low).norm());
    let most = (MOST_REACH * size).max(MOST_SPACINGS * spacing);
    let from_afar = size > 0.0 && level > most;
    let from_afar = from_afar.then_some(PipelineWarning::TouchesFromAfar { level, size });
    let unread = scene.robot().unread();
    let misread = unread.first().map(|first| PipelineWarning::UnreadUrdf {
        robot: scene.robot().name().to_owned(),
        first: first.clone(),
        others: unread.len() - 1,
    });
    let clustering = scene.rest().clustering();
    let clustered = clustering
        .filter(|times| *times > MOST_CLUSTERED)
        .map(|times| PipelineWarning::ClusteredPoints { spacing, times });
    let of_links = scene.link_shapes().iter().filter_map(huge);
    (misread.into_iter())
        .chain(clustered)
        .chain(of_links)
        .chain(from_afar)
        .chain(mesh_warnings(scene))
        .collect()
}

fn mesh_warnings(scene: &Scene) -> Vec<PipelineWarning> {
    let of_grid = |grid: &LinkGrid| {
        let link = || format!("mesh of link {:?}", scene.robot().links()[grid.link].name());
        let mesh = || grid.source.clone().unwrap_or_else(link);
        let (error, openness) = (&grid.report.error, &grid.report.openness);
        let turned = error.turned_share > MOST_TURNED;
        let unsure = 1.0 - error.sure_share;
        let turned = turned.then(|| PipelineWarning::TurnedFaces {
            mesh: mesh(),
            share: error.turned_share,
        });
        let open = (unsure > MOST_UNSURE).then(|| PipelineWarning::OpenMesh {
            mesh: mesh(),
            open: openness.boundary_edges,
            edges: openness.edges,
            share: unsure,
        });
        [turned, open].into_iter().flatten()
    };
    scene.grids().iter().flat_map(of_grid).collect()
}

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
