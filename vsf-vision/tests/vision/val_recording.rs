//! The view of a recorded plant against its rest points, which were made by another program: seen
//! surface points about 8 mm apart, and a grid of about 10 mm of what lies behind them.

use std::path::Path;
use vsf_core::RestPoints;
use vsf_data::{Dataset, Overrides};
use vsf_vision::{Bounds, Camera, OcclusionGrid, RgbdView, Seen, Sight, Visibility};

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

    // No point of theirs lies in what we think free: all are on the surface or behind it.
    for p in rest.positions() {
        let sight = view.sight(p);
        let behind = matches!(sight, Sight::Surface { behind, .. } if behind > -1e-6);
        assert!(behind, "{p}: {sight:?}");
    }
    let seen = Seen::new(&view, rest.positions(), 1e-3).unwrap();
    let visible = seen.visible.iter().filter(|v| **v).count();
    let theirs = (rest.len() - visible) as f64;
    let dims = [0, 1, 2].map(|k| (bounds.size()[k] / spacing).round() as usize);
    let grid = OcclusionGrid::new(&view, &bounds, dims).unwrap();

    // We find about as many hidden ones.
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
