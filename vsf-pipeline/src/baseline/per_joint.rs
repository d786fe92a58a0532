use super::Predicted;
use super::features::Known;
use crate::PipelineError;
use rayon::prelude::*;
use vsf_vision::{Features, Regressor, Samples, VisionError};

/// Predicts the torque of every joint by a regressor of its own.
pub fn predict<R: Regressor>(
    make: impl Fn() -> Result<R, VisionError> + Sync,
    known: &Known,
    queries: &Features,
) -> Result<Predicted, PipelineError> {
    let of_joint = |joint: usize| {
        let torques = known.torques.row(joint).iter().copied().collect();
        let exact = vec![0.0; known.features.len()];
        let mut regressor = make()?;
        regressor.fit(&Samples::new(known.features.clone(), torques, exact)?)?;
        regressor.predict(queries)
    };
    let joints = 0..known.torques.nrows();
    let found: Vec<_> = joints
        .into_par_iter()
        .map(of_joint)
        .collect::<Result<_, _>>()?;
    let rows = 0..queries.len();
    Ok(Predicted {
        mean: rows
            .clone()
            .map(|i| found.iter().map(|p| p.mean[i]).collect())
            .collect(),
        sd: rows
            .map(|i| found.iter().map(|p| p.variance[i].sqrt()).collect())
            .collect(),
    })
}
