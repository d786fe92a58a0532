//! Streams that are not perfect.

use nalgebra::{Point3, Vector3};
use serde_json::Value;
use std::io::{self, BufReader, Cursor, Write};
use std::net::UdpSocket;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use vsf_contact::{StickSlip, link_sdfs};
use vsf_core::{Belief, CoreError, Estimator, Noise, RestPoints, Session, UpdateReport};
use vsf_data::{Dataset, RobotRef, Sequence, Table, TorqueKind};
use vsf_pipeline::live::{
    Begins, Counts, Datagrams, Learner, Lines, LiveSession, MAX_LINE, Motion, Node, Options, Queue,
    Received, Sample, Source, Summary, WhenFull, run,
};
use vsf_pipeline::{FilterSpec, PipelineError, Scene, SceneContact, external_torques};
use vsf_robots::{JointTorques, RobotModel, cartesian_stage, planar_arm};

type JointSession = Session<SceneContact, JointTorques, Box<dyn Estimator<Scalar = f32>>>;
type JointNode = Node<LiveSession<Box<dyn Estimator<Scalar = f32>>>>;

fn session() -> (RobotModel, JointSession) {
    session_of(cartesian_stage(0.01).unwrap(), 0.0)
}

/// With a block of points whose upper layer is at this height (m).
fn session_of(robot: RobotModel, top: f64) -> (RobotModel, JointSession) {
    let points = (0..200).map(|i| {
        Point3::new(
            f64::from(i % 10),
            f64::from(i / 10 % 10),
            200.0 * top - f64::from(i / 100),
        ) * 0.005
    });
    let rest = Arc::new(RestPoints::new(points.collect()).unwrap());
    let links = link_sdfs(robot.colliders(), &Default::default())
        .unwrap()
        .links;
    let contact = SceneContact::Points(StickSlip::new(links, Default::default()).unwrap());
    let sensor = JointTorques::new(Noise::uniform(robot.joint_count(), 0.02).unwrap());
    let prior = Belief::<f64>::uniform(rest.len(), 0.0, 50.0).unwrap();
    let filter = FilterSpec::replay().build(prior.into(), None).unwrap();
    let chains = robot.chains().clone();
    let session = Session::new(chains, rest, contact, sensor, filter).unwrap();
    (robot, session)
}

fn node(options: Options) -> JointNode {
    let (robot, session) = session();
    let session = LiveSession::new(robot, session, None).unwrap();
    Node::new(session, Vec::new(), options).unwrap()
}

const PATIENT: Options = Options {
    rate_hz: Some(100.0),
    publish_hz: 10.0,
    max_gap: 0.1,
    restart: 1.0,
    queue: 4,
    when_full: WhenFull::Wait,
    patience: 0.0,
    tare: 0,
};

fn silent(_: &JointNode, _: &Summary) -> io::Result<()> {
    Ok(())
}

/// Sample `k` of a poke at 100 Hz, and its line.
fn sample(k: u32) -> (Sample, String) {
    let depth = 0.0001 * f64::from(k.min(80));
    let sample = Sample {
        t: 0.01 * f64::from(k),
        q: vec![0.02, 0.02, -depth],
        tau: vec![0.0, 0.0, 40.0 * depth],
        qd: None,
        touch: 1,
        sequence: 0,
    };
    let Sample {
        t, q, tau, touch, ..
    } = &sample;
    let line = format!("{{\"t\": {t}, \"q\": {q:?}, \"tau\": {tau:?}, \"touch\": {touch}}}\n");
    (sample, line)
}

/// Runs a text through a node: the node, its summaries, and the lines that it refused.
fn stream(text: &[u8], options: Options) -> (JointNode, Vec<Value>, Vec<(u64, String)>) {
    let refused = Arc::new(Mutex::new(Vec::new()));
    let note = {
        let refused = Arc::clone(&refused);
        move |k: u64, why: &str| refused.lock().unwrap().push((k, why.to_owned()))
    };
    let mut node = node(options);
    let (queue, source) = (node.new_queue(), Lines(Cursor::new(text.to_owned())));
    let mut summaries = Vec::new();
    let publish = |_: &JointNode, summary: &Summary| {
        summaries.push(serde_json::to_value(summary)?);
        Ok(())
    };
    run(&mut node, &queue, source, publish, note).unwrap();
    let mut refused = refused.lock().unwrap().clone();
    refused.sort();
    (node, summaries, refused)
}

