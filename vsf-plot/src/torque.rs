use crate::canvas::{FAINT_INK, GRID, INK};
use crate::decimate::{band, phases, thin_curve};
use crate::error::{check_len, check_values};
use crate::ticks::{significant, tick_label};
use crate::vector::{UNITS, printable, rgb, svg_file, units};
use crate::{PlotError, Rgb};
use plotters::prelude::*;

/// Largest magnitude of a torque \[N m\], a force \[N\] or a time \[s\].
const LARGE: f64 = 1e9;
/// Most panels in one picture.
const MAX_JOINTS: usize = 32;

// Blue, vermilion and orange of M. Okabe and K. Ito's palette for all color visions (2008).
const PREDICTED: Rgb = [0, 114, 178];
const NOMINAL: Rgb = [213, 94, 0];
const CONTACT: Rgb = [230, 159, 0];

/// Readings of one joint and their predictions.
#[derive(Debug, Clone, Copy)]
pub struct JointTrace<'a> {
    /// Name above the panel.
    pub name: &'a str,
    /// Unit of the values: "N m" (default) for a revolute joint, "N" for a prismatic one.
    pub unit: &'a str,
    /// Readings, one per time, each within ±1e9, that predictions are compared with.
    pub measured: &'a [f64],
    /// Predicted torques, one per time.
    pub predicted: &'a [f64],
    /// Predictions of a model before it was corrected, one per time, or empty. Their error is shown in the
    /// panel's title, and `predicted` is then labeled as corrected.
    pub nominal: &'a [f64],
    /// Standard deviations of the prediction, one per time, >= 0, drawn as a band of ±1 sigma; or empty for
    /// no band.
    pub sigma: &'a [f64],
}

impl Default for JointTrace<'_> {
    fn default() -> Self {
        Self {
            name: "",
            unit: "N m",
            measured: &[],
            predicted: &[],
            nominal: &[],
            sigma: &[],
        }
    }
}

/// A picture of measured and predicted joint torques: one panel per joint over a shared time axis. The
/// title of each panel has the root mean square error over all samples.
///
/// Long recordings are thinned to the pixels, but every extreme is kept. The error is computed from all
/// samples. The vertical range covers all curves and the band.
///
/// ```
/// use vsf_plot::{JointTrace, TorquePlot};
///
/// let time: Vec<f64> = (0..200).map(|i| 0.01 * f64::from(i)).collect();
/// let measured: Vec<f64> = time.iter().map(|t| (3.0 * t).sin()).collect();
/// let predicted: Vec<f64> = measured.iter().map(|tau| 0.9 * tau).collect();
/// let sigma = vec![0.1; 200];
/// let svg: String = TorquePlot {
///     time: &time,
///     joints: &[JointTrace {
///         name: "joint 1",
///         measured: &measured,
///         predicted: &predicted,
///         sigma: &sigma,
///         ..JointTrace::default()
///     }],
///     title: "Sequence 3",
///     ..TorquePlot::default()
/// }
/// .svg()?;
/// assert!(svg.contains("RMS error 0.0"));
/// # Ok::<(), vsf_plot::PlotError>(())
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct TorquePlot<'a> {
    /// Sample times \[s\], nondecreasing, each within ±1e9. At least one.
    pub time: &'a [f64],
    /// The joints, 1 to 32.
    pub joints: &'a [JointTrace<'a>],
    /// One flag per time, true while the robot touches the object (drawn shaded); or empty.
    pub contact: &'a [bool],
    /// First line of the picture. May be empty.
    pub title: &'a str,
}

