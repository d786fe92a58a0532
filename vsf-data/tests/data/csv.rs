//! Joint states in CSV files.

use crate::common::{arm, arm_measured, check_pause};
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;
use vsf_data::{Advice, Clock, DataError, DataWarning, Dataset, JointLog};

/// Two joints at 100 Hz, with a pause of 3 s before the last two of five lines.
const TOUCH: &str = "\
time,q_shoulder,q_elbow,tau_shoulder,tau_elbow
100,0,0,1,2
100.01,0.1,-0.1,2,3
100.02,0.2,-0.2,3,4
103.02,0.3,-0.3,4,5
103.03,0.4,-0.4,5,6
";

type Recorded = Result<(Dataset, Vec<DataWarning>), DataError>;

fn write(files: &[(&str, &[u8])]) -> (TempDir, Vec<PathBuf>) {
    let folder = tempfile::tempdir().unwrap();
    let place = |(name, bytes): &(&str, &[u8])| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let paths = files.iter().map(place).collect();
    (folder, paths)
}

fn recording(log: &JointLog, gap: Option<f64>) -> Recorded {
    log.recording(&arm_measured(), &log.names_of(&arm()), gap)
}

fn read(files: &[(&str, &[u8])]) -> Recorded {
    let (_keep, paths) = write(files);
    recording(&JointLog::open(&paths, None, Clock::Header)?, None)
}

fn recorded(text: &str) -> Recorded {
    read(&[("touch.csv", text.as_bytes())])
}

/// The error of a file, from its name on.
fn refused(text: &str) -> String {
    let error = recorded(text).expect_err(text).to_string();
    error[error.find("touch.csv").expect(&error)..].to_owned()
}

#[test]
fn lines_are_samples_and_pauses_end_sequences() {
    let (dataset, warnings) = recorded(TOUCH).unwrap();
    assert_eq!(warnings, []);
    check_pause(&dataset, [4.0, 5.0]);
}

/// A writer that was interrupted may have left a part of the last number.
#[test]
fn a_last_line_without_an_end_is_told() {
    let cut = TOUCH.trim_end();
    let (_, warnings) = recorded(cut).unwrap();
    let [warning @ DataWarning::NoLineEnd { others: 0, .. }] = &warnings[..] else {
        panic!("{warnings:?}");
    };
    assert!(
        warning
            .to_string()
            .contains("touch.csv: its last line has no end")
    );
    let bytes = cut.as_bytes();
    let (_, warnings) = read(&[
        ("a.csv", TOUCH.as_bytes()),
        ("b.csv", bytes),
        ("c.csv", bytes),
    ])
    .unwrap();
    let told = |w: &DataWarning| matches!(w, DataWarning::NoLineEnd { path, others: 1 } if path.ends_with("b.csv"));
    assert!(warnings.iter().any(told), "{warnings:?}");
}

/// Whatever titles, order, separators and marks programs write.
#[test]
fn the_same_columns_by_other_titles() {
    let plain = recorded(TOUCH).unwrap();
    let rows = TOUCH.split_once('\n').unwrap().1;
    for titles in [
        "t,shoulder_position,elbow_pos,shoulder_effort,elbow_torque",
        "Timestamp,shoulder.q,elbow/position,torque.shoulder,Effort_elbow",
        "time_s,q1,q2,tau1,tau2",
        "time,q_0,q_1,torque_0,torque_1",
        "time,position_01,position_02,tau01,tau2",
        "# time, q1, q2, tau1, tau2",
        "\u{feff}time,\"q1\",\"q2\",tau1,tau2",
    ] {
        assert_eq!(
            recorded(&format!("{titles}\n{rows}")).unwrap(),
            plain,
            "{titles}"
        );
    }
    let tabs = TOUCH.replace(',', "\t");
    assert_eq!(read(&[("touch.TSV", tabs.as_bytes())]).unwrap(), plain);
    let lines = TOUCH.replace('\n', "\r\n\r\n");
    assert_eq!(recorded(&lines).unwrap(), plain);
    // Other columns may hold anything, and joints that are not asked for no number.
    let more: String = (TOUCH.lines().enumerate())
        .map(|(k, line)| match k {
            0 => format!("frame,q_finger,{line},position\n"),
            _ => format!("\"a, b\",,{line},?\n"),
        })
        .collect();
    assert_eq!(recorded(&more).unwrap(), plain);
}

