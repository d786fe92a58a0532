use super::drive::{Done, Drive, Others};
use vsf_gap::{Acts, Effect, Parameter, Role, Site};

/// Halvings of the interval in which a jump is searched.
const HALVINGS: usize = 12;
/// Largest share of a parameter's change that a jump may make up. Some jumps are normal: points come and go one by one.
const JUMP: f64 = 0.5;

/// An effect at a site.
pub(super) struct Suite<'a> {
    effect: &'a dyn Effect,
    site: &'a Site,
    parameters: Vec<Parameter>,
    starts: Vec<Vec<f64>>,
    drive: Drive<'a>,
    /// Output without an effect.
    nominal: Done,
}

/// Does nothing.
#[derive(Clone)]
struct Nothing;

impl vsf_gap::Compensator for Nothing {}

impl<'a> Suite<'a> {
    /// For an effect whose declaration has been checked.
    pub fn new(effect: &'a dyn Effect, site: &'a Site) -> Self {
        let drive = Drive::new(site);
        Self {
            effect,
            site,
            parameters: effect.parameters(site),
            starts: effect.starts(site),
            nominal: drive.run(&mut Nothing, Others::NONE),
            drive,
        }
    }

    fn run(&self, theta: &[f64], others: Others) -> Done {
        match self.effect.compensator(self.site, theta) {
            Ok(mut compensator) => self.drive.run(compensator.as_mut(), others),
            Err(error) => panic!("{theta:?} is within the bounds, but refused: {error}"),
        }
    }

    /// A start with all amplitudes at `share` of their scales, within the bounds.
    fn at(&self, start: &[f64], share: f64) -> Vec<f64> {
        let value = |(p, shape): (&Parameter, &f64)| match p.role {
            Role::Amplitude => (share * p.scale).min(p.bounds[1]),
            Role::Shape => *shape,
        };
        self.parameters.iter().zip(start).map(value).collect()
    }

    /// Whether it changes what it says it acts on, with all amplitudes at their scales.
    pub fn acts(&self) -> bool {
        let own: &[&str] = match self.effect.acts() {
            Acts::Torques => &["gains", "torques"],
            Acts::Springs => &["springs"],
            Acts::Contact => &["joints and motion", "object_shift", "contact"],
        };
        let changes = |start: &Vec<f64>| {
            let found = self.run(&self.at(start, 1.0), Others::NONE).parts();
            let mut pairs = found.iter().zip(self.nominal.parts());
            pairs.any(|((what, got), (_, nominal))| own.contains(what) && *got != nominal)
        };
        self.starts.iter().any(changes)
    }

    pub fn summary(&self) {
        let summary = self.effect.summary();
        for p in &self.parameters {
            let numbered = p.name.split('_').next().unwrap_or_default();
            let named = summary.contains(&format!("`{}`", p.name))
                || summary.contains(&format!("`{numbered}_"))
                || summary.contains(&format!("`{numbered}`"));
            assert!(named, "{:?} is not in {summary:?}", p.name);
        }
    }

    pub fn numbers(&self) {
        let good = self.at(&self.starts[0], 1.0);
        let longer = [&good[..], &[0.0]].concat();
        for theta in [&good[1..], &longer] {
            let made = self.effect.compensator(self.site, theta);
            let (got, expected) = (theta.len(), good.len());
            assert!(made.is_err(), "{got} parameters were taken for {expected}");
        }
    }

    pub fn neutral(&self) {
        for others in [Others::NONE, Others::SOME] {
            let nominal = self.drive.run(&mut Nothing, others);
            for start in &self.starts {
                let theta = self.at(start, 0.0);
                let found = self.run(&theta, others);
                for ((what, got), (_, expected)) in found.parts().iter().zip(nominal.parts()) {
                    // Taken apart and put together again, numbers are rounded.
                    let same = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-12 * (1.0 + b.abs());
                    assert!(
                        got.iter().zip(&expected).all(same),
                        "{theta:?} changes {what}"
                    );
                }
            }
        }
    }

    pub fn depth(&self) {
        let deeper: &[&str] = match self.effect.acts() {
            Acts::Torques => &["joints and motion", "object_shift", "contact", "springs"],
            Acts::Springs => &["joints and motion", "object_shift", "contact"],
            Acts::Contact => &[],
        };
        for start in &self.starts {
            let found = self.run(&self.at(start, 1.0), Others::NONE);
            for ((what, got), (_, expected)) in found.parts().iter().zip(self.nominal.parts()) {
                assert!(
                    !deeper.contains(what) || *got == expected,
                    "it acts on {:?} and changes {what}, which is not called",
                    self.effect.acts()
                );
            }
        }
    }

