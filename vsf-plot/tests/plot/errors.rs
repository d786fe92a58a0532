//! Input that cannot be drawn is refused with its place; odd but valid input is drawn.

use nalgebra::Point3;
use vsf_plot::{ColorLimit, FieldView, JointTrace, PlotError, TorquePlot};

fn point(x: f64, y: f64, z: f64) -> Point3<f64> {
    Point3::new(x, y, z)
}

fn refused(view: FieldView<'_>) -> PlotError {
    let (png, svg) = (view.png().unwrap_err(), view.svg().unwrap_err());
    assert_eq!(png.to_string(), svg.to_string());
    png
}

#[test]
fn field_errors_name_the_place() {
    let points_W = vec![point(0.0, 0.0, 0.0); 3];
    let good = FieldView {
        points_W: &points_W,
        stiffness: &[1.0; 3],
        ..FieldView::default()
    };

    assert_eq!(
        refused(FieldView::default()),
        PlotError::Empty {
            what: "points_W".into()
        }
    );
    fn message(view: FieldView<'_>) -> String {
        refused(view).to_string()
    }
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..3 {
            let mut points_W = points_W.clone();
            points_W[2][axis] = bad;
            let text = message(FieldView {
                points_W: &points_W,
                ..good
            });
            assert!(text.starts_with("points_W[2] is"), "{text}");
            let text = message(FieldView {
                context_W: &points_W,
                ..good
            });
            assert!(text.starts_with("context_W[2] is"), "{text}");
            let robot_W = [vec![], points_W];
            let text = message(FieldView {
                robot_W: &robot_W,
                ..good
            });
            assert!(text.starts_with("robot_W[1][2] is"), "{text}");
        }
        let text = message(FieldView {
            stiffness: &[0.0, bad, 0.0],
            ..good
        });
        assert!(text.starts_with("stiffness[1] is"), "{text}");
    }
    for bad in [-1e-9, 1e16] {
        let got = refused(FieldView {
            stiffness: &[0.0, 0.0, bad],
            ..good
        });
        assert!(
            matches!(got, PlotError::OutOfRange { index: 2, .. }),
            "{got}"
        );
    }
    let got = refused(FieldView {
        context_W: &[point(0.0, -2e6, 0.0)],
        ..good
    });
    assert!(
        matches!(got, PlotError::OutOfRange { index: 0, .. }),
        "{got}"
    );

    fn length(view: FieldView<'_>) {
        assert!(matches!(refused(view), PlotError::Length { .. }));
    }
    length(FieldView {
        stiffness: &[1.0; 2],
        ..good
    });
    length(FieldView {
        touched: &[true; 4],
        ..good
    });
    length(FieldView {
        context_W: &points_W,
        context_colors: &[[0; 3]],
        ..good
    });
    length(FieldView {
        context_colors: &[[0; 3]],
        ..good
    });

    fn parameter(view: FieldView<'_>) {
        assert!(matches!(refused(view), PlotError::Parameter { .. }));
    }
    parameter(FieldView {
        azimuth_deg: f64::NAN,
        ..good
    });
    parameter(FieldView {
        elevation_deg: 90.0,
        ..good
    });
    parameter(FieldView {
        elevation_deg: f64::NAN,
        ..good
    });
    parameter(FieldView {
        limit: ColorLimit::Value(-1.0),
        ..good
    });
    parameter(FieldView {
        limit: ColorLimit::Quantile(2.0),
        ..good
    });
}

