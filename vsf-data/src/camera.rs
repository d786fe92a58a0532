use crate::dataset::unknown_keys;
use crate::staged::Staged;
use crate::{DataError, DataWarning, files, json, pose};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::ops::RangeInclusive;
use std::path::Path;

const CONVENTION: &str = "opencv: x right, y down, z forward";
/// Larger images are refused before memory is reserved for them.
const MAX_PIXELS: u64 = 1 << 26;
/// Ranges far beyond any real camera: pinhole parameters (pixels), and meters per unit of depth.
const FOCAL_LENGTHS: RangeInclusive<f64> = 1e-3..=1e6;
const CENTERS: RangeInclusive<f64> = -1e6..=1e6;
const DEPTH_SCALES: RangeInclusive<f64> = 1e-9..=1e3;

/// One registered RGB-D view with pinhole intrinsics, in OpenCV axes: x right, y down, z forward.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraView {
    /// Width of both images \[pixels\].
    pub width: u32,
    /// Height of both images \[pixels\]; at most 2^26 pixels in all.
    pub height: u32,
    /// Red, green and blue, 3 bytes per pixel, row by row from the top left.
    pub color: Vec<u8>,
    /// Depth along z, row by row. The depth in meters is the value times [`depth_scale`](Self::depth_scale); 0 means no
    /// return.
    pub depth: Vec<u16>,
    /// Focal length in x \[pixels\], 1e-3 to 1e6.
    pub fx: f64,
    /// Focal length in y \[pixels\], 1e-3 to 1e6.
    pub fy: f64,
    /// Principal point in x \[pixels\], within 1e6. The center of the first pixel is 0.
    pub cx: f64,
    /// Principal point in y \[pixels\], within 1e6.
    pub cy: f64,
    /// Meters per unit of depth, 1e-9 to 1e3.
    pub depth_scale: f64,
    /// Pose of the camera in the world.
    pub X_WC: Isometry3<f64>,
    /// Keys of `camera.json` that this version does not know, with their values as JSON text.
    pub extra: BTreeMap<String, String>,
}

#[derive(Serialize, Deserialize)]
#[serde(expecting = "an object with the keys of camera.json")]
struct Raw {
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    depth_scale: f64,
    world_from_camera: pose::Rows4,
    convention: Option<String>,
    #[serde(flatten)]
    extra: Map<String, Value>,
}

impl CameraView {
    /// Reads `color.png` (8-bit RGB), `depth.png` (16-bit gray) and `camera.json` from a folder.
    ///
    /// # Errors
    /// A missing or damaged file; images of another kind or size; values without meaning; a `world_from_camera` that is not
    /// rigid; axes other than OpenCV's.
    pub fn open(folder: impl AsRef<Path>) -> Result<(Self, Vec<DataWarning>), DataError> {
        let folder = folder.as_ref();
        let path = folder.join("camera.json");
        let raw: Raw = json::parse(&path, &files::read(&path)?)?;
        let wrong = |key, problem| DataError::Metadata {
            path: path.clone(),
            key,
            problem,
        };
        if let Some(other) = raw.convention.filter(|c| !c.starts_with("opencv")) {
            let problem = format!("{other:?} is not {CONVENTION:?}");
            return Err(wrong("convention", problem));
        }
        let size = (raw.width, raw.height);
        let X_WC = pose::from_rows(&raw.world_from_camera)
            .map_err(|problem| wrong("world_from_camera", problem))?;
        check_size(&path, size)?;
        let color = read_png(&folder.join("color.png"), size, png::ColorType::Rgb)?;
        let depth = read_png(&folder.join("depth.png"), size, png::ColorType::Grayscale)?;
        let view = Self {
            width: raw.width,
            height: raw.height,
            color,
            depth: depth
                .chunks_exact(2)
                .map(|b| u16::from_be_bytes([b[0], b[1]]))
                .collect(),
            fx: raw.fx,
            fy: raw.fy,
            cx: raw.cx,
            cy: raw.cy,
            depth_scale: raw.depth_scale,
            X_WC,
            extra: json::to_text(raw.extra),
        };
        view.check(folder)?;
        let warnings = unknown_keys(path, &view.extra);
        Ok((view, warnings))
    }

    /// Writes the three files, all or none. Creates the folder if it does not exist.
    ///
    /// # Errors
    /// Values or sizes that [`open`](Self::open) would refuse; [`DataError::Io`].
    pub fn save(&self, folder: impl AsRef<Path>) -> Result<(), DataError> {
        let mut staged = Staged::below(folder.as_ref())?;
        self.stage(folder.as_ref(), &mut staged)?;
        staged.commit()
    }

