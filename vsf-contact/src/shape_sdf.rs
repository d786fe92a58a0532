use crate::{ContactError, Sdf, SdfSample};
use nalgebra::{Isometry3, Matrix3, Point3, Vector2, Vector3};
use vsf_core::{CoreError, Shape};

/// Lengths below this have no direction \[m\]; their squares would lose digits.
const TINY: f64 = 1e-100;

/// The exact signed distance of a posed analytic shape: ball, capsule, round cone, cylinder, box.
///
/// Where the nearest surface point is not unique the normal is that of one of them: on the axis of
/// a round shape (and in the centre of a ball) the one towards the shape's +x, in a box that of
/// the nearest face, the first of x, y, z and the positive side when several are as near.
///
/// ```
/// use vsf_contact::{Sdf, ShapeSdf};
/// use vsf_core::{Shape, nalgebra::{Isometry3, Point3}};
///
/// let ball = ShapeSdf::new(&Shape::Sphere { radius: 0.1 }, &Isometry3::translation(1.0, 0.0, 0.0))?;
/// let s = ball.sample(&Point3::new(1.0, 0.3, 0.0));
/// assert!((s.distance - 0.2).abs() < 1e-12 && (s.normal.y - 1.0).abs() < 1e-12);
/// # Ok::<(), vsf_contact::ContactError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeSdf {
    R_SB: Matrix3<f64>,
    p_BS: Point3<f64>,
    form: Form,
    /// Box around the shape.
    lower_S: Vector3<f64>,
    upper_S: Vector3<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    /// Balls along z from `bottom` over `length`; the cone between has slope (`sine`, `cosine`).
    SweptBall {
        bottom: f64,
        length: f64,
        radius_bottom: f64,
        radius_top: f64,
        sine: f64,
        cosine: f64,
    },
    /// A core cylinder, grown by `rounding`.
    Cylinder { core: Vector2<f64>, rounding: f64 },
    /// A core box, grown by `rounding`.
    Box { core: Vector3<f64>, rounding: f64 },
}

impl ShapeSdf {
    /// The signed distance of `shape` at the pose `X_BS` in the body.
    ///
    /// # Errors
    /// A dimension out of range, a pose that is not finite, or a mesh, which needs a
    /// [`GridSdf`](crate::GridSdf) or a [`MeshSdf`](crate::MeshSdf).
    pub fn new(shape: &Shape, X_BS: &Isometry3<f64>) -> Result<Self, ContactError> {
        shape.validate()?;
        CoreError::check_finite("shape position", X_BS.translation.vector.as_slice())?;
        CoreError::check_finite("shape rotation", X_BS.rotation.coords.as_slice())?;
        let (form, lower_S, upper_S) = match *shape {
            Shape::Sphere { radius } => swept_ball(radius, radius, 0.0),
            Shape::Capsule {
                radius,
                half_length,
            } => swept_ball(radius, radius, half_length),
            Shape::RoundCone {
                radius_bottom,
                radius_top,
                half_length,
            } => swept_ball(radius_bottom, radius_top, half_length),
            Shape::Cylinder {
                radius,
                half_length,
                rounding,
            } => {
                let upper = Vector3::new(radius, radius, half_length);
                let core = Vector2::new(radius - rounding, half_length - rounding);
                (Form::Cylinder { core, rounding }, -upper, upper)
            }
            Shape::Box {
                half_extents,
                rounding,
            } => {
                let core = half_extents.add_scalar(-rounding);
                (Form::Box { core, rounding }, -half_extents, half_extents)
            }
            ref other => {
                let shape = format!("{other:.40?}");
                return Err(ContactError::UnsupportedShape { shape });
            }
        };
        let R_SB = X_BS.rotation.to_rotation_matrix().matrix().transpose();
        let p_BS = Point3::from(X_BS.translation.vector);
        Ok(Self {
            R_SB,
            p_BS,
            form,
            lower_S,
            upper_S,
        })
    }
}

