//! Ctrl-C and requests to terminate. Nothing is polled: work in memory may be dropped at any time, and writing is guarded. A
//! command that is ended by them says how.

use crate::console::complain;
use anyhow::Context;
use std::process::exit;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread::{sleep, spawn};
use std::time::Duration;

/// Held while files are written.
static WRITING: Mutex<()> = Mutex::new(());
/// What the first signal does in place of ending the process.
static FIRST: OnceLock<Box<dyn Fn() + Send + Sync>> = OnceLock::new();
const INTERRUPTED: i32 = 130;
/// So long an interruption waits for them: a pipe that nobody reads takes for ever.
const PATIENCE: Duration = Duration::from_secs(5);

/// The first signal (Ctrl-C, SIGTERM, SIGHUP) waits a few seconds for files that are being written and ends the process, the
/// second ends it at once (files are replaced by a rename, so that none is ever half).
pub fn install() -> anyhow::Result<()> {
    let again = AtomicBool::new(false);
    ctrlc::set_handler(move || {
        if again.swap(true, Ordering::SeqCst) {
            exit(INTERRUPTED);
        }
        if let Some(first) = FIRST.get() {
            return first();
        }
        spawn(|| {
            sleep(PATIENCE);
            complain("interrupted while writing");
            exit(INTERRUPTED);
        });
        spawn(|| {
            let _whole = WRITING.lock().unwrap_or_else(PoisonError::into_inner);
            complain("interrupted");
            exit(INTERRUPTED);
        });
    })
    .context("cannot handle Ctrl-C")
}

/// From now on the first signal calls `end` alone, which ends what the command does; it then goes on to its end. Once a process.
pub fn first(end: impl Fn() + Send + Sync + 'static) {
    let _ = FIRST.set(Box::new(end));
}

/// Runs something that writes files; an interruption waits for its end.
pub fn writing<T>(write: impl FnOnce() -> T) -> T {
    let _guard = WRITING.lock().unwrap_or_else(PoisonError::into_inner);
    write()
}
