//! `vsf points`: rest points from what a depth camera saw.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod common;
use common::Bench;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A plant with a camera/, whose points.npy was made by another program: the seen surface 8 mm apart and
/// what lies behind it on a grid of 1 cm.
const PLANT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/orange_tree");

fn points(path: &Path) -> Vec<[f64; 3]> {
    let bytes = fs::read(path).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = String::from_utf8_lossy(&bytes[..start]).into_owned();
    let numbers: Vec<f64> = match header.contains("<f4") {
        true => (bytes[start..].chunks_exact(4))
            .map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())))
            .collect(),
        false => (bytes[start..].chunks_exact(8))
            .map(|b| f64::from_le_bytes(b.try_into().unwrap()))
            .collect(),
    };
    numbers
        .chunks_exact(3)
        .map(|p| p.try_into().unwrap())
        .collect()
}

/// Share of the points `of` with one of `among` within a cube's half diagonal.
fn covered(of: &[[f64; 3]], among: &[[f64; 3]]) -> f64 {
    const CELL: f64 = 0.01;
    let cell = |p: &[f64; 3]| p.map(|x| (x / CELL).floor() as i64);
    let mut near: std::collections::HashMap<[i64; 3], Vec<[f64; 3]>> = Default::default();
    among
        .iter()
        .for_each(|p| near.entry(cell(p)).or_default().push(*p));
    let is_near = |p: &&[f64; 3]| {
        let [x, y, z] = cell(p);
        let around =
            (-1..2).flat_map(|i| (-1..2).flat_map(move |j| (-1..2).map(move |k| [i, j, k])));
        let cells = around.filter_map(|[i, j, k]| near.get(&[x + i, y + j, z + k]));
        let distance = |q: &[f64; 3]| p.iter().zip(q).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        cells
            .flatten()
            .any(|q| distance(q).sqrt() < 0.5 * 3f64.sqrt() * CELL)
    };
    of.iter().filter(is_near).count() as f64 / of.len() as f64
}

#[test]
fn val_points_of_another_program() {
    let bench = Bench::new();
    let report: Value =
        serde_json::from_str(&bench.ok(&format!("points {PLANT} --out p.npy --json"))).unwrap();
    let made = points(&bench.root.join("p.npy"));
    assert_eq!(report["points"], made.len());
    let part = |key: &str| report[key].as_u64().unwrap();
    assert_eq!(part("surface") + part("occluded"), made.len() as u64);
    let theirs = points(&Path::new(PLANT).join("points.npy"));
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
        ("--out p.npy --box 0,0,0,0,1,1", 2, "--box: edge"),
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
