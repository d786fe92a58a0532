use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What a full queue does with one more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WhenFull {
    /// Drops its oldest and counts it: on a robot the newest sample says most.
    DropOldest,
    /// Waits until there is room, which holds the sender of a pipe back: for recordings.
    Wait,
}

/// A queue between two threads that holds no more than it was made for.
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
    /// A queue of at most `capacity` items, at least one.
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

    /// The queue, which waits in any case for so long from its first item on: what has piled up before anyone took items is not
    /// dropped.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Adds an item; false, and nothing added, once the queue is closed.
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

    /// The oldest item; waits for one. `None` once the queue is closed and empty.
    pub fn pop(&self) -> Option<T> {
        let mut state = self.lock();
        while state.items.is_empty() && !state.closed {
            state = self.wait(state);
        }
        let item = state.items.pop_front();
        self.changed.notify_all();
        item
    }

    /// No more items: those that are there can still be taken out.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Whether it is closed.
    pub fn is_closed(&self) -> bool {
        self.lock().closed
    }

    /// How many were dropped.
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