#[test]
fn joints_are_numbered_only_as_many_as_the_robot_has() {
    let (_keep, paths) = write(&[("a.csv", b"t,q1,q2,q3,tau1,tau2,tau3\n0,1,2,3,4,5,6\n")]);
    let log = JointLog::open(&paths, None, Clock::Header).unwrap();
    assert_eq!(log.topic(), None);
    assert_eq!(log.names_of(&arm()), arm());
    let three = ["a", "b", "c"].map(str::to_owned);
    assert_eq!(log.names_of(&three), ["1", "2", "3"]);
    // A name counts more than numbers.
    let one = ["2", "b", "c"].map(str::to_owned);
    assert_eq!(log.names_of(&one), one);
    let error = recording(&log, None).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("a.csv: no joint shoulder, elbow; there are 1, 2, 3"),
        "{error}"
    );
    assert!(
        matches!(
            error,
            DataError::Advised {
                advice: Advice::Names,
                ..
            }
        ),
        "{error:?}"
    );
}

#[test]
fn velocities_are_taken_where_they_are() {
    let with = |titles: &str, cells: [&str; 5]| {
        let mut cells = std::iter::once(titles).chain(cells);
        let lines = TOUCH
            .lines()
            .map(|line| format!("{line},{}\n", cells.next().unwrap()));
        lines.collect::<String>()
    };
    let titles = "dq_shoulder,elbow_velocity";
    let text = with(titles, ["1,2", "3,4", "5,6", ",", "nan,NaN"]);
    let (dataset, _) = recorded(&text).unwrap();
    let velocities = |k: usize| dataset.sequences[k].velocities.as_ref();
    assert_eq!(
        velocities(0).unwrap().data(),
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    );
    assert_eq!(velocities(1), None);

    let cases = [
        (
            with(titles, [",", "3,4", "5,6", "7,8", "9,0"]),
            "line 2: no velocity",
        ),
        (
            with(titles, ["1,2", "3,", "5,6", "7,8", "9,0"]),
            "line 3 column \"elbow_velocity\": empty or NaN",
        ),
        (
            with("qd_elbow", ["1", "2", "3", "4", "5"]),
            "touch.csv: joint \"shoulder\" has no column of its velocity (velocity_shoulder, ",
        ),
    ];
    for (text, part) in cases {
        let (_keep, paths) = write(&[("touch.csv", text.as_bytes())]);
        let log = JointLog::open(&paths, None, Clock::Header).unwrap();
        let error = recording(&log, None).unwrap_err();
        assert!(error.to_string().contains(part), "{error}");
        assert!(
            matches!(
                error,
                DataError::Advised {
                    advice: Advice::NoVelocities,
                    ..
                }
            ),
            "{error:?}"
        );
        let without = recording(&log.without_velocities(), None).unwrap();
        assert_eq!(without, recorded(TOUCH).unwrap());
    }
}

#[test]
fn what_is_wrong_with_a_file_is_said() {
    let rows = TOUCH.split_once('\n').unwrap().1;
    let titled = |titles: &str| refused(&format!("{titles}\n{rows}"));
    let cases = [
        (refused(""), "touch.csv: the file is empty"),
        (refused("\n\n"), "touch.csv: the file is empty"),
        (
            refused("time,q1,q2,tau1,tau2\n"),
            "touch.csv: no samples below the titles",
        ),
        (
            refused(rows),
            "touch.csv: no titles, the first line has numbers",
        ),
        (
            titled("stamp,q1,q2,tau1,tau2"),
            "touch.csv: no column of the time (time, t, timestamp, time_s); there are \"stamp\", \"q1\", ",
        ),
        (
            titled("time,t,q2,tau1,tau2"),
            "columns \"time\" and \"t\" are both the time",
        ),
        (
            titled("time,a,b,c,d"),
            "no column of a joint, as in time, q_NAME, tau_NAME; there are \"time\", \"a\", ",
        ),
        (
            titled("time,q1,q_1,tau1,tau2"),
            "columns \"q1\" and \"q_1\" are both the position of joint \"1\"",
        ),
        (
            titled("time,q_torque,q2,tau1,tau2"),
            "column \"q_torque\" may be the position of joint \"torque\" or the effort of joint \"q\"; rename it",
        ),
        (
            titled("time,q_shoulder,q_elbow,tau_shoulder,current_elbow"),
            "touch.csv: joint \"elbow\" has no column of its effort (effort_elbow, torque_elbow, tau_elbow); there are \"time\"",
        ),
        (
            titled("time,tau1,tau2,q1,x"),
            "touch.csv: joint \"2\" has no column of its position (position_2, pos_2, q_2)",
        ),
        (
            titled("time,q_shoulder,q_wrist,tau_shoulder,tau_wrist"),
            "touch.csv: no joint elbow; there are shoulder, wrist; should these be the same",
        ),
    ];
    for (error, part) in cases {
        assert!(
            error.starts_with(part) || error.contains(&format!(": {part}")),
            "{error}"
        );
    }
}