    pub fn composes(&self) {
        let close =
            |got: f64, expected: f64| (got - expected).abs() <= 1e-9 * (1.0 + expected.abs());
        for start in &self.starts {
            let theta = self.at(start, 1.0);
            let alone = self.run(&theta, Others::NONE);
            let after = |others| self.run(&theta, others);

            let before = Others::SOME.torques;
            let torques = after(Others {
                torques: before,
                ..Others::NONE
            });
            for (i, (got, own)) in torques.torques.iter().zip(&alone.torques).enumerate() {
                let j = i % self.site.joints();
                let expected = own + before * (j + 1) as f64;
                assert!(
                    close(*got, expected),
                    "torque {got} of joint {} where it adds {own} to {}: torques are added",
                    j + 1,
                    before * (j + 1) as f64
                );
            }
            let before = Others::SOME.gains;
            let gains = after(Others {
                gains: before,
                ..Others::NONE
            });
            for (got, own) in gains.gains.iter().zip(&alone.gains) {
                assert!(
                    close(*got, own * before),
                    "gain {got} where it makes {own} of 1 and {before} was there: gains are multiplied"
                );
            }
            let springs = after(Others {
                springs: Others::SOME.springs,
                ..Others::NONE
            });
            let lost = |(got, own): (&f64, &f64)| got == own;
            let all_lost = springs.springs.iter().zip(&alone.springs).all(lost);
            assert!(
                !all_lost || alone.springs.iter().all(|s| *s == 0.0),
                "springs are the same whatever other effects made of them"
            );
        }
    }

    pub fn determinism(&self) {
        assert!(
            self.effect.parameters(self.site) == self.parameters,
            "its parameters are others when asked again"
        );
        for start in &self.starts {
            let theta = self.at(start, 1.0);
            let [first, second] = [(); 2].map(|()| self.run(&theta, Others::NONE));
            assert!(first == second, "{theta:?}: a second compensator differs");
        }
    }

    pub fn finite(&self) {
        let bound = |of: [usize; 2]| -> Vec<f64> {
            let value = |p: &Parameter| p.bounds[of[usize::from(p.role == Role::Shape)]];
            self.parameters.iter().map(value).collect()
        };
        // Amplitudes at either end, shapes at either end.
        for theta in [[0, 0], [0, 1], [1, 0], [1, 1]].map(bound) {
            let found = self.run(&theta, Others::NONE);
            for (what, values) in found.parts() {
                if let Some(bad) = values.iter().find(|v| !v.is_finite()) {
                    panic!("{theta:?}: {what} is {bad}");
                }
            }
            if let Err(error) = found.contact.check() {
                panic!("{theta:?}: {error}");
            }
        }
    }

    pub fn continuous(&self) {
        for start in &self.starts {
            let base = self.at(start, 1.0);
            for (i, p) in self.parameters.iter().enumerate() {
                let [low, high] = p.bounds;
                let from = match p.role {
                    Role::Amplitude => 0.0,
                    Role::Shape => base[i].min(high - p.scale).max(low),
                };
                let to = (from + p.scale).min(high);
                if let Some((share, at)) = self.jump(&base, i, [from, to]) {
                    assert!(
                        share <= JUMP,
                        "{share:.2} of what {:?} changes between {from} and {to} comes at {at}",
                        p.name
                    );
                }
            }
        }
    }

    /// Largest jump between two values of parameter `i`: the share of the change that is left after halving the interval
    /// repeatedly toward the larger change, and where. `None` if nothing changes.
    fn jump(&self, base: &[f64], i: usize, between: [f64; 2]) -> Option<(f64, f64)> {
        let at = |value: f64| {
            let mut theta = base.to_vec();
            theta[i] = value;
            self.run(&theta, Others::NONE).parts()
        };
        let size = |a: &[f64], b: &[f64]| -> f64 {
            let pairs = a.iter().zip(b);
            pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let [mut low, mut high] = between.map(|value| (value, at(value)));
        // Each part by its own change, since they have different units.
        let whole: Vec<f64> = (low.1.iter().zip(&high.1))
            .map(|(a, b)| size(&a.1, &b.1))
            .collect();
        let share = |a: &[(&str, Vec<f64>)], b: &[(&str, Vec<f64>)]| -> f64 {
            let changes = a.iter().zip(b).map(|(a, b)| size(&a.1, &b.1));
            let acting = changes.zip(&whole).filter(|(_, whole)| **whole > 1e-12);
            acting.map(|(size, whole)| size / whole).fold(0.0, f64::max)
        };
        if share(&low.1, &high.1) == 0.0 {
            return None;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low.0 + high.0);
            let there = (middle, at(middle));
            if share(&low.1, &there.1) > share(&there.1, &high.1) {
                high = there
            } else {
                low = there
            }
        }
        Some((share(&low.1, &high.1), low.0))
    }
}
