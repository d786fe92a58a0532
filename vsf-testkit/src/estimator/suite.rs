use super::EstimatorOptions;
use crate::{LinearWorld, Reading};
use vsf_core::{Belief, Estimator, Scalar};

/// A maker of estimators, and the problems for what it makes.
pub(super) struct Suite<'a, T: Scalar> {
    /// Boxed, so that the problems are compiled only once for all estimators.
    pub(super) make: &'a dyn Fn(Belief<T>) -> Box<dyn Estimator<Scalar = T>>,
    pub(super) options: EstimatorOptions,
}

impl<T: Scalar> Suite<'_, T> {
    /// A prior that differs from point to point, to detect mixed-up points.
    pub(super) fn prior(&self) -> Belief<T> {
        let o = &self.options;
        let spread = |i: usize| 1.0 + 0.2 * ((i * 7 % 5) as f64 - 2.0) / 2.0;
        let mean = (0..o.points).map(|i| T::from_f64(o.prior_mean * spread(i)));
        let variance = (0..o.points).map(|i| T::from_f64((o.prior_sd * spread(i)).powi(2)));
        Belief::new(mean.collect(), variance.collect()).unwrap()
    }

    /// A sequence that touches points below `limit`.
    pub(super) fn sequence(&self, limit: usize) -> Vec<Reading> {
        let o = &self.options;
        let mut world = LinearWorld::new(o.points, o.prior_mean, o.prior_sd, o.seed);
        (0..o.steps)
            .map(|t| {
                let contacts = 1 + (t * 5) % (limit / 2);
                world.reading(limit, contacts, o.channels, o.weight, o.noise_sd)
            })
            .collect()
    }

    pub(super) fn feed(&self, estimator: &mut dyn Estimator<Scalar = T>, readings: &[Reading]) {
        for (t, reading) in readings.iter().enumerate() {
            let obs = reading.observation(self.options.points).unwrap();
            if let Err(error) = estimator.update(&obs) {
                panic!("a good observation was refused at step {t}: {error}");
            }
        }
    }

    pub(super) fn run(&self, prior: Belief<T>, readings: &[Reading]) -> Belief<T> {
        let mut estimator = (self.make)(prior);
        self.feed(&mut estimator, readings);
        estimator.belief().clone()
    }

    /// Tolerance for sums over a sequence, relative to the prior's scale.
    pub(super) fn tolerance(&self) -> f64 {
        2e3 * T::EPSILON.to_f64()
    }

    pub(super) fn close(&self, got: &Belief<T>, expected: &Belief<T>, scale: f64, what: &str) {
        let o = &self.options;
        let bound = self.tolerance() * scale;
        for i in 0..o.points {
            let (a, b) = (got.mean()[i].to_f64(), expected.mean()[i].to_f64());
            let allowed = bound * (o.prior_mean + o.prior_sd);
            assert!(
                (a - b).abs() <= allowed,
                "{what}: mean {i} is {a}, expected {b}"
            );
            let (a, b) = (got.variance()[i].to_f64(), expected.variance()[i].to_f64());
            let allowed = bound * scale * o.prior_sd.powi(2);
            assert!(
                (a - b).abs() <= allowed,
                "{what}: variance {i} is {a}, expected {b}"
            );
        }
    }
}

/// Asserts equality, bit for bit.
pub(super) fn same<T: Scalar>(got: &Belief<T>, expected: &Belief<T>, what: &str) {
    let bits = |x: &[T]| x.iter().map(|v| v.to_f64().to_bits()).collect::<Vec<_>>();
    let (g, e) = (bits(got.mean()), bits(expected.mean()));
    if let Some(i) = (0..e.len()).find(|&i| g.get(i) != e.get(i)) {
        panic!("{what}: mean {i} is not the same bit for bit");
    }
    let (g, e) = (bits(got.variance()), bits(expected.variance()));
    if let Some(i) = (0..e.len()).find(|&i| g.get(i) != e.get(i)) {
        panic!("{what}: variance {i} is not the same bit for bit");
    }
}
