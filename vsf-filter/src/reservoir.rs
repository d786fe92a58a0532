use crate::aging::Aging;
use crate::key_heap::KeyHeap;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use vsf_core::{Observation, Scalar};

#[cfg(feature = "serde")]
mod state;

/// An observation of a field that moves has faded when what the steps have added to the noise of a
/// channel exceeds this multiple of it.
const FADED: f64 = 3.0;

/// A uniform sample of a stream of observations within a bound on memory.
///
/// Every observation draws a random key; kept are those with the smallest keys, as many as fit.
/// For equal sizes, which ones these are does not depend on the order in which they came (a bottom-k sample, the law of
/// Vitter's algorithm R, doi 10.1145/3147.3165); memory that a larger one leaves is reused as it is, so that a few less
/// may fit. An observation is taken in or out in O(log n), apart from its copy.
#[derive(Debug, Clone)]
pub(crate) struct Reservoir<T: Scalar, X = ()> {
    /// The sample, followed by slots whose memory waits for reuse.
    slots: Vec<Slot<T, X>>,
    filled: usize,
    /// Keys of the sample.
    keys: KeyHeap,
    /// Memory of all slots.
    bytes: usize,
    /// Observations with this key or a larger one are left out.
    limit: u64,
}

#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct Slot<T: Scalar, X> {
    key: u64,
    /// Memory of the slot with the largest observation that was in it.
    held: usize,
    /// How far the field had moved (total variance of its random steps) when the noise of the
    /// observation was last right.
    diffused: f64,
    /// How far the field may move before the observation has faded; known once it has moved.
    fades_at: Option<f64>,
    obs: Observation<T>,
    extra: X,
}

/// What an estimator keeps beside a past observation; nothing, for some.
pub(crate) trait Extra: Clone {
    /// Memory outside the structure itself, for an observation of `channels` (bytes).
    fn heap_bytes(channels: usize) -> usize;
}

impl Extra for () {
    fn heap_bytes(_: usize) -> usize {
        0
    }
}

impl<T: Scalar, X: Extra> Slot<T, X> {
    /// Memory of a slot with this observation (bytes), without what the allocator adds.
    fn memory(obs: &Observation<T>) -> usize {
        size_of::<Self>() - size_of::<Observation<T>>()
            + obs.bytes()
            + X::heap_bytes(obs.dim())
            + KeyHeap::BYTES
    }
}

impl<T: Scalar, X: Extra> Reservoir<T, X> {
    pub(crate) fn new() -> Self {
        Self {
            slots: Vec::new(),
            filled: 0,
            keys: KeyHeap::default(),
            bytes: 0,
            limit: u64::MAX,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.filled
    }

    pub(crate) fn bytes(&self) -> usize {
        self.bytes
    }

    pub(crate) fn get(&self, index: usize) -> Option<&Observation<T>> {
        self.slots[..self.filled].get(index).map(|slot| &slot.obs)
    }

    /// An observation and what is kept beside it.
    pub(crate) fn get_mut(&mut self, index: usize) -> Option<(&Observation<T>, &mut X)> {
        let slot = self.slots[..self.filled].get_mut(index)?;
        Some((&slot.obs, &mut slot.extra))
    }

    /// All observations and what is kept beside them.
    #[cfg(feature = "serde")]
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&Observation<T>, &X)> {
        self.slots[..self.filled].iter().map(|s| (&s.obs, &s.extra))
    }

    /// Brings the noise of an observation up to date with a field that has moved by `diffused`;
    /// false when it has faded.
    pub(crate) fn age(&mut self, index: usize, diffused: f64, aging: &mut Aging<T>) -> bool {
        let Some(slot) = self.slots[..self.filled].get_mut(index) else {
            return true;
        };
        let moved = diffused - slot.diffused;
        if moved > 0.0 && slot.fades_at.is_none_or(|at| diffused <= at) {
            // Noise beyond all numbers has faded too.
            let Ok(ratio) = aging.age(&mut slot.obs, moved) else {
                slot.fades_at = Some(slot.diffused);
                return false;
            };
            let first = slot.diffused + moved * FADED / ratio;
            slot.fades_at.get_or_insert(first);
            slot.diffused = diffused;
        }
        slot.fades_at.is_none_or(|at| diffused <= at)
    }

    /// Takes an observation out. There is room for any other again.
    pub(crate) fn remove(&mut self, index: usize) {
        if index < self.filled {
            self.take_out(index);
            self.limit = u64::MAX;
        }
    }

    /// Empties the sample and keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.filled = 0;
        self.keys.clear();
        self.limit = u64::MAX;
    }

    /// Takes the observation that was put in last out again.
    pub(crate) fn pop(&mut self) {
        if self.filled > 0 {
            self.take_out(self.filled - 1);
        }
    }

    fn take_out(&mut self, index: usize) {
        self.filled -= 1;
        self.slots.swap(index, self.filled);
        self.keys.swap_remove(index);
    }

    /// Puts in an observation of a field that has moved by `diffused`, at the end, with what is kept
    /// beside it; false when it is left out. Memory stays within `budget`, but one observation is
    /// always kept.
    pub(crate) fn push(
        &mut self,
        obs: &Observation<T>,
        extra: &X,
        diffused: f64,
        budget: usize,
        rng: &mut Pcg64Mcg,
    ) -> bool {
        let key = rng.random::<u64>();
        if key >= self.limit {
            return false;
        }
        let size = Slot::<T, X>::memory(obs);
        while self.bytes + size.saturating_sub(self.spare()) > budget {
            if self.slots.len() > self.filled + 1 || (self.filled == 0 && !self.slots.is_empty()) {
                self.bytes -= self.slots.pop().map_or(0, |slot| slot.held);
            } else if self.filled == 0 {
                break;
            } else if !self.evict(key) {
                return false;
            }
        }
        self.bytes += size.saturating_sub(self.spare());
        match self.slots.get_mut(self.filled) {
            Some(slot) if size <= slot.held => {
                slot.key = key;
                (slot.diffused, slot.fades_at) = (diffused, None);
                slot.obs.clone_from(obs);
                slot.extra.clone_from(extra);
            }
            // A fresh copy holds no more memory than it needs, a grown one might.
            reused => {
                let fresh = Slot {
                    key,
                    held: size,
                    diffused,
                    fades_at: None,
                    obs: obs.clone(),
                    extra: extra.clone(),
                };
                match reused {
                    Some(slot) => *slot = fresh,
                    None => self.slots.push(fresh),
                }
            }
        }
        self.filled += 1;
        self.keys.push(key);
        true
    }

    /// Memory of the slot that the next observation goes to.
    fn spare(&self) -> usize {
        self.slots.get(self.filled).map_or(0, |slot| slot.held)
    }

    /// Lowers the limit to the largest key, whose observation leaves; false if that is `key`.
    fn evict(&mut self, key: u64) -> bool {
        match self.keys.largest() {
            Some((index, largest)) if largest > key => {
                self.limit = largest;
                self.take_out(index);
                true
            }
            _ => {
                self.limit = key;
                false
            }
        }
    }
}