#[test]
fn a_perfect_stream_is_a_session() {
    let text: String = (0..100).map(|k| sample(k).1).collect();
    let (node, summaries, refused) = stream(text.as_bytes(), PATIENT);
    let (robot, mut session) = session();
    let mut posture = robot.posture();
    session.begin_touch();
    for k in 0..100 {
        let sample = sample(k).0;
        robot.update_posture(&sample.q, &mut posture).unwrap();
        session.step(&posture, &sample.tau).unwrap();
    }
    assert!(node.learner().session().belief() == session.belief());
    assert!(refused.is_empty());
    let all = Counts {
        received: 100,
        used: 100,
        ..Counts::default()
    };
    assert_eq!(*node.counts(), all);

    // One summary every tenth of a second, and the last.
    assert_eq!(summaries.len(), 10);
    let times: Vec<f64> = summaries.iter().map(|s| s["t"].as_f64().unwrap()).collect();
    assert!(
        times
            .windows(2)
            .take(8)
            .all(|w| (w[1] - w[0] - 0.1).abs() < 1e-9),
        "{times:?}"
    );
    let last = &summaries[9];
    assert_eq!(
        (&last["t"], &last["used"]),
        (&Value::from(0.99), &Value::from(100))
    );
    let touched = last["touched"].as_u64().unwrap();
    let mean = session.belief().mean();
    let most = mean.iter().copied().fold(0.0, f32::max);
    assert!(touched > 10 && last["contacts"].as_u64().unwrap() <= touched);
    assert_eq!(last["stiffness"]["max"], f64::from(most));
    assert!(last["stiffness"]["mean"].as_f64().unwrap() > 0.0);
    assert!(last["residual"].as_f64().unwrap() < 0.1);
}

#[test]
fn late_repeated_and_missing_samples() {
    let order = [0, 1, 2, 2, 3, 5, 4, 6, 7, 30, 31];
    let mut text: String = order.iter().map(|&k| sample(k).1).collect();
    let at = |t: &str, k: u32| {
        let line = sample(k).1;
        let (_, rest) = line.split_once(", \"q\"").unwrap();
        format!("{{\"t\": {t}, \"q\"{rest}")
    };
    // A single stamp far ahead, then a clock that was set anew, ahead and back.
    text += &at("1e10", 31);
    text += &(at("0.32", 32) + &at("5", 32) + &at("5.01", 33));
    text += &(at("0.01", 1) + &at("0.02", 2) + &at("0.03", 3));
    let (node, summaries, refused) = stream(text.as_bytes(), PATIENT);
    assert!(refused.is_empty(), "{refused:?}");
    let counts = node.counts();
    assert_eq!((counts.received, counts.used), (18, 12));
    assert_eq!((counts.repeated, counts.late, counts.stray), (1, 1, 4));
    // Sample 4, 23 between 7 and 31, and those up to 5.01 s.
    assert_eq!(counts.missing, 1 + 23 + 468);
    // At 5 s the arm is where it was.
    assert_eq!((counts.gaps, counts.restarts), (1, 1));
    assert_eq!(summaries.last().unwrap()["t"], 0.03);
    let text: String = order.iter().map(|&k| sample(k).1).collect();
    let (node, ..) = stream(text.as_bytes(), PATIENT);
    let expected = Counts {
        received: 11,
        used: 8,
        repeated: 1,
        late: 1,
        stray: 1,
        missing: 24,
        gaps: 1,
        ..Counts::default()
    };
    assert_eq!(*node.counts(), expected);
}

/// The rate is that of the stamps, if nobody says another.
#[test]
fn a_slow_stream_is_one_touch() {
    for rate_hz in [None, Some(5.0)] {
        let mut node = node(Options { rate_hz, ..PATIENT });
        // 0.2 s apart; one sample is missing, then three.
        for k in (0..12).chain([13, 14, 18, 19]) {
            let k = f64::from(k);
            let sliding = Sample {
                t: 0.2 * k,
                q: vec![0.004 * k, 0.02, -0.001],
                ..sample(0).0
            };
            node.take(&sliding).unwrap();
        }
        let counts = node.counts();
        assert_eq!((counts.missing, counts.gaps), (5, 1), "{rate_hz:?}");
        assert_eq!((counts.used, counts.stray), (15, 1));
    }
}

/// How points got to where they are inside of the object is not known: nothing is learned until the arm has been in free air.
#[test]
fn a_touch_whose_beginning_is_missing_is_skipped() {
    let at = |k: u32, depth: f64| Sample {
        q: vec![0.02, 0.02, -depth],
        ..sample(k).0
    };
    let mut missed = node(PATIENT);
    for k in 0..10 {
        missed.take(&at(k, 0.008)).unwrap();
    }
    assert_eq!((missed.counts().used, missed.counts().skipped), (0, 10));
    missed.take(&at(10, -0.02)).unwrap();
    missed.take(&at(11, -0.001)).unwrap();
    missed.take(&at(12, 0.001)).unwrap();
    assert_eq!((missed.counts().used, missed.counts().skipped), (3, 10));

    // A gap within a touch; in free air it is none.
    let text: String = (0..100)
        .filter(|k| !(40..60).contains(k))
        .map(|k| sample(k).1)
        .collect();
    let (node, ..) = stream(text.as_bytes(), PATIENT);
    assert_eq!((node.counts().used, node.counts().skipped), (40, 39));
    let (before, ..) = stream(
        (0..40).map(|k| sample(k).1).collect::<String>().as_bytes(),
        PATIENT,
    );
    assert!(node.learner().session().belief() == before.learner().session().belief());
}

