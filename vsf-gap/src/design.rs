use crate::windows::Windows;
use crate::{Campaign, ContactLog, GapError, Model, Motion};
use faer::Mat;
use std::sync::Arc;

/// A model over windows: `tau = W K + a`.
#[derive(Debug, Clone)]
pub(crate) struct Design {
    /// Touched points, increasing.
    pub(crate) points: Vec<u32>,
    /// Columns of the touched points, rows as in [`Windows`].
    pub(crate) w: Mat<f64>,
    /// Torques that do not depend on the stiffness.
    pub(crate) a: Vec<f64>,
}

impl Campaign {
    /// The model's columns and torques over windows.
    ///
    /// # Errors
    /// Parameters that an effect cannot take.
    pub(crate) fn design(
        &self,
        model: &Model,
        motions: &[&Motion],
        logs: &[Arc<ContactLog>],
        windows: &Windows,
    ) -> Result<Design, GapError> {
        let d = windows.joints;
        let mut slot = vec![u32::MAX; self.site.rest.len()];
        for &p in logs
            .iter()
            .flat_map(|l| &l.contacts)
            .flat_map(|c| c.points())
        {
            slot[p as usize] = 0;
        }
        let mut points = Vec::new();
        for (p, slot) in slot.iter_mut().enumerate().filter(|(_, s)| **s == 0) {
            *slot = points.len() as u32;
            points.push(p as u32);
        }
        let mut design = Design {
            w: Mat::zeros(windows.rows(), points.len()),
            a: vec![0.0; windows.rows()],
            points,
        };
        let index = windows.index(motions);
        let mut column = vec![0.0; d];
        self.predict(model, motions, logs, |s, row, touch, terms| {
            let Some(i) = index[s][row].map(|i| i as usize) else {
                return;
            };
            let share = 1.0 / windows.list[i].rows.len() as f64;
            for (a, t) in design.a[i * d..].iter_mut().zip(&terms.torques) {
                *a += share * t;
            }
            for (k, &p) in touch.contacts.points().iter().enumerate() {
                terms.column(touch, k, &mut column);
                let entries = design.w.col_as_slice_mut(slot[p as usize] as usize);
                for (w, c) in entries[i * d..].iter_mut().zip(&column) {
                    *w += share * c;
                }
            }
        })?;
        Ok(design)
    }

    /// The model's torques over windows for a stiffness per rest point.
    ///
    /// # Errors
    /// Parameters that an effect cannot take.
    pub(crate) fn torques(
        &self,
        model: &Model,
        motions: &[&Motion],
        logs: &[Arc<ContactLog>],
        windows: &Windows,
        stiffness: &[f64],
    ) -> Result<Vec<f64>, GapError> {
        let d = windows.joints;
        let mut out = vec![0.0; windows.rows()];
        let index = windows.index(motions);
        let mut tau = vec![0.0; d];
        self.predict(model, motions, logs, |s, row, touch, terms| {
            let Some(i) = index[s][row].map(|i| i as usize) else {
                return;
            };
            let share = 1.0 / windows.list[i].rows.len() as f64;
            terms.apply(touch, stiffness, &mut tau);
            for (o, t) in out[i * d..].iter_mut().zip(&tau) {
                *o += share * t;
            }
        })?;
        Ok(out)
    }
}
