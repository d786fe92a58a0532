//! Lines on standard output that nobody waits for: a reader that stands still is no reason to learn nothing.

use crate::console::complain;
use std::io::{Write, stdout};
use std::sync::mpsc::{
    Receiver, RecvTimeoutError, SyncSender, TrySendError, channel, sync_channel,
};
use std::thread::{sleep, spawn};
use std::time::Duration;

/// So many lines wait for their reader.
const LINES: usize = 64;
const A_MOMENT: Duration = Duration::from_millis(5);
/// So long the last lines have in the end, unless they are waited for.
const PATIENCE: Duration = Duration::from_secs(5);

pub struct Printer {
    thread: Option<Thread>,
    waits: bool,
}

struct Thread {
    lines: SyncSender<String>,
    ended: Receiver<()>,
}

impl Printer {
    /// Prints nothing unless it is `shown`; `waits` for a slow reader in place of leaving lines out.
    pub fn new(shown: bool, waits: bool) -> Self {
        Self {
            thread: shown.then(Thread::new),
            waits,
        }
    }

    /// Prints a line. Where there is no room for it, it is left out, or waits until there is or this is `interrupted`.
    pub fn print(&mut self, line: String, interrupted: impl Fn() -> bool) {
        let mut line = line + "\n";
        while let Some(thread) = &self.thread {
            line = match thread.lines.try_send(line) {
                Err(TrySendError::Full(line)) if self.waits && !interrupted() => line,
                Ok(()) | Err(TrySendError::Full(_)) => return,
                Err(TrySendError::Disconnected(_)) => {
                    self.thread = None;
                    return;
                }
            };
            sleep(A_MOMENT);
        }
    }

    /// Waits for the last lines, but not for ever unless it `waits` for all.
    pub fn finish(self, interrupted: impl Fn() -> bool) {
        let Some(Thread { lines, ended }) = self.thread else {
            return;
        };
        drop(lines);
        while ended.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout)
            && self.waits
            && !interrupted()
        {}
    }
}

impl Thread {
    fn new() -> Self {
        let (lines, received) = sync_channel::<String>(LINES);
        let (end, ended) = channel();
        spawn(move || {
            let mut out = stdout();
            for line in received {
                if let Err(error) = out.write_all(line.as_bytes()).and_then(|()| out.flush()) {
                    complain(format_args!(
                        "warning: no further summaries: cannot write to standard output: {error}"
                    ));
                    break;
                }
            }
            let _ = end.send(());
        });
        Self { lines, ended }
    }
}
