use super::{Begins, Sample};
use std::collections::VecDeque;
use std::sync::Arc;
use vsf_core::CoreError;
use vsf_robots::RobotModel;

/// Slopes are over this long (s), and over so many samples at least.
const WINDOW: f64 = 0.025;
const LEAST_SAMPLES: usize = 5;
/// After a longer time (s) in which a touch begins nothing is known of the motion.
const MOST_GAP: f64 = 0.1;

/// Positions, velocities and accelerations of the joints of a stream.
///
/// Accelerations, and velocities that samples do not have, are slopes over the last 0.025 s and at least
/// five samples; they are zero until there are that many. Velocities lag by half of this window,
/// accelerations behind the velocities by as much.
#[derive(Debug, Clone)]
pub struct Motion {
    robot: Arc<RobotModel>,
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
    positions: Slopes,
    velocities: Slopes,
    /// Time of the last sample (s).
    last: f64,
}

impl Motion {
    /// Creates the state of a robot before the first sample.
    pub fn new(robot: Arc<RobotModel>) -> Self {
        let zeros = vec![0.0; robot.joint_count()];
        Self {
            q: zeros.clone(),
            qd: zeros.clone(),
            qdd: zeros,
            positions: Slopes::default(),
            velocities: Slopes::default(),
            last: f64::NEG_INFINITY,
            robot,
        }
    }

    /// Continues with a sample, or starts anew there.
    ///
    /// # Errors
    /// Times, positions or velocities that are not finite, or not one per joint. The state is then
    /// unchanged.
    pub fn follow(&mut self, sample: &Sample, begins: Begins) -> Result<(), CoreError> {
        CoreError::check_finite("time", &[sample.t])?;
        let rows = [Some(&sample.q), sample.qd.as_ref()];
        for (row, what) in rows.into_iter().zip(["positions", "velocities"]) {
            if let Some(row) = row {
                CoreError::check_len(what, row.len(), self.q.len())?;
                CoreError::check_finite(what, row)?;
            }
        }
        // A touch may begin while the arm moves on.
        let goes_on = match begins {
            Begins::Nothing => self.last.is_finite(),
            Begins::Touch => (0.0..=MOST_GAP).contains(&(sample.t - self.last)),
            Begins::Sequence => false,
        };
        self.last = sample.t;
        if goes_on {
            // Continuous joints turn on beyond a turn.
            let pairs = self.q.iter_mut().zip(&sample.q);
            let joints = self.robot.joints().iter();
            pairs
                .zip(joints)
                .for_each(|((q, next), joint)| *q += joint.change(*q, *next));
        } else {
            self.q.copy_from_slice(&sample.q);
            self.positions.begin();
            self.velocities.begin();
        }
        let mut is_known = self.positions.add(sample.t, &self.q, &mut self.qd);
        if let Some(qd) = &sample.qd {
            self.qd.copy_from_slice(qd);
            is_known = true;
        }
        self.qdd.fill(0.0);
        if is_known {
            self.velocities.add(sample.t, &self.qd, &mut self.qdd);
        }
        Ok(())
    }

    /// Positions (rad or m).
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Velocities (rad/s or m/s).
    pub fn qd(&self) -> &[f64] {
        &self.qd
    }

    /// Accelerations (rad/s² or m/s²).
    pub fn qdd(&self) -> &[f64] {
        &self.qdd
    }
}

/// Slopes of the last rows of a stream, by least squares.
#[derive(Debug, Clone, Default)]
struct Slopes {
    rows: VecDeque<(f64, Vec<f64>)>,
    /// Rows that are no longer needed, to be used again.
    spare: Vec<Vec<f64>>,
}

impl Slopes {
    /// Adds a row and writes the slopes of the last ones; says whether there are enough of them, else these are zero.
    fn add(&mut self, time: f64, row: &[f64], slopes: &mut [f64]) -> bool {
        let is_old = |(then, _): &mut (f64, Vec<f64>)| time - *then > WINDOW;
        while self.rows.len() >= LEAST_SAMPLES
            && let Some((_, row)) = self.rows.pop_front_if(is_old)
        {
            self.spare.push(row);
        }
        let mut kept = self.spare.pop().unwrap_or_default();
        kept.clear();
        kept.extend_from_slice(row);
        self.rows.push_back((time, kept));
        slopes.fill(0.0);
        let ago = |then: &f64| then - time;
        let mean = self.rows.iter().map(|(t, _)| ago(t)).sum::<f64>() / self.rows.len() as f64;
        let spread: f64 = (self.rows.iter().map(|(t, _)| (ago(t) - mean).powi(2))).sum();
        // Samples of one time say nothing of motion.
        if self.rows.len() < LEAST_SAMPLES || spread <= 0.0 {
            return false;
        }
        for (then, row) in &self.rows {
            let weight = (ago(then) - mean) / spread;
            let pairs = slopes.iter_mut().zip(row);
            pairs.for_each(|(slope, x)| *slope += weight * x);
        }
        true
    }

    /// What comes next does not go on from the rows so far.
    fn begin(&mut self) {
        self.spare.extend(self.rows.drain(..).map(|(_, row)| row));
    }
}
