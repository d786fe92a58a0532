use crate::{GapError, Sample};
use nalgebra::Vector3;
use std::ops::Range;
use vsf_core::CoreError;
use vsf_data::{Sequence, Table, TorqueKind};
use vsf_pipeline::{Scene, derivatives_of, external_torques, rigid_body_torques, unwound};

/// Half the window (samples) of [`Motion::smooth`]. It halves white noise and hardly blunts an onset.
pub(crate) const HALF_MEAN: usize = 2;

/// One sequence, with everything that effects may depend on.
#[derive(Debug, Clone)]
pub struct Motion {
    /// ID of the sequence.
    pub id: String,
    /// Time since the session began (s). Sequences whose time stamps start anew are placed one after the other.
    pub clock: Vec<f64>,
    /// Joint positions (rad or m), one row per sample. Continuous joints are unwrapped.
    pub q: Table,
    /// Joint velocities (rad/s or m/s).
    pub qd: Table,
    /// Joint accelerations (rad/s² or m/s²).
    pub qdd: Table,
    /// Readings as load of the environment on the joints (N m or N). For `measured` readings, the rigid-body torques minus
    /// the reading.
    pub reading: Table,
    /// Readings averaged over a few neighboring samples, for effects that move the links or the object by them. Otherwise
    /// noise of the reading would become noise of every contact.
    pub smooth: Table,
    /// Load of the gears (N m or N); see [`crate::Sample::load`].
    pub load: Table,
    /// Rows of each touch.
    pub touches: Vec<Range<usize>>,
    /// Number of samples at the start whose mean was subtracted from the readings; 0 if none was.
    pub tare: usize,
}

impl Motion {
    /// A recorded sequence; `origin` is the time stamp at which the session's clock is zero.
    ///
    /// # Errors
    /// Torques or motions that cannot be read.
    pub(crate) fn of(scene: &Scene, sequence: &Sequence, origin: f64) -> Result<Self, GapError> {
        let derivatives = derivatives_of(scene.robot(), sequence)?;
        let clock = sequence.time.iter().map(|t| t - origin).collect();
        let reading = external_torques(scene, sequence)?;
        let load = match scene.torque_kind() {
            TorqueKind::External => reading.clone(),
            TorqueKind::Measured => {
                rigid_body_torques(scene.robot(), &scene.gravity(), sequence, &derivatives)?
            }
        };
        Ok(Self {
            id: sequence.id.clone(),
            clock,
            q: unwound(scene.robot(), sequence).into_owned().angles,
            qd: derivatives.velocities,
            qdd: derivatives.accelerations,
            smooth: smoothed(&reading, sequence.touches())?,
            reading,
            load,
            touches: sequence.touches().collect(),
            tare: scene.tare_samples(),
        })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.clock.len()
    }

    /// True if there are no samples.
    pub fn is_empty(&self) -> bool {
        self.clock.is_empty()
    }

    /// Checks consistency with a robot of `joints` joints: every table has a row of finite numbers for each sample, and the
    /// touches cover all samples one after the other, each with increasing time.
    pub(crate) fn check(&self, joints: usize) -> Result<(), GapError> {
        let n = self.len();
        for table in [
            &self.q,
            &self.qd,
            &self.qdd,
            &self.reading,
            &self.smooth,
            &self.load,
        ] {
            CoreError::check_len("joints of a motion", table.cols(), joints)?;
            CoreError::check_len("rows of a motion", table.rows(), n)?;
            CoreError::check_finite("motion", table.data())?;
        }
        CoreError::check_finite("clock of a motion", &self.clock)?;
        let mut end = 0;
        for touch in &self.touches {
            CoreError::check_len("samples before a touch", touch.start, end)?;
            end = touch.end.max(touch.start);
        }
        CoreError::check_len("samples of all touches", end, n)?;
        let steps = |touch: &Range<usize>| self.clock[touch.clone()].windows(2);
        let back = (self.touches.iter()).find_map(|t| steps(t).find(|c| c[1] <= c[0]));
        match back {
            Some(clock) => Err(GapError::TimeBackwards {
                dt: clock[1] - clock[0],
            }),
            None => Ok(()),
        }
    }

