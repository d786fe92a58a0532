//! A node: joint angles and torques come in as lines of JSON, what is known of the field goes out.
//!
//! Each line is one [`Sample`], `{"t": 12.345, "q": [..], "tau": [..]}`. One thread reads and checks
//! lines, the other estimates; between them lies a [`Queue`] that drops its oldest samples when the
//! estimation is too slow, and counts them. Whoever closes it ends the node, as Ctrl-C does `vsf live`.

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
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::spawn;

/// A sample and the number of its line, from 1.
pub type Numbered = (u64, Sample);

/// What the reading thread has seen.
struct Reading {
    received: AtomicU64,
    refused: AtomicU64,
    /// Why it ended, if the source failed.
    failed: Mutex<Option<io::Error>>,
}

/// Runs a node until its source ends, `queue` ([`Node::queue`]) is closed or nobody reads `out` any more.
///
/// [`Summary`]s go to `out`, one JSON object a line, [`Options::publish_hz`] times a second of the
/// samples' time, and once more in the end. A line that is no sample is passed to `refuse` with its
/// number, counted from 1, and why; it changes nothing else. The thread that reads is left to itself where the source has not
/// ended: it ends with the next line, or with the process.
///
/// ```
/// use std::io::Cursor;
/// use std::sync::Arc;
/// use vsf_contact::{StickSlip, link_sdfs};
/// use vsf_core::{Belief, Noise, RestPoints};
/// use vsf_pipeline::live::{Lines, LiveSession, Node, run};
/// use vsf_pipeline::{FilterSpec, SceneContact};
/// # use nalgebra::Point3;
/// use vsf_robots::{JointTorques, cartesian_stage};
///
/// // A ball of 1 cm radius on three axes, above a single point.
/// let robot = cartesian_stage(0.01)?;
/// let rest = Arc::new(RestPoints::new(vec![Point3::origin()])?);
/// let links = link_sdfs(robot.colliders(), &Default::default())?.links;
/// let contact = SceneContact::Points(StickSlip::new(links, Default::default())?);
/// let sensor = JointTorques::new(Noise::uniform(3, 0.05)?);
/// let prior = Belief::<f64>::uniform(1, 0.0, 50.0)?;
/// let filter = FilterSpec::replay().build(prior.into(), None)?;
/// let session = LiveSession::new(robot.chains().clone(), rest, contact, sensor, filter)?;
/// let mut node = Node::new(robot, session, Default::default())?;
///
/// let lines = r#"{"t": 0.000, "q": [0, 0, 0.02], "tau": [0, 0, 0]}
/// {"t": 0.001, "q": [0, 0, -0.001], "tau": [0, 0, NaN]}
/// {"t": 0.002, "q": [0, 0, -0.001], "tau": [0, 0, 0.3]}"#;
/// let queue = node.queue();
/// let mut out = Vec::new();
/// run(&mut node, &queue, Lines(Cursor::new(lines)), &mut out, |line, why| {
///     println!("line {line}: {why}");
/// })?;
/// assert_eq!((node.counts().used, node.counts().refused), (2, 1));
/// assert!(node.session().belief().mean()[0] > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// What `source` cannot read or `out` cannot write; the node has what came before.
pub fn run(
    node: &mut Node,
    queue: &Arc<Queue<Numbered>>,
    source: impl Source + Send + 'static,
    out: &mut impl Write,
    refuse: impl Fn(u64, &str) + Send + Sync + 'static,
) -> io::Result<()> {
    let joints = node.joints();
    let reading = Arc::new(Reading {
        received: AtomicU64::new(0),
        refused: AtomicU64::new(0),
        failed: Mutex::new(None),
    });
    let refuse = {
        let reading = Arc::clone(&reading);
        Arc::new(move |number: u64, why: &str| {
            reading.refused.fetch_add(1, Ordering::Relaxed);
            refuse(number, why);
        })
    };
    spawn({
        let (queue, reading, refuse) = (Arc::clone(queue), Arc::clone(&reading), refuse.clone());
        move || {
            // Also where it panics, or the estimation would wait for ever.
            let _close = Close(&queue);
            if let Err(error) = read(source, joints, &queue, &reading.received, &*refuse) {
                *(reading.failed.lock()).unwrap_or_else(PoisonError::into_inner) = Some(error);
            }
        }
    });
    let publish = |node: &mut Node, out: &mut dyn Write| {
        node.counts.received = reading.received.load(Ordering::Relaxed);
        node.counts.refused = reading.refused.load(Ordering::Relaxed);
        node.counts.dropped = queue.dropped();
        let line = serde_json::to_string(&node.summary())?;
        writeln!(out, "{line}")?;
        out.flush()
    };
    let _close = Close(queue);
    let estimated = estimate(node, queue, out, &*refuse, &publish);
    let published = estimated.and_then(|()| publish(node, out));
    let mut failed = (reading.failed.lock()).unwrap_or_else(PoisonError::into_inner);
    match (failed.take(), published) {
        (Some(error), _) => Err(error),
        (None, Err(e)) if e.kind() != ErrorKind::BrokenPipe => Err(e),
        _ => Ok(()),
    }
}

/// Closes a queue once it is dropped.
struct Close<'a>(&'a Queue<Numbered>);

impl Drop for Close<'_> {
    fn drop(&mut self) {
        self.0.close();
    }
}

/// Puts samples into the queue until the source ends or the queue is closed.
fn read(
    mut source: impl Source,
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
                    received.store(number - 1, Ordering::Relaxed);
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
