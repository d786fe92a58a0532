use crate::property::ask;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use vsf_contact::{Batch, Sdf, SdfSample};
use vsf_core::nalgebra::{Point3, Vector3};

/// Number of places that are tested.
const PLACES: usize = 600;
/// Distance from the surface at which contact happens, as a share of the body's size.
const NEAR: f64 = 0.1;
/// Share of the places near the surface at which the normal has to be the gradient. At edges there is none.
const SMOOTH: f64 = 0.9;
/// Step of finite differences, as a share of the body's size.
const STEP: f64 = 1e-5;
/// Rounding error, relative to 1 and to the body's size.
const ROUNDING: f64 = 1e-9;

type Property<'a> = fn(&Suite<'a>);

/// Checks that a signed distance field keeps the promises of [`Sdf`], at places in and around its bounds.
///
/// | property |
/// | --- |
/// | the bounds are a box |
/// | distances and normals are finite, normals of unit length |
/// | the distance alone equals that of the sample |
/// | distances change no faster than places do, except for the slack |
/// | near the surface, the normal is the gradient of the distance, where there is one |
/// | the inside and the surface lie within the bounds |
/// | many places at once have the same samples as one by one |
/// | places that are not finite do no harm |
///
/// # Panics
/// With the name of the property that does not hold.
///
/// ```
/// use vsf_core::{Shape, nalgebra::Isometry3};
/// let ball = vsf_contact::ShapeSdf::new(&Shape::Sphere { radius: 0.02 }, &Isometry3::identity())?;
/// vsf_testkit::check_sdf(&ball);
/// # Ok::<(), vsf_contact::ContactError>(())
/// ```
pub fn check_sdf(sdf: &dyn Sdf) {
    let (low, high) = sdf.bounds();
    ask("sdf", "the bounds are a box", || {
        let is_box = (0..3).all(|k| low[k].is_finite() && high[k].is_finite() && low[k] <= high[k]);
        assert!(is_box, "from {low} to {high}");
    });
    let size = (high - low).norm();
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut near = || {
        let share = Vector3::from_fn(|_, _| rng.random_range(-0.5..1.5));
        low + (high - low).component_mul(&share)
    };
    let suite = Suite {
        sdf,
        size,
        places: (0..PLACES).map(|_| near()).collect(),
    };
    let properties: [(&str, Property<'_>); 7] = [
        ("distances and normals are finite", Suite::finite),
        ("the distance alone is that of the sample", Suite::alone),
        ("distances change no faster than places", Suite::lipschitz),
        ("the normal is the gradient", Suite::gradient),
        ("the inside lies within the bounds", Suite::inside),
        ("many places have the samples of each", Suite::many),
        ("places that are not finite do no harm", Suite::no_place),
    ];
    for (property, check) in properties {
        ask("sdf", property, || check(&suite));
    }
}

struct Suite<'a> {
    sdf: &'a dyn Sdf,
    /// Diagonal of the bounds (m).
    size: f64,
    places: Vec<Point3<f64>>,
}

impl Suite<'_> {
    fn finite(&self) {
        for p in &self.places {
            let SdfSample { distance, normal } = self.sdf.sample(p);
            assert!(distance.is_finite(), "the distance at {p} is {distance}");
            let off = (normal.norm() - 1.0).abs();
            // NaN is off, too.
            assert!(off < 1e-6, "the normal at {p} is {normal}");
        }
        let slack = self.sdf.slack();
        assert!((0.0..f64::MAX).contains(&slack), "the slack is {slack}");
    }

    fn alone(&self) {
        for p in &self.places {
            let (alone, sample) = (self.sdf.distance(p), self.sdf.sample(p).distance);
            assert!(
                (alone - sample).abs() <= ROUNDING * self.size,
                "{alone} and {sample} at {p}"
            );
        }
    }

    fn lipschitz(&self) {
        for pair in self.places.windows(2) {
            let change = (self.sdf.distance(&pair[0]) - self.sdf.distance(&pair[1])).abs();
            let most = (pair[0] - pair[1]).norm() + self.sdf.slack() + ROUNDING * self.size;
            assert!(
                change <= most,
                "by {change} from {} to {}",
                pair[0],
                pair[1]
            );
        }
    }

    fn gradient(&self) {
        let step = STEP * self.size;
        let agrees = |p: &&Point3<f64>| {
            let normal = self.sdf.sample(p).normal;
            let along = |sign: f64| self.sdf.distance(&(**p + normal * (sign * step)));
            // Interpolated fields are as steep as their slack lets them be.
            let slope = (along(1.0) - along(-1.0)) / (2.0 * step);
            (slope - 1.0).abs() < 0.25
        };
        let is_near = |p: &&Point3<f64>| self.sdf.distance(p).abs() < NEAR * self.size;
        let near: Vec<&Point3<f64>> = self.places.iter().filter(is_near).collect();
        let (count, all) = (near.iter().copied().filter(agrees).count(), near.len());
        assert!(
            all > 0,
            "of {PLACES} places in and around the bounds none is near the surface"
        );
        assert!(
            count as f64 >= SMOOTH * all as f64,
            "along the normal the distance grows by as much at {count} of {all} places alone"
        );
    }

    fn inside(&self) {
        let (low, high) = self.sdf.bounds();
        let room = self.sdf.slack() + ROUNDING * self.size;
        let is_within = |p: &Point3<f64>| (0..3).all(|k| (low[k]..=high[k]).contains(&p[k]));
        for p in self.places.iter().filter(|p| !is_within(p)) {
            let distance = self.sdf.distance(p);
            assert!(
                distance > -room,
                "{p} is outside of them, and {distance} m from the surface"
            );
        }
    }

    fn many(&self) {
        let mut batch = Batch::default();
        for places in self.places.chunks(Batch::CAPACITY) {
            batch.clear();
            places.iter().for_each(|p| batch.push(p));
            self.sdf.unite(&mut batch);
            for (i, p) in places.iter().enumerate() {
                let (many, one) = (batch.sample(i), self.sdf.sample(p));
                let off = (many.distance - one.distance).abs();
                assert!(
                    off <= 1e-6 * self.size,
                    "{many:?} in place of {one:?} at {p}"
                );
            }
        }
    }

    /// At places that are not finite, the answer does not matter, but there is one.
    fn no_place(&self) {
        for value in [f64::NAN, f64::INFINITY, -1e300] {
            for k in 0..3 {
                let mut p = self.places[0];
                p[k] = value;
                self.sdf.sample(&p);
                self.sdf.distance(&p);
            }
        }
    }
}
