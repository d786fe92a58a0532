use crate::forms::{Form, RoundedBox, RoundedCylinder, SweptBall};
use crate::lanes::{Number, Triple, dispatch, vectors};
use crate::{Batch, ContactError, Sdf, SdfSample};
use nalgebra::{Isometry3, Matrix3, Point3, Vector2, Vector3};
use pulp::{Scalar, Simd, WithSimd};
use vsf_core::{CoreError, Shape};

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
    form: AnyForm,
    /// Box around the shape.
    lower_S: Vector3<f64>,
    upper_S: Vector3<f64>,
    center_B: Point3<f64>,
    half_B: Vector3<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum AnyForm {
    SweptBall(SweptBall),
    Cylinder(RoundedCylinder),
    Box(RoundedBox),
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
                let form = AnyForm::Cylinder(RoundedCylinder { core, rounding });
                (form, -upper, upper)
            }
            Shape::Box {
                half_extents,
                rounding,
            } => {
                let core = half_extents.add_scalar(-rounding);
                let form = AnyForm::Box(RoundedBox { core, rounding });
                (form, -half_extents, half_extents)
            }
            ref other => {
                let shape = format!("{other:.40?}");
                return Err(ContactError::UnsupportedShape { shape });
            }
        };
        let R_SB = X_BS.rotation.to_rotation_matrix().matrix().transpose();
        let p_BS = Point3::from(X_BS.translation.vector);
        let R_BS = R_SB.transpose();
        let center_B = p_BS + R_BS * (0.5 * (lower_S + upper_S));
        let half_B: Vector3<f64> = R_BS.abs() * (0.5 * (upper_S - lower_S));
        let rounding = 1e-12 * (center_B.coords.amax() + half_B.amax());
        Ok(Self {
            R_SB,
            p_BS,
            form,
            lower_S,
            upper_S,
            center_B,
            half_B: half_B.add_scalar(rounding),
        })
    }
}

impl Sdf for ShapeSdf {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        match &self.form {
            AnyForm::SweptBall(form) => self.sample_one(form, p_B),
            AnyForm::Cylinder(form) => self.sample_one(form, p_B),
            AnyForm::Box(form) => self.sample_one(form, p_B),
        }
    }

    fn distance(&self, p_B: &Point3<f64>) -> f64 {
        // The unused normal is optimised away.
        match &self.form {
            AnyForm::SweptBall(form) => self.sample_one(form, p_B).distance,
            AnyForm::Cylinder(form) => self.sample_one(form, p_B).distance,
            AnyForm::Box(form) => self.sample_one(form, p_B).distance,
        }
    }

    fn unite(&self, batch: &mut Batch) {
        Self::unite_all(std::slice::from_ref(self), batch);
    }

    fn unite_all(shapes: &[Self], batch: &mut Batch) {
        dispatch(Unite { shapes, batch });
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let R_BS = self.R_SB.transpose();
        let center = self.p_BS + R_BS * (0.5 * (self.lower_S + self.upper_S));
        let half = R_BS.abs() * (0.5 * (self.upper_S - self.lower_S));
        (center - half, center + half)
    }
}

impl ShapeSdf {
    #[inline(always)]
    fn sample_one(&self, form: &impl Form, p_B: &Point3<f64>) -> SdfSample {
        let simd = Scalar::new();
        let (distance, normal) = self.sample_lanes(simd, form, Triple::splat(simd, p_B.coords));
        let normal = normal();
        SdfSample {
            distance: distance.value(),
            normal: Vector3::new(normal.x.value(), normal.y.value(), normal.z.value()),
        }
    }

    #[inline(always)]
    fn sample_lanes<S: Simd>(
        &self,
        simd: S,
        form: &impl Form,
        p_B: Triple<S>,
    ) -> (Number<S>, impl FnOnce() -> Triple<S>) {
        let p = p_B - Triple::splat(simd, self.p_BS.coords);
        let row = move |i: usize| Triple::splat(simd, self.R_SB.row(i).transpose());
        let (distance, normal_S) = form.sample(Triple {
            x: row(0).dot(p),
            y: row(1).dot(p),
            z: row(2).dot(p),
        });
        let normal = move || {
            let n = normal_S();
            row(0) * n.x + row(1) * n.y + row(2) * n.z
        };
        (distance, normal)
    }

    /// The nearer of this shape and what is `kept`.
    #[inline(always)]
    fn nearer<S: Simd>(
        &self,
        simd: S,
        form: &impl Form,
        p_B: Triple<S>,
        kept: (Number<S>, Triple<S>),
    ) -> (Number<S>, Triple<S>) {
        let (distance, normal) = self.sample_lanes(simd, form, p_B);
        let nearer = distance.below(kept.0);
        if nearer.any() {
            (
                nearer.pick(distance, kept.0),
                nearer.pick3(normal(), kept.1),
            )
        } else {
            kept
        }
    }
}

/// Shows a batch to shapes.
struct Unite<'a> {
    shapes: &'a [ShapeSdf],
    batch: &'a mut Batch,
}

impl WithSimd for Unite<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { shapes, batch } = self;
        for v in 0..vectors::<S>(batch.len()) {
            let p_B = Triple::load(simd, &batch.places, v);
            let mut least = Number::load(simd, &batch.distances, v);
            let mut normal = Triple::load(simd, &batch.normals, v);
            for shape in shapes {
                // No nearer than its box.
                let out = p_B.zip(Triple::splat(simd, shape.center_B.coords), |a, b| {
                    (a - b).abs()
                });
                let out = out - Triple::splat(simd, shape.half_B);
                if out.x.max(out.y).max(out.z).below(least).any() {
                    let kept = (least, normal);
                    (least, normal) = match &shape.form {
                        AnyForm::SweptBall(form) => shape.nearer(simd, form, p_B, kept),
                        AnyForm::Cylinder(form) => shape.nearer(simd, form, p_B, kept),
                        AnyForm::Box(form) => shape.nearer(simd, form, p_B, kept),
                    };
                }
            }
            least.store(&mut batch.distances, v);
            normal.store(&mut batch.normals, v);
        }
    }
}

fn swept_ball(bottom: f64, top: f64, half_length: f64) -> (AnyForm, Vector3<f64>, Vector3<f64>) {
    let length = 2.0 * half_length;
    let sine = if length > 0.0 {
        (bottom - top) / length
    } else {
        0.0
    };
    let form = AnyForm::SweptBall(SweptBall {
        bottom: -half_length,
        length,
        radius_bottom: bottom,
        radius_top: top,
        sine,
        cosine: (1.0 - sine * sine).max(0.0).sqrt(),
    });
    let r = bottom.max(top);
    let lower_z = (-half_length - bottom).min(half_length - top);
    let upper_z = (half_length + top).max(bottom - half_length);
    (
        form,
        Vector3::new(-r, -r, lower_z),
        Vector3::new(r, r, upper_z),
    )
}
