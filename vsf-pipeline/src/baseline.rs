use crate::{SequencePrediction, Trace};
use vsf_data::Sequence;

/// Predictors that know nothing of contact, to stand beside a field (section IV-C).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Baseline {
    /// No torque at all.
    Zero,
    /// The mean reading of the `k` train samples with the nearest joint positions (Euclidean, in
    /// radians and metres as they come). The paper takes 50, with RBF weights and the position and
    /// axis of the end effector as further features.
    Knn {
        /// Number of neighbours, at least 1; fewer samples than that are all used.
        k: usize,
    },
}

impl Baseline {
    /// Predicts `test` from the readings of `train`; sequences and traces pair up. Cost is
    /// `O(test samples x train samples)`.
    pub fn predict(
        self,
        train: &[(&Sequence, &Trace)],
        test: &[(&Sequence, &Trace)],
    ) -> Vec<SequencePrediction> {
        let known: Vec<(&[f64], &[f64])> = train
            .iter()
            .flat_map(|(s, t)| {
                s.angles
                    .iter()
                    .zip(t.observations.iter().map(|o| o.reading()))
            })
            .collect();
        let mut distances = Vec::with_capacity(known.len());
        test.iter()
            .map(|(sequence, trace)| SequencePrediction {
                id: trace.id.clone(),
                mean: sequence
                    .angles
                    .iter()
                    .map(|q| match self {
                        Self::Zero => vec![0.0; q.len()],
                        Self::Knn { k } => nearest_mean(&known, q, k, &mut distances),
                    })
                    .collect(),
                sd: Vec::new(),
            })
            .collect()
    }
}

fn nearest_mean(
    known: &[(&[f64], &[f64])],
    q: &[f64],
    k: usize,
    distances: &mut Vec<(f64, usize)>,
) -> Vec<f64> {
    let mut mean = vec![0.0; q.len()];
    let k = k.clamp(1, known.len().max(1));
    let squared = |p: &[f64]| p.iter().zip(q).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    distances.clear();
    distances.extend(known.iter().enumerate().map(|(i, (p, _))| (squared(p), i)));
    if k < distances.len() {
        distances.select_nth_unstable_by(k - 1, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
    let nearest = &distances[..k.min(distances.len())];
    for (_, i) in nearest {
        for (m, tau) in mean.iter_mut().zip(known[*i].1) {
            *m += tau / nearest.len() as f64;
        }
    }
    mean
}
