use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// Pose of a link's shape and the box in the link frame that holds all places in contact with it.
#[derive(Debug, Clone)]
pub(crate) struct LinkPose {
    pub R_WL: Matrix3<f64>,
    pub p_WL: Vector3<f64>,
    pub center_L: Point3<f64>,
    pub half_L: Vector3<f64>,
    /// Center and radius of the ball around the box.
    pub center_W: Point3<f64>,
    pub radius: f64,
    /// Size of the coordinates that distances are computed from, which their rounding follows.
    pub scale: f64,
}

impl LinkPose {
    /// The box is that around the shape, `margin` larger on every side.
    pub fn new(
        X_WL: &Isometry3<f64>,
        (lower, upper): (Point3<f64>, Point3<f64>),
        margin: f64,
    ) -> Self {
        let R_WL = X_WL.rotation.to_rotation_matrix().into_inner();
        let p_WL = X_WL.translation.vector;
        let center_L = nalgebra::center(&lower, &upper);
        let half_L = (0.5 * (upper - lower)).add_scalar(margin);
        let center_W = Point3::from(R_WL * center_L.coords + p_WL);
        let radius = half_L.norm();
        Self {
            R_WL,
            p_WL,
            center_L,
            half_L,
            center_W,
            radius,
            scale: center_W.coords.norm() + center_L.coords.norm() + radius,
        }
    }

    #[inline]
    pub fn to_link(&self, p_W: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.R_WL.tr_mul(&(p_W.coords - self.p_WL)))
    }

    #[inline]
    pub fn to_world(&self, p_L: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.R_WL * p_L.coords + self.p_WL)
    }

    /// How far a place in the link frame is outside of the box, along the axis where that is most;
    /// negative inside. Never more than the distance.
    #[inline]
    pub fn outside(&self, p_L: &Point3<f64>) -> f64 {
        beyond(p_L, &self.center_L, &self.half_L)
    }

    /// Whether squares of displacements that the link can cause stay finite.
    pub fn is_bounded(&self) -> bool {
        let radius = self.center_L.coords.norm() + self.radius;
        (4.0 * (self.p_WL.norm() + radius)).powi(2).is_finite()
    }
}

/// How far a point is outside of a box, along the axis where that is most; negative inside.
#[inline]
pub(crate) fn beyond(p: &Point3<f64>, center: &Point3<f64>, half: &Vector3<f64>) -> f64 {
    let out = (p - center).abs() - half;
    out.x.max(out.y).max(out.z)
}
