//! Torque pictures against what must be readable in them.

use vsf_plot::{JointTrace, TorquePlot};

fn time(n: usize) -> Vec<f64> {
    (0..n).map(|i| 1e-3 * i as f64).collect()
}

#[test]
fn one_panel_per_joint_with_its_error_and_unit() {
    let time = time(500);
    let measured: Vec<f64> = time.iter().map(|t| (9.0 * t).sin()).collect();
    let predicted: Vec<f64> = measured.iter().map(|tau| tau - 0.25).collect();
    for count in [1, 2, 7, 8, 9, 16, 17, 32] {
        let names: Vec<String> = (1..=count).map(|k| format!("axis-{k}.")).collect();
        let joints: Vec<_> = names
            .iter()
            .map(|name| JointTrace {
                name,
                unit: "N",
                measured: &measured,
                predicted: &predicted,
                ..JointTrace::default()
            })
            .collect();
        let svg = TorquePlot {
            time: &time,
            joints: &joints,
            ..TorquePlot::default()
        };
        let svg = svg.svg().unwrap();
        for name in &names {
            let title = format!("{name} [N], RMS error 0.250 N");
            assert!(svg.contains(&title), "{title}");
        }
        // Shared time axis: one label per column of panels.
        let columns = if count <= 8 {
            1
        } else if count <= 16 {
            2
        } else {
            4
        };
        assert_eq!(svg.matches("time [s]").count(), columns);
        assert_eq!(svg.matches("<polygon").count(), 0, "no band without sigma");
        assert!(!svg.contains("contact"));
    }
}

#[test]
fn long_recordings_stay_small_and_keep_the_error() {
    let n = 100_000;
    let time = time(n);
    let measured: Vec<f64> = (0..n)
        .map(|i| if i % 2 == 0 { 1.0 } else { -1.0 })
        .collect();
    let predicted = vec![0.0; n];
    let sigma = vec![0.5; n];
    let contact: Vec<bool> = (0..n).map(|i| i % 3 == 0).collect();
    let joint = JointTrace {
        name: "j",
        measured: &measured,
        predicted: &predicted,
        sigma: &sigma,
        ..JointTrace::default()
    };
    let joints = [joint; 7];
    let plot = TorquePlot {
        time: &time,
        joints: &joints,
        contact: &contact,
        title: "long",
    };
    let svg = plot.svg().unwrap();
    assert!(svg.len() < 2_000_000, "{} bytes", svg.len());
    assert_eq!(svg.matches("RMS error 1.00 N m").count(), 7);
    assert_eq!(svg.matches("<polygon").count(), 7);
    assert!(svg.contains("contact") && svg.contains("1 sigma"));
    assert_eq!(svg, plot.svg().unwrap());
}

#[test]
fn odd_ranges_are_drawn() {
    for (time, values) in [
        (vec![3.0], vec![0.0]),
        (vec![0.0, 0.0, 0.0], vec![1.0, 1.0, 1.0]),
        (vec![1e9, 1e9], vec![1e9, -1e9]),
        (vec![-1e9, 1e9], vec![1e-300, -1e-300]),
        (vec![0.0, 1e-12], vec![1e9, 1e9 - 1e-6]),
    ] {
        let joints = [JointTrace {
            measured: &values,
            predicted: &values,
            sigma: &values.iter().map(|v| v.abs()).collect::<Vec<_>>(),
            ..JointTrace::default()
        }];
        let contact = vec![true; time.len()];
        let plot = TorquePlot {
            time: &time,
            joints: &joints,
            contact: &contact,
            title: "",
        };
        let svg = plot.svg().unwrap();
        assert!(svg.contains("RMS error 0 N m"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }
}

#[test]
fn names_cannot_break_the_file() {
    let plot = TorquePlot {
        time: &[0.0, 1.0],
        joints: &[JointTrace {
            name: "<script>&\"\u{0}\u{1b}",
            measured: &[0.0, 1.0],
            predicted: &[0.0, 1.0],
            ..JointTrace::default()
        }],
        title: "</svg>",
        ..TorquePlot::default()
    };
    let svg = plot.svg().unwrap();
    assert_eq!(svg.matches("</svg>").count(), svg.matches("<svg").count());
    assert!(!svg.contains("<script>") && !svg.contains(['\u{0}', '\u{1b}']));
}
