//! Any stream for the node of `vsf live`: lines that are none, and samples that are late, repeated, missing
//! or beyond any robot. What it publishes are numbers, its belief is one, and its counts add up.
#![no_main]

use libfuzzer_sys::arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use std::io::Cursor;
use vsf::core::nalgebra::Vector3;
use vsf::core::{Belief, Estimator, Noise};
use vsf::pipeline::live::{Lines, LiveSession, Node, Options, Summary, WhenFull, run};
use vsf::pipeline::{FilterSpec, SceneContact};
use vsf::robots::JointTorques;
use vsf_fuzz::{JOINTS, WORLD, number, row};

type Session = vsf::core::Session<SceneContact, JointTorques, Box<dyn Estimator<Scalar = f32>>>;

fn node(
    of_cells: bool,
    gravity: Option<Vector3<f64>>,
    tare: u64,
) -> Node<LiveSession<Box<dyn Estimator<Scalar = f32>>>> {
    let (rest, contact) = (WORLD.rest.clone(), WORLD.contact(of_cells));
    let sensor = JointTorques::new(Noise::uniform(JOINTS, 0.1).expect("noise"));
    let prior = Belief::<f64>::uniform(rest.len(), 1.0, 10.0).expect("a prior");
    let filter = FilterSpec::replay().build(prior.into(), None);
    let filter = filter.expect("a filter");
    let chains = WORLD.robot.chains().clone();
    let session = Session::new(chains, rest, contact, sensor, filter).expect("a session");
    // Samples that are dropped depend on the time that the estimation takes.
    let options = Options {
        when_full: WhenFull::Wait,
        ..Options::default()
    };
    let robot = WORLD.robot.clone();
    let session = LiveSession::new(robot, session, gravity).expect("a robot of its own");
    Node::new(session, Vec::new(), Options { tare, ..options }).expect("a node")
}

/// Samples one after the other, and in the end the bytes that are left as they are.
fn stream(u: &mut Unstructured<'_>) -> Result<Vec<u8>> {
    let mut text = Vec::new();
    let mut clock = 0.0;
    while !u.is_empty() {
        let t = match u.arbitrary::<u8>()? {
            0 => {
                text.extend(u.bytes(u.len())?);
                break;
            }
            1..16 => number(u)?,
            step => {
                clock += 0.0005 * (f64::from(step) - 48.0);
                clock
            }
        };
        let (touch, sequence) = (u.arbitrary::<u8>()? / 64, u.arbitrary::<u8>()? / 64);
        let (q, tau) = (row(u, JOINTS)?, row(u, JOINTS)?);
        let line = format!(
            "{{\"t\": {t:?}, \"q\": {q:?}, \"tau\": {tau:?}, \"touch\": {touch}, \"sequence\": {sequence}}}\n"
        );
        text.extend(line.bytes());
    }
    Ok(text)
}

fuzz_target!(|data: &[u8]| {
    let mut u = Unstructured::new(data);
    let weighs: bool = u.arbitrary().unwrap_or_default();
    let gravity = weighs.then(|| Vector3::new(0.0, 0.0, -9.81));
    let tare = u.arbitrary::<u8>().unwrap_or_default() % 4;
    let mut node = node(u.arbitrary().unwrap_or_default(), gravity, tare.into());
    let text = stream(&mut u).unwrap_or_default();
    let mut all = Vec::new();
    let (queue, source) = (node.new_queue(), Lines(Cursor::new(text)));
    let publish = |_: &Node<_>, summary: &Summary| {
        all.push(*summary);
        Ok(())
    };
    let done = run(&mut node, &queue, source, publish, |_, _| ());
    done.expect("a source that works");
    for Summary {
        stiffness,
        residual,
        nis_ratio,
        slowest_ms,
        ..
    } in all
    {
        let numbers = [stiffness.mean, stiffness.sd, stiffness.max, slowest_ms];
        assert!(numbers.iter().all(|x| x.is_finite()), "{numbers:?}");
        assert!(residual.is_none_or(f64::is_finite) && nis_ratio.is_none_or(f64::is_finite));
    }
    let belief = node.learner().session().belief();
    Belief::new(belief.mean().to_vec(), belief.variance().to_vec()).expect("a belief");
    let c = node.counts();
    let all = c.refused + c.dropped + c.repeated + c.late + c.stray + c.tared + c.skipped + c.used;
    assert_eq!(c.received, all);
});
