//! `vsf live`: fields of streams.

use crate::common::Bench;
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
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

/// Sample `k` of a press of 4 mm at 50 Hz, from 2 mm above the points.
fn sample(k: u32) -> String {
    let depth = 0.0005 * (f64::from(k.min(12)) - 4.0);
    format!(
        "{{\"t\": {}, \"q\": [0.018, 0.016, {}], \"tau\": [0, 0, {}]}}\n",
        0.02 * f64::from(k),
        -depth,
        50.0 * depth.max(0.0)
    )
}

/// Writes `m.json`, a corrected model of constant torques (N).
fn write_biases(bench: &Bench, values: [f64; 3]) {
    let line = "diagnose touch --effects torque_bias,payload --model m.json --train a --test c";
    bench.ok(line);
    let model = fs::read_to_string(bench.root.join("m.json")).unwrap();
    let mut model: Value = serde_json::from_str(&model).unwrap();
    let parameter = |j: usize, value: f64| serde_json::json!({"name": format!("b_{}", j + 1), "value": value, "std": 0.01, "unit": "N"});
    model["effects"] = serde_json::json!([{
        "effect": "torque_bias",
        "parameters": values.iter().enumerate().map(|(j, v)| parameter(j, *v)).collect::<Vec<_>>(),
    }]);
    fs::write(bench.root.join("m.json"), model.to_string()).unwrap();
}

/// The field of a stream is that of the filter of the same name over the recording that it is, with the prior and noise
/// that are chosen for it.
#[test]
fn a_recording_played_is_the_recording() {
    let bench = Bench::touched();
    let text = bench.ok("live touch --play --publish-hz 20 --out live.npz");
    let lines: Vec<Value> = (text.lines())
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    assert!(lines.len() > 10, "{text}");
    let last = &lines[lines.len() - 1];
    assert_eq!(last["used"], 48);
    assert_eq!((&last["missing"], &last["gaps"]), (&0.into(), &0.into()));
    bench.ok("estimate touch --estimator replay --out whole.npz");
    let error = |field: &str| {
        let text = bench.ok(&format!("evaluate touch --field {field} --json"));
        let report: Value = serde_json::from_str(&text).unwrap();
        report["mean_error"].as_f64().unwrap()
    };
    let (live, whole) = (error("live.npz"), error("whole.npz"));
    assert!((live - whole).abs() < 1e-3 * whole, "{live} {whole}");
    // What it has learned from is known.
    let warning = bench.warned("evaluate touch --field live.npz --sequences a");
    assert!(warning.contains("has learned from"), "{warning}");
}

#[test]
fn a_recording_played_under_a_model_is_the_recording() {
    let bench = Bench::touched();
    write_biases(&bench, [0.02, -0.03, 0.1]);
    let given = "--model m.json --prior-sd 40 --noise-sd 0.02";
    bench.ok(&format!("live touch --play {given} --out live.npz"));
    bench.ok(&format!(
        "estimate touch --estimator replay {given} --out whole.npz"
    ));
    let mean = |field: &str| {
        let text = bench.ok(&format!(
            "evaluate touch --field {field} --model m.json --json"
        ));
        let report: Value = serde_json::from_str(&text).unwrap();
        report["mean_error"].as_f64().unwrap()
    };
    let (live, whole) = (mean("live.npz"), mean("whole.npz"));
    assert!((live - whole).abs() < 1e-6 * whole, "{live} {whole}");
    // Fields remember the model.
    let warning = bench.warned("evaluate touch --field live.npz");
    assert!(warning.contains("torque_bias"), "{warning}");
}

#[test]
fn lines_of_a_pipe() {
    let bench = Bench::touched();
    let samples: String = (0..20).map(sample).collect();
    let bad = samples.replacen("[0, 0, 0]", "[0, NaN, 0]", 1);
    let output = piped(
        &bench,
        "live touch --wait --out field.npz --json=told.json",
        &bad,
    );
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    assert!(
        error.contains("warning: line 1: no sample in JSON: expected value"),
        "{error}"
    );
    assert!(
        error.contains("19 of 20 samples used, 1 refused"),
        "{error}"
    );
    assert!(bench.root.join("field.npz").is_file());
    let told = fs::read_to_string(bench.root.join("told.json")).unwrap();
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!((&told["used"], &told["refused"]), (&19.into(), &1.into()));
    assert_eq!(told["out"], "field.npz");

    // Quiet, or with its result there, nothing else is on standard output.
    let quiet = piped(
        &bench,
        "live touch --wait --quiet --out field.npz",
        &samples,
    );
    assert!(quiet.status.success() && quiet.stdout.is_empty());
    let json = piped(&bench, "live touch --wait --out field.npz --json", &samples);
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
    let line = "live touch --play --field first.npz --smooth-share 0.2 --out second.npz";
    bench.fails(line, 2, &["--smooth-share: --field says"]);
    let line = "live touch --play --field truth --out second.npz";
    bench.fails(line, 1, &["truth", "does not say how sure it is"]);
}

