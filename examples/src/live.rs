//! A node: joint angles and torques come in as lines of JSON, what is known of the field goes out.
//!
//! Each line is one [`Sample`], `{"t": 12.345, "q": [..], "tau": [..]}`. One thread reads and checks
//! lines, the other estimates; between them lies a [`Queue`] that drops its oldest samples when the
//! estimation is too slow, and counts them.

mod node;
mod queue;
mod sample;
mod source;

pub use node::{Counts, LiveSession, Node, Options, Stiffness, Summary};
pub use queue::{Queue, WhenFull};
pub use sample::Sample;
pub use source::{Datagrams, Lines, MAX_LINE, Received, Source};

use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicU64, Ordering};

/// A sample and the number of its line.
type Numbered = (u64, Sample);

/// Runs a node until the source ends or nobody reads `out` any more, and gives it back.
///
/// [`Summary`]s go to `out`, one JSON object a line, [`Options::publish_hz`] times a second of the
/// samples' time, and once more in the end. A line that is no sample is passed to `refuse` with its
/// number, counted from 1, and why; it changes nothing else.
///
/// # Errors
/// What `source` cannot read or `out` cannot write.
pub fn run(
    mut node: Node,
    source: &mut (impl Source + Send),
    out: &mut impl Write,
    refuse: &(impl Fn(u64, &str) + Sync),
) -> io::Result<Node> {
    let joints = node.joints();
    let queue = Queue::new(node.options().queue, node.options().when_full);
    let (received, refused) = (AtomicU64::new(0), AtomicU64::new(0));
    let refuse = |number: u64, why: &str| {
        refused.fetch_add(1, Ordering::Relaxed);
        refuse(number, why);
    };
    let publish = |node: &mut Node, out: &mut dyn Write| {
        node.counts.received = received.load(Ordering::Relaxed);
        node.counts.refused = refused.load(Ordering::Relaxed);
        node.counts.dropped = queue.dropped();
        let line = serde_json::to_string(&node.summary())?;
        writeln!(out, "{line}")?;
        out.flush()
    };
    let done = std::thread::scope(|scope| {
        let reader = scope.spawn(|| {
            let done = read(source, joints, &queue, &received, &refuse);
            queue.close();
            done
        });
        let estimated = estimate(&mut node, &queue, out, &refuse, &publish);
        queue.close();
        let crashed = |_| io::Error::other("the reading thread crashed");
        reader.join().map_err(crashed).flatten()?;
        estimated?;
        publish(&mut node, out)
    });
    match done {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e),
        _ => Ok(node),
    }
}

/// Puts samples into the queue until the source ends or the queue is closed.
fn read(
    source: &mut impl Source,
    joints: usize,
    queue: &Queue<Numbered>,
    received: &AtomicU64,
    refuse: &impl Fn(u64, &str),
) -> io::Result<()> {
    let mut line = Vec::new();
    for number in 1.. {
        let sample = match source.receive(&mut line)? {
            Received::End => break,
            Received::Line => Sample::parse(&line, joints),
            Received::TooLong => Err(format!("longer than {MAX_LINE} bytes")),
        };
        received.store(number, Ordering::Relaxed);
        match sample {
            Err(why) => refuse(number, &why),
            Ok(sample) => {
                if !queue.push((number, sample)) {
                    break;
                }
            }
        }
    }
    Ok(())
}

/// Takes samples out of the queue until it is closed and empty.
fn estimate<W: Write>(
    node: &mut Node,
    queue: &Queue<Numbered>,
    out: &mut W,
    refuse: &impl Fn(u64, &str),
    publish: &impl Fn(&mut Node, &mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    while let Some((number, sample)) = queue.pop() {
        if let Err(why) = node.take(&sample) {
            refuse(number, &why.to_string());
        }
        if node.is_due() {
            publish(node, out)?;
        }
    }
    Ok(())
}
