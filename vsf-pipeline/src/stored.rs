//! Conversion between estimates and fields on disk.

use crate::{Estimate, Hyper, PipelineError, Scene, Trace};
use vsf_core::Belief;
use vsf_data::{StiffnessField, Table};

/// Features of a stored field, of one row per point: 0 or 1, and the same numbers for every point.
const TOUCHED: &str = "touched";
const PRIOR_SD: &str = "prior_sd";
const NOISE_SD: &str = "noise_sd";
/// Largest stiffness or deviation that is taken (N/m): squares of it are finite.
const MOST: f64 = 1e100;

impl Estimate {
    /// Converts the estimate to a field to store, with [`StiffnessField::save_npz`] and its like.
    ///
    /// The field has all that predictions with deviations need:
    /// - mean and deviation of every point;
    /// - the parameters of contact, and where the robot stood;
    /// - as features, which points were `touched`, the deviation of the prior (`prior_sd`, all its parts
    ///   together) and that of the readings (`noise_sd`, a column per channel);
    /// - the name of the `recording`, and the sequences of it that `traces` are of.
    ///
    /// # Errors
    /// An estimate with a number of points other than that of the scene.
    pub fn to_field(
        &self,
        scene: &Scene,
        hyper: &Hyper,
        recording: &str,
        traces: &[Trace],
    ) -> Result<StiffnessField, PipelineError> {
        let points = scene.rest().positions().to_vec();
        if points.len() != self.belief.len() {
            let (field, recording) = (self.belief.len(), points.len());
            return Err(PipelineError::FieldSize { field, recording });
        }
        let n = points.len();
        let touched = self.touched.iter().map(|&t| f64::from(u8::from(t)));
        let features = [
            (TOUCHED, Table::new(1, touched.collect())?),
            (PRIOR_SD, Table::new(1, vec![hyper.point_sd(); n])?),
            (
                NOISE_SD,
                Table::new(hyper.noise_sd.len(), hyper.noise_sd.repeat(n))?,
            ),
        ];
        let sd = self.belief.variance().iter().map(|v| v.sqrt());
        Ok(StiffnessField {
            points,
            stiffness: self.belief.mean().to_vec(),
            sd: Some(sd.collect()),
            features: features.map(|(k, v)| (k.to_owned(), v)).into(),
            recording: Some(recording.to_owned()),
            learned_from: Some(traces.iter().map(|t| t.id.clone()).collect()),
            model: None,
            contact: Some(scene.contact_parameters()),
            base_pose: Some(*scene.robot().base_pose()),
        })
    }
}

/// An estimate read from a field on disk, whoever wrote it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct StoredEstimate {
    /// Mean and variance. If the field has no deviation, or 0, the variance is next to nothing, since a
    /// belief must have one.
    pub belief: Belief<f64>,
    /// Which points were touched; empty if the field does not say.
    pub touched: Vec<bool>,
    /// Deviation of the stiffness of a point before it was touched (N/m), all parts of the prior together;
    /// `None` if the field does not say.
    pub prior_sd: Option<f64>,
    /// Deviation of the readings (N m or N), one for all channels or one each, if the field says.
    noise_sd: Option<Vec<f64>>,
    has_sd: bool,
}

impl StoredEstimate {
    /// Reads a field that [`Estimate::to_field`] may have made.
    ///
    /// # Errors
    /// [`PipelineError::Stored`]: a stiffness or deviation that is negative or beyond 1e100 N/m, or a
    /// feature `touched`, `prior_sd` or `noise_sd` that `to_field` could not have written.
    pub fn of(field: &StiffnessField) -> Result<Self, PipelineError> {
        within("K", &field.stiffness)?;
        within("K_std", field.sd.as_deref().unwrap_or_default())?;
        // One number per point, always the same.
        column(field, PRIOR_SD)?;
        let prior_sd = constant(field, PRIOR_SD)?.and_then(|row| row.first().copied());
        let touched = column(field, TOUCHED)?.unwrap_or_default();
        if let Some(row) = touched.iter().position(|v| *v != 0.0 && *v != 1.0) {
            let problem = format!("row {row} is {:?}, neither 0 nor 1", touched[row]);
            return Err(wrong(TOUCHED, problem));
        }
        let least = f64::MIN_POSITIVE;
        let variance = match &field.sd {
            Some(sd) => sd.iter().map(|s| (s * s).max(least)).collect(),
            None => vec![least; field.stiffness.len()],
        };
        Ok(Self {
            belief: Belief::new(field.stiffness.clone(), variance)?,
            touched: touched.iter().map(|v| *v != 0.0).collect(),
            prior_sd,
            noise_sd: constant(field, NOISE_SD)?.map(<[f64]>::to_vec),
            has_sd: field.sd.is_some(),
        })
    }

    /// Whether the field has all that the deviations of predicted readings need.
    pub fn has_deviations(&self) -> bool {
        self.has_sd && self.noise_sd.is_some()
    }

    /// Deviation of the readings (N m or N) as stored, one for all channels or one each; `None` if the
    /// field does not say.
    pub fn stored_noise_sd(&self) -> Option<&[f64]> {
        self.noise_sd.as_deref()
    }

    /// Deviation of the readings of each of `channels` (N m or N); `None` if the field does not say.
    ///
    /// # Errors
    /// [`PipelineError::Stored`] if the field has another number of channels.
    pub fn noise_sd(&self, channels: usize) -> Result<Option<Vec<f64>>, PipelineError> {
        match self.noise_sd.as_deref() {
            None => Ok(None),
            Some([one]) => Ok(Some(vec![*one; channels])),
            Some(all) if all.len() == channels => Ok(Some(all.to_vec())),
            Some(all) => {
                let problem = format!("is of {} channels, the robot has {channels}", all.len());
                Err(wrong(NOISE_SD, problem))
            }
        }
    }
}

fn within(name: &'static str, values: &[f64]) -> Result<(), PipelineError> {
    match values.iter().position(|v| !(0.0..=MOST).contains(v)) {
        None => Ok(()),
        Some(row) => {
            let problem = format!("row {row} is {:?}, not in 0 .. 1e100 N/m", values[row]);
            Err(wrong(name, problem))
        }
    }
}

/// The row of a feature whose rows are all the same; `None` where there is none.
fn constant<'a>(
    field: &'a StiffnessField,
    name: &'static str,
) -> Result<Option<&'a [f64]>, PipelineError> {
    let Some(table) = field.features.get(name).filter(|t| t.rows() > 0) else {
        return Ok(None);
    };
    let first = &table.data()[..table.cols()];
    if let Some(odd) = first.iter().find(|v| !(**v > 0.0 && **v <= MOST)) {
        let problem = format!("is {odd:?}; it must be > 0 and at most 1e100");
        return Err(wrong(name, problem));
    }
    if let Some((row, other)) = table.iter().enumerate().find(|(_, row)| *row != first) {
        let problem = format!("row {row} is {other:?} and row 0 {first:?}; all must be the same");
        return Err(wrong(name, problem));
    }
    Ok(Some(first))
}

/// The numbers of a feature with one column; there are as many as points.
fn column<'a>(
    field: &'a StiffnessField,
    name: &'static str,
) -> Result<Option<&'a [f64]>, PipelineError> {
    match field.features.get(name) {
        Some(t) if t.cols() != 1 => {
            let problem = format!("has {} columns, expected one number per point", t.cols());
            Err(wrong(name, problem))
        }
        found => Ok(found.map(Table::data)),
    }
}

fn wrong(name: &'static str, problem: String) -> PipelineError {
    PipelineError::Stored { name, problem }
}