impl TorquePlot<'_> {
    /// Renders the picture as an SVG file. Equal input gives equal bytes.
    ///
    /// # Errors
    /// [`PlotError::Empty`] without samples or joints, [`PlotError::TooMany`] joints,
    /// [`PlotError::Length`], [`PlotError::NotFinite`], [`PlotError::OutOfRange`] or
    /// [`PlotError::TimeOrder`] for data that violate what the fields state, [`PlotError::Encode`].
    pub fn svg(&self) -> Result<String, PlotError> {
        self.check()?;
        let grid = Grid::new(self.joints.len());
        svg_file(grid.width(), grid.height(), |backend| {
            self.draw(&grid, &backend.into_drawing_area())
                .map_err(|e| e.to_string())
        })
    }

    fn check(&self) -> Result<(), PlotError> {
        for (what, count) in [("time", self.time.len()), ("joints", self.joints.len())] {
            if count == 0 {
                return Err(PlotError::Empty { what: what.into() });
            }
        }
        if self.joints.len() > MAX_JOINTS {
            let got = self.joints.len();
            return Err(PlotError::TooMany {
                what: "joints".into(),
                got,
                max: MAX_JOINTS,
            });
        }
        check_values("time", self.time.iter().copied(), -LARGE, LARGE)?;
        if let Some(i) = self.time.windows(2).position(|w| w[1] < w[0]) {
            let (previous, value) = (self.time[i], self.time[i + 1]);
            return Err(PlotError::TimeOrder {
                index: i + 1,
                value,
                previous,
            });
        }
        if !self.contact.is_empty() {
            check_len("contact", self.contact.len(), self.time.len())?;
        }
        for (k, joint) in self.joints.iter().enumerate() {
            for (field, values, least) in [
                ("measured", joint.measured, -LARGE),
                ("predicted", joint.predicted, -LARGE),
                ("nominal", joint.nominal, -LARGE),
                ("sigma", joint.sigma, 0.0),
            ] {
                let what = format!("joints[{k}].{field}");
                let optional = matches!(field, "nominal" | "sigma");
                if !(optional && values.is_empty()) {
                    check_len(&what, values.len(), self.time.len())?;
                }
                check_values(&what, values.iter().copied(), least, LARGE)?;
            }
        }
        Ok(())
    }

    fn draw<D: DrawingBackend>(&self, grid: &Grid, root: &Area<D>) -> Drawn<D> {
        let span = padded(self.time[0], self.time[self.time.len() - 1], 0.0);
        text(root, self.title, (LEFT, 28.0), 24.0, INK)?;
        self.legend(root)?;
        let columns = grid.panel_width as usize;
        let phases = phases(self.time, self.contact, span, columns);
        for k in 0..self.joints.len() {
            self.panel(root, grid, k, span, &phases)?;
        }
        root.present()
    }

    fn legend<D: DrawingBackend>(&self, root: &Area<D>) -> Drawn<D> {
        let y = 62.0;
        let banded = self.joints.iter().any(|j| !j.sigma.is_empty());
        let corrected = self.joints.iter().any(|j| !j.nominal.is_empty());
        let entries = [
            ("reading", true, INK, 1.0),
            ("nominal model", corrected, NOMINAL, 1.0),
            ("corrected model", corrected, PREDICTED, 1.0),
            ("predicted", !corrected, PREDICTED, 1.0),
            ("prediction ± 1 sigma", banded, PREDICTED, BAND_ALPHA),
            ("contact", !self.contact.is_empty(), CONTACT, CONTACT_ALPHA),
        ];
        let mut x = LEFT;
        for (name, _, color, alpha) in entries.into_iter().filter(|e| e.1) {
            let half = if alpha < 1.0 { 7.0 } else { 1.25 };
            let swatch = [
                (units(x), units(y - half)),
                (units(x + 28.0), units(y + half)),
            ];
            root.draw(&Rectangle::new(swatch, rgb(color).mix(alpha).filled()))?;
            text(root, name, (x + 36.0, y), 17.0, INK)?;
            x += 36.0 + 9.0 * name.chars().count() as f64 + 30.0;
        }
        Ok(())
    }

    fn panel<D: DrawingBackend>(
        &self,
        root: &Area<D>,
        grid: &Grid,
        k: usize,
        span: (f64, f64),
        phases: &[(f64, f64)],
    ) -> Drawn<D> {
        let (joint, (x, y)) = (&self.joints[k], grid.place(k));
        let last = grid.is_last_of_column(k);
        let unit = joint.unit;
        let rms = significant(rms_error(joint.measured, joint.predicted));
        let errors = match joint.nominal {
            [] => rms,
            nominal => format!(
                "{} to {rms}",
                significant(rms_error(joint.measured, nominal))
            ),
        };
        let title = format!("{} [{unit}], RMS error {errors} {unit}", joint.name);
        text(root, &title, (x + LEFT, y + 12.0), 17.0, INK)?;

        let below = if last { TIME_AXIS } else { 0.0 };
        let size = (grid.panel_width + LEFT, grid.panel_height + below);
        let area = root.clone().shrink(
            (units(x), units(y + HEADER)),
            (units(size.0) as u32, units(size.1) as u32),
        );
        let range = value_range(joint);
        let mut chart = ChartBuilder::on(&area)
            .set_label_area_size(LabelAreaPosition::Left, units(LEFT))
            .set_label_area_size(LabelAreaPosition::Bottom, units(below))
            .build_cartesian_2d(span.0..span.1, range.0..range.1)?;

        let shade = rgb(CONTACT).mix(CONTACT_ALPHA).filled();
        chart.draw_series(
            phases
                .iter()
                .map(|p| Rectangle::new([(p.0, range.0), (p.1, range.1)], shade)),
        )?;
        let label = ("sans-serif", UNITS * 17.0).into_font().color(&rgb(INK));
        let (across, up) = (grid.panel_width / 90.0, grid.panel_height / 30.0);
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(rgb(GRID).stroke_width(UNITS as u32))
            .axis_style(rgb(FAINT_INK).stroke_width(UNITS as u32))
            .label_style(label)
            .set_all_tick_mark_size(units(5.0))
            .x_labels(across as usize)
            .x_label_formatter(&|t| numbered(*t, span, across))
            .y_labels(up as usize)
            .y_label_formatter(&|v| numbered(*v, range, up))
            .x_desc(if last { "time [s]" } else { "" })
            .draw()?;

        let columns = grid.panel_width as usize;
        if !joint.sigma.is_empty() {
            let edge = |sign: f64| -> Vec<f64> {
                joint
                    .predicted
                    .iter()
                    .zip(joint.sigma)
                    .map(|(p, s)| p + sign * s)
                    .collect()
            };
            let outline = band(self.time, &edge(-1.0), &edge(1.0), span, columns);
            let fill = rgb(PREDICTED).mix(BAND_ALPHA).filled();
            chart.draw_series([Polygon::new(outline, fill)])?;
        }
        let curves = [
            (joint.measured, INK),
            (joint.nominal, NOMINAL),
            (joint.predicted, PREDICTED),
        ];
        for (values, color) in curves.into_iter().filter(|c| !c.0.is_empty()) {
            let curve = thin_curve(self.time, values, span, columns);
            let style = rgb(color).stroke_width(units(1.5) as u32);
            chart.draw_series(LineSeries::new(curve, style))?;
        }
        Ok(())
    }
}