#[test]
fn lines_that_cannot_be_samples_are_named() {
    let changed = |from: &str, to: &str| {
        assert_eq!(TOUCH.matches(from).count(), 1);
        refused(&TOUCH.replace(from, to))
    };
    let cases = [
        (
            changed("-0.1,2,3", "-0.1,2"),
            "line 3: 4 cells below 5 titles",
        ),
        (
            changed("-0.1,2,3", "-0.1,2,3,"),
            "line 3: 6 cells below 5 titles",
        ),
        (
            changed("-0.1,2,3", "-0.1,\n"),
            "line 3: 4 cells below 5 titles",
        ),
        (
            changed("0.1,-0.1", "0.1,\"-0.1"),
            "line 3: a cell of several lines; a quote (\") may be opened and not closed",
        ),
        (
            changed("tau_elbow", "\"tau_elbow"),
            "line 1: a cell of several lines; a quote (\") may be opened and not closed",
        ),
        (
            changed("-0.2", "-0.2 rad"),
            "line 4 column \"q_elbow\": \"-0.2 rad\" is not a number",
        ),
        (
            changed("-0.2", "\"-0,2\""),
            "line 4 column \"q_elbow\": \"-0,2\" is not a number",
        ),
        (
            changed("-0.3", ""),
            "line 5 column \"q_elbow\": empty or NaN",
        ),
        (
            changed("-0.3", "NaN"),
            "line 5 column \"q_elbow\": empty or NaN",
        ),
        (
            changed("-0.3", "-inf"),
            "line 5 column \"q_elbow\": -inf is not finite",
        ),
        (
            changed("-0.3", "1e999"),
            "line 5 column \"q_elbow\": inf is not finite",
        ),
        (
            changed("100.02,", ","),
            "line 4 column \"time\": \"\" is not a finite number",
        ),
        (
            changed("100.02", "100020000000000"),
            "line 4 column \"time\": 100020000000000 s is beyond",
        ),
        (
            changed("100.02", "100.01"),
            "line 4: time 100.01 s is not after 100.01 s of the line before it",
        ),
        (
            changed("103.02", "99"),
            "line 5: time 99 s is not after 100.02 s",
        ),
    ];
    for (error, part) in cases {
        assert!(
            error.starts_with(&format!("touch.csv {part}")),
            "{part}: {error}"
        );
    }
    let error = read(&[(
        "touch.csv",
        &[TOUCH.as_bytes(), b"104,\xff,0,0,0\n"].concat(),
    )]);
    let error = error.unwrap_err().to_string();
    assert!(
        error.ends_with("touch.csv line 7: not UTF-8 text"),
        "{error}"
    );
}

/// Each file has a clock of its own, columns of its own, and begins a sequence.
#[test]
fn files_follow_one_another() {
    let other = "q2,q1,time,tau2,tau1\n8,7,0,6,5\n8,7,0.5,6,5\n";
    let numbered = TOUCH.replace("_shoulder", "1").replace("_elbow", "2");
    let files = [("a.csv", numbered.as_bytes()), ("b.csv", other.as_bytes())];
    let (dataset, _) = read(&files).unwrap();
    assert_eq!(dataset.name, "a");
    let [_, _, c] = &dataset.sequences[..] else {
        panic!("{} sequences", dataset.sequences.len());
    };
    assert_eq!((&*c.id, &c.time[..]), ("002", &[0.0, 0.5][..]));
    assert_eq!(
        (&c.angles[0], &c.torques[1]),
        (&[7.0, 8.0][..], &[5.0, 6.0][..])
    );

    // The one that is wrong is named.
    let bad = other.replace("0.5", "0");
    let files = [("a.csv", numbered.as_bytes()), ("b.csv", bad.as_bytes())];
    let error = read(&files).unwrap_err().to_string();
    assert!(
        error.contains("b.csv line 3: time 0 s is not after"),
        "{error}"
    );
    let error = read(&[("a.csv", numbered.as_bytes()), ("b.csv", TOUCH.as_bytes())]);
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("a.csv: no joint shoulder, elbow; there are 1, 2"),
        "{error}"
    );
    let (keep, _) = write(&files);
    let error = JointLog::open(&[keep.path()], None, Clock::Header).unwrap_err();
    let part = "*.mcap: no such file; CSV files are given one by one";
    assert!(error.to_string().ends_with(part), "{error}");
    let error = read(&[("a.mcap", b""), ("b.csv", TOUCH.as_bytes())]);
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("b.csv: given beside ") && error.contains("a.mcap, which"),
        "{error}"
    );
}

