use crate::{Acts, ContactLog, GapError, Model};
use nalgebra::Vector3;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use vsf_core::Posture;

/// Bytes for the contacts of models that change them, over all sequences. Searches return to the best of a few neighbors,
/// so one or two logs per sequence serve most repeated requests.
const BUDGET: usize = 128 << 20;

/// Bytes of a contact: point, link, displacement and normal.
const CONTACT: usize = 2 * size_of::<u32>() + 2 * size_of::<Vector3<f64>>();

/// Cached contacts of one sequence.
#[derive(Default)]
pub(crate) struct KnownContacts {
    /// Contacts of the nominal model, and of all others that leave contacts as they are.
    nominal: OnceLock<Arc<ContactLog>>,
    /// Contacts of the last models that change them, the latest at the end. Each is keyed by the effects of its model that
    /// act on contact.
    changed: Mutex<Vec<(Model, Arc<ContactLog>)>>,
    /// Most bytes for `changed`.
    budget: usize,
}

impl KnownContacts {
    /// Empty caches for so many sequences.
    pub(crate) fn of_none(sequences: usize) -> Arc<[Self]> {
        let none = |_| Self {
            budget: BUDGET / sequences,
            ..Self::default()
        };
        (0..sequences).map(none).collect()
    }

    /// The contacts of a model: cached, or computed by `run`.
    ///
    /// # Errors
    /// Those of `run`.
    pub(crate) fn of(
        &self,
        model: &Model,
        run: impl FnOnce() -> Result<ContactLog, GapError>,
    ) -> Result<Arc<ContactLog>, GapError> {
        let model = model.acting_on(Acts::Contact);
        if model.parts.is_empty() {
            return match self.nominal.get() {
                Some(log) => Ok(log.clone()),
                None => run().map(|log| self.nominal.get_or_init(|| Arc::new(log)).clone()),
            };
        }
        if let Some(log) = self.recall(&model) {
            return Ok(log);
        }
        // Not under the lock: another thread may need other contacts of the same sequence meanwhile.
        let log = Arc::new(run()?);
        if self.recall(&model).is_none() {
            self.keep(model, &log);
        }
        Ok(log)
    }

    fn recall(&self, model: &Model) -> Option<Arc<ContactLog>> {
        let mut changed = self.changed.lock().unwrap_or_else(PoisonError::into_inner);
        let at = changed.iter().position(|(known, _)| known.is(model))?;
        changed[at..].rotate_left(1);
        changed.last().map(|(_, log)| log.clone())
    }

    fn keep(&self, model: Model, log: &Arc<ContactLog>) {
        let mut changed = self.changed.lock().unwrap_or_else(PoisonError::into_inner);
        changed.push((model, log.clone()));
        let all: usize = changed.iter().map(|(_, log)| bytes(log)).sum();
        let mut over = all.saturating_sub(self.budget);
        while over > 0 {
            over = over.saturating_sub(bytes(&changed.remove(0).1));
        }
    }
}

/// Bytes of a log: its contacts and, in every row, where the links are. Where nothing is touched, the latter is all.
fn bytes(log: &ContactLog) -> usize {
    let contacts: usize = log.contacts.iter().map(|c| c.len()).sum();
    let posture = log.postures.first().map_or(0, |p| {
        size_of::<Posture>()
            + size_of_val(p.q())
            + size_of_val(p.link_poses())
            + size_of_val(p.screws())
    });
    CONTACT * contacts
        + posture * log.postures.len()
        + size_of_val(&log.contacts[..])
        + size_of_val(&log.forces[..])
        + size_of_val(&log.rigid[..])
        + size_of_val(&log.moved[..])
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use vsf_core::Contacts;

    /// A log of so many contacts.
    fn log(contacts: u32) -> ContactLog {
        let mut all = Contacts::new();
        for k in 0..contacts {
            all.push(k, 0, Vector3::z(), Vector3::z()).unwrap();
        }
        ContactLog {
            postures: Vec::new(),
            contacts: vec![all],
            forces: Vec::new(),
            rigid: Vec::new(),
            moved: Vec::new(),
        }
    }

    /// Of an arm in free air, too.
    #[test]
    fn rows_without_contacts_take_memory() {
        let robot = vsf_robots::kinova_gen3().unwrap();
        let rows = 10;
        let free = ContactLog {
            postures: vec![robot.posture(); rows],
            contacts: vec![Contacts::new(); rows],
            forces: vec![Vector3::zeros(); rows],
            rigid: vec![0.0; 7 * rows],
            moved: vec![0.0; 21 * rows],
        };
        let numbers = 7 * 8 + 7 * 6 * 8 + robot.link_count() * 7 * 8 + 3 * 8 + 28 * 8;
        assert!(bytes(&free) > rows * numbers);
    }

    #[test]
    fn beyond_the_budget_the_oldest_goes() {
        let known = KnownContacts {
            budget: 5 * CONTACT + 2 * size_of::<Contacts>(),
            ..KnownContacts::default()
        };
        let padding = crate::effects::named(&["geometry_padding"]).unwrap();
        let is_run = |by: f64, contacts: u32| {
            let mut runs = false;
            let run = || {
                runs = true;
                Ok(log(contacts))
            };
            known.of(&Model::of(&padding[0], &[by]), run).unwrap();
            runs
        };
        assert!(is_run(1.0, 2) && is_run(2.0, 2));
        // Asked for once more, the first is not the oldest.
        assert!(!is_run(1.0, 2) && is_run(3.0, 3));
        assert!(!is_run(1.0, 2) && !is_run(3.0, 3) && is_run(2.0, 2));
        // More than fits is not kept, nor is anything beside it.
        assert!(is_run(4.0, 8) && is_run(4.0, 8) && is_run(2.0, 2));
    }
}
