use crate::camera::Camera;
use crate::canvas::{Anchor, Canvas, Disc, FAINT_INK, Font, GRID, INK, Rect, WHITE};
use crate::color::{Rgb, mix, stiffness_color};
use crate::scene::{FaintPoint, FieldPoint, Scene};
use crate::ticks::Ticks;
use crate::wire_box::{axes, wire_box};

pub(crate) const AXIS_NAMES: [&str; 3] = ["x [m]", "y [m]", "z [m]"];
/// Light enough for labels to stay readable on top.
const ROBOT: Rgb = [122, 158, 204];
/// Most numbers along an edge.
const MOST_TICKS: usize = 9;

/// A view along a world axis with ruled axes, the stiffest points in front.
pub(crate) fn projection_panel(
    scene: &Scene<'_>,
    camera: &Camera,
    title: &str,
    canvas: &mut dyn Canvas,
) {
    let rect = camera.rect;
    let (across, up) = camera.view.axes();
    canvas.text(
        title,
        (rect.x0, rect.y0 - 48.0),
        Anchor::Start,
        Font::Heading,
        INK,
    );
    canvas.text(
        AXIS_NAMES[up],
        (rect.x0 - 14.0, rect.y0 - 20.0),
        Anchor::End,
        Font::Label,
        INK,
    );

    let middle = scene.bounds.center_W();
    let place = |axis: usize, value: f64| {
        let mut p_W = middle;
        p_W[axis] = value;
        camera.project(&p_W)
    };
    let (lo, hi) = camera.right_range();
    let ticks = Ticks::fitting(lo, hi, rect.width());
    for &value in &ticks.values {
        let (x, _) = place(across, value);
        canvas.line((x, rect.y0), (x, rect.y1), 1.0, GRID);
        canvas.text(
            &ticks.label(value),
            (x, rect.y1 + 18.0),
            Anchor::Middle,
            Font::Label,
            INK,
        );
    }
    let (lo, hi) = camera.up_range();
    let ticks = Ticks::new(lo, hi, 5);
    for &value in &ticks.values {
        let (_, y) = place(up, value);
        canvas.line((rect.x0, y), (rect.x1, y), 1.0, GRID);
        canvas.text(
            &ticks.label(value),
            (rect.x0 - 10.0, y),
            Anchor::End,
            Font::Label,
            INK,
        );
    }
    canvas.text(
        AXIS_NAMES[across],
        (0.5 * (rect.x0 + rect.x1), rect.y1 + 44.0),
        Anchor::Middle,
        Font::Label,
        INK,
    );

    faint_points(scene, camera, canvas);
    robot(scene, camera, rect, canvas);
    let radius = (0.72 * scene.spacing * camera.scale).clamp(1.4, 14.0);
    for point in &scene.field {
        let color = stiffness_color(point.level);
        canvas.disc(Disc {
            at: camera.project(&point.p_W),
            radius,
            color,
            alpha: 1.0,
            ball: false,
        });
    }
    canvas.frame(rect, FAINT_INK);
}

/// The three-quarter view inside a wire box.
pub(crate) fn slanted_panel(
    scene: &Scene<'_>,
    camera: Camera,
    clip: Rect,
    canvas: &mut dyn Canvas,
) {
    let ticks = [0, 1, 2].map(|k| {
        let b = &scene.bounds;
        let (lo, hi) = (b.min_W[k], b.max_W[k]);
        let count = ((5.0 * (hi - lo) / b.size()).ceil() as usize).max(2);
        // One number alone gives no scale.
        let finer = (count..=MOST_TICKS).map(|n| Ticks::new(lo, hi, n));
        let mut with_scale = finer.filter(|ticks| ticks.values.len() > 1);
        with_scale
            .next()
            .unwrap_or_else(|| Ticks::new(lo, hi, count))
    });
    wire_box(&scene.bounds, &ticks, &camera, canvas);
    faint_points(scene, &camera, canvas);
    robot(scene, &camera, clip, canvas);
    axes(&scene.bounds, &ticks, &camera, canvas);

    // Far to near, but a stiffer point counts as nearer: soft material never veils a stiff part.
    let (middle, size) = (
        camera.view.nearness(&scene.bounds.center_W()),
        scene.bounds.size(),
    );
    let nearness = |p: &FieldPoint| (camera.view.nearness(&p.p_W) - middle) / size;
    let mut order: Vec<(f64, &FieldPoint)> = scene
        .field
        .iter()
        .map(|p| (nearness(p) + 2.0 * p.level, p))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The deeper the cloud, the fainter its soft points.
    let haze = (2.0 / (scene.field.len() as f64).cbrt()).clamp(0.04, 0.8);
    for (_, point) in order {
        let level = point.level;
        // Far points pale toward the paper: a cue for depth.
        let distance = (0.5 - nearness(point)).clamp(0.0, 1.0);
        let solid = (2.0 * level).min(1.0);
        canvas.disc(Disc {
            at: camera.project(&point.p_W),
            radius: (scene.spacing * camera.scale * (0.28 + 0.3 * level)).clamp(1.2, 16.0),
            color: mix(stiffness_color(level), WHITE, 0.35 * distance),
            alpha: haze + (1.0 - haze) * solid * solid * (3.0 - 2.0 * solid),
            ball: true,
        });
    }
}

/// Points without a value, far ones first.
fn faint_points(scene: &Scene<'_>, camera: &Camera, canvas: &mut dyn Canvas) {
    let mut order: Vec<&FaintPoint> = scene.faint.iter().collect();
    order.sort_by(|a, b| {
        camera
            .view
            .nearness(&a.p_W)
            .total_cmp(&camera.view.nearness(&b.p_W))
    });
    let pixels = scene.spacing * camera.scale;
    for point in order {
        let (share, alpha) = if point.surface {
            (0.4, 0.8)
        } else {
            (0.15, 0.25)
        };
        let radius = (share * pixels).clamp(0.8, 8.0);
        canvas.disc(Disc {
            at: camera.project(&point.p_W),
            radius,
            color: point.color,
            alpha,
            ball: false,
        });
    }
}

fn robot(scene: &Scene<'_>, camera: &Camera, clip: Rect, canvas: &mut dyn Canvas) {
    for line in scene.robot_W {
        let at: Vec<_> = line.iter().map(|p| camera.project(p)).collect();
        for pair in at.windows(2) {
            if let Some((a, b)) = clip.clip(pair[0], pair[1]) {
                canvas.line(a, b, 5.0, ROBOT);
            }
        }
        for &joint in at.iter().filter(|&&p| clip.contains(p)) {
            canvas.disc(Disc {
                at: joint,
                radius: 5.5,
                color: ROBOT,
                alpha: 1.0,
                ball: false,
            });
            canvas.disc(Disc {
                at: joint,
                radius: 2.5,
                color: WHITE,
                alpha: 1.0,
                ball: false,
            });
        }
    }
}