    /// The sample at `row` of a touch that began at row `first`.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn sample(&self, row: usize, first: usize, force_W: Vector3<f64>) -> Sample<'_> {
        let dt = if row > first {
            self.clock[row] - self.clock[row - 1]
        } else {
            0.0
        };
        Sample {
            clock: self.clock[row],
            dt,
            q: &self.q[row],
            qd: &self.qd[row],
            qdd: &self.qdd[row],
            reading: &self.smooth[row],
            load: &self.load[row],
            force_W,
        }
    }

    /// Averages every `by` samples, never across two touches or the end of the tare. Blocks of the tare have the same
    /// length, to a sample, so the mean of the tare is the mean of its blocks.
    pub(crate) fn thinned(&self, by: usize) -> Result<Self, GapError> {
        let (mut blocks, mut touches, mut tare) = (Vec::new(), Vec::new(), 0);
        for touch in &self.touches {
            let first = blocks.len();
            let tared = self.tare.clamp(touch.start, touch.end);
            let (start, samples) = (touch.start, tared - touch.start);
            let parts = samples.div_ceil(by);
            blocks.extend(
                (0..parts).map(|k| start + k * samples / parts..start + (k + 1) * samples / parts),
            );
            tare += parts;
            let starts = (tared..touch.end).step_by(by);
            blocks.extend(starts.map(|row| row..(row + by).min(touch.end)));
            touches.push(first..blocks.len());
        }
        let means = |table: &Table| {
            let d = table.cols();
            let mut means = Table::new(d, vec![0.0; blocks.len() * d])?;
            for (block, mean) in blocks.iter().zip(means.data_mut().chunks_exact_mut(d)) {
                average(table, block.clone(), mean);
            }
            Ok::<Table, GapError>(means)
        };
        let clock = |block: &Range<usize>| {
            self.clock[block.clone()].iter().sum::<f64>() / block.len() as f64
        };
        self.with_rows(blocks.iter().map(clock).collect(), touches, tare, means)
    }

    /// A part of the sequence.
    ///
    /// # Errors
    /// None in practice: the tables keep their form.
    pub(crate) fn part(&self, rows: Range<usize>) -> Result<Self, GapError> {
        let cut = |table: &Table| {
            let d = table.cols();
            let own = table.data()[rows.start * d..rows.end * d].to_vec();
            Ok(Table::new(d, own)?)
        };
        let inside = |t: &Range<usize>| {
            let (start, end) = (t.start.max(rows.start), t.end.min(rows.end));
            (start < end).then(|| start - rows.start..end - rows.start)
        };
        let touches = self.touches.iter().filter_map(inside).collect();
        let tare = self.tare.saturating_sub(rows.start).min(rows.len());
        self.with_rows(self.clock[rows.clone()].to_vec(), touches, tare, cut)
    }

    /// The same sequence with other rows, which `rows` computes from those of every table.
    fn with_rows(
        &self,
        clock: Vec<f64>,
        touches: Vec<Range<usize>>,
        tare: usize,
        rows: impl Fn(&Table) -> Result<Table, GapError>,
    ) -> Result<Self, GapError> {
        Ok(Self {
            id: self.id.clone(),
            clock,
            q: rows(&self.q)?,
            qd: rows(&self.qd)?,
            qdd: rows(&self.qdd)?,
            reading: rows(&self.reading)?,
            smooth: rows(&self.smooth)?,
            load: rows(&self.load)?,
            touches,
            tare,
        })
    }

    /// When it begins, by the session's clock (s).
    pub(crate) fn begin(&self) -> f64 {
        self.clock.first().copied().unwrap_or(0.0)
    }

    /// Whether `other` is the same part of the same sequence.
    pub(crate) fn is(&self, other: &Self) -> bool {
        self.id == other.id && self.begin() == other.begin()
    }

    /// A sequence of one joint, ten samples a second, whose tables count its rows.
    #[cfg(test)]
    #[allow(clippy::unwrap_used)]
    pub(crate) fn counting(rows: usize, touches: Vec<Range<usize>>) -> Self {
        let table = || Table::new(1, (0..rows).map(|k| k as f64).collect()).unwrap();
        Self {
            id: "0".to_owned(),
            clock: (0..rows).map(|k| 0.1 * k as f64).collect(),
            q: table(),
            qd: table(),
            qdd: table(),
            reading: table(),
            smooth: table(),
            load: table(),
            touches,
            tare: 0,
        }
    }
}

/// The mean of some rows of a table.
fn average(table: &Table, rows: Range<usize>, mean: &mut [f64]) {
    for (j, mean) in mean.iter_mut().enumerate() {
        let sum: f64 = rows.clone().map(|k| table[k][j]).sum();
        *mean = sum / rows.len() as f64;
    }
}

/// The mean of each sample and its neighbors in the same touch.
fn smoothed(table: &Table, touches: impl Iterator<Item = Range<usize>>) -> Result<Table, GapError> {
    let d = table.cols();
    let mut means = Table::new(d, vec![0.0; table.rows() * d])?;
    for touch in touches {
        for row in touch.clone() {
            let from = row.saturating_sub(HALF_MEAN).max(touch.start);
            let to = (row + HALF_MEAN + 1).min(touch.end);
            average(table, from..to, &mut means.data_mut()[row * d..][..d]);
        }
    }
    Ok(means)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Blocks neither straddle the end of the tare nor that of a touch; the mean of the tare is that of its blocks.
    #[test]
    fn thinning_keeps_the_tare() {
        for (tare, by, counts) in [
            (50, 107, (1, 1 + 1 + 1)),
            (50, 20, (3, 3 + 3 + 3)),
            (0, 20, (0, 5 + 3)),
            (120, 50, (3, 2 + 1 + 1)),
            (150, 50, (3, 2 + 1)),
        ] {
            let mut motion = Motion::counting(150, vec![0..100, 100..150]);
            motion.tare = tare;
            let thinned = motion.thinned(by).unwrap();
            assert_eq!((thinned.tare, thinned.len()), counts, "{tare} {by}");
            let mean = |rows: &[f64]| rows.iter().sum::<f64>() / rows.len() as f64;
            if tare > 0 && tare <= 100 {
                let [blocks, rows] = [&thinned, &motion].map(|m| mean(&m.q.data()[..m.tare]));
                assert!((blocks - rows).abs() < 0.5, "{tare} {by}: {blocks} {rows}");
            }
        }
    }
}