#[test]
fn streams_without_samples_write_no_field() {
    let bench = Bench::touched();
    let none = [
        "",
        "no sample\n",
        "[0, [0, 0, 0], [0, 0, 0]]\n",
        "{\"t\": 0, \"q\": [1], \"tau\": [1]}\n",
    ];
    for samples in none {
        let output = piped(&bench, "live touch --out field.npz", samples);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{error}");
        assert!(error.contains("had no sample to learn from"), "{error}");
        assert!(!bench.root.join("field.npz").exists());
    }
    // Nor do those that touch nothing.
    let free = sample(0).replacen("0.002", "0.05", 1);
    let output = piped(&bench, "live touch --out field.npz", &free);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{error}");
    assert!(error.contains("touched none of the 160 points"), "{error}");
    assert!(!bench.root.join("field.npz").exists());
    bench.fails(
        "live touch --out f.npz --udp 192.0.2.1:9000",
        2,
        &["this machine"],
    );
    bench.fails("live touch --play --udp 127.0.0.1:0", 2, &["--udp"]);
    bench.fails("live touch --out f.npz --idle 3", 2, &["--udp"]);
    bench.fails("live touch --out f.npz --sequences a", 2, &["--play"]);
    bench.fails(
        "live touch --wait --out f.npz --sequences a",
        2,
        &["--play"],
    );
    bench.fails("live touch --wait --out f.npz --idle 3", 2, &["--udp"]);
    bench.fails("live touch --out f.png", 2, &["--out f.png: pictures"]);
    bench.fails("live touch", 2, &["--out"]);
    bench.fails(
        "live touch --play --estimator batch",
        2,
        &["learns sample by sample"],
    );
    bench.fails("live touch --play --vision knn", 2, &["--vision"]);
    let both = "--prior-sd and --noise-sd are required";
    bench.fails("live data --play", 2, &[both]);
}

