//! Every contact model keeps the promises of `vsf_core::ContactModel`.

use crate::common;

use nalgebra::Point3;
use vsf_contact::{
    CellContact, Cells, ContactConfig, GridOptions, GridSdf, MeshSdf, StickSlip, link_sdfs,
};
use vsf_core::{ContactModel, Posture, RestPoints, TriMesh};
use vsf_robots::{RobotModel, kinova_gen3, planar_arm};
use vsf_testkit::{check_contact, check_sdf};

/// A block of 6 x 6 x 4 points, 1 cm apart, from `corner` on.
fn block(corner: [f64; 3]) -> RestPoints {
    let at = |i: i32| {
        let [x, y, z] = [i % 6, i / 6 % 6, i / 36].map(f64::from);
        Point3::from(corner) + 0.01 * Point3::new(x, y, z).coords
    };
    RestPoints::new((0..144).map(at).collect()).unwrap()
}

fn path(robot: &RobotModel, q: impl Fn(f64) -> Vec<f64>) -> Vec<Posture> {
    let at = |k: i32| {
        let mut posture = robot.posture();
        let q = q((0.2 * f64::from(k)).sin());
        robot.update_posture(&q, &mut posture).unwrap();
        posture
    };
    (0..32).map(at).collect()
}

fn check(robot: &RobotModel, rest: &RestPoints, path: &[Posture]) {
    let links = link_sdfs(robot.colliders(), &Default::default()).unwrap();
    let links: std::sync::Arc<[_]> = links.links.into();
    for config in [
        ContactConfig::default(),
        ContactConfig {
            friction: 0.6,
            adhesion: 0.003,
            parallel: true,
            ..ContactConfig::default()
        },
    ] {
        let points = || StickSlip::new(links.clone(), config).unwrap();
        check_contact(points, rest, path);
        let cells = Cells::new(rest, 0.01, 2).unwrap();
        check_contact(|| CellContact::new(points(), cells.clone()), rest, path);
        check_contact(|| Box::new(points()) as Box<dyn ContactModel>, rest, path);
    }
}

#[test]
fn the_planar_arm_conforms() {
    let robot = planar_arm(2, 0.3, 0.03).unwrap();
    let swing = |s: f64| vec![0.3 * s, 0.4 - 0.3 * s];
    check(&robot, &block([0.45, -0.03, 0.08]), &path(&robot, swing));
}

#[test]
fn the_gen3_conforms() {
    let robot = kinova_gen3().unwrap();
    let push = |s: f64| {
        let start = [-0.1722, 0.7707, 3.3871, -2.0982, -0.5440, -0.3332, 0.5249];
        let end = [-0.2159, 0.9687, 3.5203, -1.5222, -0.4679, -0.7417, 0.3624];
        let q = start.iter().zip(end).map(|(a, b)| a + s * (b - a));
        q.collect()
    };
    check(&robot, &block([0.50, -0.03, 0.2]), &path(&robot, push));
}

/// Meshes: exact, and baked into a grid.
#[test]
fn meshes_and_their_grids_conform() {
    let (vertices, triangles) = common::cube(0.04);
    for mesh in [
        common::ball(0.05, 2),
        TriMesh::new(vertices, triangles).unwrap(),
    ] {
        check_sdf(&MeshSdf::new(&mesh).unwrap());
        check_sdf(&GridSdf::bake(&mesh, &GridOptions::default()).unwrap().0);
    }
}
