use super::{Extra, Reservoir, Slot};
use crate::key_heap::KeyHeap;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};
use vsf_core::{CoreError, Noise, Observation, Scalar};

/// No memory is larger; sums of sizes below it do not overflow.
const MOST_BYTES: usize = isize::MAX as usize;

/// What is saved of a [`Reservoir`]: its sample, and of the slots that wait for reuse only their
/// size, on which depends when observations have to leave.
#[derive(Serialize, Deserialize)]
#[serde(rename = "Reservoir")]
struct Parts<Slots> {
    kept: Slots,
    spare: Vec<usize>,
    limit: u64,
}

impl<T: Scalar + Serialize, X: Serialize> Serialize for Reservoir<T, X> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let (kept, spare) = self.slots.split_at(self.filled);
        let parts = Parts {
            kept,
            spare: spare.iter().map(|slot| slot.held).collect(),
            limit: self.limit,
        };
        parts.serialize(to)
    }
}

impl<'de, T, X> Deserialize<'de> for Reservoir<T, X>
where
    T: Scalar + Deserialize<'de>,
    X: Extra + Default + Deserialize<'de>,
{
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let parts = Parts::<Vec<Slot<T, X>>>::deserialize(from)?;
        Self::try_from(parts).map_err(Error::custom)
    }
}

impl<T: Scalar, X: Extra + Default> TryFrom<Parts<Vec<Slot<T, X>>>> for Reservoir<T, X> {
    type Error = CoreError;

    fn try_from(parts: Parts<Vec<Slot<T, X>>>) -> Result<Self, CoreError> {
        let mut slots = parts.kept;
        for slot in &slots {
            if slot.key > parts.limit || slot.held < Slot::<T, X>::memory(&slot.obs) {
                return Err(CoreError::other(
                    "a replay buffer holds an observation that it could not have kept",
                ));
            }
            if !(slot.diffused >= 0.0 && slot.diffused.is_finite()) {
                return Err(CoreError::Parameter {
                    name: "variance of the field's steps before an observation",
                    value: slot.diffused,
                    range: ">= 0 N²/m² and finite",
                });
            }
        }
        let filled = slots.len();
        let mut keys = KeyHeap::default();
        slots.iter().for_each(|slot| keys.push(slot.key));
        let nothing = Observation::new(Noise::uniform(0, 1.0)?);
        slots.extend(parts.spare.into_iter().map(|held| Slot {
            key: 0,
            held,
            diffused: 0.0,
            fades_at: None,
            obs: nothing.clone(),
            extra: X::default(),
        }));
        let held = slots.iter().map(|slot| slot.held);
        let bytes = held.fold(0, usize::saturating_add);
        if bytes > MOST_BYTES {
            return Err(CoreError::TooMany {
                what: "bytes of a replay buffer",
                got: bytes,
                max: MOST_BYTES,
            });
        }
        Ok(Self {
            slots,
            filled,
            keys,
            bytes,
            limit: parts.limit,
        })
    }
}

impl<T: Scalar, X: Extra> Reservoir<T, X> {
    /// Checks that all fits a field of `field_len` points that has moved by `diffused`, and `budget`.
    pub(crate) fn check(
        &self,
        field_len: usize,
        diffused: f64,
        budget: usize,
    ) -> Result<(), CoreError> {
        for slot in &self.slots[..self.filled] {
            slot.obs.check_fits(field_len)?;
            if slot.diffused > diffused {
                return Err(CoreError::Parameter {
                    name: "variance of the field's steps before an observation",
                    value: slot.diffused,
                    range: "at most that of all steps",
                });
            }
        }
        if self.bytes > budget && self.slots.len() > 1 {
            return Err(CoreError::Parameter {
                name: "replay byte budget",
                value: budget as f64,
                range: "at least what the buffer holds",
            });
        }
        Ok(())
    }
}
