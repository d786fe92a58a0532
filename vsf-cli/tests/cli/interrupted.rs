//! Outputs are whole, whatever stops the command while it writes them.
#![cfg(unix)]

use crate::common::Bench;
use std::fs;
use std::process::{Command, Output};
#[cfg(target_os = "linux")]
use std::{process::Stdio, thread::sleep, time::Duration};

/// Runs a command that may write no file of more than 1 KiB. The system kills it when it does, or refuses
/// to write as a full disk does, where `refuse` says so.
fn limited(bench: &Bench, line: &str, refuse: bool) -> Output {
    let trap = if refuse { "trap '' XFSZ;" } else { "" };
    Command::new("sh")
        .arg("-c")
        .arg(format!(
            "{trap} ulimit -c 0; ulimit -f 1; exec \"$0\" {line}"
        ))
        .arg(env!("CARGO_BIN_EXE_vsf"))
        .current_dir(&bench.root)
        .output()
        .unwrap()
}

/// Names in the folder, less those of files that were being written.
fn names(bench: &Bench) -> Vec<String> {
    let entries = fs::read_dir(&bench.root).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|n| !n.ends_with(".part"))
        .collect();
    names.sort();
    names
}

#[test]
fn killed_or_out_of_space_while_writing() {
    let bench = Bench::touched();
    bench.ok("estimate touch --prior-sd 10 --noise-sd 1 --out kept.npz");
    let whole = fs::read(bench.root.join("kept.npz")).unwrap();
    assert!(whole.len() > 1024);
    let before = names(&bench);
    for line in [
        "estimate touch --prior-sd 20 --noise-sd 1 --out kept.npz",
        "estimate touch --prior-sd 20 --noise-sd 1 --out new.npz",
        "simulate data --field truth --out recording",
        "export kept.npz --out picture.png --out cloud.ply",
    ] {
        let refused = limited(&bench, line, true);
        let error = String::from_utf8_lossy(&refused.stderr);
        assert_eq!(refused.status.code(), Some(3), "{line}: {error}");
        assert!(error.contains("error: "), "{line}: {error}");
        assert_eq!(names(&bench), before, "{line}");
        let killed = limited(&bench, line, false);
        assert_eq!(killed.status.code(), None, "{line}");
        assert_eq!(names(&bench), before, "{line}");
        assert_eq!(
            fs::read(bench.root.join("kept.npz")).unwrap(),
            whole,
            "{line}"
        );
    }
    bench.ok("estimate touch --prior-sd 20 --noise-sd 1 --out kept.npz");
    assert_ne!(fs::read(bench.root.join("kept.npz")).unwrap(), whole);
}

/// What a killed command leaves is in nobody's way, be the folder a new one, an empty one, or a
/// recording with fewer sequences.
#[test]
fn killed_commands_are_run_again() {
    let bench = Bench::new();
    let out = bench.root.join("out");
    let killed_and_again = |line: &str| {
        assert_eq!(limited(&bench, line, false).status.code(), None, "{line}");
        let text = bench.ok(line);
        assert!(text.contains("wrote"), "{text}");
    };
    let line = "simulate data --field truth --out out";
    killed_and_again(line);
    fs::remove_dir_all(&out).unwrap();
    fs::create_dir(&out).unwrap();
    killed_and_again(line);
    fs::remove_dir_all(&out).unwrap();
    bench.ok(&format!("{line} --sequences a"));
    killed_and_again(line);
    bench.ok("info out");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_device() {
    let bench = Bench::touched();
    let link = bench.root.join("full.npz");
    std::os::unix::fs::symlink("/dev/full", link).unwrap();
    let line = "estimate touch --prior-sd 10 --noise-sd 1 --out full.npz";
    bench.fails(line, 3, &["full.npz", "No space"]);
}

/// Terminates a command that has run for so long since it has a handler of signals, and returns its exit code.
#[cfg(target_os = "linux")]
fn terminated(command: &mut Command, after: Duration) -> Option<i32> {
    const SIGTERM: u32 = 15;
    let mut child = command.stderr(Stdio::null()).spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    loop {
        let status = fs::read_to_string(&status).unwrap();
        let caught = status.lines().find_map(|l| l.strip_prefix("SigCgt:"));
        let caught = u64::from_str_radix(caught.unwrap().trim(), 16).unwrap();
        if caught >> (SIGTERM - 1) & 1 == 1 {
            break;
        }
        assert!(
            child.try_wait().unwrap().is_none(),
            "ended without a handler"
        );
        sleep(Duration::from_millis(10));
    }
    sleep(after);
    let sent = Command::new("kill").arg(child.id().to_string()).status();
    assert!(sent.unwrap().success());
    child.wait().unwrap().code()
}

/// A service manager ends a command as Ctrl-C does: what is being written is ended first.
#[cfg(target_os = "linux")]
#[test]
fn termination_is_an_interruption() {
    let mut soak = Command::new(env!("CARGO_BIN_EXE_vsf"));
    soak.args(["bench", "--soak", "10", "--points", "1000", "--quiet"]);
    assert_eq!(terminated(&mut soak, Duration::ZERO), Some(130));
}

/// Were it waited for, this would not end.
#[cfg(target_os = "linux")]
#[test]
fn a_pipe_whose_reader_sleeps_is_not_waited_for() {
    let bench = Bench::touched();
    let pipe = bench.root.join("pipe.html");
    let made = Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let mut reader = Command::new("sh");
    let mut reader = (reader.args(["-c", "exec sleep 60 < pipe.html"]))
        .current_dir(&bench.root)
        .spawn()
        .unwrap();
    sleep(Duration::from_secs(1));
    let mut view = Command::new(env!("CARGO_BIN_EXE_vsf"));
    view.args(["view", "touch", "--field", "truth", "--out", "pipe.html"]);
    view.current_dir(&bench.root);
    assert_eq!(terminated(&mut view, Duration::from_secs(2)), Some(130));
    reader.kill().unwrap();
    reader.wait().unwrap();
}
