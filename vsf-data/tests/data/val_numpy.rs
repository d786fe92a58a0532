//! Files that NumPy wrote (tests/golden/numpy/make.py) read as the numbers that went in.

use crate::common;

use common::{Folder, f8, golden};
use std::fs;
use std::path::Path;
use vsf_data::{DataError, DataWarning, NpyError, StiffnessField};

const VALUES: [f64; 12] = [
    0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 100.0, 7.0, 127.0, 9.0, 10.0, 11.0,
];

/// A field folder of four points whose feature `x` is the fixture.
fn with_feature(fixture: &Path) -> Result<(StiffnessField, Vec<DataWarning>), DataError> {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    write("points.npy", &f8("(4, 3)", &VALUES));
    write("K.npy", &f8("(4,)", &[1.0, 2.0, 3.0, 4.0]));
    write("x.npy", &fs::read(fixture).unwrap());
    StiffnessField::open(folder.path())
}

#[test]
fn every_dtype_in_both_orders() {
    for dtype in [
        "f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8",
    ] {
        for order in ["c", "f"] {
            let name = format!("{dtype}_{order}.npy");
            let (field, warnings) = with_feature(&golden(&name)).unwrap();
            assert_eq!(field.features["x"].data(), VALUES, "{name}");
            assert_eq!(warnings, []);
        }
    }
}

#[test]
fn truth_values_are_zeros_and_ones() {
    let (field, warnings) = with_feature(&golden("bool.npy")).unwrap();
    assert_eq!(field.features["x"].data(), [1.0, 0.0, 0.0, 1.0]);
    assert_eq!(warnings, []);
    // No angle, torque or stiffness is true.
    let folder = Folder::new();
    folder.write("seq_2/angles.npy", &fs::read(golden("bool.npy")).unwrap());
    assert!(matches!(
        folder.error().0,
        DataError::Npy {
            source: NpyError::Dtype(_),
            ..
        }
    ));
}

#[test]
fn fortran_order_of_three_axes() {
    let (field, _) = with_feature(&golden("cube_f.npy")).unwrap();
    let expected: Vec<f64> = (0..24).map(f64::from).collect();
    assert_eq!(field.features["x"].cols(), 6);
    assert_eq!(field.features["x"].data(), expected);
}

#[test]
fn versions_2_and_3() {
    for version in [2, 3] {
        let (field, _) = with_feature(&golden(&format!("version_{version}.npy"))).unwrap();
        assert_eq!(field.features["x"].data(), VALUES);
    }
}

#[test]
fn half_floats_bit_by_bit() {
    // Against the definition: every finite half, as a file of 65536 - 2048 numbers.
    let halves: Vec<u16> = (0..=u16::MAX).filter(|h| h & 0x7c00 != 0x7c00).collect();
    let data: Vec<u8> = halves.iter().flat_map(|h| h.to_le_bytes()).collect();
    let folder = tempfile::tempdir().unwrap();
    let n = halves.len();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    write("points.npy", &f8(&format!("({n}, 3)"), &vec![0.0; 3 * n]));
    write("K.npy", &common::npy("<f2", &format!("({n},)"), &data));
    let (field, _) = StiffnessField::open(folder.path()).unwrap();
    for (h, value) in halves.iter().zip(field.stiffness) {
        let (exponent, fraction) = (i32::from(h >> 10 & 31), f64::from(h & 1023));
        let magnitude = match exponent {
            0 => fraction / 1024.0 * 2f64.powi(-14),
            e => (1.0 + fraction / 1024.0) * 2f64.powi(e - 15),
        };
        assert_eq!(value.abs(), magnitude);
        assert_eq!(value.is_sign_negative(), h >> 15 == 1);
    }
}

#[test]
fn half_floats_that_are_not_finite_are_seen() {
    // -0, the smallest halves, -65504 and 0.1 pass; the infinity behind them does not.
    let folder = Folder::new();
    let bytes = fs::read(golden("special_f2.npy")).unwrap();
    folder.write("seq_2/time.npy", &bytes);
    let (error, text) = folder.error();
    assert!(matches!(error, DataError::Rows { .. }), "{error:?}");
    assert!(text.contains("6 rows"), "{text}");
    folder.write("points.npy", &f8("(6, 3)", &[0.0; 18]));
    folder.remove("seq_2/time.npy");
    folder.write("field/points.npy", &f8("(6, 3)", &[0.0; 18]));
    folder.write("field/K.npy", &bytes);
    let (_, text) = folder.error();
    assert!(text.contains("field/K.npy row 4: inf"), "{text}");
}

#[test]
fn what_is_not_numbers_is_refused() {
    let npy = |name: &str| match with_feature(&golden(name)) {
        Err(DataError::Npy { source, path }) => {
            assert!(path.ends_with("x.npy"));
            source
        }
        other => panic!("{name}: {other:?}"),
    };
    assert_eq!(npy("object.npy"), NpyError::Object);
    assert_eq!(npy("big_endian.npy"), NpyError::BigEndian(">f8".to_owned()));
    assert_eq!(npy("beyond_2_53.npy"), NpyError::Inexact { index: 1 });
    for name in ["complex.npy", "structured.npy"] {
        let (field, warnings) = with_feature(&golden(name)).unwrap();
        assert!(field.features.is_empty());
        assert!(
            matches!(warnings[..], [DataWarning::Ignored { .. }]),
            "{name}"
        );
        // In the place of a required array it is an error.
        let folder = Folder::new();
        folder.write("seq_2/angles.npy", &fs::read(golden(name)).unwrap());
        let (error, _) = folder.error();
        let dtype = matches!(
            &error,
            DataError::Npy {
                source: NpyError::Dtype(_),
                ..
            }
        );
        assert!(dtype, "{error:?}");
    }
}

#[test]
fn archives() {
    let (field, warnings) = StiffnessField::open(golden("plain.npz")).unwrap();
    assert_eq!(field.points.len(), 4);
    assert_eq!(field.points[2].y, 7.0);
    assert_eq!(field.stiffness, [1.0, 2.0, 3.0, 4.0]);
    assert_eq!(field.features["N_obs"].data(), [0.0, 1.0, 2.0, 3.0]);
    assert_eq!((field.sd, warnings), (None, vec![]));

    // Deflated, K of shape (N, 1), and a K_std that nobody marked.
    let (field, warnings) = StiffnessField::open(golden("compressed.npz")).unwrap();
    assert_eq!(field.stiffness, [1.0, 2.0, 3.0, 4.0]);
    assert_eq!(field.sd, None);
    assert!(matches!(
        warnings[..],
        [DataWarning::UnmarkedDeviation { .. }]
    ));
}

#[test]
fn archives_of_openvsf_with_pickles_or_axes() {
    let refused = |name: &str| StiffnessField::open(golden(name)).unwrap_err();
    let error = refused("openvsf.npz");
    assert!(matches!(error, DataError::PickledFeatures { .. }));
    assert!(
        error.to_string().contains("np.savez(g, points=z['points']"),
        "{error}"
    );
    for (name, mode, shape) in [
        ("axis_aligned.npz", "axis_aligned", vec![4, 3]),
        ("anisotropic.npz", "anisotropic", vec![4, 3, 3]),
    ] {
        let DataError::AxisMode {
            axis_mode,
            got,
            points,
            ..
        } = refused(name)
        else {
            panic!("{name}");
        };
        assert_eq!((axis_mode.as_str(), got, points), (mode, shape, 4));
    }
}
