use crate::canvas::Rect;
use nalgebra::{Point3, Vector3};

/// An orthographic view: the world directions that lie along the picture's axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    right_W: Vector3<f64>,
    up_W: Vector3<f64>,
    /// From the object toward the viewer.
    pub(crate) toward_W: Vector3<f64>,
}

impl View {
    /// Seen from this azimuth (from +x, about +z) and elevation [deg].
    pub(crate) fn from_angles(azimuth_deg: f64, elevation_deg: f64) -> Self {
        let (sa, ca) = azimuth_deg.to_radians().sin_cos();
        let (se, ce) = elevation_deg.to_radians().sin_cos();
        Self {
            right_W: Vector3::new(-sa, ca, 0.0),
            up_W: Vector3::new(-se * ca, -se * sa, ce),
            toward_W: Vector3::new(ce * ca, ce * sa, se),
        }
    }

    /// Seen along a horizontal axis, from the side that is nearest to this azimuth [deg].
    pub(crate) fn side(azimuth_deg: f64) -> Self {
        let quarter = (azimuth_deg / 90.0).round().rem_euclid(4.0);
        let toward_W = match quarter as u8 {
            0 => Vector3::x(),
            1 => Vector3::y(),
            2 => -Vector3::x(),
            _ => -Vector3::y(),
        };
        let up_W = Vector3::z();
        Self {
            right_W: up_W.cross(&toward_W),
            up_W,
            toward_W,
        }
    }

    /// Seen from above, x to the right, y up.
    pub(crate) fn top() -> Self {
        Self {
            right_W: Vector3::x(),
            up_W: Vector3::y(),
            toward_W: Vector3::z(),
        }
    }

    /// Nearness to the viewer \[m\]; larger is nearer.
    pub(crate) fn nearness(&self, p_W: &Point3<f64>) -> f64 {
        self.toward_W.dot(&p_W.coords)
    }

    /// World axes (0 = x, 1 = y, 2 = z) that run along the picture's right and up.
    pub(crate) fn axes(&self) -> (usize, usize) {
        (self.right_W.iamax(), self.up_W.iamax())
    }

    /// The signed world axis that points most toward the viewer, such as `-y`.
    pub(crate) fn seen_from(&self) -> &'static str {
        let axis = self.toward_W.iamax();
        let names = if self.toward_W[axis] < 0.0 {
            ["-x", "-y", "-z"]
        } else {
            ["+x", "+y", "+z"]
        };
        names[axis]
    }

    fn flat(&self, p_W: &Point3<f64>) -> (f64, f64) {
        (self.right_W.dot(&p_W.coords), self.up_W.dot(&p_W.coords))
    }
}

/// An axis-aligned box in world coordinates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) min_W: Point3<f64>,
    pub(crate) max_W: Point3<f64>,
}

impl Bounds {
    /// The box around the points, no side shorter than a tenth of the longest or 1 mm; a lone
    /// point gets 10 cm around it.
    pub(crate) fn around<'a>(points_W: impl Iterator<Item = &'a Point3<f64>>) -> Self {
        let mut min_W = Point3::from(Vector3::repeat(f64::INFINITY));
        let mut max_W = Point3::from(Vector3::repeat(f64::NEG_INFINITY));
        for p in points_W {
            min_W = min_W.inf(p);
            max_W = max_W.sup(p);
        }
        let longest = (max_W - min_W).max();
        let least = if longest > 0.0 {
            (0.1 * longest).max(1e-3)
        } else {
            0.1
        };
        for axis in 0..3 {
            let missing = least - (max_W[axis] - min_W[axis]);
            if missing > 0.0 {
                min_W[axis] -= 0.5 * missing;
                max_W[axis] += 0.5 * missing;
            }
        }
        Self { min_W, max_W }
    }

    /// Longest side \[m\].
    pub(crate) fn size(&self) -> f64 {
        (self.max_W - self.min_W).max()
    }

    pub(crate) fn center_W(&self) -> Point3<f64> {
        nalgebra::center(&self.min_W, &self.max_W)
    }

    /// The eight corners; bit k of the index chooses the upper side of axis k.
    pub(crate) fn corners_W(&self) -> [Point3<f64>; 8] {
        [0, 1, 2, 3, 4, 5, 6, 7].map(|bits| {
            let side = |k: usize| {
                if bits >> k & 1 == 1 {
                    self.max_W[k]
                } else {
                    self.min_W[k]
                }
            };
            Point3::new(side(0), side(1), side(2))
        })
    }
}

