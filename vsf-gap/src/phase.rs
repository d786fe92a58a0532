use crate::effect::Touch;
use crate::forward::velocity_columns;
use crate::{Campaign, ContactLog, GapError, Motion, centre};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

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

/// A robot slower than this share of its speed in motion (90th percentile) holds still.
const STILL: f64 = 0.08;

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
        let mut sorted = speed.clone();
        sorted.sort_by(f64::total_cmp);
        let usual = sorted.get(sorted.len() * 9 / 10).copied().unwrap_or(0.0);
        let still = |row: usize| speed[row] <= STILL * usual;
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
