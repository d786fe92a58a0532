//! Streams that are not perfect.

use nalgebra::{Point3, Vector3};
use serde_json::Value;
use std::io::{self, BufReader, Cursor, Write};
use std::net::UdpSocket;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use vsf_contact::{StickSlip, link_sdfs};
use vsf_core::{Belief, Noise, RestPoints, Session};
use vsf_pipeline::live::{
    Counts, Datagrams, Lines, LiveSession, MAX_LINE, Node, Options, Queue, Received, Sample,
    Source, WhenFull, run,
};
use vsf_pipeline::{FilterSpec, SceneContact};
use vsf_robots::{JointTorques, RobotModel, cartesian_stage, planar_arm};

fn session() -> (RobotModel, LiveSession) {
    session_of(cartesian_stage(0.01).unwrap())
}

fn session_of(robot: RobotModel) -> (RobotModel, LiveSession) {
    let points = (0..200).map(|i| {
        Point3::new(
            f64::from(i % 10),
            f64::from(i / 10 % 10),
            -f64::from(i / 100),
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

fn node(options: Options) -> Node {
    let (robot, session) = session();
    Node::new(robot, session, options).unwrap()
}

const PATIENT: Options = Options {
    rate_hz: 100.0,
    publish_hz: 10.0,
    max_gap: 0.1,
    restart: 1.0,
    queue: 4,
    when_full: WhenFull::Wait,
    weight: None,
    tare: 0,
};

/// Sample `k` of a poke at 100 Hz, and its line.
fn sample(k: u32) -> (Sample, String) {
    let depth = 0.0001 * f64::from(k.min(80));
    let sample = Sample {
        t: 0.01 * f64::from(k),
        q: vec![0.02, 0.02, -depth],
        tau: vec![0.0, 0.0, 40.0 * depth],
        touch: 1,
    };
    let Sample { t, q, tau, touch } = &sample;
    let line = format!("{{\"t\": {t}, \"q\": {q:?}, \"tau\": {tau:?}, \"touch\": {touch}}}\n");
    (sample, line)
}

/// Runs a text through a node: the node, its summaries, and the lines that it refused.
fn stream(text: &[u8], options: Options) -> (Node, Vec<Value>, Vec<(u64, String)>) {
    let refused = Arc::new(Mutex::new(Vec::new()));
    let mut out = Vec::new();
    let note = {
        let refused = Arc::clone(&refused);
        move |k: u64, why: &str| refused.lock().unwrap().push((k, why.to_owned()))
    };
    let mut node = node(options);
    let (queue, source) = (node.queue(), Lines(Cursor::new(text.to_owned())));
    run(&mut node, &queue, source, &mut out, note).unwrap();
    let lines = String::from_utf8(out).unwrap();
    let summaries = lines
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
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
    assert!(node.session().belief() == session.belief());
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
    // A clock that was set anew, far ahead and then back.
    text += &sample(0).1.replace("\"t\": 0", "\"t\": 1e300");
    text += &sample(1).1;
    text += &sample(2).1;
    let (node, summaries, refused) = stream(text.as_bytes(), PATIENT);
    assert!(refused.is_empty(), "{refused:?}");
    let counts = node.counts();
    assert_eq!((counts.received, counts.used), (14, 12));
    assert_eq!((counts.repeated, counts.late), (1, 1));
    // Sample 4, 22 between 7 and 30, and more than can be counted before 1e300 s.
    assert_eq!(counts.missing, u64::MAX);
    assert_eq!((counts.gaps, counts.restarts), (2, 1));
    assert_eq!(summaries.last().unwrap()["t"], 0.02);
    let text: String = order.iter().map(|&k| sample(k).1).collect();
    let (node, ..) = stream(text.as_bytes(), PATIENT);
    let expected = Counts {
        received: 11,
        used: 9,
        repeated: 1,
        late: 1,
        missing: 23,
        gaps: 1,
        ..Counts::default()
    };
    assert_eq!(*node.counts(), expected);
}

#[test]
fn a_slow_stream_is_one_touch() {
    let options = Options {
        rate_hz: 5.0,
        ..PATIENT
    };
    // 0.2 s apart; one sample is missing, then three.
    let text = [0, 1, 2, 4, 5, 9].map(|k| sample(20 * k).1).concat();
    let (node, ..) = stream(text.as_bytes(), options);
    let counts = node.counts();
    assert_eq!((counts.used, counts.missing, counts.gaps), (6, 4, 1));
}

#[test]
fn bad_lines_are_refused_by_number_and_change_nothing() {
    let good = |k: u32| sample(k).1;
    let long = "1".repeat(3 * MAX_LINE) + "\n";
    let bad: [(&str, &str); 16] = [
        (
            "{\"t\": 0.1, \"q\": [0, 0, 0], \"tau\": [NaN, 0, 0]}\n",
            "expected value (column 36)",
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
        ("\n", "EOF"),
        ("no json\n", "expected"),
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
    assert!(node.session().belief() == clean.session().belief());
    let counts = node.counts();
    assert_eq!((counts.received, counts.used), (20, 3));
    for ((number, why), (line, part)) in refused.iter().zip(bad) {
        assert!(
            why.contains(part),
            "line {number}: {part:?} is not in {why:?}: {line:.80}"
        );
    }
    let numbers: Vec<u64> = refused.iter().map(|r| r.0).collect();
    assert_eq!(numbers, (2..=18).collect::<Vec<_>>());
    assert_eq!(counts.refused, 17);
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
        node.session().belief().clone()
    };
    assert!(belief(2, true) != belief(1, true));
    assert!(belief(2, false) != belief(1, false));
}

/// A source that says when it has nothing more, and a sink that waits for that at its first line.
struct Hasty(Lines<Cursor<String>>, Sender<()>);
struct Slow(Option<Receiver<()>>, Vec<u8>);

impl Source for Hasty {
    fn receive(&mut self, line: &mut Vec<u8>) -> io::Result<Received> {
        let received = self.0.receive(line)?;
        if received == Received::End {
            self.1.send(()).unwrap();
        }
        Ok(received)
    }
}

impl Write for Slow {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if let Some(end) = self.0.take() {
            end.recv().unwrap();
        }
        self.1.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
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
    let mut out = Slow(Some(ended), Vec::new());
    let source = Hasty(Lines(Cursor::new(text)), end);
    let mut node = node(options);
    let queue = node.queue();
    run(&mut node, &queue, source, &mut out, |_, _| ()).unwrap();
    let counts = node.counts();
    // Up to two before it stands still, the last four in the end.
    assert!((4..=6).contains(&counts.used), "{counts:?}");
    assert_eq!(counts.received, counts.used + counts.dropped);
    let last = String::from_utf8(out.1).unwrap();
    assert!(
        last.lines().last().unwrap().starts_with("{\"t\":0.99,"),
        "{last}"
    );
}

#[test]
fn nobody_reads_any_more() {
    struct Gone;
    impl Write for Gone {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::BrokenPipe.into())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let text: String = (0..100).map(|k| sample(k).1).collect();
    let mut node = node(PATIENT);
    let (queue, source) = (node.queue(), Lines(Cursor::new(text)));
    run(&mut node, &queue, source, &mut Gone, |_, _| ()).unwrap();
    assert!(node.counts().used < 100);
}

#[test]
fn datagrams() {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    for k in 0..50 {
        let line = sample(k).1;
        sender
            .send_to(line.as_bytes(), socket.local_addr().unwrap())
            .unwrap();
    }
    sender.send_to(b"", socket.local_addr().unwrap()).unwrap();
    let mut out = Vec::new();
    let mut node = node(PATIENT);
    let queue = node.queue();
    run(&mut node, &queue, Datagrams(socket), &mut out, |_, _| ()).unwrap();
    assert_eq!((node.counts().used, node.counts().received), (50, 50));

    // Silence ends it too.
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket
        .set_read_timeout(Some(Duration::from_millis(10)))
        .unwrap();
    let mut line = Vec::new();
    assert_eq!(Datagrams(socket).receive(&mut line).unwrap(), Received::End);
}

#[test]
fn options_out_of_range() {
    for options in [
        Options {
            rate_hz: 0.0,
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
        assert!(Node::new(robot, session, options).is_err(), "{options:?}");
    }
}

/// What it has learned is kept, though the source never ends.
#[test]
fn whoever_closes_the_queue_ends_the_stream() {
    let (reader, mut writer) = io::pipe().unwrap();
    let mut node = node(PATIENT);
    let queue = node.queue();
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
    let mut out = Vec::new();
    let source = Lines(BufReader::new(reader));
    let refuse = move |_: u64, _: &str| told.send(()).unwrap();
    run(&mut node, &queue, source, &mut out, refuse).unwrap();
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
    struct Full;
    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::StorageFull.into())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let mut failing = node(PATIENT);
    let queue = failing.queue();
    let error = run(&mut failing, &queue, Failing(0), &mut Vec::new(), |_, _| ());
    assert_eq!(error.unwrap_err().to_string(), "unplugged");
    assert_eq!(failing.counts().used, 30);

    let mut full = node(PATIENT);
    let queue = full.queue();
    let error = run(&mut full, &queue, Failing(0), &mut Full, |_, _| ()).unwrap_err();
    assert_eq!(error.kind(), io::ErrorKind::StorageFull);
    assert!(full.counts().used > 0);
}

/// Readings of actuators that hold the arm up, in free air, are those of no touch.
#[test]
fn the_weight_of_the_arm_is_taken_off() {
    let (robot, session) = session_of(planar_arm(3, 0.3, 0.02).unwrap());
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let weight = Some(gravity);
    let options = Options { weight, ..PATIENT };
    let mut node = Node::new(robot.clone(), session, options).unwrap();
    let mut workspace = robot.dynamics_workspace();
    let q = vec![0.3; robot.joint_count()];
    let held = robot.gravity_torques(&q, &gravity, &mut workspace).unwrap();
    let mut last = vec![0.0; held.len()];
    for (k, reading) in [held.to_vec(), held.iter().map(|t| t - 0.5).collect()]
        .into_iter()
        .enumerate()
    {
        let sample = Sample {
            t: k as f64,
            q: q.clone(),
            tau: reading,
            touch: 0,
        };
        node.take(&sample).unwrap();
        last[k] = node.summary().residual;
    }
    // Held by the environment: by 0.5 N m in each joint.
    let expected = 0.5 * (held.len() as f64).sqrt();
    assert_eq!(last[0], 0.0);
    assert!((last[1] - expected).abs() < 1e-9, "{last:?}");
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
    let pairs = tared.session().belief().mean().iter();
    let pairs = pairs.zip(plain.session().belief().mean());
    let largest = pairs.clone().map(|(_, b)| *b).fold(0.0, f32::max);
    assert!(largest > 1.0);
    for (a, b) in pairs {
        assert!((a - b).abs() < 1e-3 * largest, "{a} {b}");
    }
}
