//! Specifications of cases, and random draws of them.

use crate::effect::{EFFECTS, UNKNOWN_EFFECTS};
use crate::motion::Protocol;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

/// Kind of object that is touched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A soft body: irregular nodes on springs, tied to their neighbors.
    Springs,
    /// A plant with jointed stems and branches: rigid segments on torsional springs.
    Plant,
}

/// Kind of answer that is right for a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Nothing is wrong.
    None,
    /// One effect of the catalogue.
    Single,
    /// Two or more effects of the catalogue.
    Pair,
    /// An effect outside the catalogue.
    Unknown,
}

/// Strength of an effect: the RMS of the torque change divided by the RMS of the torques, on the test rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// 0.2 to 0.4.
    Clear,
    /// 0.1 to 0.2.
    Subtle,
}

impl Level {
    /// Smallest and largest strength.
    pub fn band(self) -> (f64, f64) {
        match self {
            Self::Clear => (0.2, 0.4),
            Self::Subtle => (0.1, 0.2),
        }
    }
}

/// Specification of one case. The same specification always gives the same bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseSpec {
    /// Kind of object that is touched.
    pub kind: Kind,
    /// What the arm does.
    pub protocol: Protocol,
    /// Names of the effects, from [`EFFECTS`] and [`UNKNOWN_EFFECTS`]; empty for a case in which nothing is wrong.
    pub effects: Vec<String>,
    /// Strength of each effect.
    pub level: Level,
    /// Seed of all random draws: object, motion, parameters, noise.
    pub seed: u64,
}

impl CaseSpec {
    /// Kind of answer that is right.
    pub fn class(&self) -> Class {
        let known = |name: &String| EFFECTS.contains(&name.as_str());
        match self.effects.len() {
            0 => Class::None,
            _ if !self.effects.iter().all(known) => Class::Unknown,
            1 => Class::Single,
            _ => Class::Pair,
        }
    }
}

/// Draws `n` cases.
///
/// Every 20 cases contain 4 without effect, 10 with one effect, 3 with two, and 3 with one from outside the catalogue.
/// Single effects take turns, so 54 cases contain each of the 27 once. Independently of that, 3 in 10 cases are plants (if
/// a plant can show the effect), 1 in 4 cases is subtle, and 1 in 8 is a mere push.
///
/// ```
/// let cases = vsf_world::draw_cases(40, 7);
/// assert_eq!(cases.len(), 40);
/// assert_eq!(cases, vsf_world::draw_cases(40, 7));
/// ```
pub fn draw_cases(n: usize, seed: u64) -> Vec<CaseSpec> {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut singles = Deck::new(&EFFECTS);
    let mut unknowns = Deck::new(&UNKNOWN_EFFECTS);
    (0..n)
        .map(|i| {
            let effects = match i % 20 {
                0 | 5 | 10 | 15 => vec![],
                3 | 9 | 16 => {
                    let first = EFFECTS[rng.random_range(0..EFFECTS.len())];
                    let mut second = first;
                    while second == first {
                        second = EFFECTS[rng.random_range(0..EFFECTS.len())];
                    }
                    vec![first, second]
                }
                6 | 12 | 18 => vec![unknowns.next(&mut rng)],
                _ => vec![singles.next(&mut rng)],
            };
            let plant = rng.random::<f64>() < 0.3 && !effects.contains(&"spatial_coupling");
            CaseSpec {
                kind: if plant { Kind::Plant } else { Kind::Springs },
                protocol: match rng.random_range(0..8) {
                    0 => Protocol::PushOnly,
                    _ => Protocol::Rich,
                },
                effects: effects.into_iter().map(str::to_owned).collect(),
                level: match rng.random_range(0..4) {
                    0 => Level::Subtle,
                    _ => Level::Clear,
                },
                seed: rng.random(),
            }
        })
        .collect()
}

/// Names that take turns in a shuffled order.
struct Deck<'a> {
    names: &'a [&'static str],
    left: Vec<&'static str>,
}

impl<'a> Deck<'a> {
    fn new(names: &'a [&'static str]) -> Self {
        Self {
            names,
            left: Vec::new(),
        }
    }

    fn next(&mut self, rng: &mut Pcg64Mcg) -> &'static str {
        if self.left.is_empty() {
            self.left = self.names.to_vec();
        }
        let pick = rng.random_range(0..self.left.len());
        self.left.swap_remove(pick)
    }
}
