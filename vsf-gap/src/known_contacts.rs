use crate::{Acts, ContactLog, GapError, Model};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Logs of models that change contact that are kept: searches return to the best of few neighbours, and logs are large.
const KEPT: usize = 2;

/// Contacts of one sequence that were run already.
#[derive(Default)]
pub(crate) struct KnownContacts {
    /// Of the nominal model, and of all others that leave contacts as they are.
    nominal: OnceLock<Arc<ContactLog>>,
    /// Of the last models that change them, the latest at the end. Of a model, the effects that act on contact.
    changed: Mutex<Vec<(Model, Arc<ContactLog>)>>,
}

impl KnownContacts {
    /// Of sequences whose contacts nobody asked for.
    pub(crate) fn of_none(sequences: usize) -> Arc<[Self]> {
        (0..sequences).map(|_| Self::default()).collect()
    }

    /// The contacts of a model: known, or as `run` finds them.
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
        if let Some(log) = self.recall(&model) {
            return Ok(log);
        }
        let mut changed = self.changed.lock().unwrap_or_else(PoisonError::into_inner);
        if changed.len() == KEPT {
            changed.remove(0);
        }
        changed.push((model, log.clone()));
        Ok(log)
    }

    fn recall(&self, model: &Model) -> Option<Arc<ContactLog>> {
        let mut changed = self.changed.lock().unwrap_or_else(PoisonError::into_inner);
        let at = changed.iter().position(|(known, _)| known.is(model))?;
        changed[at..].rotate_left(1);
        changed.last().map(|(_, log)| log.clone())
    }
}