    pub(crate) fn stage(&self, folder: &Path, staged: &mut Staged) -> Result<(), DataError> {
        self.check(folder)?;
        let size = (self.width, self.height);
        let depth: Vec<u8> = self.depth.iter().flat_map(|d| d.to_be_bytes()).collect();
        for (name, color, samples) in [
            ("color.png", png::ColorType::Rgb, &self.color),
            ("depth.png", png::ColorType::Grayscale, &depth),
        ] {
            let path = folder.join(name);
            staged.file(&path, &encode_png(&path, size, color, samples)?)?;
        }
        let path = folder.join("camera.json");
        let raw = Raw {
            width: self.width,
            height: self.height,
            fx: self.fx,
            fy: self.fy,
            cx: self.cx,
            cy: self.cy,
            depth_scale: self.depth_scale,
            world_from_camera: pose::to_rows(&self.X_WC),
            convention: Some(CONVENTION.to_owned()),
            extra: json::from_text(&path, &self.extra)?,
        };
        staged.file(&path, &json::encode(&path, &raw)?)
    }

    pub(crate) fn check(&self, folder: &Path) -> Result<(), DataError> {
        let path = folder.join("camera.json");
        let wrong = |key, problem| DataError::Metadata {
            path: path.clone(),
            key,
            problem,
        };
        check_size(&path, (self.width, self.height))?;
        let pixels = self.width as usize * self.height as usize;
        for (name, got, expected) in [
            ("color.png", self.color.len(), 3 * pixels),
            ("depth.png", self.depth.len(), pixels),
        ] {
            if got != expected {
                return Err(DataError::Png {
                    path: folder.join(name),
                    problem: format!("{got} values, {expected} expected"),
                });
            }
        }
        for (key, value, range) in [
            ("fx", self.fx, FOCAL_LENGTHS),
            ("fy", self.fy, FOCAL_LENGTHS),
            ("cx", self.cx, CENTERS),
            ("cy", self.cy, CENTERS),
            ("depth_scale", self.depth_scale, DEPTH_SCALES),
        ] {
            if !range.contains(&value) {
                let (least, most) = (range.start(), range.end());
                let problem = format!("{value:?} must be from {least:e} to {most:e}");
                return Err(wrong(key, problem));
            }
        }
        pose::check(&self.X_WC).map_err(|problem| wrong("world_from_camera", problem))
    }
}

fn check_size(path: &Path, (width, height): (u32, u32)) -> Result<(), DataError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels > 0 && pixels <= MAX_PIXELS {
        return Ok(());
    }
    Err(DataError::Metadata {
        path: path.to_owned(),
        key: "width",
        problem: format!("{width} x {height} pixels; expected 1 to {MAX_PIXELS} in all"),
    })
}

/// Bits per sample: 8 for color, 16 for depth.
fn bit_depth(color: png::ColorType) -> png::BitDepth {
    match color {
        png::ColorType::Rgb => png::BitDepth::Eight,
        _ => png::BitDepth::Sixteen,
    }
}

/// The samples in file order, 16-bit ones big-endian. `size` has been checked.
fn read_png(path: &Path, size: (u32, u32), color: png::ColorType) -> Result<Vec<u8>, DataError> {
    let wrong = |problem: String| DataError::Png {
        path: path.to_owned(),
        problem,
    };
    let damaged = |e: png::DecodingError| wrong(format!("damaged PNG: {e}"));
    let bytes = files::read(path)?;
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    let header = decoder.read_header_info().map_err(damaged)?;
    if header.size() != size {
        let (w, h) = header.size();
        return Err(wrong(format!(
            "{w} x {h} pixels, camera.json says {} x {}",
            size.0, size.1
        )));
    }
    if (header.color_type, header.bit_depth) != (color, bit_depth(color)) {
        return Err(wrong(format!(
            "{:?} with {} bits, expected {color:?} with {} bits",
            header.color_type,
            header.bit_depth as u8,
            bit_depth(color) as u8
        )));
    }
    let mut reader = decoder.read_info().map_err(damaged)?;
    let length = reader
        .output_buffer_size()
        .ok_or_else(|| wrong("the image is too large".to_owned()))?;
    let mut pixels = vec![0; length];
    reader.next_frame(&mut pixels).map_err(damaged)?;
    reader.finish().map_err(damaged)?;
    Ok(pixels)
}

fn encode_png(
    path: &Path,
    (width, height): (u32, u32),
    color: png::ColorType,
    samples: &[u8],
) -> Result<Vec<u8>, DataError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(bit_depth(color));
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(samples)?;
        writer.finish()
    });
    written.map_err(|e| DataError::Png {
        path: path.to_owned(),
        problem: e.to_string(),
    })?;
    Ok(bytes)
}
