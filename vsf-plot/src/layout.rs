use crate::camera::{Camera, View};
use crate::canvas::{Anchor, Canvas, FAINT_INK, Font, INK, Rect};
use crate::color::stiffness_color;
use crate::panel::{projection_panel, slanted_panel};
use crate::scene::Scene;
use crate::ticks::Ticks;

const SLANTED: Rect = Rect {
    x0: 30.0,
    y0: 110.0,
    x1: 860.0,
    y1: 905.0,
};
const TOP: Rect = Rect {
    x0: 965.0,
    y0: 155.0,
    x1: 1405.0,
    y1: 465.0,
};
const SIDE: Rect = Rect {
    x0: 965.0,
    y0: 600.0,
    x1: 1405.0,
    y1: 880.0,
};
const BAR: Rect = Rect {
    x0: 1465.0,
    y0: 155.0,
    x1: 1490.0,
    y1: 755.0,
};

/// Draws the whole field picture.
pub(crate) fn draw(scene: &Scene<'_>, canvas: &mut dyn Canvas) {
    canvas.text(scene.title, (40.0, 40.0), Anchor::Start, Font::Title, INK);
    canvas.text(
        &scene.summary,
        (40.0, 76.0),
        Anchor::Start,
        Font::Label,
        FAINT_INK,
    );

    slanted_panel(
        scene,
        Camera::fit(
            scene.view,
            &scene.bounds,
            SLANTED.shrunk(110.0, 40.0, 70.0, 85.0),
        ),
        SLANTED,
        canvas,
    );

    let margin = |r: Rect| r.shrunk(22.0, 22.0, 22.0, 22.0);
    let mut cameras = [(View::top(), TOP), (scene.side, SIDE)]
        .map(|(view, rect)| Camera::fit(view, &scene.bounds, margin(rect)));
    let common = cameras[0].scale.min(cameras[1].scale);
    for (camera, rect) in cameras.iter_mut().zip([TOP, SIDE]) {
        camera.scale = common;
        camera.rect = rect;
    }
    projection_panel(scene, &cameras[0], "top view, from +z", canvas);
    let side_title = format!("side view, from {}", scene.side.seen_from());
    projection_panel(scene, &cameras[1], &side_title, canvas);

    color_bar(scene, canvas);
    let paler = format!(
        "in space, points far away or of little {} are paler",
        scene.quantity
    );
    for (line, y) in [paler, legend(scene)].iter().zip([917.0, 937.0]) {
        canvas.text(line, (40.0, y), Anchor::Start, Font::Small, FAINT_INK);
    }
}

/// What the marks mean, for those that occur.
fn legend(scene: &Scene<'_>) -> String {
    let mut parts = Vec::new();
    if scene.faint.iter().any(|p| !p.surface) {
        parts.push("gray: not touched");
    }
    if scene.faint.iter().any(|p| p.surface) {
        parts.push("pale: object surface");
    }
    if scene.robot_W.iter().any(|line| !line.is_empty()) {
        parts.push("blue line: robot");
    }
    let largest = format!(
        "top and side view: largest {} along each line of sight",
        scene.quantity
    );
    parts.push(&largest);
    parts.join("  |  ")
}

fn color_bar(scene: &Scene<'_>, canvas: &mut dyn Canvas) {
    let caption = format!("{} [N/m]", scene.quantity);
    canvas.text(
        &caption,
        (1580.0, TOP.y0 - 48.0),
        Anchor::End,
        Font::Heading,
        INK,
    );
    let slices = 200;
    let height = BAR.height() / f64::from(slices);
    for i in 0..slices {
        let y1 = BAR.y1 - height * f64::from(i);
        let level = (f64::from(i) + 0.5) / f64::from(slices);
        let slice = Rect {
            y0: y1 - height,
            y1,
            ..BAR
        };
        canvas.rect(slice, stiffness_color(level));
    }
    canvas.frame(BAR, INK);
    let ticks = Ticks::new(0.0, scene.limit, 6);
    for &value in &ticks.values {
        let y = BAR.y1 - BAR.height() * value / scene.limit;
        canvas.line((BAR.x1, y), (BAR.x1 + 6.0, y), 1.0, INK);
        canvas.text(
            &ticks.label(value),
            (BAR.x1 + 12.0, y),
            Anchor::Start,
            Font::Label,
            INK,
        );
    }
    for (i, note) in scene.limit_notes.iter().enumerate() {
        let y = BAR.y1 + 30.0 + 22.0 * i as f64;
        canvas.text(
            note,
            (BAR.x0 - 10.0, y),
            Anchor::Start,
            Font::Small,
            FAINT_INK,
        );
    }
}
