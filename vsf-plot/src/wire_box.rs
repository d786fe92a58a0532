use crate::camera::{Bounds, Camera};
use crate::canvas::{Anchor, Canvas, FAINT_INK, Font, GRID, INK};
use crate::color::Rgb;
use crate::panel::AXIS_NAMES;
use crate::ticks::Ticks;
use nalgebra::Point3;

/// Coordinate of the box's side that faces the viewer.
fn near(b: &Bounds, camera: &Camera, k: usize) -> f64 {
    if camera.view.toward_W[k] >= 0.0 {
        b.max_W[k]
    } else {
        b.min_W[k]
    }
}

/// Coordinate of the opposite side.
fn far(b: &Bounds, camera: &Camera, k: usize) -> f64 {
    if camera.view.toward_W[k] >= 0.0 {
        b.min_W[k]
    } else {
        b.max_W[k]
    }
}

/// Floor grid and back faces of the bounding box.
pub(crate) fn wire_box(b: &Bounds, ticks: &[Ticks; 3], camera: &Camera, canvas: &mut dyn Canvas) {
    let (near, far) = (|k| near(b, camera, k), |k| far(b, camera, k));
    let (floor, ceiling) = (b.min_W.z, b.max_W.z);
    let mut rule = |from: Point3<f64>, to: Point3<f64>, color: Rgb| {
        canvas.line(camera.project(&from), camera.project(&to), 1.0, color);
    };
    for &x in &ticks[0].values {
        rule(
            Point3::new(x, b.min_W.y, floor),
            Point3::new(x, b.max_W.y, floor),
            GRID,
        );
        rule(
            Point3::new(x, far(1), floor),
            Point3::new(x, far(1), ceiling),
            GRID,
        );
    }
    for &y in &ticks[1].values {
        rule(
            Point3::new(b.min_W.x, y, floor),
            Point3::new(b.max_W.x, y, floor),
            GRID,
        );
        rule(
            Point3::new(far(0), y, floor),
            Point3::new(far(0), y, ceiling),
            GRID,
        );
    }
    for &z in &ticks[2].values {
        rule(
            Point3::new(far(0), b.min_W.y, z),
            Point3::new(far(0), b.max_W.y, z),
            GRID,
        );
        rule(
            Point3::new(b.min_W.x, far(1), z),
            Point3::new(b.max_W.x, far(1), z),
            GRID,
        );
    }
    for z in [floor, ceiling] {
        rule(
            Point3::new(far(0), b.min_W.y, z),
            Point3::new(far(0), b.max_W.y, z),
            FAINT_INK,
        );
        rule(
            Point3::new(b.min_W.x, far(1), z),
            Point3::new(b.max_W.x, far(1), z),
            FAINT_INK,
        );
    }
    rule(
        Point3::new(near(0), b.min_W.y, floor),
        Point3::new(near(0), b.max_W.y, floor),
        FAINT_INK,
    );
    rule(
        Point3::new(b.min_W.x, near(1), floor),
        Point3::new(b.max_W.x, near(1), floor),
        FAINT_INK,
    );
    for (x, y) in [(far(0), far(1)), (far(0), near(1)), (near(0), far(1))] {
        rule(
            Point3::new(x, y, floor),
            Point3::new(x, y, ceiling),
            FAINT_INK,
        );
    }
}

/// Numbers and names of the three axes, on the outer edges of the box.
pub(crate) fn axes(b: &Bounds, ticks: &[Ticks; 3], camera: &Camera, canvas: &mut dyn Canvas) {
    let (near, far) = (|k| near(b, camera, k), |k| far(b, camera, k));
    let center = b.center_W();
    let (floor, x_edge, y_edge) = (b.min_W.z, near(1), near(0));
    // The upright edge at the left of the picture carries the z axis.
    let uprights = [(far(0), near(1)), (near(0), far(1))].map(|(x, y)| Point3::new(x, y, center.z));
    let [p, q] = uprights.map(|p| camera.project(&p).0);
    let z_edge = uprights[usize::from(q < p)];
    axis(
        camera,
        &ticks[0],
        0,
        Point3::new(center.x, x_edge, floor),
        center,
        canvas,
    );
    axis(
        camera,
        &ticks[1],
        1,
        Point3::new(y_edge, center.y, floor),
        center,
        canvas,
    );
    axis(camera, &ticks[2], 2, z_edge, center, canvas);
}

/// Numbers and name of an axis, outside the edge through `on_edge_W`.
fn axis(
    camera: &Camera,
    ticks: &Ticks,
    k: usize,
    on_edge_W: Point3<f64>,
    center_W: Point3<f64>,
    canvas: &mut dyn Canvas,
) {
    let mut inner_W = center_W;
    inner_W.z = on_edge_W.z;
    let (inner, edge) = (camera.project(&inner_W), camera.project(&on_edge_W));
    // Away from the box, square to the edge.
    let mut end_W = on_edge_W;
    end_W[k] += 1.0 / camera.scale;
    let end = camera.project(&end_W);
    let along = (end.0 - edge.0, end.1 - edge.1);
    let square = (-along.1, along.0);
    let length = square.0.hypot(square.1).max(1e-12);
    let sign = (square.0 * (edge.0 - inner.0) + square.1 * (edge.1 - inner.1)).signum();
    let out = (sign * square.0 / length, sign * square.1 / length);

    let anchor = match out.0 {
        x if x < -0.35 => Anchor::End,
        x if x > 0.35 => Anchor::Start,
        _ => Anchor::Middle,
    };
    let mut longest = 0;
    for &value in &ticks.values {
        let mut p_W = on_edge_W;
        p_W[k] = value;
        let (x, y) = camera.project(&p_W);
        let label = ticks.label(value);
        longest = longest.max(label.len());
        canvas.line((x, y), (x + 6.0 * out.0, y + 6.0 * out.1), 1.0, INK);
        let at = (x + 12.0 * out.0, y + 18.0 * out.1);
        canvas.text(&label, at, anchor, Font::Label, INK);
    }
    // The name stands beyond the widest number.
    let beyond = 22.0 + 11.0 * longest as f64 * out.0.abs();
    let at = (edge.0 + beyond * out.0, edge.1 + (beyond + 30.0) * out.1);
    canvas.text(AXIS_NAMES[k], at, anchor, Font::Label, INK);
}
