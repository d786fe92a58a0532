use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What a full queue does with another item.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WhenFull {
    /// Drops its oldest item and counts it: on a robot the newest sample says most.
    DropOldest,
    /// Waits until there is room, which blocks the sender of a pipe: for recordings.
    Wait,
}

/// A bounded queue between two threads.
#[derive(Debug)]
pub struct Queue<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
    capacity: usize,
    when_full: WhenFull,
    patience: Duration,
}

#[derive(Debug)]
struct State<T> {
    items: VecDeque<T>,
    /// When the first item came.
    began: Option<Instant>,
    dropped: u64,
    closed: bool,
}

/// Items that memory is taken for at once; a longer queue takes it as it grows.
const RESERVED: usize = 1 << 16;

impl<T> Queue<T> {
    /// Creates a queue of at most `capacity` items (at least one).
    pub fn new(capacity: usize, when_full: WhenFull) -> Self {
        let capacity = capacity.max(1);
        let state = State {
            items: VecDeque::with_capacity(capacity.min(RESERVED)),
            began: None,
            dropped: 0,
            closed: false,
        };
        Self {
            state: Mutex::new(state),
            changed: Condvar::new(),
            capacity,
            when_full,
            patience: Duration::ZERO,
        }
    }

    /// Makes the queue wait instead of drop during the time `patience` from its first item on. Items that
    /// piled up before anyone took them are thus not dropped.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Adds an item. Returns false, and adds nothing, once the queue is closed.
    pub fn push(&self, item: T) -> bool {
        self.push_with(item, || ())
    }

    /// The same; `added` is called before anyone can take it.
    pub(super) fn push_with(&self, item: T, added: impl FnOnce()) -> bool {
        let mut state = self.lock();
        let began = *state.began.get_or_insert_with(Instant::now);
        while state.items.len() == self.capacity && !state.closed {
            let left = self.patience.saturating_sub(began.elapsed());
            state = match self.when_full {
                WhenFull::Wait => self.wait(state),
                WhenFull::DropOldest if left.is_zero() => break,
                WhenFull::DropOldest => {
                    let waited = self.changed.wait_timeout(state, left);
                    waited.unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
        if state.closed {
            return false;
        }
        if state.items.len() == self.capacity {
            state.items.pop_front();
            state.dropped += 1;
        }
        state.items.push_back(item);
        added();
        self.changed.notify_all();
        true
    }

    /// Takes the oldest item, waiting for one if necessary. `None` once the queue is closed and empty.
    pub fn pop(&self) -> Option<T> {
        let mut state = self.lock();
        while state.items.is_empty() && !state.closed {
            state = self.wait(state);
        }
        let item = state.items.pop_front();
        self.changed.notify_all();
        item
    }

    /// Closes the queue: no items can be added, but those present can still be taken.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Whether the queue is closed.
    pub fn is_closed(&self) -> bool {
        self.lock().closed
    }

    /// Number of items dropped.
    pub fn dropped(&self) -> u64 {
        self.lock().dropped
    }

    // Items are whole whatever a thread that held the lock did afterward.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State<T>>) -> MutexGuard<'a, State<T>> {
        (self.changed.wait(state)).unwrap_or_else(PoisonError::into_inner)
    }
}
