//! `vsf live`: fields of streams.

use crate::common::Bench;
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Output, Stdio};

/// The command with a pipe to each of its ends.
fn started(bench: &Bench, line: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_vsf"))
        .args(line.split_whitespace())
        .current_dir(&bench.root)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn piped(bench: &Bench, line: &str, samples: &str) -> Output {
    let mut child = started(bench, line);
    let mut stdin = child.stdin.take().unwrap();
    stdin.write_all(samples.as_bytes()).unwrap();
    drop(stdin);
    child.wait_with_output().unwrap()
}

/// Sample `k` of a press of 4 mm at 50 Hz.
fn sample(k: u32) -> String {
    let depth = 0.0005 * f64::from(k.min(8));
    format!(
        "{{\"t\": {}, \"q\": [0.018, 0.016, {}], \"tau\": [0, 0, {}]}}\n",
        0.02 * f64::from(k),
        -depth,
        50.0 * depth
    )
}

/// The field of a stream is that of the filter of the same name over the recording that it is.
#[test]
fn a_recording_played_is_the_recording() {
    let bench = Bench::touched();
    let text = bench.ok("live touch --play --publish-hz 20 --out live.npz --noise-sd 0.01");
    let lines: Vec<Value> = (text.lines())
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    assert!(lines.len() > 10, "{text}");
    let last = &lines[lines.len() - 1];
    assert_eq!(
        (&last["used"], &last["missing"], &last["gaps"]),
        (&Value::from(48), &Value::from(0), &Value::from(0))
    );
    bench.ok(
        "estimate touch --estimator replay --prior-sd 30 --noise-sd 0.01 --smooth-share 0 --out whole.npz",
    );
    let evaluated = |field: &str| -> Value {
        let text = bench.ok(&format!("evaluate touch --field {field} --json"));
        serde_json::from_str(&text).unwrap()
    };
    let (live, whole) = (evaluated("live.npz"), evaluated("whole.npz"));
    let (a, b) = (
        live["mean_error"].as_f64().unwrap(),
        whole["mean_error"].as_f64().unwrap(),
    );
    assert!((a - b).abs() < 1e-3 * b, "{a} {b}");
    let told = bench.ok("info live.npz");
    assert!(told.contains("touch") && told.contains("0.01000"), "{told}");
}

#[test]
fn lines_of_a_pipe() {
    let bench = Bench::touched();
    let samples: String = (0..20).map(sample).collect();
    let bad = samples.replacen("[0, 0, 0]", "[0, NaN, 0]", 1);
    let output = piped(&bench, "live touch --wait --json=told.json", &bad);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    assert!(error.contains("line 1: expected value"), "{error}");
    assert!(error.contains("19 of 20 samples used"), "{error}");
    assert!(bench.root.join("field.npz").is_file());
    let told = fs::read_to_string(bench.root.join("told.json")).unwrap();
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!((&told["used"], &told["refused"]), (&19.into(), &1.into()));
    assert_eq!(told["out"], "field.npz");

    // Quiet, or with its result there, nothing else is on standard output.
    let quiet = piped(&bench, "live touch --wait --quiet", &samples);
    assert!(quiet.status.success() && quiet.stdout.is_empty());
    let json = piped(&bench, "live touch --wait --json", &samples);
    let result: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(result["used"], 20);
}

/// From an earlier field on, whose touched points stay touched.
#[test]
fn a_field_goes_on() {
    let bench = Bench::touched();
    bench.ok("estimate touch --prior-sd 30 --noise-sd 0.01 --out first.npz --json=first.json");
    let samples: String = (0..20).map(sample).collect();
    let line = "live touch --wait --field first.npz --out second.npz --json=second.json";
    let output = piped(&bench, line, &samples);
    assert!(output.status.success());
    let touched = |name: &str, key: &str| {
        let text = fs::read_to_string(bench.root.join(name)).unwrap();
        let report: Value = serde_json::from_str(&text).unwrap();
        report[key].as_u64().unwrap()
    };
    assert!(touched("second.json", "touched") >= touched("first.json", "touched_points"));
    bench.ok("evaluate touch --field second.npz");
    let line = "live touch --play --field truth --out second.npz";
    bench.fails(line, 1, &["truth", "does not say how sure it is"]);
}

#[test]
fn streams_without_samples_write_no_field() {
    let bench = Bench::touched();
    for samples in ["", "no sample\n", "{\"t\": 0, \"q\": [1], \"tau\": [1]}\n"] {
        let output = piped(&bench, "live touch", samples);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{error}");
        assert!(error.contains("had no sample to learn from"), "{error}");
        assert!(!bench.root.join("field.npz").exists());
    }
    bench.fails("live touch --udp 192.0.2.1:9000", 2, &["this machine"]);
    bench.fails("live touch --play --udp 127.0.0.1:0", 2, &["--udp"]);
    bench.fails("live touch --idle 3", 2, &["--udp"]);
    bench.fails("live touch --sequences a", 2, &["--play"]);
}

/// Ctrl-C ends a stream; what was learned is kept.
#[cfg(unix)]
#[test]
fn an_interruption_ends_the_stream() {
    let bench = Bench::touched();
    let mut child = started(&bench, "live touch --publish-hz 50");
    let mut stdin = child.stdin.take().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    for k in 0..20 {
        stdin.write_all(sample(k).as_bytes()).unwrap();
    }
    lines.next().unwrap().unwrap();
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status();
    assert!(sent.unwrap().success());
    // The pipe is still open.
    assert_eq!(child.wait().unwrap().code(), Some(0));
    bench.ok("info field.npz");
    drop(stdin);
}

/// A command whose summaries nobody reads any more ends, and keeps what it has.
#[test]
fn nobody_reads_the_summaries() {
    let bench = Bench::touched();
    let mut child = started(&bench, "live touch --wait --publish-hz 1000");
    let mut stdin = child.stdin.take().unwrap();
    drop(child.stdout.take());
    for k in 0..1000 {
        if stdin.write_all(sample(k).as_bytes()).is_err() {
            break;
        }
    }
    drop(stdin);
    assert_eq!(child.wait().unwrap().code(), Some(0));
    bench.ok("info field.npz");
}

#[cfg(target_os = "linux")]
#[test]
fn datagrams_until_silence() {
    let bench = Bench::touched();
    let free = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = free.local_addr().unwrap();
    drop(free);
    let mut child = started(&bench, &format!("live touch --udp {address} --idle 2"));
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let (told, hears) = std::sync::mpsc::channel();
    let reader = std::thread::spawn(move || {
        lines.next().unwrap().unwrap();
        told.send(()).unwrap();
        lines.count()
    });
    // Until it listens, datagrams are lost.
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut k = 0;
    while hears.try_recv().is_err() {
        let _ = socket.send_to(sample(k).as_bytes(), address);
        std::thread::sleep(std::time::Duration::from_millis(1));
        k += 1;
    }
    assert!(reader.join().unwrap() > 0);
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    bench.ok("info field.npz");
}
