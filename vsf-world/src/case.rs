//! Which cases there are, and draws of them.

use crate::effect::{EFFECTS, UNKNOWN_EFFECTS};
use crate::motion::Protocol;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

/// What is touched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A soft body of irregular nodes on springs, tied to their neighbors.
    Springs,
    /// Jointed stems and branches: rigid segments on torsional springs.
    Plant,
}

/// What kind of answer is right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Nothing is wrong.
    None,
    /// One effect of the catalogue.
    Single,
    /// Two effects of the catalogue, or more.
    Pair,
    /// An effect outside the catalogue.
    Unknown,
}

/// How strong an effect is: RMS of the torque change over RMS of the torques, on the test rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// 0.2 to 0.4.
    Clear,
    /// 0.1 to 0.2.
    Subtle,
}

impl Level {
    /// Smallest and largest share.
    pub fn band(self) -> (f64, f64) {
        match self {
            Self::Clear => (0.2, 0.4),
            Self::Subtle => (0.1, 0.2),
        }
    }
}

/// One case to make. The same spec always gives the same bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseSpec {
    /// What is touched.
    pub kind: Kind,
    /// What the arm does.
    pub protocol: Protocol,
    /// Names of the effects, of [`EFFECTS`] and [`UNKNOWN_EFFECTS`]; none for a case in which
    /// nothing is wrong.
    pub effects: Vec<String>,
    /// How strong each of them is.
    pub level: Level,
    /// Seed of all that is drawn: object, motion, parameters, noise.
    pub seed: u64,
}

impl CaseSpec {
    /// What kind of answer is right.
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

/// Draws `n` cases. In every 20: 4 without effect, 10 with one effect, 3 with two, 3 with one from
/// outside the catalogue. Single effects take turns, so that 54 cases hold each of the 27 once.
/// Independently of that, 3 in 10 are plants (where the effect can be shown by one), 1 in 4 is a
/// subtle one, and 1 in 8 a mere push.
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
