//! The experiments of section IV on a recording: Tables II to V, Figs. 4 and 7.

mod errors;
mod overlap;
mod speed;
mod update_time;

pub use errors::{Method, MethodErrors, TrainedOn};
pub use overlap::{Overlap, OverlapShares};
pub use speed::{UpdateSpeed, update_speed};
pub use update_time::{UpdateTime, UpdateTimes, update_times};

use serde::Serialize;

/// Mean and standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
}

impl Spread {
    /// Of some values, 0 of none.
    pub(crate) fn of(values: impl Iterator<Item = f64>) -> Self {
        let values: Vec<f64> = values.collect();
        let n = values.len().max(1) as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        Self {
            mean,
            sd: variance.sqrt(),
        }
    }
}
