use super::PipelineWarning;
use crate::Scene;
use nalgebra::Point3;
use vsf_contact::{LinkGrid, LinkSdf};
use vsf_core::RestPoints;
use vsf_vision::{Camera, RgbdView, Sight};

/// Least share of the rest points near the surface that a camera sees.
const LEAST_NEAR: f64 = 0.01;
/// Most of the points near a mesh that may lie behind turned faces (good meshes: below 0.05 %), and
/// whose side may be a guess.
const MOST_TURNED: f64 = 0.005;
const MOST_UNSURE: f64 = 0.25;
/// No robot that touches soft things has a link of more meters, nor is there such a thing.
const MOST_SIZE: f64 = 10.0;
/// Nor one of less.
const LEAST_SIZE: f64 = 1e-3;
/// From how far on points may be touched: share of the object, and spacings of points.
const MOST_REACH: f64 = 0.25;
const MOST_SPACINGS: f64 = 4.0;
/// Points come in clusters where the eighth nearest is so many times as far as the nearest.
const MOST_CLUSTERED: f64 = 20.0;

/// Pixels of cameras are square, but for this factor.
const MOST_OBLONG: f64 = 1.2;

/// Checks a view: reports intrinsics that no camera has and a surface where there are no rest points.
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
    let (camera, [width, height]) = (view.camera(), view.size());
    let Camera { fx, fy, cx, cy, .. } = *camera;
    let is_square = (1.0 / MOST_OBLONG..=MOST_OBLONG).contains(&(fx / fy));
    let is_inside = (0.0..=width as f64).contains(&cx) && (0.0..=height as f64).contains(&cy);
    let odd = PipelineWarning::OddCamera {
        focal: [fx, fy],
        center: [cx, cy],
        size: [width, height],
    };
    let odd = (!(is_square && is_inside)).then_some(odd);
    odd.into_iter()
        .chain(elsewhere.then_some(warning))
        .collect()
}

/// Checks robot, points and the shapes that contact uses.
///
/// Reports words of a URDF that are not understood, points in clusters, links and objects in another unit
/// of length, points that are touched from afar, and meshes with flipped faces or with sides that can only
/// be guessed.
pub fn scene_warnings(scene: &Scene) -> Vec<PipelineWarning> {
    let odd = |link: &LinkSdf| {
        let (low, high) = link.sdf.bounds();
        let size = (high - low).max();
        let link = || scene.robot().links()[link.link].name().to_owned();
        if size > MOST_SIZE {
            let link = link();
            Some(PipelineWarning::HugeLink { link, size })
        } else if size < LEAST_SIZE {
            let link = link();
            Some(PipelineWarning::TinyLink { link, size })
        } else {
            None
        }
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
    let of_links = scene.link_shapes().iter().filter_map(odd);
    let huge = (size > MOST_SIZE).then_some(PipelineWarning::HugeObject { size });
    (misread.into_iter())
        .chain(huge)
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
