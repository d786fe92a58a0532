use crate::camera::{Bounds, View};
use crate::color::{Rgb, mix};
use crate::ticks::significant;
use crate::{ColorLimit, FieldView, PlotError};
use nalgebra::Point3;

/// Sampled points for the estimate of the cloud's spacing.
const SPACING_SAMPLES: usize = 64;

/// A point with an estimated value.
pub(crate) struct FieldPoint {
    pub(crate) p_W: Point3<f64>,
    /// Value relative to the color limit, 0..=1.
    pub(crate) level: f64,
}

/// A point without a value.
pub(crate) struct FaintPoint {
    pub(crate) p_W: Point3<f64>,
    pub(crate) color: Rgb,
    /// Belongs to the visible surface, not to the untouched part of the field.
    pub(crate) surface: bool,
}

/// What a field picture shows, sorted and counted.
pub(crate) struct Scene<'a> {
    /// In order of stiffness, softest first.
    pub(crate) field: Vec<FieldPoint>,
    pub(crate) faint: Vec<FaintPoint>,
    pub(crate) robot_W: &'a [Vec<Point3<f64>>],
    pub(crate) bounds: Bounds,
    /// Typical distance between neighboring points \[m\].
    pub(crate) spacing: f64,
    pub(crate) title: &'a str,
    pub(crate) summary: String,
    pub(crate) quantity: &'a str,
    /// Value at the upper end of the color bar \[N/m\].
    pub(crate) limit: f64,
    /// What that value is, and what lies above.
    pub(crate) limit_notes: Vec<String>,
    pub(crate) view: View,
    pub(crate) side: View,
}

impl<'a> Scene<'a> {
    /// Sorts the data of a checked view; keeps the stiffest `field_cap` points and an even pick
    /// of `faint_cap` others.
    pub(crate) fn new(
        view: &FieldView<'a>,
        field_cap: usize,
        faint_cap: usize,
    ) -> Result<Self, PlotError> {
        let is_touched = |i: usize| view.touched.get(i).copied().unwrap_or(true);
        let (mut drawn, rest): (Vec<usize>, Vec<usize>) =
            (0..view.points_W.len()).partition(|&i| is_touched(i));
        let value = |i: usize| view.stiffness[i];
        let limit = view.limit.resolve(drawn.iter().map(|&i| value(i)))?;
        let largest = drawn.iter().map(|&i| value(i)).fold(0.0, f64::max);
        let above = drawn.iter().filter(|&&i| value(i) > limit).count();

        drawn.sort_by(|&a, &b| value(a).total_cmp(&value(b)));
        let touched = drawn.len();
        drawn.drain(..touched.saturating_sub(field_cap));
        let field = drawn
            .iter()
            .map(|&i| FieldPoint {
                p_W: view.points_W[i],
                level: (value(i) / limit).clamp(0.0, 1.0),
            })
            .collect();

        let bounds = Bounds::around(view.points_W.iter().chain(view.context_W));
        Ok(Self {
            field,
            faint: thin_out(faint_points(view, &rest), faint_cap),
            robot_W: view.robot_W,
            bounds,
            spacing: spacing(view.points_W).unwrap_or(0.03 * bounds.size()),
            title: view.title,
            summary: summary(view, touched, drawn.len(), largest),
            quantity: view.quantity,
            limit,
            limit_notes: limit_notes(view.limit, limit, largest, above),
            view: View::from_angles(view.azimuth_deg, view.elevation_deg),
            side: View::side(view.azimuth_deg),
        })
    }
}

fn faint_points(view: &FieldView<'_>, untouched: &[usize]) -> Vec<FaintPoint> {
    let surface = view
        .context_W
        .iter()
        .enumerate()
        .map(|(i, &p_W)| FaintPoint {
            p_W,
            color: match view.context_colors.get(i) {
                Some(&color) => mix(color, [255; 3], 0.55),
                None => [206, 208, 212],
            },
            surface: true,
        });
    let untouched = untouched.iter().map(|&i| FaintPoint {
        p_W: view.points_W[i],
        color: [178, 182, 190],
        surface: false,
    });
    surface.chain(untouched).collect()
}

fn thin_out<T>(all: Vec<T>, cap: usize) -> Vec<T> {
    let count = all.len();
    if count <= cap {
        return all;
    }
    // Element i is kept where the running share i * cap / count steps up.
    let kept = |i: usize| (i + 1) * cap / count > i * cap / count;
    all.into_iter()
        .enumerate()
        .filter(|&(i, _)| kept(i))
        .map(|(_, p)| p)
        .collect()
}

