use crate::canvas::{Anchor, Canvas, Disc, Font, Rect};
use crate::color::Rgb;
use crate::{MADE_BY, PlotError};
use plotters::backend::{DrawingBackend, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontFamily, FontStyle, RGBColor, ShapeStyle, TextStyle};

/// The backend places shapes at whole units; this many of them make a pixel.
pub(crate) const UNITS: f64 = 4.0;

/// Pixels in the backend's units.
pub(crate) fn units(pixels: f64) -> i32 {
    (UNITS * pixels).round() as i32
}

/// An SVG file of this size \[px\], drawn by a backend that is finer by [`UNITS`].
pub(crate) fn svg_file(
    width: u32,
    height: u32,
    draw: impl FnOnce(SVGBackend<'_>) -> Result<(), String>,
) -> Result<String, PlotError> {
    let size = (width * UNITS as u32, height * UNITS as u32);
    let mut inner = String::new();
    draw(SVGBackend::with_string(&mut inner, size)).map_err(|reason| PlotError::Encode {
        format: "SVG",
        reason,
    })?;
    Ok(format!(
        "<svg width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {} {}\" \
         xmlns=\"http://www.w3.org/2000/svg\">\n<!-- {MADE_BY} -->\n{inner}</svg>\n",
        size.0, size.1
    ))
}

/// The canvas of a field picture in an SVG.
pub(crate) struct Vector<'a> {
    backend: SVGBackend<'a>,
    failure: Option<String>,
}

/// Text without the control characters that XML forbids, and those that turn a line around.
pub(crate) fn printable(text: &str) -> String {
    let forbidden = |c: char| c.is_control() || matches!(c, '\u{FFFE}' | '\u{FFFF}');
    let turns = |c: char| matches!(c, '\u{200E}'..='\u{200F}' | '\u{2028}'..='\u{202E}' | '\u{2066}'..='\u{2069}');
    let shown = |c: char| {
        if forbidden(c) || turns(c) {
            char::REPLACEMENT_CHARACTER
        } else {
            c
        }
    };
    text.chars().map(shown).collect()
}

impl<'a> Vector<'a> {
    pub(crate) fn new(backend: SVGBackend<'a>) -> Self {
        Self {
            backend,
            failure: None,
        }
    }

    /// Closes the file.
    pub(crate) fn finish(mut self) -> Result<(), String> {
        let outcome = self.backend.present();
        self.note(outcome);
        self.failure.take().map_or(Ok(()), Err)
    }

    /// Keeps the first failure; drawing goes on.
    fn note(&mut self, outcome: Result<(), impl std::fmt::Display>) {
        if let Err(e) = outcome {
            self.failure.get_or_insert(e.to_string());
        }
    }
}

pub(crate) fn rgb([r, g, b]: Rgb) -> RGBColor {
    RGBColor(r, g, b)
}

impl Canvas for Vector<'_> {
    fn disc(&mut self, disc: Disc) {
        // Two decimals of opacity keep the file small.
        let alpha = (100.0 * disc.alpha).round() / 100.0;
        let at = (units(disc.at.0), units(disc.at.1));
        let radius = units(disc.radius).max(1) as u32;
        let outcome = self
            .backend
            .draw_circle(at, radius, &rgb(disc.color).mix(alpha), true);
        self.note(outcome);
    }

    fn line(&mut self, a: (f64, f64), b: (f64, f64), width: f64, color: Rgb) {
        let style = ShapeStyle {
            color: rgb(color).to_rgba(),
            filled: false,
            stroke_width: units(width).max(1) as u32,
        };
        let (a, b) = ((units(a.0), units(a.1)), (units(b.0), units(b.1)));
        let outcome = self.backend.draw_line(a, b, &style);
        self.note(outcome);
    }

    fn rect(&mut self, r: Rect, color: Rgb) {
        let (a, b) = ((units(r.x0), units(r.y0)), (units(r.x1), units(r.y1)));
        let outcome = self.backend.draw_rect(a, b, &rgb(color), true);
        self.note(outcome);
    }

    fn text(&mut self, text: &str, at: (f64, f64), anchor: Anchor, font: Font, color: Rgb) {
        let (pixels, weight) = match font {
            Font::Title => (24.0, FontStyle::Bold),
            Font::Heading => (20.0, FontStyle::Bold),
            Font::Label => (19.0, FontStyle::Normal),
            Font::Small => (17.0, FontStyle::Normal),
        };
        let h_pos = match anchor {
            Anchor::Start => HPos::Left,
            Anchor::Middle => HPos::Center,
            Anchor::End => HPos::Right,
        };
        let fill = rgb(color);
        let style = TextStyle::from((FontFamily::SansSerif, UNITS * pixels, weight))
            .color(&fill)
            .pos(Pos::new(h_pos, VPos::Center));
        let outcome = self
            .backend
            .draw_text(&printable(text), &style, (units(at.0), units(at.1)));
        self.note(outcome);
    }
}

#[cfg(test)]
mod tests {
    use super::printable;

    #[test]
    fn names_do_not_turn_lines_around() {
        assert_eq!(
            printable("Stab\u{1b}[2J\u{202E}b\u{2066}"),
            "Stab\u{FFFD}[2J\u{FFFD}b\u{FFFD}"
        );
    }
}
