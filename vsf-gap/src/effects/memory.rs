//! State of touched points that lasts from sample to sample.

use nalgebra::Vector3;
use vsf_core::Contacts;

/// A point's displacement (m) and the inner variable of its material at the last sample.
#[derive(Clone, Copy)]
struct State {
    u: Vector3<f64>,
    inner: Vector3<f64>,
}

const AT_REST: State = State {
    u: Vector3::new(0.0, 0.0, 0.0),
    inner: Vector3::new(0.0, 0.0, 0.0),
};

/// The states of all rest points; those that are not touched are at rest.
#[derive(Clone)]
pub(super) struct Memory {
    states: Vec<State>,
    /// Points touched at the last sample.
    before: Vec<u32>,
    /// States of the points touched now.
    now: Vec<(u32, State)>,
}

impl Memory {
    /// Of so many points, all at rest.
    pub(super) fn new(points: usize) -> Self {
        Self {
            states: vec![AT_REST; points],
            before: Vec::new(),
            now: Vec::new(),
        }
    }

    /// Puts all points to rest.
    pub(super) fn forget(&mut self) {
        for p in self.before.drain(..) {
            self.states[p as usize] = AT_REST;
        }
    }

    /// Advances by one sample. `next` computes the inner variable of a point from its last displacement, its last inner
    /// variable and its displacement. `gain` times the result is added to the spring. It never makes a spring
    /// pull: the point would leave the link.
    pub(super) fn advance(
        &mut self,
        contacts: &Contacts,
        springs: &mut [Vector3<f64>],
        gain: f64,
        next: impl Fn(&Vector3<f64>, &Vector3<f64>, &Vector3<f64>) -> Vector3<f64>,
    ) {
        let touched = contacts.points().iter().zip(contacts.displacements());
        self.now.clear();
        for (s, (&p, u)) in springs.iter_mut().zip(touched) {
            let last = self.states[p as usize];
            let inner = next(&last.u, &last.inner, u);
            // What effects before this one made of the spring stays.
            let pushes = s.dot(u) >= 0.0;
            *s += inner * gain;
            if pushes && s.dot(u) < 0.0 {
                *s = Vector3::zeros();
            }
            self.now.push((p, State { u: *u, inner }));
        }
        self.forget();
        for (p, state) in &self.now {
            self.states[*p as usize] = *state;
            self.before.push(*p);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Springs that other effects have turned round, as anisotropy may, are theirs.
    #[test]
    fn no_gain_changes_no_spring() {
        let mut contacts = Contacts::new();
        let u = Vector3::new(0.0, 0.0, -0.002);
        contacts.push(3, 0, u, Vector3::z()).unwrap();
        for spring in [u, -u, Vector3::new(0.001, 0.0, 0.0005)] {
            let mut memory = Memory::new(5);
            for gain in [0.0, -0.9] {
                let mut springs = [spring];
                memory.advance(&contacts, &mut springs, gain, |_, _, u| *u);
                let expected = spring + u * gain;
                // Only what pushed may no longer do so.
                let pulls = spring.dot(&u) >= 0.0 && expected.dot(&u) < 0.0;
                let none = Vector3::zeros();
                assert_eq!(springs[0], if pulls { none } else { expected });
            }
        }
        let mut springs = [0.5 * u];
        Memory::new(5).advance(&contacts, &mut springs, -0.9, |_, _, u| *u);
        assert_eq!(springs[0], Vector3::zeros());
    }
}
