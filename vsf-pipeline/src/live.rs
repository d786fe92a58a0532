//! Estimates a field while samples arrive.
//!
//! A [`Node`] takes [`Sample`]s as they come: late, repeated or with gaps. It passes the useful ones to a
//! [`Learner`], which is a [`LiveSession`] or one with a corrected model (`LiveCorrector` of `vsf-gap`).
//!
//! [`run`] feeds a node from a [`Source`] of lines of JSON, `{"t": 12.345, "q": [..], "tau": [..]}`. One
//! thread reads and checks the lines, the other estimates. Between them lies a [`Queue`]. When the
//! estimation is too slow, it drops its oldest samples and counts them. Closing the queue ends the node, as
//! Ctrl-C does for `vsf live`. While `publish` blocks, samples wait.

mod learner;
mod motion;
mod node;
mod queue;
mod sample;
mod source;
mod tare;

pub(crate) use learner::deepest_start;
pub use learner::{Begins, Guard, Learner, LiveSession, check_free};
pub use motion::Motion;
pub use node::{Counts, Node, Options, Stiffness, Summary};
pub use queue::{Queue, WhenFull};
pub use sample::Sample;
pub use source::{Datagrams, Lines, MAX_LINE, Received, Source};
pub use tare::Tare;

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::spawn;

/// A sample with its line number, from 1.
pub type Numbered = (u64, Sample);

/// What the reading thread has seen.
#[derive(Default)]
struct Reading {
    received: AtomicU64,
    refused: AtomicU64,
    /// Why it ended, if the source failed.
    failed: Mutex<Option<io::Error>>,
    ended: AtomicBool,
}

/// Runs a node until its source ends or someone else closes `queue`, which must be a new one
/// ([`Node::new_queue`]).
///
/// `publish` is called with a summary [`Options::publish_hz`] times per second of the samples' time, and
/// once more at the end. While it runs, samples wait.
///
/// `refuse` is called for every line that is not a sample, and for samples that the learner refuses, with
/// the line number (from 1) and the reason. A refused line changes nothing else. Both threads call
/// `refuse`.
///
/// If the source has not ended, this function does not wait for the reading thread. That thread ends with
/// the next line, or for datagrams within a tenth of a second.
///
/// ```
/// use std::io::Cursor;
/// use std::sync::Arc;
/// use vsf_contact::{StickSlip, link_sdfs};
/// use vsf_core::{Belief, Noise, RestPoints, Session};
/// use vsf_pipeline::live::{Learner, Lines, LiveSession, Node, Summary, run};
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
/// let filter = FilterSpec::replay().build::<f32>(prior.into(), None)?;
/// let session = Session::new(robot.chains().clone(), rest, contact, sensor, filter)?;
/// let session = LiveSession::new(robot, session, None)?;
/// let mut node = Node::new(session, Vec::new(), Default::default())?;
///
/// let lines = r#"{"t": 0.000, "q": [0, 0, 0.02], "tau": [0, 0, 0]}
/// {"t": 0.001, "q": [0, 0, -0.001], "tau": [0, 0, NaN]}
/// {"t": 0.002, "q": [0, 0, -0.001], "tau": [0, 0, 0.3]}"#;
/// let queue = node.new_queue();
/// let publish = |_: &Node<_>, summary: &Summary| Ok(println!("{} points touched", summary.touched));
/// run(&mut node, &queue, Lines(Cursor::new(lines)), publish, |line, why| {
///     println!("line {line}: {why}");
/// })?;
/// assert_eq!((node.counts().used, node.counts().refused), (2, 1));
/// assert!(node.learner().stiffness(0)[0] > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// An error or panic of `source`, or the first error of `publish`. The node keeps what came before.
pub fn run<L: Learner>(
    node: &mut Node<L>,
    queue: &Arc<Queue<Numbered>>,
    source: impl Source + Send + 'static,
    mut publish: impl FnMut(&Node<L>, &Summary) -> io::Result<()>,
    refuse: impl Fn(u64, &str) + Send + Sync + 'static,
) -> io::Result<()> {
    let joints = node.learner().joints();
    let reading = Arc::new(Reading::default());
    let refuse = {
        let reading = Arc::clone(&reading);
        Arc::new(move |number: u64, why: &str| {
            reading.refused.fetch_add(1, Ordering::Relaxed);
            refuse(number, why);
        })
    };
    let reader = spawn({
        let (queue, reading, refuse) = (Arc::clone(queue), Arc::clone(&reading), refuse.clone());
        move || {
            let done = catch_unwind(AssertUnwindSafe(|| {
                read(source, joints, &queue, &reading.received, &*refuse)
            }));
            let failed = match done {
                Ok(done) => done.err(),
                Err(_) => Some(io::Error::other("the reading thread panicked")),
            };
            *(reading.failed.lock()).unwrap_or_else(PoisonError::into_inner) = failed;
            reading.ended.store(true, Ordering::Release);
            queue.close();
        }
    });
    let before = node.counts;
    let mut tell = |node: &mut Node<L>| {
        node.counts.received = before.received + reading.received.load(Ordering::Relaxed);
        node.counts.refused = before.refused + reading.refused.load(Ordering::Relaxed);
        node.counts.dropped = before.dropped + queue.dropped();
        let summary = node.summary();
        publish(node, &summary)
    };
    let _close = Close(queue);
    let estimated = estimate(node, queue, &*refuse, &mut tell);
    queue.close();
    if reading.ended.load(Ordering::Acquire) {
        // It is about to.
        let _ = reader.join();
    }
    let published = estimated.and_then(|()| tell(node));
    let failed = (reading.failed.lock())
        .unwrap_or_else(PoisonError::into_inner)
        .take();
    failed.map_or(published, Err)
}

/// Closes a queue once it is dropped, as where a caller's code panics: the reading thread would wait for ever.
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
    let (mut line, mut number) = (Vec::new(), 0);
    while !queue.is_closed() {
        let sample = match source.receive(&mut line)? {
            Received::Nothing => continue,
            Received::End => break,
            Received::Line => Sample::parse(&line, joints),
            Received::TooLong => Err(format!("longer than {MAX_LINE} bytes")),
        };
        number += 1;
        match sample {
            Err(why) => {
                received.store(number, Ordering::Relaxed);
                refuse(number, &why);
            }
            // Counted before anyone can take it.
            Ok(sample) => {
                let count = || received.store(number, Ordering::Relaxed);
                queue.push_with((number, sample), count);
            }
        }
    }
    Ok(())
}

/// Takes samples out of the queue until it is closed and empty.
fn estimate<L: Learner>(
    node: &mut Node<L>,
    queue: &Queue<Numbered>,
    refuse: &impl Fn(u64, &str),
    tell: &mut impl FnMut(&mut Node<L>) -> io::Result<()>,
) -> io::Result<()> {
    while let Some((number, sample)) = queue.pop() {
        if let Err(why) = node.take(&sample) {
            refuse(number, &why.to_string());
        }
        if node.is_due() {
            tell(node)?;
        }
    }
    Ok(())
}
