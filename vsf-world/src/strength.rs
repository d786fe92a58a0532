//! Search for the strength at which an effect changes the torques by a given share.

use crate::WorldError;
use crate::effect::Effect;
use crate::generate::World;
use crate::label::{difference, rms_test};
use crate::motion::SEQUENCES;
use crate::sensor::Rows;
use rand_pcg::Pcg64Mcg;

/// A world with its torques without effects, for all samples and for some.
pub(crate) struct Trial<'a> {
    pub world: &'a mut World,
    pub fine: (&'a [Rows], usize),
    pub coarse: (&'a [Rows], usize),
}

impl Trial<'_> {
    /// Torque change of an effect, and its ratio to the torques on the test rows.
    fn change(&mut self, effect: &Effect, fine: bool) -> (Vec<Rows>, f64) {
        let (nominal, stride) = if fine { self.fine } else { self.coarse };
        let effects = std::slice::from_ref(effect);
        let (with, without) = self.world.with_and_without(effects, nominal, stride);
        let diff = difference(&with, &without);
        let ratio = rms_test(&diff) / rms_test(&without);
        (diff, ratio)
    }
}

/// An effect at the requested strength.
pub(crate) struct Found {
    pub effect: Effect,
    pub strength: f64,
    pub ratio: f64,
    /// Torque change of this effect alone.
    pub diff: Vec<Rows>,
}

/// Draws the effect `name` and scales it so that it changes the test torques by about `target` of their RMS, in any case
/// within `band`.
pub(crate) fn find_strength(
    trial: &mut Trial<'_>,
    name: &str,
    target: f64,
    band: (f64, f64),
    seed: u64,
    rng: &mut Pcg64Mcg,
) -> Result<Found, WorldError> {
    const DRAWS: usize = 8;
    let mut reached: f64 = 0.0;
    for _ in 0..DRAWS {
        let drawn = Effect::draw(name, rng, SEQUENCES)?;
        let most = drawn.strongest();
        let cheap = drawn.is_of_the_sensor();
        let s = search(1.0, most, target, 9, 0.03, |s| {
            trial.change(&drawn.scaled(s), cheap).1
        });
        // What was found at coarse steps is set right at fine ones.
        let s = if cheap {
            s
        } else {
            search(s, most, target, 4, 0.08, |s| {
                trial.change(&drawn.scaled(s), true).1
            })
        };
        let effect = drawn.scaled(s);
        let (diff, ratio) = trial.change(&effect, true);
        if (band.0..=band.1).contains(&ratio) {
            return Ok(Found {
                effect,
                strength: s,
                ratio,
                diff,
            });
        }
        reached = reached.max(ratio);
    }
    Err(WorldError::TooWeak {
        seed,
        effect: name.to_owned(),
        reached,
        wanted: target,
    })
}

/// Strength up to `most` at which `ratio` is `target`, by the secant method on logarithms from `start`. Returns the nearest
/// of `tries`, or the first within the tolerance.
fn search(
    start: f64,
    most: f64,
    target: f64,
    tries: usize,
    tolerance: f64,
    mut ratio: impl FnMut(f64) -> f64,
) -> f64 {
    let mut s = start;
    let mut best = (f64::INFINITY, start);
    let mut last: Option<(f64, f64)> = None;
    for _ in 0..tries {
        let miss = (ratio(s).max(1e-6) / target).ln();
        if miss.abs() < best.0 {
            best = (miss.abs(), s);
        }
        if miss.abs() < tolerance {
            break;
        }
        let power = match last {
            Some((s0, miss0)) if (s / s0).ln().abs() > 1e-9 => {
                ((miss - miss0) / (s / s0).ln()).clamp(0.4, 2.5)
            }
            _ => 1.0,
        };
        last = Some((s, miss));
        if s == most && miss < 0.0 {
            break;
        }
        s = (s * (-miss / power).exp().clamp(0.2, 5.0)).clamp(1e-3, most);
    }
    best.1
}
