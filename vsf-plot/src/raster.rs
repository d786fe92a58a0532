use crate::canvas::{Anchor, Canvas, Disc, Font, Rect, WHITE};
use crate::color::Rgb;
use crate::{MADE_BY, PlotError};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, RasterizedChar, get_raster};

/// The pixel canvas. Edges are anti-aliased by their distance to the pixel's center.
pub(crate) struct Raster {
    width: usize,
    height: usize,
    /// Kept in floating point so that many faint layers add up without rounding.
    pixels: Vec<[f32; 3]>,
}

impl Raster {
    pub(crate) fn new(width: u32, height: u32) -> Self {
        let (width, height) = (width as usize, height as usize);
        Self {
            width,
            height,
            pixels: vec![WHITE.map(f32::from); width * height],
        }
    }

    pub(crate) fn into_png(self) -> Result<Vec<u8>, PlotError> {
        let fail = |e: png::EncodingError| PlotError::Encode {
            format: "PNG",
            reason: e.to_string(),
        };
        let bytes: Vec<u8> = self
            .pixels
            .iter()
            .flatten()
            .map(|v| v.round() as u8)
            .collect();
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        (encoder.add_text_chunk("Software".to_owned(), MADE_BY.to_owned())).map_err(fail)?;
        let mut writer = encoder.write_header().map_err(fail)?;
        writer.write_image_data(&bytes).map_err(fail)?;
        writer.finish().map_err(fail)?;
        Ok(file)
    }

    /// Blends `color` over pixels with the opacity that `cover` gives for a pixel's center.
    /// Visits the rows between `rows` and in each the columns that `columns` gives for its center.
    fn fill(
        &mut self,
        rows: (f64, f64),
        columns: impl Fn(f64) -> (f64, f64),
        color: Rgb,
        cover: impl Fn(f64, f64) -> f64,
    ) {
        let color = color.map(f32::from);
        // The cast from float saturates, so a negative start becomes zero.
        let range = |(a, b): (f64, f64), n: usize| (a.floor() as usize, (b.ceil() as usize).min(n));
        let (y0, y1) = range(rows, self.height);
        for y in y0..y1 {
            let center_y = y as f64 + 0.5;
            let (x0, x1) = range(columns(center_y), self.width);
            for x in x0..x1 {
                let alpha = cover(x as f64 + 0.5, center_y) as f32;
                if alpha > 0.0 {
                    let pixel = &mut self.pixels[y * self.width + x];
                    let [r, g, b] = *pixel;
                    *pixel = [
                        r + alpha * (color[0] - r),
                        g + alpha * (color[1] - g),
                        b + alpha * (color[2] - b),
                    ];
                }
            }
        }
    }

    /// Fills a circle; `alpha` gets the distance inward from the anti-aliased edge \[px\].
    fn round(&mut self, (cx, cy): (f64, f64), radius: f64, color: Rgb, alpha: impl Fn(f64) -> f64) {
        let reach = radius + 0.5;
        let half = |y: f64| (reach * reach - (y - cy) * (y - cy)).max(0.0).sqrt();
        self.fill(
            (cy - reach, cy + reach),
            |y| (cx - half(y), cx + half(y)),
            color,
            |x, y| {
                let (dx, dy) = (x - cx, y - cy);
                alpha((reach - (dx * dx + dy * dy).sqrt()).max(0.0))
            },
        );
    }
}

impl Canvas for Raster {
    fn disc(&mut self, disc: Disc) {
        self.round(disc.at, disc.radius, disc.color, |edge| {
            disc.alpha * edge.min(1.0)
        });
        if disc.ball && disc.radius > 2.0 {
            let (r, (cx, cy)) = (disc.radius, disc.at);
            let light = (cx - 0.3 * r, cy - 0.3 * r);
            self.round(light, 0.6 * r, WHITE, |edge| {
                disc.alpha * 0.4 * (edge / (0.6 * r)).min(1.0)
            });
        }
    }

    fn line(&mut self, a: (f64, f64), b: (f64, f64), width: f64, color: Rgb) {
        let reach = 0.5 * width + 0.5;
        let (dx, dy) = (b.0 - a.0, b.1 - a.1);
        let length_squared = dx * dx + dy * dy;
        let ends = (a.0.min(b.0) - reach, a.0.max(b.0) + reach);
        // In a row, the strip along the line, cut off at the line's ends.
        let columns = |y: f64| {
            if dy == 0.0 {
                return ends;
            }
            let middle = a.0 + (y - a.1) * dx / dy;
            let half = (reach * length_squared.sqrt() / dy).abs();
            ((middle - half).max(ends.0), (middle + half).min(ends.1))
        };
        let rows = (a.1.min(b.1) - reach, a.1.max(b.1) + reach);
        self.fill(rows, columns, color, |x, y| {
            let along = (x - a.0) * dx + (y - a.1) * dy;
            let t = if length_squared > 0.0 {
                (along / length_squared).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let (ex, ey) = (x - a.0 - t * dx, y - a.1 - t * dy);
            (reach - (ex * ex + ey * ey).sqrt()).clamp(0.0, 1.0)
        });
    }

    fn rect(&mut self, r: Rect, color: Rgb) {
        let inside = |v: f64, lo: f64, hi: f64| ((v + 0.5).min(hi) - (v - 0.5).max(lo)).max(0.0);
        let cover = |x, y| inside(x, r.x0, r.x1) * inside(y, r.y0, r.y1);
        self.fill((r.y0, r.y1), |_| (r.x0, r.x1), color, cover);
    }

    fn text(&mut self, text: &str, at: (f64, f64), anchor: Anchor, font: Font, color: Rgb) {
        let glyphs: Vec<RasterizedChar> = text.chars().filter_map(|c| glyph(c, font)).collect();
        let width = glyphs.iter().map(|g| g.width()).sum::<usize>() as f64;
        let height = glyphs.first().map_or(0, |g| g.height()) as f64;
        let left = match anchor {
            Anchor::Start => at.0,
            Anchor::Middle => at.0 - 0.5 * width,
            Anchor::End => at.0 - width,
        };
        // Whole pixels keep the glyphs sharp.
        let (mut x0, y0) = (left.round(), (at.1 - 0.5 * height).round());
        for glyph in &glyphs {
            let x1 = x0 + glyph.width() as f64;
            let ink = |x: f64, y: f64| glyph.pixel((x - x0) as usize, (y - y0) as usize);
            self.fill(
                (y0, y0 + height),
                |_| (x0, x1),
                color,
                |x, y| ink(x, y).map_or(0.0, |v| f64::from(v) / 255.0),
            );
            x0 = x1;
        }
    }
}

/// The glyph of a character; a question mark where the font has none.
fn glyph(c: char, font: Font) -> Option<RasterizedChar> {
    let (weight, height) = match font {
        Font::Title => (FontWeight::Bold, RasterHeight::Size24),
        Font::Heading => (FontWeight::Bold, RasterHeight::Size20),
        Font::Label => (FontWeight::Regular, RasterHeight::Size20),
        Font::Small => (FontWeight::Regular, RasterHeight::Size16),
    };
    get_raster(c, weight, height).or_else(|| get_raster('?', weight, height))
}
