use crate::{Bounds, PointCloud};
use nalgebra::{Isometry3, Point3};
use vsf_core::CoreError;

/// A pinhole camera in OpenCV axes: x right, y down, z forward. The center of the first pixel is (0, 0).
/// Undistort images of a lens with distortion first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Focal length in x (pixels), > 0.
    pub fx: f64,
    /// Focal length in y (pixels), > 0.
    pub fy: f64,
    /// Principal point in x (pixels).
    pub cx: f64,
    /// Principal point in y (pixels).
    pub cy: f64,
    /// Pose of the camera in the world.
    pub X_WC: Isometry3<f64>,
}

impl Camera {
    /// The world point in the direction of pixel `(u, v)`, at the given depth along z (m).
    pub fn unproject(&self, u: f64, v: f64, depth: f64) -> Point3<f64> {
        let ray = Point3::new((u - self.cx) / self.fx, (v - self.cy) / self.fy, 1.0);
        self.X_WC * (ray * depth)
    }

    /// Pixel coordinates and depth along z (m) of a world point; `None` for a point behind the camera.
    pub fn project(&self, p_W: &Point3<f64>) -> Option<(f64, f64, f64)> {
        let p = self.X_WC.inverse_transform_point(p_W);
        (p.z > 0.0).then(|| {
            let u = self.fx * p.x / p.z + self.cx;
            (u, self.fy * p.y / p.z + self.cy, p.z)
        })
    }

    fn check(&self) -> Result<(), CoreError> {
        for (name, value) in [("fx", self.fx), ("fy", self.fy)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(CoreError::Parameter {
                    name,
                    value,
                    range: "> 0 pixels",
                });
            }
        }
        let pose = self.X_WC.to_homogeneous();
        CoreError::check_finite("principal point", &[self.cx, self.cy])?;
        CoreError::check_finite("camera pose", pose.as_slice())
    }
}

/// One registered color and depth image.
#[derive(Debug, Clone)]
pub struct RgbdView {
    camera: Camera,
    width: usize,
    height: usize,
    color: Vec<[u8; 3]>,
    /// Meters along z; 0 without a return.
    depth: Vec<f32>,
}

/// What a view shows at a world point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sight {
    /// The ray through the point met a surface, in front of the point or behind it.
    Surface {
        /// Depth of the point minus that of the surface (m, along the camera's z); negative if the point
        /// lies in front.
        behind: f64,
        /// Color of the surface.
        color: [u8; 3],
    },
    /// The ray met nothing.
    NoReturn,
    /// The point is not in the picture.
    Outside,
}

impl RgbdView {
    /// Creates a view of `width` x `height` pixels, row by row from the top left.
    ///
    /// Colors are 3 bytes per pixel (red, green, blue). Depths are along z in units of `depth_scale` (m), 0
    /// where there was no return.
    ///
    /// # Errors
    /// Images of another size, an invalid camera, or a depth scale that is not positive.
    pub fn new(
        camera: Camera,
        (width, height): (usize, usize),
        color: &[u8],
        depth: &[u16],
        depth_scale: f64,
    ) -> Result<Self, CoreError> {
        camera.check()?;
        let pixels = width.saturating_mul(height);
        CoreError::check_len("color image", color.len(), pixels.saturating_mul(3))?;
        CoreError::check_len("depth image", depth.len(), pixels)?;
        if !(depth_scale > 0.0 && depth_scale.is_finite()) {
            return Err(CoreError::Parameter {
                name: "depth scale",
                value: depth_scale,
                range: "> 0 m",
            });
        }
        Ok(Self {
            camera,
            width,
            height,
            color: color.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
            depth: (depth.iter())
                .map(|&d| (f64::from(d) * depth_scale) as f32)
                .collect(),
        })
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Width and height of the image (pixels).
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The colored world points of all pixels with a return inside the bounds, row by row.
    pub fn cloud(&self, bounds: &Bounds) -> PointCloud {
        let mut cloud = PointCloud::default();
        for (i, (&depth, &color)) in self.depth.iter().zip(&self.color).enumerate() {
            let (u, v) = ((i % self.width) as f64, (i / self.width) as f64);
            let p_W = self.camera.unproject(u, v, f64::from(depth));
            if depth > 0.0 && bounds.contains(&p_W) {
                cloud.positions.push(p_W);
                cloud.colors.push(color);
            }
        }
        cloud
    }

    /// What the view shows at the pixel that a world point projects to.
    pub fn sight(&self, p_W: &Point3<f64>) -> Sight {
        let Some((u, v, z)) = self.camera.project(p_W) else {
            return Sight::Outside;
        };
        let (u, v) = (u.round(), v.round());
        if u < 0.0 || v < 0.0 || u >= self.width as f64 || v >= self.height as f64 {
            return Sight::Outside;
        }
        let pixel = v as usize * self.width + u as usize;
        match f64::from(self.depth[pixel]) {
            0.0 => Sight::NoReturn,
            depth => Sight::Surface {
                behind: z - depth,
                color: self.color[pixel],
            },
        }
    }
}
