//! The view of a recorded plant against its rest points, which were made by another program: seen
//! surface points about 8 mm apart, and a grid of about 10 mm of what lies behind them.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use vsf_core::RestPoints;
use vsf_data::{Dataset, Overrides};
use vsf_vision::{Bounds, Camera, OcclusionGrid, RgbdView, Seen, Visibility};

#[test]
fn rest_points_of_a_plant_are_on_and_behind_its_surface() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vsf-cli/data/orange_tree");
    let (dataset, _) = Dataset::open(folder, &Overrides::default()).unwrap();
    let view = dataset.camera.unwrap();
    let camera = Camera {
        fx: view.fx,
        fy: view.fy,
        cx: view.cx,
        cy: view.cy,
        X_WC: view.X_WC,
    };
    let size = (view.width as usize, view.height as usize);
    let view = RgbdView::new(camera, size, &view.color, &view.depth, view.depth_scale).unwrap();
    let [lo, hi] = dataset.object_bbox.unwrap();
    let bounds = Bounds::new(lo, hi).unwrap();
    let rest = RestPoints::new(dataset.rest_points.unwrap()).unwrap();
    let spacing = rest.spacing();

    let seen = Seen::new(&view, rest.positions(), 1e-3).unwrap();
    let visible = seen.visible.iter().filter(|v| **v).count();
    assert!(seen.behind.iter().all(|b| b.is_finite()));

    // Every point that is not on the surface lies in a cell that we do not think free.
    let dims = [0, 1, 2].map(|k| (bounds.size()[k] / spacing).round() as usize);
    let grid = OcclusionGrid::new(&view, &bounds, dims).unwrap();
    let cell = |k: usize, x: f64| (((x - lo[k]) / grid.edges()[k]) as usize).min(dims[k] - 1);
    let state = |i: usize| {
        let p = rest.positions()[i];
        let at = [0, 1, 2].map(|k| cell(k, p[k]));
        grid.cells()[(at[0] * dims[1] + at[1]) * dims[2] + at[2]]
    };
    let hidden = (0..rest.len()).filter(|&i| !seen.visible[i]);
    let free = hidden
        .clone()
        .filter(|&i| state(i) == Visibility::Free)
        .count();
    assert!(free * 50 < rest.len(), "{free} of {}", rest.len());

    // And we find about as many of them.
    let theirs = hidden.count() as f64;
    let [surface, occluded] =
        [Visibility::Surface, Visibility::Occluded].map(|v| grid.centers(v).count() as f64);
    let cells = (grid.edges().product() / spacing.powi(3)).recip();
    assert!(
        (occluded - surface..occluded + 2.0 * surface).contains(&(theirs * cells)),
        "{theirs} hidden points, {occluded} hidden and {surface} surface cells"
    );

    // The surface as we thin it is the one they thinned.
    let cloud = view.cloud(&bounds).downsampled(0.008).unwrap();
    let ratio = cloud.len() as f64 / visible as f64;
    assert!(
        (0.5..2.0).contains(&ratio),
        "{} against {visible}",
        cloud.len()
    );
}
