#[cfg(feature = "serde")]
use crate::CoreError;
use crate::UpdateReport;

/// Running statistics of a filter's innovations: a test of whether the filter is consistent.
///
/// An exact filter whose prior and noise are right has a mean normalized innovation squared (NIS)
/// equal to the number of channels, and so a [ratio](FilterHealth::nis_ratio) of 1. A filter whose
/// ratio lies above the [interval](FilterHealth::nis_ratio_interval) is overconfident, or the model is
/// wrong. Below the interval it is too cautious.
///
/// # Reference
/// Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001,
/// section 5.4. Chi-squared quantiles by Wilson and Hilferty, 1931, doi 10.1073/pnas.17.12.684.
///
/// ```
/// use vsf_core::{FilterHealth, UpdateReport};
/// let mut health = FilterHealth::default();
/// for nis in [6.0, 8.0, 7.5, 6.5] {
///     health.record(&UpdateReport { dof: 7, nis, ..Default::default() });
/// }
/// assert_eq!(health.mean_nis(), Some(7.0));
/// assert!(health.is_consistent());
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "crate::state::HealthParts")
)]
pub struct FilterHealth {
    updates: usize,
    dof: usize,
    nis: f64,
}

impl FilterHealth {
    /// Restores saved statistics: the number of updates, the sum of their channels and the sum of their NIS.
    #[cfg(feature = "serde")]
    pub(crate) fn from_sums(updates: usize, dof: usize, nis: f64) -> Result<Self, CoreError> {
        CoreError::check_finite("sum of NIS", &[nis])?;
        if nis < 0.0 {
            return Err(CoreError::Parameter {
                name: "sum of NIS",
                value: nis,
                range: ">= 0",
            });
        }
        Ok(Self { updates, dof, nis })
    }

    /// Records one update.
    ///
    /// Updates without contacts count too: they show the noise alone. An update whose NIS is not
    /// finite is ignored; no estimator of this workspace reports one.
    pub fn record(&mut self, report: &UpdateReport) {
        if !report.nis.is_finite() {
            return;
        }
        self.updates += 1;
        self.dof = self.dof.saturating_add(report.dof);
        self.nis += report.nis;
    }

    /// Number of recorded updates.
    pub fn updates(&self) -> usize {
        self.updates
    }

    /// Mean NIS per update; `None` before the first one.
    pub fn mean_nis(&self) -> Option<f64> {
        (self.updates > 0).then(|| self.nis / self.updates as f64)
    }

    /// NIS per degree of freedom, 1 for a consistent filter; `None` before the first update.
    pub fn nis_ratio(&self) -> Option<f64> {
        (self.dof > 0).then(|| self.nis / self.dof as f64)
    }

    /// Interval that contains [`FilterHealth::nis_ratio`] with 95 % probability when the filter is
    /// consistent and updates are independent; `None` before the first update.
    pub fn nis_ratio_interval(&self) -> Option<(f64, f64)> {
        (self.dof > 0).then(|| {
            let n = self.dof as f64;
            let quantile = |z: f64| {
                let root = 1.0 - 2.0 / (9.0 * n) + z * (2.0 / (9.0 * n)).sqrt();
                root.max(0.0).powi(3)
            };
            (quantile(-1.959_963_985), quantile(1.959_963_985))
        })
    }

    /// Whether the NIS ratio lies in its 95 % interval; false before the first update.
    pub fn is_consistent(&self) -> bool {
        match (self.nis_ratio(), self.nis_ratio_interval()) {
            (Some(r), Some((lo, hi))) => lo <= r && r <= hi,
            _ => false,
        }
    }
}