/// A view fitted into a rectangle of the picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Camera {
    pub(crate) view: View,
    /// Pixels per meter.
    pub(crate) scale: f64,
    pub(crate) rect: Rect,
    /// What lies in the middle of the rectangle, along right and up \[m\].
    middle: (f64, f64),
}

impl Camera {
    /// The largest scale at which the box fits into the rectangle.
    pub(crate) fn fit(view: View, bounds: &Bounds, rect: Rect) -> Self {
        let flat = bounds.corners_W().map(|p| view.flat(&p));
        let low = flat.iter().fold((f64::INFINITY, f64::INFINITY), |m, p| {
            (m.0.min(p.0), m.1.min(p.1))
        });
        let high = flat
            .iter()
            .fold((f64::NEG_INFINITY, f64::NEG_INFINITY), |m, p| {
                (m.0.max(p.0), m.1.max(p.1))
            });
        Self {
            view,
            scale: (rect.width() / (high.0 - low.0)).min(rect.height() / (high.1 - low.1)),
            rect,
            middle: (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1)),
        }
    }

    /// Position in the picture \[px\].
    pub(crate) fn project(&self, p_W: &Point3<f64>) -> (f64, f64) {
        let (right, up) = self.view.flat(p_W);
        let (cx, cy) = self.rect.center();
        (
            cx + self.scale * (right - self.middle.0),
            cy - self.scale * (up - self.middle.1),
        )
    }

    /// World coordinates at the rectangle's ends of the axis along right, in increasing order.
    pub(crate) fn right_range(&self) -> (f64, f64) {
        let half = 0.5 * self.rect.width() / self.scale;
        let sign = self.view.right_W[self.view.axes().0];
        let middle = sign * self.middle.0;
        (middle - half, middle + half)
    }

    /// World coordinates at the rectangle's ends of the axis along up.
    pub(crate) fn up_range(&self) -> (f64, f64) {
        let half = 0.5 * self.rect.height() / self.scale;
        (self.middle.1 - half, self.middle.1 + half)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_right_handed_and_show_z_up() {
        for view in [
            View::from_angles(-60.0, 25.0),
            View::side(130.0),
            View::top(),
        ] {
            assert!((view.right_W.cross(&view.up_W) - view.toward_W).norm() < 1e-12);
        }
        for azimuth in [-400.0, -90.0, -60.0, 0.0, 100.0, 180.0, 1e6] {
            let view = View::side(azimuth);
            assert_eq!(view.axes().1, 2);
            let slanted = View::from_angles(azimuth, 0.0);
            assert!(view.toward_W.dot(&slanted.toward_W) > 0.7, "{azimuth}");
        }
    }

    #[test]
    fn the_box_fills_the_rectangle_and_stays_inside() {
        let bounds =
            Bounds::around([Point3::new(0.1, -0.2, 0.0), Point3::new(0.5, 0.3, 0.9)].iter());
        let rect = Rect {
            x0: 100.0,
            y0: 50.0,
            x1: 500.0,
            y1: 350.0,
        };
        let camera = Camera::fit(View::from_angles(-60.0, 25.0), &bounds, rect);
        let at = bounds.corners_W().map(|p| camera.project(&p));
        for (x, y) in at {
            assert!((99.99..=500.01).contains(&x) && (49.99..=350.01).contains(&y));
        }
        let top = at.iter().fold(f64::INFINITY, |m, p| m.min(p.1));
        assert!((top - 50.0).abs() < 1e-9);
    }
}
