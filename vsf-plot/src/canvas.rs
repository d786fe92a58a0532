use crate::color::Rgb;

pub(crate) const WHITE: Rgb = [255, 255, 255];
pub(crate) const INK: Rgb = [32, 32, 36];
pub(crate) const FAINT_INK: Rgb = [105, 105, 112];
pub(crate) const GRID: Rgb = [222, 222, 226];

/// A rectangle in pixels, y down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rect {
    pub(crate) x0: f64,
    pub(crate) y0: f64,
    pub(crate) x1: f64,
    pub(crate) y1: f64,
}

impl Rect {
    pub(crate) fn width(&self) -> f64 {
        self.x1 - self.x0
    }

    pub(crate) fn height(&self) -> f64 {
        self.y1 - self.y0
    }

    pub(crate) fn center(&self) -> (f64, f64) {
        (0.5 * (self.x0 + self.x1), 0.5 * (self.y0 + self.y1))
    }

    pub(crate) fn contains(&self, (x, y): (f64, f64)) -> bool {
        (self.x0..=self.x1).contains(&x) && (self.y0..=self.y1).contains(&y)
    }

    pub(crate) fn shrunk(&self, left: f64, top: f64, right: f64, bottom: f64) -> Self {
        Self {
            x0: self.x0 + left,
            y0: self.y0 + top,
            x1: self.x1 - right,
            y1: self.y1 - bottom,
        }
    }

    /// The part of a segment inside the rectangle.
    ///
    /// Reference: Y.-D. Liang and B. A. Barsky, ACM TOG 3(1), 1984, doi:10.1145/357332.357333.
    pub(crate) fn clip(&self, a: (f64, f64), b: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let (mut enter, mut leave) = (0.0f64, 1.0f64);
        for (p, q) in [
            (-dx, a.0 - self.x0),
            (dx, self.x1 - a.0),
            (-dy, a.1 - self.y0),
            (dy, self.y1 - a.1),
        ] {
            if p == 0.0 {
                if q < 0.0 {
                    return None;
                }
            } else if p < 0.0 {
                enter = enter.max(q / p);
            } else {
                leave = leave.min(q / p);
            }
        }
        let at = |t: f64| (a.0 + t * dx, a.1 + t * dy);
        (enter <= leave).then(|| (at(enter), at(leave)))
    }
}

/// A filled circle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Disc {
    pub(crate) at: (f64, f64),
    pub(crate) radius: f64,
    pub(crate) color: Rgb,
    /// Opacity, 0..=1.
    pub(crate) alpha: f64,
    /// Looks like a ball, with a highlight at the upper left. The SVG leaves that out: it would
    /// double the file.
    pub(crate) ball: bool,
}

/// Height and weight of text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Font {
    Title,
    Heading,
    Label,
    Small,
}

/// Which point of the text's box lies at the given position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// What a picture is made of; the two file formats implement it.
pub(crate) trait Canvas {
    fn disc(&mut self, disc: Disc);
    fn line(&mut self, a: (f64, f64), b: (f64, f64), width: f64, color: Rgb);
    fn rect(&mut self, rect: Rect, color: Rgb);
    /// Text, vertically centered at `at`.
    fn text(&mut self, text: &str, at: (f64, f64), anchor: Anchor, font: Font, color: Rgb);

    fn frame(&mut self, r: Rect, color: Rgb) {
        let corners = [(r.x0, r.y0), (r.x1, r.y0), (r.x1, r.y1), (r.x0, r.y1)];
        for i in 0..4 {
            self.line(corners[i], corners[(i + 1) % 4], 1.0, color);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clips_to_the_part_inside() {
        let r = Rect {
            x0: 0.0,
            y0: 0.0,
            x1: 10.0,
            y1: 5.0,
        };
        assert_eq!(
            r.clip((-10.0, 2.0), (20.0, 2.0)),
            Some(((0.0, 2.0), (10.0, 2.0)))
        );
        assert_eq!(
            r.clip((1.0, 1.0), (2.0, 2.0)),
            Some(((1.0, 1.0), (2.0, 2.0)))
        );
        assert_eq!(r.clip((-5.0, -1.0), (20.0, -1.0)), None);
        assert_eq!(
            r.clip((3.0, 3.0), (3.0, 3.0)),
            Some(((3.0, 3.0), (3.0, 3.0)))
        );
    }
}
