use super::suite::Suite;
use crate::Reading;
use vsf_core::{Belief, Scalar};

impl<T: Scalar> Suite<'_, T> {
    pub(super) fn permutation(&self) {
        let n = self.options.points;
        let mut scrambled: Vec<usize> = (0..n).collect();
        scrambled.sort_by_key(|&i| (i * 17 % 31, i));
        self.relabeling(&scrambled);
        // No point keeps its place.
        let shifted: Vec<usize> = (0..n).map(|i| (i + 1) % n).collect();
        self.relabeling(&shifted);
    }

    fn relabeling(&self, order: &[usize]) {
        let (n, prior) = (self.options.points, self.prior());
        let mut rank = vec![0; n];
        order.iter().enumerate().for_each(|(r, &i)| rank[i] = r);
        let relabel = |belief: &Belief<T>| {
            let pick = |x: &[T]| order.iter().map(|&i| x[i]).collect();
            Belief::new(pick(belief.mean()), pick(belief.variance())).unwrap()
        };
        let readings = self.sequence(n);
        let relabeled: Vec<Reading> = readings
            .iter()
            .map(|r| {
                let mut touched: Vec<(u32, Vec<f64>)> = r
                    .points
                    .iter()
                    .map(|&p| rank[p as usize] as u32)
                    .zip(r.columns.iter().cloned())
                    .collect();
                touched.sort_by_key(|(p, _)| *p);
                let (points, columns) = touched.into_iter().unzip();
                Reading {
                    points,
                    columns,
                    ..r.clone()
                }
            })
            .collect();
        let expected = relabel(&self.run(prior.clone(), &readings));
        self.close(
            &self.run(relabel(&prior), &relabeled),
            &expected,
            1.0,
            "relabeled",
        );
    }

    /// The readings with columns and torques in other units.
    fn scaled(&self, columns: f64, torque: f64) -> Vec<Reading> {
        let times = |x: &[f64], c: f64| x.iter().map(|v| v * c).collect::<Vec<_>>();
        let scale = |r: &Reading| Reading {
            points: r.points.clone(),
            columns: r.columns.iter().map(|w| times(w, columns)).collect(),
            tau: times(&r.tau, torque),
            noise_sd: times(&r.noise_sd, torque),
        };
        self.sequence(self.options.points)
            .iter()
            .map(scale)
            .collect()
    }

    /// With tau, W and the noise in another unit of torque, the stiffness stays the same.
    pub(super) fn torque_units(&self) {
        let expected = self.run(self.prior(), &self.scaled(1.0, 1.0));
        for c in [3.7, 1e-3] {
            let got = self.run(self.prior(), &self.scaled(c, c));
            self.close(&got, &expected, 1.0, "unit of torque");
        }
    }

    /// With W in another unit of length, stiffness is in the inverse unit.
    pub(super) fn stiffness_units(&self) {
        let expected = self.run(self.prior(), &self.scaled(1.0, 1.0));
        let times = |x: &[T], c: f64| x.iter().map(|v| T::from_f64(v.to_f64() * c)).collect();
        let scale = |b: &Belief<T>, c: f64| {
            Belief::new(times(b.mean(), c), times(b.variance(), c * c)).unwrap()
        };
        for c in [3.7, 1e-3] {
            let got = self.run(scale(&self.prior(), 1.0 / c), &self.scaled(c, 1.0));
            self.close(&scale(&got, c), &expected, 1.0, "unit of stiffness");
        }
    }

    pub(super) fn order(&self) {
        let mut readings = self.sequence(self.options.points);
        let expected = self.run(self.prior(), &readings);
        readings.reverse();
        self.close(
            &self.run(self.prior(), &readings),
            &expected,
            10.0,
            "reversed",
        );
        readings.rotate_left(self.options.steps / 3);
        self.close(
            &self.run(self.prior(), &readings),
            &expected,
            10.0,
            "rotated",
        );
    }

    pub(super) fn splitting(&self) {
        let readings = self.sequence(self.options.points);
        let single = |r: &Reading, i: usize| Reading {
            points: r.points.clone(),
            columns: r.columns.iter().map(|w| vec![w[i]]).collect(),
            tau: vec![r.tau[i]],
            noise_sd: vec![r.noise_sd[i]],
        };
        let split: Vec<Reading> = readings
            .iter()
            .flat_map(|r| (0..self.options.channels).map(move |i| single(r, i)))
            .collect();
        let expected = self.run(self.prior(), &readings);
        self.close(
            &self.run(self.prior(), &split),
            &expected,
            10.0,
            "channel by channel",
        );
    }
}
