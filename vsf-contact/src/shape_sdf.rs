use crate::forms::{Form, RoundedBox, RoundedCylinder, SweptBall};
use crate::lanes::{Number, Triple, dispatch, vectors};
use crate::{Batch, ContactError, Sdf, SdfSample, UnionSdf};
use nalgebra::{Isometry3, Matrix3, Point3, Vector2, Vector3};
use pulp::{Scalar, Simd, WithSimd};
use vsf_core::{CoreError, Shape};

/// The exact signed distance of a posed analytic shape: ball, capsule, round cone, cylinder, box.
///
/// Where the nearest surface point is not unique, the normal is that of one of them. On the axis of a
/// round shape (and at the center of a ball) it points toward the shape's +x. In a box it is that of
/// the nearest face; of several equally near faces the first of x, y, z wins, then the positive side.
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
    /// Box around the shape. Due to rounding a distance may be below that from the box by `rounding`.
    center_B: Point3<f64>,
    half_B: Vector3<f64>,
    rounding: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum AnyForm {
    SweptBall(SweptBall),
    Cylinder(RoundedCylinder),
    Box(RoundedBox),
}

impl ShapeSdf {
    /// Creates the signed distance field of `shape` at the pose `X_BS` in the body frame.
    ///
    /// # Errors
    /// A dimension out of range, a pose that is not finite, or a mesh; for meshes use
    /// [`GridSdf`](crate::GridSdf) or [`MeshSdf`](crate::MeshSdf).
    pub fn new(shape: &Shape, X_BS: &Isometry3<f64>) -> Result<Self, ContactError> {
        shape.check()?;
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
            Shape::Mesh(_) => return Err(ContactError::UnsupportedShape { shape: "mesh" }),
            _ => {
                return Err(ContactError::UnsupportedShape {
                    shape: "new kind of shape",
                });
            }
        };
        let R_SB = X_BS.rotation.to_rotation_matrix().matrix().transpose();
        let R_BS = R_SB.transpose();
        let p_BS = Point3::from(X_BS.translation.vector);
        let center_B = p_BS + R_BS * (0.5 * (lower_S + upper_S));
        let half_B = R_BS.abs() * (0.5 * (upper_S - lower_S));
        Ok(Self {
            R_SB,
            p_BS,
            form,
            center_B,
            half_B,
            rounding: 1e-12 * (center_B.coords.amax() + half_B.amax()),
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
        // The unused normal is optimized away.
        match &self.form {
            AnyForm::SweptBall(form) => self.sample_one(form, p_B).distance,
            AnyForm::Cylinder(form) => self.sample_one(form, p_B).distance,
            AnyForm::Box(form) => self.sample_one(form, p_B).distance,
        }
    }

    fn unite(&self, batch: &mut Batch) {
        let shapes = std::slice::from_ref(self);
        dispatch(Unite { shapes, batch });
    }

    fn unite_all(union: &UnionSdf<Self>, batch: &mut Batch) {
        let shapes = union.parts();
        dispatch(Unite { shapes, batch });
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        (self.center_B - self.half_B, self.center_B + self.half_B)
    }
}

impl ShapeSdf {
    #[inline(always)]
    fn sample_one(&self, form: &impl Form, p_B: &Point3<f64>) -> SdfSample {
        let p_B = Triple::splat(Scalar::new(), p_B.coords);
        let (distance, normal) = self.sample_lanes(form, p_B);
        let normal = normal();
        SdfSample {
            distance: distance.value(),
            normal: Vector3::new(normal.x.value(), normal.y.value(), normal.z.value()),
        }
    }

    #[inline(always)]
    fn sample_lanes<S: Simd>(
        &self,
        form: &impl Form,
        p_B: Triple<S>,
    ) -> (Number<S>, impl FnOnce() -> Triple<S>) {
        let p = p_B - p_B.all(self.p_BS.coords);
        let row = move |i: usize| p.all(self.R_SB.row(i).transpose());
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

    /// How far places are outside of the box, along the axis where that is most. This is a lower bound of
    /// their distance from the shape.
    #[inline(always)]
    fn distance_from_box<S: Simd>(&self, p_B: Triple<S>) -> Number<S> {
        let from_center = p_B - p_B.all(self.center_B.coords);
        let out = from_center.map(Number::abs) - p_B.all(self.half_B);
        out.x.max(out.y).max(out.z) - out.x.all(self.rounding)
    }
}

/// Updates a batch with several shapes.
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
            let mut kept = Kept {
                distance: Number::load(simd, &batch.distances, v),
                normal: Triple::load(simd, &batch.normals, v),
            };
            for shape in shapes {
                let from_box = shape.distance_from_box(p_B);
                if from_box.below(kept.distance).any() {
                    match &shape.form {
                        AnyForm::SweptBall(form) => kept.offer(shape.sample_lanes(form, p_B)),
                        AnyForm::Cylinder(form) => kept.offer(shape.sample_lanes(form, p_B)),
                        AnyForm::Box(form) => kept.offer(shape.sample_lanes(form, p_B)),
                    }
                }
            }
            kept.distance.store(&mut batch.distances, v);
            kept.normal.store(&mut batch.normals, v);
        }
    }
}

/// The nearest samples so far.
struct Kept<S: Simd> {
    distance: Number<S>,
    normal: Triple<S>,
}

impl<S: Simd> Kept<S> {
    #[inline(always)]
    fn offer(&mut self, (distance, normal): (Number<S>, impl FnOnce() -> Triple<S>)) {
        let nearer = distance.below(self.distance);
        if nearer.any() {
            self.distance = nearer.pick(distance, self.distance);
            self.normal = nearer.pick3(normal(), self.normal);
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
