//! `vsf points`: rest points from what a depth camera saw.

use crate::common::Bench;
use serde_json::Value;
use std::path::Path;
use vsf::core::RestPoints;
use vsf::core::nalgebra::{Point3, Vector3, distance};
use vsf::data::read_points;

/// A plant with a camera/, whose points.npy was made by another program: the seen surface 8 mm apart and
/// what lies behind it on a grid of 1 cm.
const PLANT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/orange_tree");

/// Share of the points `of` with one of `among` within half the diagonal of a cube of 1 cm.
fn covered(of: &[Point3<f64>], among: &[Point3<f64>]) -> f64 {
    let reach = 0.5 * 3f64.sqrt() * 0.01;
    let half = Vector3::repeat(reach);
    let among = RestPoints::new(among.to_vec()).unwrap();
    let is_near = |p: &&Point3<f64>| {
        let mut near = false;
        among.for_cells_in(&(*p - half), &(*p + half), |cell| {
            let at = |&k: &u32| distance(&among.positions()[k as usize], p) < reach;
            near |= cell.points.iter().any(at);
        });
        near
    };
    of.iter().filter(is_near).count() as f64 / of.len() as f64
}

#[test]
fn val_points_of_another_program() {
    let bench = Bench::new();
    let report: Value =
        serde_json::from_str(&bench.ok(&format!("points {PLANT} --out p.npy --json"))).unwrap();
    let made = read_points(bench.root.join("p.npy")).unwrap().0;
    assert_eq!(report["points"], made.len());
    let part = |key: &str| report[key].as_u64().unwrap();
    assert_eq!(part("surface") + part("occluded"), made.len() as u64);
    let theirs = read_points(Path::new(PLANT).join("points.npy")).unwrap().0;
    let (ours, theirs) = (covered(&theirs, &made), covered(&made, &theirs));
    assert!(ours > 0.98 && theirs > 0.98, "{ours} {theirs}");
}

#[test]
fn what_has_no_points() {
    let bench = Bench::new();
    bench.fails("points data --out p.npy", 1, &["camera/"]);
    bench.fails("points data --out p.ply", 2, &["must end in .npy"]);
    for (flags, code, part) in [
        ("--out p.npy --spacing 1e-5", 2, "cells of the box"),
        ("--out p.npy --box 1,2,3", 2, "takes 6 numbers"),
        ("--out p.npy --spacing 10", 2, "more than the box"),
        (
            "--out p.npy --box 0,0,0,0,1,1",
            2,
            "--box has an edge of length 0",
        ),
        ("--out data/points.npy", 2, "is there already"),
    ] {
        bench.fails(&format!("points {PLANT} {flags}"), code, &[part]);
    }
    assert!(!bench.root.join("p.npy").exists());
    let warning = bench.warned(&format!(
        "points {PLANT} --out p.npy --box 9,9,9,9.1,9.1,9.1"
    ));
    assert!(warning.contains("no seen surface"), "{warning}");
}
