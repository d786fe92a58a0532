use crate::PlotError;
use crate::canvas::{Anchor, Canvas, Disc, FAINT_INK, Font, GRID, INK, Rect};
use crate::color::Rgb;
use crate::error::{check_len, check_values};
use crate::raster::Raster;
use crate::ticks::{Ticks, log_ticks};
use crate::vector::{Vector, svg_file};

/// Largest magnitude of a number, and smallest on a logarithmic axis.
const LARGE: f64 = 1e12;
const SMALL: f64 = 1e-12;

/// The palette for all color visions of M. Okabe and K. Ito (2008), without its yellow.
const PALETTE: [Rgb; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [86, 180, 233],
    [230, 159, 0],
    [0, 0, 0],
];

const FRAME: Rect = Rect {
    x0: 90.0,
    y0: 150.0,
    x1: 970.0,
    y1: 570.0,
};
/// Lines of the legend.
const LEGEND_TOP: f64 = 72.0;
const LINE: f64 = 26.0;

/// One curve: points joined by lines, each with an optional error bar.
#[derive(Debug, Clone, Copy, Default)]
pub struct Curve<'a> {
    /// Name in the legend.
    pub name: &'a str,
    /// Horizontal positions, each within ±1e12. At least one.
    pub x: &'a [f64],
    /// Values, one per position, within ±1e12; at least 1e-12 on a logarithmic axis.
    pub y: &'a [f64],
    /// Lower ends of the bars, one per position, or empty for no bars. They may lie outside of the axis
    /// range, which follows the values; the bars are then cut off at the frame.
    pub low: &'a [f64],
    /// Upper ends of the bars, as many as `low`.
    pub high: &'a [f64],
}

/// A picture of curves over a common axis.
///
/// ```
/// use vsf_plot::{Curve, CurvePlot};
///
/// let curve = Curve {
///     name: "field",
///     x: &[1.0, 2.0, 4.0],
///     y: &[3.0, 1.8, 1.1],
///     ..Curve::default()
/// };
/// let plot = CurvePlot {
///     curves: &[curve],
///     title: "Error against touches",
///     x_label: "touches",
///     y_label: "error [N m]",
///     log_y: false,
/// };
/// assert!(plot.svg()?.starts_with("<svg"));
/// assert_eq!(&plot.png()?[1..4], b"PNG");
/// # Ok::<(), vsf_plot::PlotError>(())
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct CurvePlot<'a> {
    /// The curves, 1 to 7.
    pub curves: &'a [Curve<'a>],
    /// First line of the picture. May be empty. In a PNG, characters outside Latin-1 are shown as `?`.
    pub title: &'a str,
    /// Label of the horizontal axis, with its unit.
    pub x_label: &'a str,
    /// Label of the vertical axis, with its unit.
    pub y_label: &'a str,
    /// Whether the vertical axis is logarithmic. A linear axis begins at zero if no value is negative.
    pub log_y: bool,
}