#[test]
fn bad_lines_are_refused_by_number_and_change_nothing() {
    let good = |k: u32| sample(k).1;
    let long = "1".repeat(3 * MAX_LINE) + "\n";
    let bad: [(&str, &str); 18] = [
        (
            "{\"t\": 0.1, \"q\": [0, 0, 0], \"tau\": [NaN, 0, 0]}\n",
            "expected value (column 36, after \"[0, 0, 0], \\\"tau\\\": [N\")",
        ),
        (
            "{\"t\": 0.1, \"q\": [0, 0, 0], \"tau\": [0, Infinity, 0]}\n",
            "expected value",
        ),
        (
            "{\"t\": 0.1, \"q\": [0, 0, 1e999], \"tau\": [0, 0, 0]}\n",
            "out of range",
        ),
        (
            "{\"t\": 0.1, \"q\": [0, 0, null], \"tau\": [0, 0, 0]}\n",
            "null",
        ),
        (
            "{\"t\": null, \"q\": [0, 0, 0], \"tau\": [0, 0, 0]}\n",
            "null",
        ),
        (
            "{\"t\": 0.1, \"q\": [0, 0], \"tau\": [0, 0, 0]}\n",
            "q has 2 numbers, the robot has 3",
        ),
        (
            "{\"t\": 0.1, \"q\": [0, 0, 0], \"tau\": [0, 0, 0, 0]}\n",
            "tau has 4 numbers",
        ),
        ("{\"t\": 0.1, \"q\": [0, 0, 0]}\n", "missing field `tau`"),
        (
            "{\"t\": 0.1, \"t\": 0.2, \"q\": [0, 0, 0], \"tau\": [0, 0, 0]}\n",
            "duplicate field `t`",
        ),
        (
            "{\"t\": 0.1, \"q\": [0, 0, 0], \"tau\": [0, 0, 0], \"touhc\": 1}\n",
            "unknown field `touhc`",
        ),
        ("{\"t\": 0.1, \"q\": [0, 0, 0], \"tau\": [0, 0,\n", "EOF"),
        ("\n", "not an object"),
        ("no json\n", "not an object"),
        ("[0.1, [0, 0, 0], [0, 0, 0], null, 1, 0]\n", "not an object"),
        (&long, "longer than 65536 bytes"),
        // Numbers beyond any robot.
        (
            "{\"t\": 0.1, \"q\": [0, 0, 0], \"tau\": [0, 0, 1e300]}\n",
            "tau[2] is 1e300, beyond 1e12",
        ),
        (
            "{\"t\": 0.1, \"q\": [0, 0, 1e308], \"tau\": [0, 0, 0]}\n",
            "q[2] is 1e308, beyond 1e6",
        ),
        (
            "{\"t\": 0.1, \"q\": [0, 0, 0], \"qd\": [0, 0], \"tau\": [0, 0, 0]}\n",
            "qd has 2 numbers",
        ),
    ];
    let mut text = good(0);
    for (line, _) in bad {
        text += line;
    }
    let mut text = text.into_bytes();
    text.extend(b"\xff\xfe not text\n");
    text.extend(good(1).bytes());
    // The last line has no end.
    text.extend(good(2).trim_end().bytes());
    let (node, _, refused) = stream(&text, PATIENT);
    let (clean, ..) = stream([good(0), good(1), good(2)].concat().as_bytes(), PATIENT);
    assert!(node.learner().session().belief() == clean.learner().session().belief());
    let counts = node.counts();
    assert_eq!((counts.received, counts.used), (22, 3));
    for ((number, why), (line, part)) in refused.iter().zip(bad) {
        assert!(
            why.contains(part),
            "line {number}: {part:?} is not in {why:?}: {line:.80}"
        );
    }
    let numbers: Vec<u64> = refused.iter().map(|r| r.0).collect();
    assert_eq!(numbers, (2..=20).collect::<Vec<_>>());
    assert_eq!(counts.refused, 19);
}

