//! Meshes of the Kinova Gen3's links against numbers made by other software (`golden/README.md`).
//!
//! The meshes are the vendor's and not part of this repository: without them the tests skip.

use nalgebra::Point3;
use ndarray::{Array1, Array2};
use ndarray_npy::NpzReader;
use std::fs::File;
use std::io::Write;
use std::path::Path;
use vsf_contact::{GridOptions, GridSdf, MeshSdf, Sdf};
use vsf_core::TriMesh;

const LINKS: [&str; 8] = [
    "base_link",
    "shoulder_link",
    "half_arm_1_link",
    "half_arm_2_link",
    "forearm_link",
    "spherical_wrist_1_link",
    "spherical_wrist_2_link",
    "bracelet_no_vision_link",
];

struct Reference {
    point: Point3<f64>,
    distance: f64,
    winding: f64,
}

impl Reference {
    fn side_is_sure(&self) -> bool {
        self.winding < 0.1 || self.winding > 0.9
    }
}

fn mesh(link: &str) -> Option<TriMesh> {
    let folder =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/kinova_gen3/kinova_gen3");
    let path = folder.join(format!("{link}.stl"));
    let Ok(mut file) = File::open(&path) else {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED {link}: no mesh at {}",
            path.display()
        );
        return None;
    };
    let stl = stl_io::read_stl(&mut file).unwrap();
    let vertices = stl
        .vertices
        .iter()
        .map(|v| Point3::from(v.0.map(f64::from)))
        .collect();
    let faces = stl
        .faces
        .iter()
        .map(|f| f.vertices.map(|i| i as u32))
        .collect();
    Some(TriMesh::new(vertices, faces).unwrap())
}

fn references(link: &str) -> Vec<Reference> {
    let path = format!("{}/tests/golden/sdf.npz", env!("CARGO_MANIFEST_DIR"));
    let mut npz = NpzReader::new(File::open(path).unwrap()).unwrap();
    let points: Array2<f64> = npz.by_name(&format!("{link}/points")).unwrap();
    let distances: Array1<f64> = npz.by_name(&format!("{link}/sd")).unwrap();
    let windings: Array1<f64> = npz.by_name(&format!("{link}/winding")).unwrap();
    (0..points.nrows())
        .map(|i| Reference {
            point: Point3::new(points[[i, 0]], points[[i, 1]], points[[i, 2]]),
            distance: distances[i],
            winding: windings[i],
        })
        .collect()
}

#[test]
fn exact_distances_and_winding_numbers_agree() {
    for link in LINKS {
        let Some(mesh) = mesh(link) else { continue };
        let sdf = MeshSdf::new(&mesh).unwrap();
        let mut at_sheet = 0;
        for r in references(link) {
            let (d, w) = (sdf.distance(&r.point), sdf.winding_number(&r.point));
            assert!(
                (w - r.winding).abs() < 0.02,
                "{link} {}: {w} not {}",
                r.point,
                r.winding
            );
            // The sheet over an opening may be nearer than the mesh, never farther.
            assert!(d.abs() <= r.distance.abs() + 1e-6, "{link} {}", r.point);
            if d.abs() < r.distance.abs() - 1e-6 {
                at_sheet += 1;
                let deep = r.distance.abs() > 0.01;
                assert!(
                    !r.side_is_sure() || deep,
                    "{link} {}: {d} {}",
                    r.point,
                    r.distance
                );
            }
            if r.side_is_sure() {
                assert_eq!(d > 0.0, r.distance > 0.0, "{link} {}", r.point);
            }
        }
        eprintln!("{link}: {at_sheet} of 200 points nearer to an opening than to the mesh");
    }
}

/// Errors of a grid at the reference points within 1 cm whose side is sure.
fn grid_errors(link: &str, mesh: &TriMesh, options: &GridOptions) -> Vec<f64> {
    let (grid, report) = GridSdf::bake(mesh, options).unwrap();
    assert!(report.reached, "{link}: {report:?}");
    let near = |r: &Reference| r.side_is_sure() && r.distance.abs() < 0.01;
    let errors: Vec<f64> = references(link)
        .iter()
        .filter(|r| near(r))
        .map(|r| (grid.distance(&r.point) - r.distance).abs())
        .collect();
    let max = errors.iter().fold(0.0f64, |m, e| m.max(*e));
    eprintln!(
        "{link}: {} points, max error {max:.2e} m, {report:?}",
        errors.len()
    );
    errors
}

#[test]
fn default_grids_stay_within_half_a_millimeter() {
    let errors: Vec<f64> = LINKS
        .iter()
        .filter_map(|link| Some(grid_errors(link, &mesh(link)?, &GridOptions::default())))
        .flatten()
        .collect();
    for error in errors {
        assert!(error < 0.5e-3, "{error}");
    }
}