impl CurvePlot<'_> {
    /// Width of the picture \[px\].
    pub const WIDTH: u32 = 1000;
    /// Height of the picture \[px\].
    pub const HEIGHT: u32 = 640;

    /// Renders the picture as a PNG file, 1000 x 640 pixels. Equal input gives equal bytes.
    ///
    /// # Errors
    /// [`PlotError::Empty`] without curves or positions, [`PlotError::TooMany`] curves,
    /// [`PlotError::Length`], [`PlotError::NotFinite`] or [`PlotError::OutOfRange`] for data that violate
    /// what the fields state, [`PlotError::Encode`].
    pub fn png(&self) -> Result<Vec<u8>, PlotError> {
        self.check()?;
        let mut canvas = Raster::new(Self::WIDTH, Self::HEIGHT);
        self.draw(&mut canvas);
        canvas.into_png()
    }

    /// Renders the picture as an SVG file. Equal input gives equal bytes.
    ///
    /// # Errors
    /// As [`png`](Self::png).
    pub fn svg(&self) -> Result<String, PlotError> {
        self.check()?;
        svg_file(Self::WIDTH, Self::HEIGHT, |backend| {
            let mut canvas = Vector::new(backend);
            self.draw(&mut canvas);
            canvas.finish()
        })
    }

    fn check(&self) -> Result<(), PlotError> {
        if self.curves.is_empty() {
            return Err(PlotError::Empty {
                what: "curves".into(),
            });
        }
        if self.curves.len() > PALETTE.len() {
            return Err(PlotError::TooMany {
                what: "curves".into(),
                got: self.curves.len(),
                max: PALETTE.len(),
            });
        }
        let least = if self.log_y { SMALL } else { -LARGE };
        for (k, curve) in self.curves.iter().enumerate() {
            let what = |field: &str| format!("curves[{k}].{field}");
            if curve.x.is_empty() {
                return Err(PlotError::Empty { what: what("x") });
            }
            check_values(&what("x"), curve.x.iter().copied(), -LARGE, LARGE)?;
            check_len(&what("y"), curve.y.len(), curve.x.len())?;
            check_values(&what("y"), curve.y.iter().copied(), least, LARGE)?;
            let bars = if curve.low.is_empty() {
                0
            } else {
                curve.x.len()
            };
            for (field, ends) in [("low", curve.low), ("high", curve.high)] {
                check_len(&what(field), ends.len(), bars)?;
                check_values(&what(field), ends.iter().copied(), -LARGE, LARGE)?;
            }
        }
        Ok(())
    }

    fn draw(&self, canvas: &mut dyn Canvas) {
        canvas.text(self.title, (40.0, 36.0), Anchor::Start, Font::Title, INK);
        self.legend(canvas);
        let (x, y) = (self.x_axis(), self.y_axis());
        for (value, label) in x.ticks(FRAME.width()) {
            let at = x.place(value, FRAME.x0, FRAME.x1);
            canvas.line((at, FRAME.y0), (at, FRAME.y1), 1.0, GRID);
            let place = (at, FRAME.y1 + 18.0);
            canvas.text(&label, place, Anchor::Middle, Font::Label, INK);
        }
        for (value, label) in y.ticks(FRAME.height()) {
            let at = y.place(value, FRAME.y1, FRAME.y0);
            canvas.line((FRAME.x0, at), (FRAME.x1, at), 1.0, GRID);
            let place = (FRAME.x0 - 10.0, at);
            canvas.text(&label, place, Anchor::End, Font::Label, INK);
        }
        let below = (FRAME.center().0, FRAME.y1 + 48.0);
        canvas.text(self.x_label, below, Anchor::Middle, Font::Label, INK);
        let above = (FRAME.x0 - 50.0, FRAME.y0 - 20.0);
        canvas.text(self.y_label, above, Anchor::Start, Font::Label, INK);
        for (k, (curve, color)) in self.curves.iter().zip(PALETTE).enumerate() {
            // Bars side by side stay apart.
            let shift = if curve.low.is_empty() {
                0.0
            } else {
                3.0 * (k as f64 - 0.5 * (self.curves.len() - 1) as f64)
            };
            let at = |i: usize, value: f64| {
                let across = x.place(curve.x[i], FRAME.x0, FRAME.x1) + shift;
                (across, y.place(value, FRAME.y1, FRAME.y0))
            };
            for (i, (&low, &high)) in curve.low.iter().zip(curve.high).enumerate() {
                if let Some((a, b)) = FRAME.clip(at(i, low), at(i, high)) {
                    canvas.line(a, b, 1.5, color);
                }
            }
            for i in 1..curve.x.len() {
                let (a, b) = (at(i - 1, curve.y[i - 1]), at(i, curve.y[i]));
                canvas.line(a, b, 2.0, color);
            }
            for i in 0..curve.x.len() {
                dot(at(i, curve.y[i]), color, canvas);
            }
        }
        canvas.frame(FRAME, FAINT_INK);
    }

    fn legend(&self, canvas: &mut dyn Canvas) {
        let (mut x, mut y) = (40.0, LEGEND_TOP);
        for (curve, color) in self.curves.iter().zip(PALETTE) {
            let width = 52.0 + 11.0 * curve.name.chars().count() as f64 + 24.0;
            if x > 40.0 && x + width > FRAME.x1 {
                (x, y) = (40.0, y + LINE);
            }
            canvas.line((x, y), (x + 36.0, y), 2.0, color);
            dot((x + 18.0, y), color, canvas);
            let place = (x + 46.0, y);
            canvas.text(curve.name, place, Anchor::Start, Font::Label, INK);
            x += width;
        }
    }

    fn x_axis(&self) -> Axis {
        let (lo, hi) = range(self.curves.iter().flat_map(|c| c.x));
        let is_whole = |c: &Curve<'_>| c.x.iter().all(|x| x.fract() == 0.0);
        let scale = if self.curves.iter().all(is_whole) {
            Scale::Whole
        } else {
            Scale::Linear
        };
        let margin = match scale {
            Scale::Whole if lo == hi => 0.5,
            _ => 0.04 * (hi - lo).max(1e-6 * hi.abs().max(1.0)),
        };
        Axis {
            lo: lo - margin,
            hi: hi + margin,
            scale,
        }
    }

    fn y_axis(&self) -> Axis {
        let (lo, hi) = range(self.curves.iter().flat_map(|c| c.y));
        if self.log_y {
            let (lo, hi) = (lo / 1.6, hi * 1.6);
            let scale = Scale::Log;
            return Axis { lo, hi, scale };
        }
        let foot = lo.min(0.0);
        let margin = 0.12 * (hi - foot).max(1e-6 * hi.abs().max(1.0));
        Axis {
            lo: if lo < 0.0 { lo - margin } else { 0.0 },
            hi: hi + margin,
            scale: Scale::Linear,
        }
    }
}