/// As where times are milliseconds.
#[test]
fn samples_that_are_all_sequences_are_warned_of() {
    let text = "t,q1,q2,tau1,tau2\n0,0,0,0,1\n10,0,0,0,1\n20,0,0,0,1\n";
    let (dataset, warnings) = recorded(text).unwrap();
    assert_eq!(dataset.sequences.len(), 3);
    assert!(
        warnings.iter().any(|w| matches!(
            w,
            DataWarning::SingleSamples {
                count: 3,
                sequences: 3,
                gap: 1.0,
                ..
            }
        )),
        "{warnings:?}"
    );
    let (_keep, paths) = write(&[("a.csv", text.as_bytes())]);
    let log = JointLog::open(&paths, None, Clock::Header).unwrap();
    let (dataset, warnings) = recording(&log, Some(10.0)).unwrap();
    assert_eq!((dataset.sequences.len(), warnings), (1, vec![]));

    // Poses a second apart, or a little more.
    let rows = (0..10).map(|k| format!("{},0,0,0,1\n", f64::from(k) + 0.1 * f64::from(k % 3)));
    let text_of_poses = format!("t,q1,q2,tau1,tau2\n{}", rows.collect::<String>());
    let (dataset, warnings) = recorded(&text_of_poses).unwrap();
    let count = dataset.sequences.len();
    assert!((6..10).contains(&count));
    assert!(
        warnings.iter().any(
            |w| matches!(w, DataWarning::SingleSamples { count: 10, sequences, .. } if *sequences == count)
        ),
        "{warnings:?}"
    );

    // Of one file among others, too.
    let seconds = "t,q1,q2,tau1,tau2\n0,0,0,0,1\n0.1,0.5,0,0,1\n0.2,0.7,0,0,1\n";
    let (_keep, paths) = write(&[("a.csv", seconds.as_bytes()), ("b.csv", text.as_bytes())]);
    let log = JointLog::open(&paths, None, Clock::Header).unwrap();
    let (dataset, warnings) = recording(&log, None).unwrap();
    assert_eq!(dataset.sequences.len(), 4);
    let of_second = |w: &DataWarning| matches!(w, DataWarning::SingleSamples { path, count: 3, .. } if path.ends_with("b.csv"));
    assert!(warnings.iter().any(of_second), "{warnings:?}");
}

#[test]
fn times_may_be_as_far_apart_as_they_come() {
    let (_keep, paths) = write(&[("a.csv", b"t,q1,q2,tau1,tau2\n-4e9,0,0,0,1\n4e9,0,0,0,1\n")]);
    let log = JointLog::open(&paths, None, Clock::Header).unwrap();
    let (dataset, _) = recording(&log, Some(1e300)).unwrap();
    assert_eq!(dataset.sequences[0].time, [0.0, 8e9]);
}

#[test]
fn topics_and_times_of_logging_are_of_mcap() {
    let (_keep, paths) = write(&[("a.csv", TOUCH.as_bytes())]);
    for (topic, clock, what) in [
        (Some("/x"), Clock::Header, "topic"),
        (None, Clock::Log, "clock"),
    ] {
        let error = JointLog::open(&paths, topic, clock).unwrap_err();
        assert!(error.to_string().starts_with(what), "{error}");
        assert!(matches!(error, DataError::Argument { .. }), "{error:?}");
    }
}

/// Other separators than commas are told from titles that are missing.
#[test]
fn separators_are_told() {
    for (text, hint) in [
        ("t;q1;tau1\n0;0;0\n", "separate them by commas"),
        ("t\tq1\ttau1\n0\t0\t0\n", "call a file with tabs .tsv"),
        (
            "# by a logger\nt,q1,tau1\n0,0,0\n",
            "stand in the first line",
        ),
    ] {
        let error = recorded(text).unwrap_err().to_string();
        assert!(error.contains(hint), "{error}");
    }
}
