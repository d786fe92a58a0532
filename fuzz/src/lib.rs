//! What the fuzz targets share: files to read, numbers to draw, a small world to touch.

#![forbid(unsafe_code)]

use libfuzzer_sys::arbitrary::{Result, Unstructured};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};
use tempfile::TempDir;
use vsf::contact::GridOptions;
use vsf::core::nalgebra::{Isometry3, Point3, Vector3};
use vsf::core::{Belief, CoreError, RestPoints, TriMesh};
use vsf::data::{
    CameraView, ContactParameters, Dataset, JointLog, Overrides, RobotRef, Sequence, Splits,
    StiffnessField, Table, TorqueKind,
};
use vsf::filter::{
    CovarianceFilter, DiagonalKalman, DualReplay, MemoryReplay, ReplayConfig, RobustLoss,
    RobustNoise,
};
use vsf::gap::Site;
use vsf::robots::planar_arm;

mod world;
pub use world::{WORLD, World};

static SCRATCH: LazyLock<TempDir> =
    LazyLock::new(|| tempfile::tempdir().expect("a folder for temporary files"));

/// The folder of this process, which stays while it runs.
pub fn scratch() -> &'static Path {
    SCRATCH.path()
}

/// A file of this name with these bytes.
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    let path = scratch().join(name);
    fs::write(&path, bytes).expect("a temporary file");
    path
}

/// A number as a robot gives it, or one that it should not give.
pub fn number(u: &mut Unstructured<'_>) -> Result<f64> {
    Ok(match u.arbitrary::<u8>()? {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => f64::NEG_INFINITY,
        3 => f64::MAX,
        4 => f64::MIN_POSITIVE / 4.0,
        5 => 1e12,
        6 => -1e-12,
        7 => u.arbitrary()?,
        _ => f64::from(u.arbitrary::<i16>()?) / 8192.0,
    })
}

/// As many numbers as joints; seldom another number of them.
pub fn row(u: &mut Unstructured<'_>, joints: usize) -> Result<Vec<f64>> {
    let length = match u.arbitrary::<u8>()? {
        n @ 0..4 => usize::from(n),
        _ => joints,
    };
    (0..length).map(|_| number(u)).collect()
}

/// Joints of the arm that touches.
pub const JOINTS: usize = 3;

/// Points around the built-in planar arm with [`JOINTS`] links, some of them twice and some inside its
/// links where it starts.
pub fn points() -> Vec<Point3<f64>> {
    let lattice = (0..75).map(|i| {
        let at = |from: f64, k: usize| from + 0.03 * k as f64;
        Point3::new(at(0.5, i / 15), at(-0.06, i % 5), at(-0.03, i / 5 % 3))
    });
    let twice = [Point3::new(0.5, 0.0, 0.0); 3];
    lattice.chain(twice).collect()
}

/// The recordings that joint states make, one by file and by pauses.
pub fn recordings(log: &JointLog) {
    let given = Overrides {
        robot: RobotRef::resolve("planar_arm", Path::new(".")).ok(),
        torque_kind: Some(TorqueKind::Measured),
        ..Overrides::default()
    };
    let joints: Vec<String> = (1..=JOINTS).map(|j| format!("joint_{j}")).collect();
    for gap in [None, Some(0.5)] {
        let _ = log.recording(&given, &joints, gap);
    }
}

/// A recording of the built-in planar arm with all that a folder may hold.
pub fn recording() -> Dataset {
    let angles: Vec<f64> = (0..JOINTS * 6).map(|i| 0.01 * i as f64).collect();
    let table = Table::new(JOINTS, angles).expect("full rows");
    let time: Vec<f64> = (0..6).map(|k| 0.1 * f64::from(k)).collect();
    let sequence = |id: &str| Sequence {
        velocities: Some(table.clone()),
        touch_starts: vec![0, 3],
        tags: vec!["loaded".to_owned()],
        ..Sequence::new(id, time.clone(), table.clone(), table.clone())
    };
    let robot = RobotRef::resolve("planar_arm", Path::new(".")).expect("a built-in robot");
    Dataset {
        name: "small".to_owned(),
        rate_hz: Some(10.0),
        object_bbox: Some([Point3::new(0.0, -1.0, -1.0), Point3::new(2.0, 1.0, 1.0)]),
        tare_samples: 1,
        splits: Splits {
            train: vec!["1".to_owned()],
            test: vec!["2".to_owned()],
        },
        rest_points: Some(points()),
        field: Some(field()),
        camera: Some(CameraView {
            width: 4,
            height: 3,
            color: (0..36).collect(),
            depth: (0..12).map(|d| 999 * d).collect(),
            fx: 2.0,
            fy: 2.0,
            cx: 1.5,
            cy: 1.0,
            depth_scale: 0.001,
            X_WC: Isometry3::identity(),
            extra: Default::default(),
        }),
        ..Dataset::new(robot, vec![sequence("1"), sequence("2")])
    }
}