fn dot(at: (f64, f64), color: Rgb, canvas: &mut dyn Canvas) {
    canvas.disc(Disc {
        at,
        radius: 4.5,
        color,
        alpha: 1.0,
        ball: false,
    });
}

fn range<'a>(values: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &v| {
        (lo.min(v), hi.max(v))
    })
}

/// What numbers stand along an axis.
#[derive(PartialEq)]
enum Scale {
    Linear,
    /// Linear, with whole numbers.
    Whole,
    Log,
}

/// The range of an axis.
struct Axis {
    lo: f64,
    hi: f64,
    scale: Scale,
}

impl Axis {
    /// Where a value lies between two pixels.
    fn place(&self, value: f64, from: f64, to: f64) -> f64 {
        let share = if self.scale == Scale::Log {
            // What lies below the axis may be negative.
            (value.max(SMALL) / self.lo).ln() / (self.hi / self.lo).ln()
        } else {
            (value - self.lo) / (self.hi - self.lo)
        };
        from + share * (to - from)
    }

    fn ticks(&self, pixels: f64) -> Vec<(f64, String)> {
        let ticks = Ticks::fitting(self.lo, self.hi, pixels);
        let values = ticks.values.iter().copied();
        match self.scale {
            Scale::Log => log_ticks(self.lo, self.hi),
            Scale::Linear => values.map(|v| (v, ticks.label(v))).collect(),
            // Steps below 1 divide it.
            Scale::Whole => values
                .filter(|v| (v - v.round()).abs() < 1e-6)
                .map(|v| (v, format!("{v:.0}")))
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot<'a>(curves: &'a [Curve<'a>], log_y: bool) -> CurvePlot<'a> {
        CurvePlot {
            curves,
            log_y,
            ..CurvePlot::default()
        }
    }

    #[test]
    fn axes_hold_all_values_and_begin_at_zero() {
        let curves = [Curve {
            x: &[1.0, 9.0],
            y: &[0.5, 4.0],
            ..Curve::default()
        }];
        let linear = plot(&curves, false).y_axis();
        assert_eq!((linear.lo, linear.place(0.0, 10.0, 20.0)), (0.0, 10.0));
        assert!(linear.hi > 4.0);
        let log = plot(&curves, true).y_axis();
        assert!(log.lo < 0.5 && log.hi > 4.0);
        let middle = (log.lo * log.hi).sqrt();
        assert!((log.place(middle, 0.0, 1.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_single_place_has_one_number() {
        let curves = [Curve {
            x: &[3.0],
            y: &[1.0],
            ..Curve::default()
        }];
        let ticks = plot(&curves, false).x_axis().ticks(900.0);
        assert_eq!(ticks, [(3.0, "3".to_owned())]);
    }

    #[test]
    fn whole_places_have_whole_numbers() {
        let curves = [Curve {
            x: &[1.0, 2.0, 4.0],
            y: &[1.0, 1.0, 1.0],
            ..Curve::default()
        }];
        let ticks = plot(&curves, false).x_axis().ticks(900.0);
        let labels: Vec<_> = ticks.into_iter().map(|t| t.1).collect();
        assert_eq!(labels, ["1", "2", "3", "4"]);
    }

    #[test]
    fn what_cannot_be_drawn_is_refused() {
        let good = Curve {
            x: &[1.0],
            y: &[0.0],
            ..Curve::default()
        };
        let refused = |curve: Curve, log_y| plot(&[curve], log_y).svg().is_err();
        assert!(!refused(good, false));
        assert!(refused(good, true));
        assert!(refused(Curve { x: &[], ..good }, false));
        assert!(refused(
            Curve {
                y: &[f64::NAN],
                ..good
            },
            false
        ));
        assert!(refused(
            Curve {
                low: &[0.0],
                ..good
            },
            false
        ));
        assert!(plot(&[], false).png().is_err());
        assert!(plot(&[good; 8], false).png().is_err());
    }
}