fn summary(view: &FieldView<'_>, touched: usize, drawn: usize, largest: f64) -> String {
    let (total, quantity) = (view.points_W.len(), view.quantity);
    let mut text = match touched {
        0 => format!("none of {total} points touched yet"),
        1 if total == 1 => format!("1 point, {quantity} {} N/m", significant(largest)),
        _ if touched == total => format!(
            "{total} points, largest {quantity} {} N/m",
            significant(largest)
        ),
        _ => format!(
            "{touched} of {total} points touched, largest {quantity} {} N/m",
            significant(largest)
        ),
    };
    if drawn < touched {
        text += &format!("; the {drawn} largest are drawn");
    }
    text
}

/// The small print under the color bar: what its upper end is, and how much lies above.
fn limit_notes(kind: ColorLimit, limit: f64, largest: f64, above: usize) -> Vec<String> {
    if largest == 0.0 {
        return vec!["all are zero".into()];
    }
    let meaning = match kind {
        ColorLimit::Quantile(1.0) => "the largest".into(),
        ColorLimit::Quantile(level) => format!("{} % quantile", (1e4 * level).round() / 1e2),
        ColorLimit::Value(_) => "as chosen".into(),
    };
    let mut notes = vec![format!("top end {}:", significant(limit)), meaning];
    if above > 0 && significant(largest) != significant(limit) {
        notes.extend([
            format!("{above} above,"),
            format!("up to {}", significant(largest)),
        ]);
    }
    notes
}

/// Median distance to the nearest neighbor over an even sample of the points \[m\]; `None` when
/// all points coincide.
fn spacing(points_W: &[Point3<f64>]) -> Option<f64> {
    // Sorted along x, a search can stop as soon as the step in x alone is too long.
    let mut sorted = points_W.to_vec();
    sorted.sort_unstable_by(|a, b| a.x.total_cmp(&b.x));
    let nearest = |i: usize| {
        let p = sorted[i];
        let mut best = f64::INFINITY;
        let mut visit = |q: &Point3<f64>| {
            let (dx, dy, dz) = (q.x - p.x, q.y - p.y, q.z - p.z);
            let squared = dx * dx + dy * dy + dz * dz;
            if squared > 0.0 && squared < best {
                best = squared;
            }
            dx * dx < best
        };
        for q in &sorted[i + 1..] {
            if !visit(q) {
                break;
            }
        }
        for q in sorted[..i].iter().rev() {
            if !visit(q) {
                break;
            }
        }
        best.is_finite().then(|| best.sqrt())
    };
    let stride = sorted.len().div_ceil(SPACING_SAMPLES).max(1);
    let mut found: Vec<f64> = (0..sorted.len())
        .step_by(stride)
        .filter_map(nearest)
        .collect();
    found.sort_unstable_by(f64::total_cmp);
    found.get(found.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spacing_of_a_lattice_is_its_pitch() {
        let lattice: Vec<_> = (0..1000)
            .map(|i| {
                Point3::new(
                    f64::from(i % 10),
                    f64::from(i / 10 % 10),
                    f64::from(i / 100),
                ) * 0.01
            })
            .collect();
        assert!((spacing(&lattice).unwrap() - 0.01).abs() < 1e-12);
        assert_eq!(spacing(&[Point3::origin(); 5]), None);
    }

    #[test]
    fn thinning_keeps_exactly_the_cap_and_spreads_it() {
        let kept = thin_out((0..1000).collect(), 100);
        assert_eq!(kept.len(), 100);
        assert!(kept.windows(2).all(|w| w[1] - w[0] == 10));
        assert_eq!(thin_out(vec![1, 2], 5), [1, 2]);
    }

    #[test]
    fn the_stiffest_points_survive_a_cap() {
        let points_W: Vec<_> = (0..50)
            .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
            .collect();
        let stiffness: Vec<_> = (0..50).map(|i| f64::from(i * 7 % 50)).collect();
        let view = FieldView {
            points_W: &points_W,
            stiffness: &stiffness,
            limit: ColorLimit::Value(49.0),
            ..FieldView::default()
        };
        let scene = Scene::new(&view, 10, 10).unwrap();
        let levels: Vec<_> = scene
            .field
            .iter()
            .map(|p| (p.level * 49.0).round())
            .collect();
        assert_eq!(levels, (40..50).map(f64::from).collect::<Vec<_>>());
        assert!(scene.summary.contains("the 10 largest"));
    }
}
