//! Torques of a Kinova Gen3 pushed into 97,336 springs against OpenVSF on the same case.
//!
//! The recording and the vendor's meshes are not part of this repository: without them the test
//! skips.
//!
//! The recorded contacts stick: the peer's slip was switched off. It detects contacts below 2 mm
//! and places them 1 mm off the surface; we rest points where we detect them, at 1 mm here.

use nalgebra::Point3;
use ndarray::{Array1, Array2};
use ndarray_npy::read_npy;
use std::io::Write;
use std::path::Path;
use vsf_contact::{ContactConfig, GridOptions, StickSlip, link_sdfs};
use vsf_core::{ContactModel, Contacts, RestPoints};
use vsf_robots::{RobotModel, UrdfOptions};

const LINKS: [&str; 4] = [
    "ForeArm_Link",
    "SphericalWrist1_Link",
    "SphericalWrist2_Link",
    "Bracelet_Link",
];

#[test]
fn torques_agree_with_openvsf_within_five_percent() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let case = shared.join("peer/openvsf_case");
    let urdf = shared.join("data/kinova_gen3/kinova_gen3.urdf");
    if !case.is_dir() || !urdf.is_file() {
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: no {} or no {}",
            case.display(),
            urdf.display()
        );
        return;
    }
    let matrix = |name: &str| -> Array2<f64> { read_npy(case.join(name)).unwrap() };
    let (q, tau) = (matrix("q_traj.npy"), matrix("tau_clean.npy"));
    let stiffness: Array1<f64> = read_npy(case.join("K_true.npy")).unwrap();
    let positions: Array2<f32> = read_npy(case.join("points.npy")).unwrap();
    let positions = positions.rows().into_iter();
    let positions = positions.map(|p| Point3::new(p[0], p[1], p[2]).cast());
    let rest = RestPoints::new(positions.collect()).unwrap();

    let robot = RobotModel::from_urdf_file(&urdf, &UrdfOptions::default()).unwrap();
    let mut colliders = robot.colliders().to_vec();
    colliders.retain(|c| LINKS.contains(&robot.links()[c.link].name()));
    let options = GridOptions {
        resolution: Some(3e-3),
        ..GridOptions::default()
    };
    let links = link_sdfs(&colliders, &options).unwrap().links;
    let config = ContactConfig {
        threshold: 1e-3,
        max_slip_iterations: 0,
        ..ContactConfig::default()
    };
    let mut model = StickSlip::new(links, config).unwrap();

    let (mut posture, mut contacts) = (robot.posture(), Contacts::new());
    let (mut error, mut total) = (0.0, 0.0);
    for (q, tau) in q.rows().into_iter().zip(tau.rows()) {
        robot.update_posture(&q.to_vec(), &mut posture).unwrap();
        model.step(&rest, &posture, &mut contacts).unwrap();
        let mut predicted = vec![0.0; tau.len()];
        let mut column = vec![0.0; tau.len()];
        for k in 0..contacts.len() {
            let i = contacts.points()[k] as usize;
            let (u, link) = (contacts.displacements()[k], contacts.links()[k] as usize);
            posture.joint_torques(link, &(rest.positions()[i] + u), &-u, &mut column);
            for (sum, w) in predicted.iter_mut().zip(&column) {
                *sum += w * stiffness[i];
            }
        }
        for (ours, theirs) in predicted.iter().zip(tau) {
            error += (ours - theirs).powi(2);
            total += theirs.powi(2);
        }
    }
    let relative = f64::sqrt(error / total);
    println!("relative RMS {relative:.4}, {} contacts", contacts.len());
    assert!(relative < 0.05, "{relative}");
}