/// The files of [`recording`] in its folder.
pub const RECORDED: [&str; 10] = [
    "dataset.json",
    "points.npy",
    "vsf.npz",
    "camera/camera.json",
    "camera/color.png",
    "camera/depth.png",
    "seq_1/angles.npy",
    "seq_1/time.npy",
    "seq_2/torques.npy",
    "seq_2/velocities.npy",
];

/// A small field with all that a field may hold.
pub fn field() -> StiffnessField {
    let points = points();
    let numbers: Vec<f64> = (0..points.len()).map(|i| i as f64).collect();
    let column = Table::new(1, numbers.clone()).expect("full rows");
    StiffnessField {
        points,
        sd: Some(numbers.clone()),
        stiffness: numbers,
        features: [("height".to_owned(), column)].into(),
        base_pose: Some(Isometry3::translation(0.1, 0.2, 0.3)),
        recording: Some("small".to_owned()),
        learned_from: Some(vec!["1".to_owned()]),
        model: Some("latency".to_owned()),
        contact: Some(ContactParameters {
            threshold: 0.002,
            friction: 0.15,
            slip_step: 1e-4,
            max_slip_iterations: 200,
            padding: 0.0,
            adhesion: 0.0,
            subdivision: 2,
            links: Some(vec!["tip".to_owned()]),
        }),
    }
}

/// The arm of [`recording`] and what it touches, as effects see them.
pub fn site() -> Site {
    Site {
        robot: Arc::new(planar_arm(JOINTS, 0.3, 0.03).expect("an arm")),
        rest: Arc::new(RestPoints::new(points()).expect("points")),
        gravity: Vector3::new(0.0, 0.0, -9.81),
        torque_kind: TorqueKind::External,
        friction: 0.15,
        sequences: vec!["1".to_owned(), "2".to_owned()],
        duration: 10.0,
        sequence_duration: 5.0,
    }
}

/// A mesh whose grid is quickly made, and options to keep the grid in a folder.
pub fn tetrahedron(folder: &Path) -> (TriMesh, GridOptions) {
    let corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]];
    let vertices = corners.map(|c| Point3::from(c.map(|x| 0.03 * f64::from(x))));
    let faces = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let options = GridOptions {
        resolution: Some(0.02),
        margin: 0.001,
        max_nodes: 200,
        cache_dir: Some(folder.to_owned()),
        ..GridOptions::default()
    };
    let mesh = TriMesh::new(vertices.to_vec(), faces).expect("a mesh");
    (mesh, options)
}

/// The estimators whose states are saved.
pub type Plain = DiagonalKalman<f64>;
/// With replays, and robust.
pub type Replay = RobustNoise<MemoryReplay<DiagonalKalman<f64>>>;
/// With replays in dual form.
pub type Dual = DualReplay<f64>;
/// With correlations.
pub type Dense = CovarianceFilter<f64>;

/// A robust filter with replays whose buffer is small.
///
/// # Errors
/// None for a belief that is one.
pub fn replay(prior: Belief<f64>) -> std::result::Result<Replay, CoreError> {
    let config = ReplayConfig {
        replays: 3,
        byte_budget: 20_000,
        ..ReplayConfig::default()
    };
    let inner = MemoryReplay::new(DiagonalKalman::new(prior), config)?;
    RobustNoise::new(inner, RobustLoss::HUBER)
}