/// Ctrl-C ends a stream; what was learned is kept.
#[cfg(unix)]
#[test]
fn an_interruption_ends_the_stream() {
    let bench = Bench::touched();
    let mut child = started(&bench, "live touch --publish-hz 50 --out field.npz");
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

/// That nobody reads what it says is no reason to learn less, be the reader gone or asleep.
#[test]
fn nobody_reads_the_summaries() {
    let bench = Bench::touched();
    for (gone, line) in [
        (true, "live touch --wait --publish-hz 1000 --out field.npz"),
        (false, "live touch --publish-hz 1000 --out field.npz"),
    ] {
        let mut child = started(&bench, line);
        let mut stdin = child.stdin.take().unwrap();
        let asleep = child.stdout.take().filter(|_| !gone);
        // Their summaries are more than a pipe holds.
        for k in 0..1000 {
            stdin.write_all(sample(k).as_bytes()).unwrap();
            if !gone {
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
        }
        drop(stdin);
        let mut error = String::new();
        child
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut error)
            .unwrap();
        assert!(child.wait().unwrap().success(), "{error}");
        drop(asleep);
        assert_eq!(error.contains("no further summaries"), gone, "{error}");
        // Whatever was dropped while they came too quickly, the end was learned.
        assert!(error.contains("of 1000 samples used"), "{error}");
        bench.ok("info field.npz");
    }
}

/// A field is there before the stream has ended, if one wants that.
#[test]
fn fields_are_saved_meanwhile() {
    let bench = Bench::touched();
    let line = "live touch --wait --publish-hz 50 --save-every 0.0001 --out field.npz";
    let mut child = started(&bench, line);
    let mut stdin = child.stdin.take().unwrap();
    for k in 0.. {
        if bench.root.join("field.npz").exists() {
            break;
        }
        assert!(child.try_wait().unwrap().is_none());
        stdin.write_all(sample(k).as_bytes()).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    bench.ok("info field.npz");
}

/// Units, signs and order are looked at as those of recordings are.
#[test]
fn samples_that_look_wrong() {
    let bench = Bench::touched();
    write_biases(&bench, [0.0, 0.0, 0.4]);
    let pressed = |tau: f64, zero: f64| -> String {
        // At rest above, down, and in and out again.
        let rest = (0..20).map(|_| -200);
        let down = (0..20).map(|k| -200 + 10 * k);
        let touch = (0..200).map(|k| if k <= 100 { k } else { 200 - k });
        let there = rest.chain(down).chain(touch);
        let lines = there.enumerate().map(|(k, depth)| {
            let depth = 0.00005 * (f64::from(depth) - 40.0);
            let noise = 1e-4 * (k % 3) as f64;
            let force = zero + tau * (50.0 * depth.max(0.0) + noise);
            let t = 0.02 * k as f64;
            format!(
                "{{\"t\": {t}, \"q\": [0.018, 0.016, {}], \"tau\": [0, 0, {force}]}}\n",
                -depth
            )
        });
        lines.collect()
    };
    let told = |samples: &str, flags: &str| {
        let line = format!("live touch --wait --out field.npz {flags}");
        String::from_utf8(piped(&bench, &line, samples).stderr).unwrap()
    };
    // What is taken as zero is taken off what is looked at, too, and so is what a model explains.
    for (zero, flags) in [
        (0.0, ""),
        (0.4, "--tare 20"),
        (0.4, "--model m.json"),
        (0.7, "--model m.json --tare 20"),
    ] {
        let right = told(&pressed(1.0, zero), flags);
        assert!(!right.contains("the stream:"), "{right}");
        let opposite = told(&pressed(-1.0, zero), flags);
        assert!(
            opposite.contains("the stream: torques in contact are opposite"),
            "{opposite}"
        );
    }
    for (zero, flags) in [(0.4, ""), (0.0, "--model m.json")] {
        let untared = told(&pressed(1.0, zero), flags);
        assert!(untared.contains("the stream:"), "{untared}");
    }
    let tiny = told(&pressed(1e-9, 0.0), "");
    assert!(tiny.contains("check the unit"), "{tiny}");
}

/// Noise that was chosen by samples further apart has a stream of many tell too much.
#[test]
fn streams_that_are_quicker_than_the_recording() {
    let bench = Bench::touched();
    let every = |dt: f64| -> String {
        let lines = (0..40).map(|k| {
            sample(k).replacen(
                &format!("{{\"t\": {}", 0.02 * f64::from(k)),
                &format!("{{\"t\": {}", dt * f64::from(k)),
                1,
            )
        });
        lines.collect()
    };
    let told = |dt: f64, flags: &str| {
        let line = format!("live touch --wait --out field.npz {flags}");
        String::from_utf8(piped(&bench, &line, &every(dt)).stderr).unwrap()
    };
    let quicker = told(0.001, "");
    assert!(
        quicker.contains("the stream has 1000 samples a second"),
        "{quicker}"
    );
    for same in [told(0.05, ""), told(0.001, "--noise-sd 0.05 --prior-sd 30")] {
        assert!(!same.contains("samples a second"), "{same}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn datagrams_until_silence() {
    let bench = Bench::touched();
    let line = "live touch --udp localhost:0 --idle 2 --out field.npz";
    let mut child = started(&bench, line);
    let mut errors = BufReader::new(child.stderr.take().unwrap()).lines();
    let first = errors.by_ref().map(Result::unwrap);
    let listening = |line: String| line.strip_prefix("listening at ").map(str::to_owned);
    let address = first.filter_map(listening).next().unwrap();
    let address = address.split(": ").next().unwrap();
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    for k in 0..100 {
        socket.send_to(sample(k).as_bytes(), address).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(child.wait_with_output().unwrap().status.success());
    let told: Vec<String> = errors.map(Result::unwrap).collect();
    assert!(
        told.iter().any(|l| l.contains("of 100 samples used")),
        "{told:?}"
    );
    bench.ok("info field.npz");
}

/// What cannot be checked is no reason to lose what was learned: a touch of one sample says nothing of motion.
#[test]
fn a_lone_sample_in_the_end() {
    let bench = Bench::touched();
    let mut samples: String = (0..40).map(sample).collect();
    // Of two that follow each other the first is not believed.
    let moved = |k: u32| sample(k).replacen("0.018", "0.03", 1);
    samples += &(moved(900) + &moved(901));
    let line = "live touch --torque-kind measured --gravity 0,0,0 --prior-sd 30 --noise-sd 1 --wait --out field.npz";
    let output = piped(
        &bench,
        line,
        &samples.replace("\"tau\": [0, 0, ", "\"tau\": [0, 0, -"),
    );
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{error}");
    assert!(!error.contains("cannot be checked"), "{error}");
    bench.ok("info field.npz");
}
