use super::{CovarianceFilter, Scratch, check_means, check_variances};
use crate::dense::algebra::{add_product, product};
use crate::dense::touched::Conditional;
use faer::Mat;
use vsf_core::{CoreError, Scalar};

/// New points taken in at once.
const CHUNK: usize = 32;

impl<T: Scalar> CovarianceFilter<T> {
    /// Takes points into the joint state. Changes nothing that is known.
    pub(super) fn touch(&mut self, points: &[u32]) -> Result<(), CoreError> {
        if points.iter().all(|&p| self.touched.slot(p).is_some()) {
            return Ok(());
        }
        let unseen = self.touched.unseen(points)?;
        // Half of the entries, with room for the rest.
        self.touched.check_room(unseen.len(), size_of::<T>())?;
        unseen
            .chunks(CHUNK)
            .try_for_each(|chunk| self.append(chunk))
    }

    /// New points `K_b = mean_b + share onto^T (K_t - mean_t) + rest` of the prior.
    fn append(&mut self, unseen: &[u32]) -> Result<(), CoreError> {
        let n = self.touched.len();
        let conditional = self.touched.condition(unseen)?;
        let Conditional { onto, share, .. } = &conditional;
        let sums = onto.ncols();
        let Scratch { w, gain, work, .. } = &mut self.scratch;
        w.clear(n, sums);
        for i in 0..sums {
            (0..n).for_each(|slot| w.set(slot, i, T::from_f64(onto[(slot, i)])));
        }
        self.covariance.times(w, gain, work);
        let spread = Mat::from_fn(n, sums, |slot, i| gain.get(slot, i).to_f64());
        let spread = product(spread.as_ref(), share.transpose());
        let onto = product(onto.as_ref(), share.transpose());
        let mut own = conditional.covariance.clone();
        add_product(&mut own, 1.0, onto.transpose(), spread.as_ref());

        let mean = self.expected(unseen, &onto, |slot| self.mean[slot])?;
        // `x = mu + P lambda` goes by the same weights, since the rows of new points in `P` do.
        let mode = match &self.mode {
            Some(mode) => self.expected(unseen, &onto, |slot| mode.x(slot))?,
            None => Vec::new(),
        };
        let variance = |b: usize| T::from_f64(own[(b, b)]);
        let variance: Vec<T> = (0..unseen.len()).map(variance).collect();
        check_variances(&variance, unseen)?;

        let prior = self.touched.prior();
        let prior_sd = |&p: &u32| prior.covariance(p as usize, p as usize).sqrt();
        for ((&x, &v), sd) in mode.iter().zip(&variance).zip(unseen.iter().map(prior_sd)) {
            self.mode.iter_mut().for_each(|mode| mode.push(x, v, sd));
        }
        self.mean.extend(mean);
        self.variance.extend(variance);
        for b in 0..unseen.len() {
            self.covariance.push();
            if sums > 0 {
                for slot in 0..n {
                    let value = T::from_f64(spread[(slot, b)]);
                    self.covariance.set(n + b, slot, value);
                }
            }
            for c in 0..=b {
                let value = T::from_f64(own[(b, c)]);
                self.covariance.set(n + b, n + c, value);
            }
        }
        self.touched.append(unseen, &conditional);
        Ok(())
    }

    /// Means of new points that follow by the weights `onto` from those of the touched ones.
    fn expected(
        &self,
        unseen: &[u32],
        onto: &Mat<f64>,
        now: impl Fn(usize) -> T,
    ) -> Result<Vec<T>, CoreError> {
        let prior = self.touched.prior().mean();
        let mean = |(b, &new): (usize, &u32)| {
            let known = self.touched.points().iter().enumerate();
            let moved =
                known.map(|(slot, &p)| onto[(slot, b)] * (now(slot).to_f64() - prior[p as usize]));
            T::from_f64(prior[new as usize] + moved.sum::<f64>())
        };
        let means: Vec<T> = unseen.iter().enumerate().map(mean).collect();
        check_means(&means)?;
        Ok(means)
    }
}