type Area<D> = DrawingArea<D, plotters::coord::Shift>;
type Drawn<D> = Result<(), DrawingAreaErrorKind<<D as DrawingBackend>::ErrorType>>;

const BAND_ALPHA: f64 = 0.22;
const CONTACT_ALPHA: f64 = 0.14;
/// Room \[px\] for the numbers at the left, the title and legend, a panel's title, the time axis.
const LEFT: f64 = 72.0;
const TOP: f64 = 86.0;
const HEADER: f64 = 26.0;
const TIME_AXIS: f64 = 52.0;
const MARGIN: f64 = 24.0;

/// Where the panels lie: filled row by row.
struct Grid {
    count: usize,
    columns: usize,
    panel_width: f64,
    panel_height: f64,
}

impl Grid {
    fn new(count: usize) -> Self {
        let (columns, panel_width) = match count {
            0..=8 => (1, 1000.0),
            9..=16 => (2, 620.0),
            _ => (4, 420.0),
        };
        let panel_height = match count {
            0..=1 => 300.0,
            2..=3 => 200.0,
            _ => 120.0,
        };
        Self {
            count,
            columns,
            panel_width,
            panel_height,
        }
    }

    fn cell(&self) -> (f64, f64) {
        (
            LEFT + self.panel_width + MARGIN,
            HEADER + self.panel_height + 10.0,
        )
    }

    fn place(&self, k: usize) -> (f64, f64) {
        let (w, h) = self.cell();
        (
            w * (k % self.columns) as f64,
            TOP + h * (k / self.columns) as f64,
        )
    }

    fn is_last_of_column(&self, k: usize) -> bool {
        k + self.columns >= self.count
    }