impl Sdf for ShapeSdf {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        let (distance, normal_S) = self.form.sample(&(self.R_SB * (p_B - self.p_BS)));
        SdfSample {
            distance,
            normal: self.R_SB.tr_mul(&normal_S),
        }
    }

    fn distance(&self, p_B: &Point3<f64>) -> f64 {
        // The unused normal is optimised away.
        self.form.sample(&(self.R_SB * (p_B - self.p_BS))).0
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let R_BS = self.R_SB.transpose();
        let center = self.p_BS + R_BS * (0.5 * (self.lower_S + self.upper_S));
        let half = R_BS.abs() * (0.5 * (self.upper_S - self.lower_S));
        (center - half, center + half)
    }
}

fn swept_ball(bottom: f64, top: f64, half_length: f64) -> (Form, Vector3<f64>, Vector3<f64>) {
    let length = 2.0 * half_length;
    let sine = if length > 0.0 {
        (bottom - top) / length
    } else {
        0.0
    };
    let form = Form::SweptBall {
        bottom: -half_length,
        length,
        radius_bottom: bottom,
        radius_top: top,
        sine,
        cosine: (1.0 - sine * sine).max(0.0).sqrt(),
    };
    let r = bottom.max(top);
    let lower_z = (-half_length - bottom).min(half_length - top);
    let upper_z = (half_length + top).max(bottom - half_length);
    (
        form,
        Vector3::new(-r, -r, lower_z),
        Vector3::new(r, r, upper_z),
    )
}

impl Form {
    /// Distance and normal in the frame of the shape.
    #[inline(always)]
    fn sample(&self, p: &Vector3<f64>) -> (f64, Vector3<f64>) {
        match *self {
            Self::SweptBall {
                bottom,
                length,
                radius_bottom,
                radius_top,
                sine,
                cosine,
            } => {
                let (radial, side) = radial(p);
                let z = p.z - bottom;
                // Position along the cone's side, which ends at cosine * length.
                let along = cosine * z - sine * radial;
                // The centres of both ends belong to the side, whose normal is right there.
                if along >= 0.0 && along <= cosine * length {
                    let normal = cosine * side + Vector3::new(0.0, 0.0, sine);
                    (cosine * radial + sine * z - radius_bottom, normal)
                } else if along < 0.0 {
                    from_ball(&Vector3::new(p.x, p.y, z), &side, radius_bottom)
                } else {
                    from_ball(&Vector3::new(p.x, p.y, z - length), &side, radius_top)
                }
            }
            Self::Cylinder { core, rounding } => {
                let (radial, side) = radial(p);
                let q = Vector2::new(radial, p.z.abs()) - core;
                let out = q.sup(&Vector2::zeros());
                let (distance, n) = match out.norm() {
                    d if d > TINY => (d, out / d),
                    _ if q.x >= q.y => (q.x, Vector2::x()),
                    _ => (q.y, Vector2::y()),
                };
                let normal = n.x * side + Vector3::new(0.0, 0.0, n.y.copysign(p.z));
                (distance - rounding, normal)
            }
            Self::Box { core, rounding } => {
                let q = p.abs() - core;
                let out = q.sup(&Vector3::zeros());
                let (distance, n) = match out.norm() {
                    d if d > TINY => (d, out / d),
                    _ => {
                        let face = q.imax();
                        (q[face], Vector3::ith(face, 1.0))
                    }
                };
                (distance - rounding, n.zip_map(p, f64::copysign))
            }
        }
    }
}

/// Distance from the z axis and the unit vector away from it.
#[inline(always)]
fn radial(p: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let r = (p.x * p.x + p.y * p.y).sqrt();
    let side = if r > TINY {
        Vector3::new(p.x / r, p.y / r, 0.0)
    } else {
        Vector3::x()
    };
    (r, side)
}

#[inline(always)]
fn from_ball(p: &Vector3<f64>, side: &Vector3<f64>, radius: f64) -> (f64, Vector3<f64>) {
    let d = p.norm();
    (d - radius, if d > TINY { p / d } else { *side })
}