#[test]
fn odd_fields_are_drawn() {
    let clouds = [
        vec![point(0.1, 0.2, 0.3)],
        vec![point(0.1, 0.2, 0.3); 50],
        vec![point(-1e6, 1e6, 0.0), point(1e6, -1e6, 1e6)],
        vec![point(1e6, 1e6, 1e6), point(1e6, 1e6, 1e6 - 1e-9)],
        vec![point(0.0, 0.0, 0.0), point(1e-300, 0.0, 0.0)],
        vec![point(0.0, 0.0, 0.0), point(0.0, 0.0, 1.0)],
    ];
    for (k, points_W) in clouds.iter().enumerate() {
        for (v, values) in [[0.0, 0.0], [1e15, 1e-300], [5e-324, 5e-324], [0.0, 1e15]]
            .into_iter()
            .enumerate()
        {
            let stiffness: Vec<f64> = (0..points_W.len()).map(|i| values[i % 2]).collect();
            let robot_W = [
                vec![],
                vec![point(0.0, 0.0, 0.0)],
                vec![point(-1e6, 0.0, 0.0), point(1e6, 0.0, 1e6)],
            ];
            let view = FieldView {
                points_W,
                stiffness: &stiffness,
                robot_W: &robot_W,
                title: "<odd> & \"quoted\" \u{0}\u{7} Ω 漢",
                azimuth_deg: 1234.5,
                elevation_deg: 85.0,
                ..FieldView::default()
            };
            if k == 0 || v == 1 {
                assert_eq!(&view.png().unwrap()[1..4], b"PNG");
            }
            let svg = view.svg().unwrap();
            assert!(!svg.contains("NaN") && !svg.contains("<odd>"));
            assert!(!svg.contains(['\u{0}', '\u{7}']));
        }
    }
}

#[test]
fn torque_errors_name_the_place() {
    let good = JointTrace {
        measured: &[0.0; 3],
        predicted: &[0.0; 3],
        ..JointTrace::default()
    };
    let time = [0.0, 1.0, 2.0];
    let refused = |time: &[f64], joints: &[JointTrace<'_>], contact: &[bool]| {
        TorquePlot {
            time,
            joints,
            contact,
            title: "",
        }
        .svg()
        .unwrap_err()
    };
    assert_eq!(
        refused(&[], &[good], &[]),
        PlotError::Empty {
            what: "time".into()
        }
    );
    assert_eq!(
        refused(&time, &[], &[]),
        PlotError::Empty {
            what: "joints".into()
        }
    );
    assert!(matches!(
        refused(&time, &[good; 33], &[]),
        PlotError::TooMany {
            got: 33,
            max: 32,
            ..
        }
    ));
    assert_eq!(
        refused(&[0.0, 2.0, 1.0], &[good], &[]),
        PlotError::TimeOrder {
            index: 2,
            value: 1.0,
            previous: 2.0
        }
    );
    let message = |joint: JointTrace<'_>| refused(&time, &[good, joint], &[]).to_string();
    let bad = [0.0, f64::NAN, 0.0];
    for (field, joint) in [
        (
            "measured",
            JointTrace {
                measured: &bad,
                ..good
            },
        ),
        (
            "predicted",
            JointTrace {
                predicted: &bad,
                ..good
            },
        ),
        (
            "sigma",
            JointTrace {
                sigma: &bad,
                ..good
            },
        ),
    ] {
        let text = message(joint);
        assert!(
            text.starts_with(&format!("joints[1].{field}[1] is NaN")),
            "{text}"
        );
    }
    assert!(
        message(JointTrace {
            sigma: &[0.0, 0.0, -0.1],
            ..good
        })
        .contains("sigma[2]")
    );
    assert!(
        message(JointTrace {
            measured: &[1e10; 3],
            ..good
        })
        .contains("measured[0]")
    );
    assert!(
        message(JointTrace {
            measured: &[],
            ..good
        })
        .contains("length 0, expected 3")
    );
    assert!(
        message(JointTrace {
            sigma: &[0.0],
            ..good
        })
        .contains("length 1, expected 3")
    );
    assert!(matches!(
        refused(&time, &[good], &[true]),
        PlotError::Length { .. }
    ));
    assert!(matches!(
        refused(&[0.0, f64::NAN, 1.0], &[good], &[]),
        PlotError::NotFinite { .. }
    ));
}
