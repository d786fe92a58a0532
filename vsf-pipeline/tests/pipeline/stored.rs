//! What an estimate stores, its field says; what no estimate has is refused.

use nalgebra::Point3;
use vsf_core::Belief;
use vsf_data::{Dataset, RobotRef, Sequence, StiffnessField, Table};
use vsf_pipeline::{Estimate, Hyper, PriorShape, Scene, SceneOptions, StoredEstimate};

fn scene(points: usize) -> Scene {
    let table = |x: [f64; 3]| Table::new(3, x.repeat(2)).unwrap();
    let sequence = Sequence::new(
        "000".to_owned(),
        vec![0.0, 0.1],
        table([0.1, 0.2, 0.3]),
        table([0.0; 3]),
    );
    let robot = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
    let at = |i: usize| Point3::new(3.0, 0.0, 0.01 * i as f64);
    let dataset = Dataset {
        rest_points: Some((0..points).map(at).collect()),
        ..Dataset::new(robot, vec![sequence])
    };
    Scene::open(&dataset, &SceneOptions::default()).unwrap()
}

fn estimate() -> Estimate {
    Estimate {
        belief: Belief::new(vec![1.0, 0.0, 7.0], vec![4.0, 9.0, 0.25]).unwrap(),
        touched: vec![true, false, true],
        health: Default::default(),
    }
}

fn hyper() -> Hyper {
    Hyper {
        prior_sd: 3.0,
        shape: PriorShape::independent(),
        noise_sd: vec![0.1, 0.2, 0.3],
    }
}

#[test]
fn what_is_stored_is_read_back() {
    let scene = scene(3);
    let field = estimate().to_field(&scene, &hyper(), "touch", &[]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.npz");
    field.save_npz(&path).unwrap();
    let (read, warnings) = StiffnessField::open(&path).unwrap();
    assert!(warnings.is_empty());
    assert_eq!(read, field);
    assert_eq!(read.learned_from, Some(Vec::new()));
    let stored = StoredEstimate::of(&read).unwrap();
    assert_eq!(stored.belief, estimate().belief);
    assert_eq!(stored.touched, estimate().touched);
    assert_eq!(stored.prior_sd, Some(3.0));
    assert!(stored.has_deviations());
    assert_eq!(stored.noise_sd(3).unwrap(), Some(vec![0.1, 0.2, 0.3]));
    let wrong = stored.noise_sd(4).unwrap_err().to_string();
    assert!(wrong.contains("noise_sd is of 3 channels"), "{wrong}");
}

#[test]
fn an_estimate_of_other_points_is_not_stored() {
    let error = estimate().to_field(&scene(4), &hyper(), "touch", &[]);
    assert!(error.unwrap_err().to_string().contains("3 points"));
}

#[test]
fn fields_that_say_little_are_fields_all_the_same() {
    let bare = StiffnessField {
        points: vec![Point3::origin()],
        stiffness: vec![5.0],
        ..StiffnessField::default()
    };
    let stored = StoredEstimate::of(&bare).unwrap();
    assert_eq!(stored.belief.mean(), [5.0]);
    assert!(stored.touched.is_empty() && stored.prior_sd.is_none() && !stored.has_deviations());
    assert_eq!(stored.noise_sd(7).unwrap(), None);
    assert!(StoredEstimate::of(&StiffnessField::default()).is_ok());
}

#[test]
fn what_no_estimate_has_is_named() {
    let good = estimate()
        .to_field(&scene(3), &hyper(), "touch", &[])
        .unwrap();
    let with = |name: &str, cols: usize, numbers: &[f64]| {
        let mut field = good.clone();
        let table = Table::new(cols, numbers.to_vec()).unwrap();
        field.features.insert(name.to_owned(), table);
        StoredEstimate::of(&field).unwrap_err().to_string()
    };
    for (error, expected) in [
        (with("touched", 1, &[0.0, 0.5, 1.0]), "touched row 1 is 0.5"),
        (with("touched", 2, &[0.0; 6]), "touched has 2 columns"),
        (
            with("prior_sd", 1, &[1.0, 1.0, 2.0]),
            "prior_sd row 2 is [2.0]",
        ),
        (with("prior_sd", 1, &[0.0; 3]), "prior_sd is 0.0"),
        (with("noise_sd", 1, &[-1.0; 3]), "noise_sd is -1.0"),
    ] {
        assert!(error.contains(expected), "{error}");
    }
    let negative = StiffnessField {
        stiffness: vec![1.0, -1.0, 0.0],
        ..good
    };
    let error = StoredEstimate::of(&negative).unwrap_err().to_string();
    assert!(error.contains("K row 1 is -1.0"), "{error}");
}