    fn width(&self) -> u32 {
        (self.cell().0 * self.columns as f64) as u32
    }

    fn height(&self) -> u32 {
        let rows = self.count.div_ceil(self.columns);
        (TOP + self.cell().1 * rows as f64 + TIME_AXIS) as u32
    }
}

fn text<D: DrawingBackend>(
    root: &Area<D>,
    words: &str,
    (x, y): (f64, f64),
    pixels: f64,
    color: Rgb,
) -> Drawn<D> {
    use plotters::style::text_anchor::{HPos, Pos, VPos};
    let color = rgb(color);
    let style = TextStyle::from(("sans-serif", UNITS * pixels).into_font())
        .color(&color)
        .pos(Pos::new(HPos::Left, VPos::Center));
    root.draw(&Text::new(printable(words), (units(x), units(y)), style))
}

/// The number at a tick of a range that has room for `count` ticks.
fn numbered(value: f64, (lo, hi): (f64, f64), count: f64) -> String {
    tick_label(value, (hi - lo) / count, lo.abs().max(hi.abs()))
}

fn rms_error(measured: &[f64], predicted: &[f64]) -> f64 {
    let squares = measured.iter().zip(predicted).map(|(m, p)| (m - p).powi(2));
    (squares.sum::<f64>() / measured.len() as f64).sqrt()
}

/// The range of all curves and of the band, a little wider.
fn value_range(joint: &JointTrace<'_>) -> (f64, f64) {
    let curves = [joint.measured, joint.predicted, joint.nominal].concat();
    let sides = joint.predicted.iter().zip(joint.sigma);
    let values = curves
        .into_iter()
        .chain(sides.flat_map(|(p, s)| [p - s, p + s]));
    let (lo, hi) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |m, v| {
        (m.0.min(v), m.1.max(v))
    });
    padded(lo, hi, 0.06)
}

/// The range, wider on both sides by this share, and never so narrow that its ends agree.
fn padded(lo: f64, hi: f64, share: f64) -> (f64, f64) {
    let least = 1e-6 * lo.abs().max(hi.abs()).max(1.0);
    if hi - lo < least {
        let (middle, half) = (0.5 * (lo + hi), 0.5 * least.max(1e-3));
        return (middle - half, middle + half);
    }
    let pad = share * (hi - lo);
    (lo - pad, hi + pad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn range_holds_curves_and_band() {
        let (m, p) = ([0.0, 1.0], [0.5, 2.0]);
        let range = |sigma| {
            value_range(&JointTrace {
                measured: &m,
                predicted: &p,
                sigma,
                ..Default::default()
            })
        };
        let is = |(lo, hi): (f64, f64), low: f64, high: f64| {
            (lo - low).abs() < 1e-12 && (hi - high).abs() < 1e-12
        };
        assert!(is(range(&[]), -0.12, 2.12));
        assert!(is(range(&[0.1, 0.1]), -0.126, 2.226));
        // However wide the band is: cut off, nobody reads its width.
        assert!(is(range(&[100.0, 100.0]), -111.59, 114.09));
    }

    #[test]
    fn error_over_all_samples() {
        assert_eq!(rms_error(&[0.0, 3.0], &[0.0, -1.0]), 8f64.sqrt());
    }

    #[test]
    fn a_correction_shows_both_errors() {
        let joint = JointTrace {
            name: "j",
            measured: &[0.0, 3.0],
            predicted: &[0.0, 2.0],
            nominal: &[0.0, -1.0],
            ..Default::default()
        };
        let plot = |joint| {
            TorquePlot {
                time: &[0.0, 1.0],
                joints: &[joint],
                ..Default::default()
            }
            .svg()
        };
        let svg = plot(joint).unwrap();
        for part in [
            "reading",
            "RMS error 2.83 to 0.707 N m",
            "nominal model",
            "corrected model",
        ] {
            assert!(svg.contains(part), "{part}");
        }
        assert_eq!(value_range(&joint).0, padded(-1.0, 3.0, 0.06).0);
        let short = JointTrace {
            nominal: &[0.0],
            ..joint
        };
        let error = plot(short).unwrap_err().to_string();
        assert!(error.contains("joints[0].nominal"), "{error}");
    }
}