#[test]
fn a_full_queue_drops_its_oldest_or_waits() {
    let queue = Queue::new(4, WhenFull::DropOldest);
    assert!((0..10).all(|k| queue.push(k)));
    assert_eq!(queue.dropped(), 6);
    queue.close();
    assert!(!queue.push(10));
    let left: Vec<i32> = std::iter::from_fn(|| queue.pop()).collect();
    assert_eq!(left, [6, 7, 8, 9]);

    // In the beginning it waits in any case, but not for ever.
    let queue = Queue::new(2, WhenFull::DropOldest).with_patience(Duration::from_millis(20));
    assert!((0..5).all(|k| queue.push(k)));
    assert_eq!(queue.dropped(), 3);
    let queue = Queue::new(2, WhenFull::DropOldest).with_patience(Duration::from_secs(3600));
    std::thread::scope(|scope| {
        scope.spawn(|| assert!((0..1000).all(|k| queue.push(k))));
        assert!((0..1000).all(|k| queue.pop() == Some(k)));
    });

    let queue = Queue::new(2, WhenFull::Wait);
    let sum: u64 = std::thread::scope(|scope| {
        scope.spawn(|| {
            assert!((0..1000).all(|k| queue.push(k)));
            queue.close();
        });
        std::iter::from_fn(|| queue.pop()).sum()
    });
    assert_eq!((sum, queue.dropped()), (999 * 1000 / 2, 0));
}

/// Contact state is not shown, but the belief tells: a point that is dragged along is displaced further.
#[test]
fn a_new_touch_is_seen_though_its_first_samples_are_lost() {
    let across = |k: u32, touch: u64| {
        let x = 0.018 + 0.0005 * f64::from(k % 10);
        format!(
            "{{\"t\": {}, \"q\": [{x}, 0.02, -0.004], \"tau\": [0.01, 0, 0.2], \"touch\": {touch}}}\n",
            0.01 * f64::from(k)
        )
    };
    let belief = |second: u64, lost: bool| {
        let lines = (0..20)
            .filter(|k| !lost || *k != 10)
            .map(|k| across(k, if k < 10 { 1 } else { second }));
        let (node, ..) = stream(lines.collect::<String>().as_bytes(), PATIENT);
        node.learner().session().belief().clone()
    };
    assert!(belief(2, true) != belief(1, true));
    assert!(belief(2, false) != belief(1, false));
}

/// A source that says when it has nothing more.
struct Hasty(Lines<Cursor<String>>, Sender<()>);

impl Source for Hasty {
    fn receive(&mut self, line: &mut Vec<u8>) -> io::Result<Received> {
        let received = self.0.receive(line)?;
        if received == Received::End {
            self.1.send(()).unwrap();
        }
        Ok(received)
    }
}

#[test]
fn a_slow_node_keeps_the_newest() {
    let text: String = (0..100).map(|k| sample(k).1).collect();
    let (end, ended) = channel();
    let options = Options {
        publish_hz: 1e6,
        when_full: WhenFull::DropOldest,
        ..PATIENT
    };
    let source = Hasty(Lines(Cursor::new(text)), end);
    let mut node = node(options);
    let queue = node.new_queue();
    let (mut waits, mut last) = (true, 0.0);
    // The first summary is not taken before the source has ended.
    let publish = |_: &JointNode, summary: &Summary| {
        if std::mem::take(&mut waits) {
            ended.recv().unwrap();
        }
        last = summary.t;
        Ok(())
    };
    run(&mut node, &queue, source, publish, |_, _| ()).unwrap();
    let counts = node.counts();
    // Up to two before it stands still, and the last four in the end, which are deep in a touch.
    let taken = counts.used + counts.skipped + counts.stray;
    assert!(
        (4..=6).contains(&taken) && counts.skipped >= 3,
        "{counts:?}"
    );
    assert_eq!(counts.received, taken + counts.dropped);
    assert_eq!(last, 0.99);
}

#[test]
fn datagrams() {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = socket.local_addr().unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    for k in 0..50 {
        let line = sample(k).1;
        sender.send_to(line.as_bytes(), address).unwrap();
    }
    sender.send_to(b"", address).unwrap();
    let mut node = node(PATIENT);
    let queue = node.new_queue();
    let source = Datagrams::new(socket, None).unwrap();
    run(&mut node, &queue, source, silent, |_, _| ()).unwrap();
    assert_eq!((node.counts().used, node.counts().received), (50, 50));

    // Silence ends it too, if it is to.
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut line = Vec::new();
    let mut patient = Datagrams::new(socket.try_clone().unwrap(), None).unwrap();
    assert_eq!(patient.receive(&mut line).unwrap(), Received::Nothing);
    let mut idle = Datagrams::new(socket, Some(Duration::from_millis(10))).unwrap();
    assert_eq!(idle.receive(&mut line).unwrap(), Received::End);
}

