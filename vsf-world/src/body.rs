//! Shapes of soft bodies.

use nalgebra::{Point3, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;

/// A body: the set of points with negative [`level`](Body::level).
#[derive(Debug, Clone)]
pub(crate) struct Body {
    lobes: Vec<Lobe>,
    /// Waves of the surface: wave vector \[1/m\], phase, amplitude relative to the level.
    waves: Vec<(Vector3<f64>, f64, f64)>,
}

/// A superellipsoid.
#[derive(Debug, Clone)]
struct Lobe {
    center: Point3<f64>,
    radii: Vector3<f64>,
    power: f64,
}

impl Body {
    /// Draws a body of 0.25 to 0.4 m, in front of an arm whose base is at `base`.
    pub fn draw(base: &Point3<f64>, rng: &mut Pcg64Mcg) -> Self {
        let mut within = |low: f64, high: f64| rng.random_range(low..high);
        let center = base + Vector3::new(within(0.5, 0.6), within(-0.1, 0.1), within(0.22, 0.3));
        let radii = Vector3::new(
            within(0.125, 0.19),
            within(0.125, 0.19),
            within(0.115, 0.15),
        );
        let mut lobes = vec![Lobe {
            center,
            radii,
            power: within(1.9, 3.2),
        }];
        if within(0.0, 1.0) < 0.4 {
            let out = Vector3::new(within(-0.1, 0.05), within(-0.14, 0.14), within(0.0, 0.08));
            lobes.push(Lobe {
                center: center + out,
                radii: radii * within(0.6, 0.8),
                power: within(1.9, 2.4),
            });
        }
        let waves = (0..3)
            .map(|_| {
                let wave = Vector3::new(within(-1.0, 1.0), within(-1.0, 1.0), within(-1.0, 1.0));
                (
                    wave * 45.0,
                    within(0.0, std::f64::consts::TAU),
                    within(0.02, 0.06),
                )
            })
            .collect();
        Self { lobes, waves }
    }

    /// Level function: negative inside, growing outward, about 1 at twice the size.
    pub fn level(&self, p: &Point3<f64>) -> f64 {
        let lobe = |l: &Lobe| {
            let d = (p - l.center).component_div(&l.radii).abs();
            let sum: f64 = d.iter().map(|x| x.powf(l.power)).sum();
            sum.powf(1.0 / l.power) - 1.0
        };
        let lowest = self.lobes.iter().map(lobe).fold(f64::INFINITY, f64::min);
        let wave =
            |(k, phase, share): &(Vector3<f64>, f64, f64)| share * (k.dot(&p.coords) + phase).sin();
        lowest + self.waves.iter().map(wave).sum::<f64>()
    }

    pub fn center(&self) -> Point3<f64> {
        self.lobes[0].center
    }

    /// A bounding box of the body.
    pub fn bounds(&self) -> [Point3<f64>; 2] {
        let mut low = self.center();
        let mut high = low;
        for l in &self.lobes {
            // Waves raise the surface by less than a fifth.
            low = low.inf(&(l.center - l.radii * 1.2));
            high = high.sup(&(l.center + l.radii * 1.2));
        }
        [low, high]
    }

    /// Where a ray from outside first hits the body.
    pub fn ray(&self, from: &Point3<f64>, direction: &Vector3<f64>) -> Option<Point3<f64>> {
        const STEP: f64 = 0.002;
        (0..1000)
            .map(|k| from + direction * (STEP * k as f64))
            .find(|p| self.level(p) < 0.0)
    }

    /// Outward normal at a point on the surface.
    pub fn normal(&self, p: &Point3<f64>) -> Vector3<f64> {
        // Wide enough to look past the waves.
        const STEP: f64 = 0.006;
        let slope =
            |axis: Vector3<f64>| self.level(&(p + axis * STEP)) - self.level(&(p - axis * STEP));
        Vector3::new(
            slope(Vector3::x()),
            slope(Vector3::y()),
            slope(Vector3::z()),
        )
        .normalize()
    }
}
