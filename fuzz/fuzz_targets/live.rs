//! Any stream for the node of `vsf live`: lines that are none, and samples that are late, repeated, missing
//! or beyond any robot. What it publishes are numbers, its belief is one, and its counts add up.
#![no_main]

use libfuzzer_sys::arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use std::io::Cursor;
use vsf::core::{Belief, Noise};
use vsf::pipeline::FilterSpec;
use vsf::pipeline::live::{Lines, LiveSession, Node, Options, WhenFull, run};
use vsf::robots::JointTorques;
use vsf_fuzz::{JOINTS, WORLD, number, row};

fn node(of_cells: bool) -> Node {
    let (rest, contact) = (WORLD.rest.clone(), WORLD.contact(of_cells));
    let sensor = JointTorques::new(Noise::uniform(JOINTS, 0.1).expect("noise"));
    let prior = Belief::<f64>::uniform(rest.len(), 1.0, 10.0).expect("a prior");
    let filter = FilterSpec::replay().build(prior.into(), None);
    let filter = filter.expect("a filter");
    let chains = WORLD.robot.chains().clone();
    let session = LiveSession::new(chains, rest, contact, sensor, filter).expect("a session");
    // Samples that are dropped depend on the time that the estimation takes.
    let options = Options {
        when_full: WhenFull::Wait,
        ..Options::default()
    };
    Node::new(WORLD.robot.clone(), session, options).expect("a node")
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
        let touch = u.arbitrary::<u8>()? / 64;
        let (q, tau) = (row(u, JOINTS)?, row(u, JOINTS)?);
        let line =
            format!("{{\"t\": {t:?}, \"q\": {q:?}, \"tau\": {tau:?}, \"touch\": {touch}}}\n");
        text.extend(line.bytes());
    }
    Ok(text)
}

fuzz_target!(|data: &[u8]| {
    let mut u = Unstructured::new(data);
    let mut node = node(u.arbitrary().unwrap_or_default());
    let text = stream(&mut u).unwrap_or_default();
    let mut out = Vec::new();
    let (queue, source) = (node.queue(), Lines(Cursor::new(text)));
    let done = run(&mut node, &queue, source, &mut out, |_, _| ());
    done.expect("a source and a sink that work");
    // JSON has null for what is no number.
    let published = String::from_utf8(out).expect("text");
    let published = published.replace("\"nis_ratio\":null", "");
    assert!(!published.contains("null"), "{published}");
    assert!(node.summary().nis_ratio.is_none_or(f64::is_finite));
    let belief = node.session().belief();
    Belief::new(belief.mean().to_vec(), belief.variance().to_vec()).expect("a belief");
    let c = node.counts();
    let all = c.refused + c.dropped + c.repeated + c.late + c.used;
    assert_eq!(c.received, all);
});
