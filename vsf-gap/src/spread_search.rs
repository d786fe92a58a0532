//! Fits the spread of the stiffness, and the roughness of contact and of joints, to readings.

use crate::GapError;
use crate::evidence::Spread;
use crate::fitted::Fitted;
use crate::screen::best_of;
use rayon::prelude::*;

/// Values tried for the roughness of contact and of joints.
pub(crate) const CONTACT: [f64; 3] = [0.03, 0.1, 0.3];
pub(crate) const JOINT: [f64; 3] = [0.0, 0.05, 0.2];
/// Values tried for the random walks of effects, in their own sizes.
const WALK: [f64; 3] = [0.0, 0.1, 0.3];
/// Values tried for the spread of single points and of the smooth part, in units of the uniform stiffness.
const POINT: [f64; 3] = [0.3, 1.0, 3.0];
const SMOOTH: [f64; 3] = [0.3, 1.0, 3.0];
const LEVEL: f64 = 3.0;
/// Factor by which both are raised further if the largest value suits best, as where a few layers are a hundred times as
/// stiff as the rest; and the number of times at most.
const RAISE: f64 = 3.0;
const MOST_RAISED: usize = 4;
/// Smallest gain (nats) for which a spread is raised once more.
const WORTH_RAISING: f64 = 1.0;
/// A uniform stiffness that differs by less than this factor needs no other spread.
const RESCALE: f64 = 1.4;

impl Fitted<'_> {
    /// The spread of the stiffness with the largest evidence, given the roughness of contact and of joints.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn best_stiffness(&self, contact: f64, joint: f64) -> Result<Spread, GapError> {
        let spread = |point: f64, smooth: f64| Spread {
            point: point * self.uniform,
            smooth: smooth * self.uniform,
            level: LEVEL * self.uniform,
            contact,
            joint,
            white: 0.0,
            walk: 0.0,
        };
        if !self.touches() {
            return Ok(spread(1.0, 1.0));
        }
        let tried: Vec<Spread> = (POINT.iter())
            .flat_map(|&p| SMOOTH.iter().map(move |&s| (p, s)))
            .map(|(p, s)| spread(p, s))
            .collect();
        let found: Result<Vec<f64>, GapError> =
            tried.par_iter().map(|s| self.log_evidence(s)).collect();
        let found = found?;
        let best = best_of(&found);
        let mut best = (tried[best], found[best]);
        // Steps of the lattice are wide: an effect that scales the field would profit from them.
        for factor in [1.7, 1.3] {
            let less = 1.0 / factor;
            let around = [
                (factor, 1.0),
                (less, 1.0),
                (1.0, factor),
                (1.0, less),
                (factor, factor),
                (less, less),
            ];
            best = self.better(best, &around)?;
        }
        Ok(best.0)
    }

    /// The best spread of the stiffness within the lattice, or a larger one if it lies at the upper edge of the lattice.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn raised(&self, spread: &Spread) -> Result<Spread, GapError> {
        let largest = [(spread.point, POINT[2]), (spread.smooth, SMOOTH[2])];
        let inside = |(own, most): &(f64, f64)| *own < most * self.uniform;
        if !self.touches() || largest.iter().all(inside) {
            return Ok(*spread);
        }
        let mut best = (*spread, self.log_evidence(spread)?);
        for _ in 0..MOST_RAISED {
            let value = best.1;
            best = self.better(best, &[(RAISE, 1.0), (1.0, RAISE), (RAISE, RAISE)])?;
            if best.1 < value + WORTH_RAISING {
                break;
            }
        }
        Ok(best.0)
    }

    /// The spread with the largest evidence, among a given one with known evidence and those whose parts for single points
    /// and the smooth field are multiplied by pairs of factors.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    fn better(
        &self,
        (spread, value): (Spread, f64),
        factors: &[(f64, f64)],
    ) -> Result<(Spread, f64), GapError> {
        let found: Vec<(Spread, f64)> = (factors.par_iter())
            .map(|(point, smooth)| {
                let spread = Spread {
                    point: point * spread.point,
                    smooth: smooth * spread.smooth,
                    ..spread
                };
                Ok((spread, self.log_evidence(&spread)?))
            })
            .collect::<Result<_, GapError>>()?;
        Ok((found.into_iter()).fold(
            (spread, value),
            |best, next| {
                if next.1 > best.1 { next } else { best }
            },
        ))
    }

    /// A spread of the stiffness chosen for another model, or the same in proportion to this model's own uniform stiffness,
    /// whichever has the larger evidence. Where contact changes much, so does the stiffness that explains the readings.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn adapted(&self, spread: &Spread) -> Result<Spread, GapError> {
        let ratio = LEVEL * self.uniform / spread.level;
        if !self.touches() || (1.0 / RESCALE..RESCALE).contains(&ratio) || !ratio.is_normal() {
            return Ok(*spread);
        }
        let own = spread.scaled(ratio);
        if self.log_evidence(&own)? > self.log_evidence(spread)? {
            Ok(own)
        } else {
            Ok(*spread)
        }
    }

    /// The spread with every combination of roughness that is tried.
    pub(crate) fn roughness(&self, stiffness: &Spread) -> Vec<Spread> {
        let contact: &[f64] = if self.touches() {
            &CONTACT
        } else {
            &CONTACT[..1]
        };
        let walk: &[f64] = if self.parts.walks() {
            &WALK
        } else {
            &WALK[..1]
        };
        let of = |&contact: &f64| {
            JOINT.iter().flat_map(move |&joint| {
                walk.iter().map(move |&walk| Spread {
                    contact,
                    joint,
                    walk,
                    ..*stiffness
                })
            })
        };
        contact.iter().flat_map(of).collect()
    }
}
