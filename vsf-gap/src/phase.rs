use crate::{Campaign, ContactLog, GapError, Motion, center};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use vsf_robots::jacobian;

/// What the robot does at a sample, determined from contacts and motion alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
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

/// A robot slower than the second share of its speed in motion (90th percentile) may hold still. It does up to a multiple
/// of the median of such speeds, which is 0 or noise where there are holds, and at least up to the first share.
const STILL: [f64; 2] = [0.02, 0.08];
const SPREAD: f64 = 4.0;

/// Whether a robot with these speeds holds still. Holds are runs of slow samples without their ends, at which it comes to
/// rest and sets off again: there it is faster than a multiple of the median of the run. Such samples are few, but as deep
/// as the hold.
fn holds(speed: &[f64]) -> Vec<bool> {
    let [least, most] = STILL.map(|share| share * quantile(speed, 0.9));
    let slow: Vec<f64> = speed.iter().copied().filter(|s| *s <= most).collect();
    let stillness = (SPREAD * quantile(&slow, 0.5)).clamp(least, most);
    let is_slow = |s: &f64| *s <= stillness;
    let mut holds = Vec::with_capacity(speed.len());
    for run in speed.chunk_by(|a, b| is_slow(a) == is_slow(b)) {
        let rest = (SPREAD * quantile(run, 0.5)).min(stillness);
        let at_rest = |s: &f64| *s <= rest;
        let first = run.iter().position(at_rest).unwrap_or(run.len());
        let end = run.iter().rposition(at_rest).map_or(0, |last| last + 1);
        holds.extend((0..run.len()).map(|k| (first..end).contains(&k)));
    }
    holds
}

/// The value below which this share of some numbers lies; 0 for none.
fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (sorted.len() as f64 * share) as usize;
    sorted.get(at).copied().unwrap_or(0.0)
}

impl Campaign {
    /// The phase of every sample of a sequence with contacts `log`.
    ///
    /// # Errors
    /// A motion with another number of joints or with parts of different length; contacts that do not belong to this
    /// sequence and site.
    pub fn phases(&self, motion: &Motion, log: &ContactLog) -> Result<Vec<Phase>, GapError> {
        motion.check(self.site.joints())?;
        log.check(&self.site, motion)?;
        let speed: Vec<f64> = motion
            .qd
            .iter()
            .map(|qd| qd.iter().map(|v| v * v).sum::<f64>().sqrt())
            .collect();
        let still = holds(&speed);
        let mut phases = vec![Phase::Free; motion.len()];
        let mut columns = vec![Vector3::zeros(); self.site.joints()];
        for (row, phase) in phases.iter_mut().enumerate() {
            let touch = log.touch(&self.site, row);
            let Some((link, p)) = center(&touch) else {
                continue;
            };
            jacobian(touch.posture, link, &p, &mut columns)?;
            let velocity: Vector3<f64> = columns
                .iter()
                .zip(&motion.qd[row])
                .map(|(c, v)| c * *v)
                .sum();
            let push: Vector3<f64> = touch.contacts.displacements().iter().sum();
            *phase = if still[row] {
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
                    while back > range.start && phases[back - 1] == Phase::Free && !still[back - 1]
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    /// Speeds of a push that starts and ends smoothly, of a hold, and of a retreat, with noise of each joint.
    fn speeds(joints: usize, noise: f64) -> Vec<f64> {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let of = |k: usize, rng: &mut Pcg64Mcg| {
            let x = (k % 400) as f64 / 200.0;
            let pace = 16.0 * (x * (1.0 - x)).powi(2);
            let moving = if k % 400 < 200 { pace } else { 0.0 };
            let mut of_joint = |along: f64| {
                let e: f64 = StandardNormal.sample(rng);
                (along + noise * e).powi(2)
            };
            let rest: f64 = (1..joints).map(|_| of_joint(0.0)).sum();
            (of_joint(moving) + rest).sqrt()
        };
        (0..1200).map(|k| of(k, &mut rng)).collect()
    }

    #[test]
    fn holds_are_told_from_the_ends_of_smooth_motions_as_well_as_noise_allows() {
        for (joints, noise, most_missed, most_taken) in [
            (7, 0.0, 0.0, 0.02),
            (1, 0.0, 0.0, 0.02),
            (7, 0.005, 0.01, 0.15),
            (1, 0.01, 0.01, 0.2),
            (1, 0.02, 0.01, 0.2),
        ] {
            let speed = speeds(joints, noise);
            let still = holds(&speed);
            let share = |hold: bool| {
                // A motion begins at rest.
                let own = (0..speed.len()).filter(|k| (k % 400 >= 200 || k % 400 == 0) == hold);
                own.clone().filter(|k| still[*k]).count() as f64 / own.count() as f64
            };
            let (missed, taken) = (1.0 - share(true), share(false));
            let what = format!("{joints} joints, noise {noise}: {missed} {taken}");
            assert!(missed <= most_missed && taken <= most_taken, "{what}");
        }
        assert!(holds(&[]).is_empty());
    }

    /// One in ten samples of a hold jumps to the next step of the encoder.
    #[test]
    fn steps_of_encoders_do_not_end_holds() {
        let mut speed = speeds(1, 0.0);
        for k in (210..1200).step_by(10).filter(|k| k % 400 > 200) {
            speed[k] = 0.01;
        }
        let still = holds(&speed);
        assert!((0..1200).filter(|k| k % 400 >= 200).all(|k| still[k]));
    }

    /// However still it stood before: what is no rest there is noise here.
    #[test]
    fn a_hold_is_told_from_its_own_noise() {
        let mut speed = vec![0.0; 160];
        speed.extend(speeds(1, 0.0).drain(..200));
        speed.extend(speeds(1, 0.005).drain(200..300));
        let still = holds(&speed);
        let missed = (360..460).filter(|k| !still[*k]).count();
        let taken = (161..360).filter(|k| still[*k]).count();
        assert!(missed <= 2 && taken <= 20, "{missed} {taken}");
    }
}