/// The port is free again soon after the end, and nothing of the next stream is lost to the last one.
#[test]
fn a_closed_stream_lets_go_of_its_port() {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = socket.local_addr().unwrap();
    let mut node = node(PATIENT);
    let queue = node.new_queue();
    queue.close();
    let source = Datagrams::new(socket, None).unwrap();
    run(&mut node, &queue, source, silent, |_, _| ()).unwrap();
    let begin = std::time::Instant::now();
    while UdpSocket::bind(address).is_err() {
        assert!(begin.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn options_out_of_range() {
    for options in [
        Options {
            rate_hz: Some(0.0),
            ..PATIENT
        },
        Options {
            publish_hz: f64::NAN,
            ..PATIENT
        },
        Options {
            max_gap: -1.0,
            ..PATIENT
        },
        Options {
            restart: f64::NAN,
            ..PATIENT
        },
    ] {
        let (robot, session) = session();
        let session = LiveSession::new(robot, session, None).unwrap();
        assert!(
            Node::new(session, Vec::new(), options).is_err(),
            "{options:?}"
        );
    }
}

/// What it has learned is kept, though the source never ends.
#[test]
fn whoever_closes_the_queue_ends_the_stream() {
    let (reader, mut writer) = io::pipe().unwrap();
    let mut node = node(PATIENT);
    let queue = node.new_queue();
    let other = Arc::clone(&queue);
    let text: String = (0..50).map(|k| sample(k).1).collect();
    let (told, hears) = channel();
    let sender = std::thread::spawn(move || {
        writer.write_all(text.as_bytes()).unwrap();
        writer.write_all(b"no sample\n").unwrap();
        // All lines before this one are in the queue, or were taken out of it.
        hears.recv().unwrap();
        other.close();
        writer
    });
    let source = Lines(BufReader::new(reader));
    let refuse = move |_: u64, _: &str| told.send(()).unwrap();
    run(&mut node, &queue, source, silent, refuse).unwrap();
    let counts = node.counts();
    assert_eq!((counts.received, counts.used, counts.refused), (51, 50, 1));
    drop(sender.join().unwrap());
}

/// A source or a sink that fails is told, and what came before is there.
#[test]
fn a_source_or_a_sink_that_fails() {
    struct Failing(u32);
    impl Source for Failing {
        fn receive(&mut self, line: &mut Vec<u8>) -> io::Result<Received> {
            self.0 += 1;
            if self.0 > 30 {
                return Err(io::Error::other("unplugged"));
            }
            *line = sample(self.0).1.into_bytes();
            Ok(Received::Line)
        }
    }
    let mut failing = node(PATIENT);
    let queue = failing.new_queue();
    let error = run(&mut failing, &queue, Failing(0), silent, |_, _| ());
    assert_eq!(error.unwrap_err().to_string(), "unplugged");
    assert_eq!(failing.counts().used, 30);

    let mut full = node(PATIENT);
    let queue = full.new_queue();
    let publish = |_: &JointNode, _: &Summary| Err(io::ErrorKind::StorageFull.into());
    let error = run(&mut full, &queue, Failing(0), publish, |_, _| ()).unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    assert!(full.counts().used > 0);

    struct Panicking;
    impl Source for Panicking {
        fn receive(&mut self, _: &mut Vec<u8>) -> io::Result<Received> {
            panic!("of the source")
        }
    }
    let mut node = node(PATIENT);
    let queue = node.new_queue();
    let error = run(&mut node, &queue, Panicking, silent, |_, _| ()).unwrap_err();
    assert!(error.to_string().contains("panicked"), "{error}");
}

/// Counts of one stream after the other add up.
#[test]
fn a_node_takes_a_second_stream() {
    let mut node = node(PATIENT);
    for k in [0, 50] {
        let text: String = (k..k + 50).map(|k| sample(k).1).collect();
        let queue = node.new_queue();
        let source = Lines(Cursor::new(text + "no sample\n"));
        run(&mut node, &queue, source, silent, |_, _| ()).unwrap();
    }
    let counts = node.counts();
    assert_eq!(
        (counts.received, counts.used, counts.refused),
        (102, 100, 2)
    );
}

/// Where the arm rested, nothing was missed.
#[test]
fn a_pause_in_a_touch_is_no_gap() {
    let text: String = (0..200)
        .filter(|k| !(100..150).contains(k))
        .map(|k| sample(k).1)
        .collect();
    let (node, ..) = stream(text.as_bytes(), PATIENT);
    let counts = node.counts();
    assert_eq!((counts.gaps, counts.skipped, counts.stray), (0, 0, 1));
    assert_eq!((counts.used, counts.missing), (149, 51));
}

/// Readings of actuators come out as those of a recording do: of the environment, with its sign, each sequence tared anew.
#[test]
fn readings_of_actuators_are_those_of_a_recording() {
    const TARE: usize = 4;
    let (robot, session) = session_of(planar_arm(3, 0.3, 0.02).unwrap(), -5.0);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let mut workspace = robot.dynamics_workspace();
    let mut sequences = Vec::new();
    for (id, offset) in [("a", 0.2), ("b", -0.7)] {
        let (mut angles, mut torques) = (Vec::new(), Vec::new());
        for k in 0..20 {
            let q = [0.3 + 0.002 * f64::from(k), -0.2, 0.1];
            let held = robot.gravity_torques(&q, &gravity, &mut workspace).unwrap();
            // The environment presses the more the later.
            let felt = 0.1 * f64::from((k - 4).max(0));
            torques.extend(
                held.iter()
                    .zip([1.0, 2.0, -0.5])
                    .map(|(h, f)| h - f * felt + offset),
            );
            angles.extend(q);
        }
        let time = (0..20).map(|k| 0.1 * f64::from(k)).collect();
        let table = |data| Table::new(3, data).unwrap();
        sequences.push(Sequence::new(id, time, table(angles), table(torques)));
    }
    let dataset = Dataset {
        torque_kind: TorqueKind::Measured,
        tare_samples: TARE,
        ..Dataset::new(
            RobotRef::resolve("planar_arm", ".".as_ref()).unwrap(),
            sequences,
        )
    };
    let scene = Scene::in_air(&dataset, robot.clone()).unwrap();

    let session = LiveSession::new(robot, session, Some(gravity)).unwrap();
    let tare = TARE as u64;
    let options = Options {
        tare,
        rate_hz: Some(10.0),
        ..PATIENT
    };
    let mut node = Node::new(session, Vec::new(), options).unwrap();
    for (number, sequence) in (0..).zip(&dataset.sequences) {
        let expected = external_torques(&scene, sequence).unwrap();
        for (k, t) in sequence.time.iter().enumerate() {
            let sample = Sample {
                t: *t,
                q: sequence.angles[k].to_vec(),
                tau: sequence.torques[k].to_vec(),
                qd: None,
                touch: 0,
                sequence: number,
            };
            node.take(&sample).unwrap();
            if k >= TARE {
                let reading = node.learner().session().observation().reading();
                for (a, b) in reading.iter().zip(&expected[k]) {
                    assert!((f64::from(*a) - b).abs() < 1e-4, "{a} {b}");
                }
            }
        }
        assert!(expected[19][0] > 1.0 && expected[19][2] < -0.5);
    }
    assert_eq!((node.counts().tared, node.counts().used), (8, 32));
    assert_eq!(node.counts().gaps, 0);
}

/// Joints that swing, at 1 kHz: their velocities and accelerations are those of the swing, a little later, whether velocities are
/// given or not, and over a turn of a joint that has no end.
#[test]
fn how_joints_move() {
    let robot = Arc::new(planar_arm(3, 0.3, 0.02).unwrap());
    for given in [false, true] {
        let mut motion = Motion::new(Arc::clone(&robot));
        let swing = |t: f64, j: f64| (1.0 + j) * t;
        // Lags (s): half a window of positions, and one of velocities on top, where these are not given.
        let lags = if given {
            [0.0, 0.0125]
        } else {
            [0.0125, 0.025]
        };
        for k in 0..3000 {
            let t = 0.001 * f64::from(k);
            let of = |f: &dyn Fn(f64, f64) -> f64| {
                (0..3).map(|j| f(f64::from(j), t)).collect::<Vec<_>>()
            };
            let sample = Sample {
                t: 1.7e9 + t,
                q: of(&|j, t| swing(t, j).sin()),
                tau: vec![0.0; 3],
                qd: given.then(|| of(&|j, t| (1.0 + j) * swing(t, j).cos())),
                touch: 0,
                sequence: 0,
            };
            let begins = if k == 0 {
                Begins::Sequence
            } else {
                Begins::Nothing
            };
            motion.follow(&sample, begins).unwrap();
            if k < 60 {
                continue;
            }
            for (j, (qd, qdd)) in (0..3).zip(motion.qd().iter().zip(motion.qdd())) {
                let (j, pace) = (f64::from(j), 1.0 + f64::from(j));
                let right = [
                    pace * swing(t - lags[0], j).cos(),
                    -pace * pace * swing(t - lags[1], j).sin(),
                ];
                assert!((qd - right[0]).abs() < 0.01, "{k}: {qd} {}", right[0]);
                // Stamps since 1970 are rounded to 0.2 us.
                assert!((qdd - right[1]).abs() < 0.1, "{k}: {qdd} {}", right[1]);
            }
        }
    }
}

/// Memory is taken as samples wait, not for all that might.
#[test]
fn a_queue_without_end() {
    let queue = Queue::new(usize::MAX, WhenFull::Wait);
    assert!(queue.push(1));
    assert_eq!(queue.pop(), Some(1));
}

/// A clock that goes back is another one: nothing is known of how the arm moves until enough samples have come by it.
#[test]
fn a_clock_that_goes_back() {
    let mut motion = Motion::new(Arc::new(planar_arm(3, 0.3, 0.02).unwrap()));
    let mut follow = |t: f64, q: f64, begins| {
        let sample = Sample {
            t,
            q: vec![q; 3],
            tau: vec![0.0; 3],
            qd: None,
            touch: 0,
            sequence: 0,
        };
        motion.follow(&sample, begins).unwrap();
        motion.qd()[0]
    };
    for k in 0..100 {
        let t = 100.0 + 0.001 * f64::from(k);
        follow(t, 0.5 * (t - 100.0), Begins::Nothing);
    }
    for k in 0..100 {
        let begins = if k == 0 {
            Begins::Touch
        } else {
            Begins::Nothing
        };
        let t = 5.0 + 0.001 * f64::from(k);
        let qd = follow(t, 1.0 - 0.2 * (t - 5.0), begins);
        if k >= 50 {
            assert!((qd + 0.2).abs() < 1e-6, "{k}: {qd}");
        }
    }
}

/// Readings of an arm that swings freely are those of no touch, but for the lag of what is known of its motion.
#[test]
fn what_moves_the_arm_is_taken_off() {
    let (robot, session) = session_of(planar_arm(3, 0.3, 0.02).unwrap(), -5.0);
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let (joints, mut workspace) = (robot.clone(), robot.dynamics_workspace());
    let session = LiveSession::new(robot, session, Some(gravity)).unwrap();
    let options = Options {
        rate_hz: None,
        ..PATIENT
    };
    let mut node = Node::new(session, Vec::new(), options).unwrap();
    let (mut most, mut inertia) = (0.0_f64, 0.0_f64);
    for k in 0..2000 {
        let t = 0.001 * f64::from(k);
        let of = |f: fn(f64) -> f64, pace: f64| [0.5, -0.3, 0.2].map(|a| a * pace * f(4.0 * t));
        let (q, qd) = (of(f64::sin, 1.0), of(f64::cos, 4.0));
        let qdd = of(f64::sin, -16.0);
        let needed = joints
            .inverse_dynamics(&q, &qd, &qdd, &gravity, &mut workspace)
            .unwrap();
        let tau = needed.to_vec();
        let held = joints
            .gravity_torques(&q, &gravity, &mut workspace)
            .unwrap();
        let own = tau.iter().zip(held).map(|(n, h)| (n - h).abs());
        inertia = own.fold(inertia, f64::max);
        let sample = Sample {
            t,
            q: q.to_vec(),
            tau,
            qd: None,
            touch: 0,
            sequence: 0,
        };
        node.take(&sample).unwrap();
        if k > 100 {
            let reading = node.learner().session().observation().reading();
            most = reading
                .iter()
                .map(|r| f64::from(r.abs()))
                .fold(most, f64::max);
        }
    }
    assert_eq!((node.counts().gaps, node.counts().used), (0, 2000));
    // 4 rad/s times 25 ms.
    assert!(
        inertia > 1.0 && most < 0.12 * inertia,
        "{most} of {inertia}"
    );
}

/// A clock that is another one, or was set back, is told of as soon, and what moved meanwhile was not seen.
#[test]
fn clocks_that_begin_anew() {
    let mut node = node(Options { tare: 2, ..PATIENT });
    let (mut summaries, mut free) = (0, sample(0).0);
    free.q[2] = 0.02;
    for sequence in 0..2 {
        let begin = if sequence == 0 { 300.0 } else { 0.0 };
        for k in 0..50 {
            let t = begin + 0.01 * f64::from(k);
            node.take(&Sample {
                t,
                sequence,
                ..free.clone()
            })
            .unwrap();
            summaries += u32::from(node.is_due());
            if node.is_due() {
                node.summary();
            }
        }
    }
    assert_eq!((node.counts().tared, node.counts().used), (4, 96));
    assert!((8..=10).contains(&summaries), "{summaries}");
    // An old one is no new sequence.
    let old = Sample {
        t: 400.0,
        sequence: 0,
        ..free.clone()
    };
    node.take(&old).unwrap();
    assert_eq!((node.counts().late, node.counts().restarts), (1, 0));
    // Set back by half a second: deep in a touch when it has caught up.
    for k in 0..60 {
        let mut deep = sample(60).0;
        deep.t = 0.01 * f64::from(k);
        node.take(&Sample {
            sequence: 1,
            ..deep
        })
        .unwrap();
    }
    assert_eq!((node.counts().late, node.counts().gaps), (50, 1));
    assert_eq!(node.counts().skipped, 10);
}

/// A learner that is chosen at run time learns alike; one that names points that it has not got is refused.
#[test]
fn learners_of_ones_own() {
    let (robot, session) = session();
    let own = LiveSession::new(robot, session, None).unwrap();
    let own: Box<dyn Learner<Error = PipelineError>> = Box::new(own);
    let mut boxed = Node::new(own, Vec::new(), PATIENT).unwrap();
    let mut plain = node(PATIENT);
    for k in 0..60 {
        boxed.take(&sample(k).0).unwrap();
        plain.take(&sample(k).0).unwrap();
    }
    assert_eq!(boxed.touched(), plain.touched());
    assert_eq!(boxed.counts(), plain.counts());

    struct Liar;
    impl Learner for Liar {
        type Error = CoreError;
        fn joints(&self) -> usize {
            3
        }
        fn zero(&self) -> &[f64] {
            &[0.0; 3]
        }
        fn tare(&mut self, _: &Sample, _: Begins, _: bool) -> Result<(), CoreError> {
            Ok(())
        }
        fn learn(&mut self, _: &Sample, _: Begins) -> Result<Option<UpdateReport>, CoreError> {
            Ok(Some(UpdateReport::default()))
        }
        fn touching(&self) -> &[u32] {
            &[5]
        }
        fn stiffness(&self, _: usize) -> [f64; 2] {
            [0.0; 2]
        }
        fn field(&self) -> Result<Belief<f64>, CoreError> {
            Belief::uniform(2, 0.0, 1.0)
        }
        fn points(&self) -> usize {
            2
        }
    }
    let mut node = Node::new(Liar, Vec::new(), PATIENT).unwrap();
    let error = node.take(&sample(0).0).unwrap_err();
    assert!(matches!(
        error,
        CoreError::OutOfRange {
            index: 5,
            len: 2,
            ..
        }
    ));
}

/// What tares the sensors has to be free: readings of a touch are not zero.
#[test]
fn a_touch_tares_nothing() {
    let mut node = node(Options { tare: 2, ..PATIENT });
    let error = node.take(&sample(60).0).unwrap_err().to_string();
    assert!(error.contains("tares the sensors"), "{error}");
    let mut free = sample(61).0;
    free.q[2] = 0.02;
    for k in 0..3 {
        free.t += 0.01 * f64::from(k);
        node.take(&free).unwrap();
    }
    assert_eq!((node.counts().tared, node.counts().used), (2, 1));
}

/// Of two samples, one is lost: two more tare.
#[test]
fn a_sample_that_is_refused_begins_to_tare_anew() {
    let mut node = node(Options { tare: 2, ..PATIENT });
    let mut free = sample(0).0;
    free.q[2] = 0.02;
    for (k, tau) in [vec![9.0; 3], vec![1.0; 2], vec![2.0; 3], vec![4.0; 3]]
        .into_iter()
        .enumerate()
    {
        let refused = tau.len() != 3;
        let t = 0.01 * k as f64;
        let taken = node.take(&Sample {
            t,
            tau,
            ..free.clone()
        });
        assert_eq!(taken.is_err(), refused, "{taken:?}");
    }
    assert_eq!(node.learner().zero(), [3.0; 3]);
    assert_eq!(node.counts().tared, 3);
}

/// With an end or without.
#[test]
fn the_longest_line_is_taken() {
    for (length, end, expected) in [
        (MAX_LINE, "\n", Received::Line),
        (MAX_LINE, "", Received::Line),
        (MAX_LINE + 1, "\n", Received::TooLong),
        (MAX_LINE + 1, "", Received::TooLong),
    ] {
        let text = "1".repeat(length) + end;
        let mut line = Vec::new();
        let found = Lines(text.as_bytes()).receive(&mut line).unwrap();
        assert_eq!(found, expected, "{length} {end:?}");
    }
}

/// A sensor that is off by as much all the time, as first readings in free air say, is none of the object.
#[test]
fn the_first_readings_are_zero() {
    let off = [0.3, -0.2, 5.0];
    let tare = 5;
    let mut tared = node(Options { tare, ..PATIENT });
    let mut plain = node(PATIENT);
    for k in 0..60 {
        let mut right = sample(k).0;
        if k < 5 {
            right.q[2] = 0.02;
            right.tau = vec![0.0; 3];
        }
        let tau = right.tau.iter().zip(off).map(|(t, o)| t + o).collect();
        tared
            .take(&Sample {
                tau,
                ..right.clone()
            })
            .unwrap();
        plain.take(&right).unwrap();
    }
    let (counts, all) = (tared.counts(), plain.counts());
    assert_eq!((counts.tared, counts.used, all.used), (5, 55, 60));
    let pairs = tared.learner().session().belief().mean().iter();
    let pairs = pairs.zip(plain.learner().session().belief().mean());
    let largest = pairs.clone().map(|(_, b)| *b).fold(0.0, f32::max);
    assert!(largest > 1.0);
    for (a, b) in pairs {
        assert!((a - b).abs() < 1e-3 * largest, "{a} {b}");
    }
}
