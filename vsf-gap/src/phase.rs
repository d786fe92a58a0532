use crate::effect::Touch;
use crate::forward::velocity_columns;
use crate::{Campaign, ContactLog, GapError, Motion, centre};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use vsf_data::Table;

/// What the robot does at a sample, found from contacts and motion alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Touches nothing.
    Free,
    /// Touches nothing yet, on its way to the next contact.
    Approach,
    /// In contact, pushing deeper.
    Load,
    /// In contact, still.
    Hold,
    /// In contact, retreating.
    Unload,
}

impl Phase {
    /// All phases, in the order of a touch.
    pub const ALL: [Self; 5] = [
        Self::Free,
        Self::Approach,
        Self::Load,
        Self::Hold,
        Self::Unload,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Approach => "approach",
            Self::Load => "load",
            Self::Hold => "hold",
            Self::Unload => "unload",
        }
    }
}

/// A robot slower than the first share of its speed in motion (90th percentile) holds still; where speeds are noisy,
/// one slower than so many times their noise, up to the second share.
const STILL: [f64; 2] = [0.02, 0.08];
const NOISE: f64 = 2.0;

/// The speed up to which a robot of these joint velocities holds still.
fn stillness(qd: &Table, speed: &[f64]) -> f64 {
    let usual = quantile(speed, 0.9);
    // Second differences of motion are small, those of white noise sqrt(6) times as large as the noise.
    let bends = (1..qd.rows().saturating_sub(1)).map(|k| {
        let (before, at, after) = (&qd[k - 1], &qd[k], &qd[k + 1]);
        let bend = |j: usize| before[j] - 2.0 * at[j] + after[j];
        (0..qd.cols()).map(|j| bend(j).powi(2)).sum::<f64>().sqrt()
    });
    let noise = quantile(&bends.collect::<Vec<_>>(), 0.5) / 6.0_f64.sqrt();
    (NOISE * noise).clamp(STILL[0] * usual, STILL[1] * usual)
}

/// The value that this share of some numbers lies below; 0 of none.
fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (sorted.len() as f64 * share) as usize;
    sorted.get(at).copied().unwrap_or(0.0)
}

impl Campaign {
    /// The phase of every sample of a sequence, `log` its contacts.
    ///
    /// # Errors
    /// A motion of other joints or whose parts differ in length, contacts that are not of this sequence and
    /// site.
    pub fn phases(&self, motion: &Motion, log: &ContactLog) -> Result<Vec<Phase>, GapError> {
        motion.check(self.site.joints())?;
        log.check(&self.site, motion)?;
        let speed: Vec<f64> = motion
            .qd
            .iter()
            .map(|qd| qd.iter().map(|v| v * v).sum::<f64>().sqrt())
            .collect();
        let stillness = stillness(&motion.qd, &speed);
        let still = |row: usize| speed[row] <= stillness;
        let mut phases = vec![Phase::Free; motion.len()];
        let mut columns = vec![Vector3::zeros(); self.site.joints()];
        for (row, phase) in phases.iter_mut().enumerate() {
            let touch = Touch {
                rest: &self.site.rest,
                posture: &log.postures[row],
                contacts: &log.contacts[row],
            };
            let Some((link, p)) = centre(&touch) else {
                continue;
            };
            velocity_columns(touch.posture, link, &p, &mut columns);
            let velocity: Vector3<f64> = columns
                .iter()
                .zip(&motion.qd[row])
                .map(|(c, v)| c * *v)
                .sum();
            let push: Vector3<f64> = touch.contacts.displacements().iter().sum();
            *phase = if still(row) {
                Phase::Hold
            } else if velocity.dot(&push) >= 0.0 {
                Phase::Load
            } else {
                Phase::Unload
            };
        }
        // The last stretch of motion before a contact is its approach.
        for range in &motion.touches {
            for row in range.clone().skip(1) {
                let begins = phases[row] != Phase::Free && phases[row - 1] == Phase::Free;
                if begins {
                    let mut back = row;
                    while back > range.start && phases[back - 1] == Phase::Free && !still(back - 1)
                    {
                        back -= 1;
                        phases[back] = Phase::Approach;
                    }
                }
            }
        }
        Ok(phases)
    }
}
