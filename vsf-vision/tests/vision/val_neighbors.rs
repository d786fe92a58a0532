//! Nearest neighbors against brute force.

use proptest::prelude::*;
use vsf_core::CoreError;
use vsf_vision::{Neighbors, VisionError};

fn brute(rows: &[f64], dim: usize, query: &[f64], k: usize) -> Vec<f64> {
    let square = |row: &[f64]| row.iter().zip(query).map(|(a, b)| (a - b) * (a - b)).sum();
    let mut all: Vec<f64> = rows.chunks_exact(dim).map(square).collect();
    all.sort_by(f64::total_cmp);
    all.truncate(k);
    all
}

fn compare(rows: &[f64], dim: usize, query: &[f64], k: usize) {
    let tree = Neighbors::new(rows, dim).unwrap();
    let mut found = Vec::new();
    tree.nearest(query, k, &mut found);
    let expected = brute(rows, dim, query, k);
    assert_eq!(found.len(), expected.len());
    for (n, square) in found.iter().zip(&expected) {
        assert!(
            (n.squared - square).abs() <= 1e-9 * (1.0 + square),
            "{n:?}, {square}"
        );
        let row = &rows[n.index * dim..(n.index + 1) * dim];
        assert!((brute(row, dim, query, 1)[0] - n.squared).abs() <= 1e-9 * (1.0 + square));
    }
    let mut rows: Vec<usize> = found.iter().map(|n| n.index).collect();
    rows.sort_unstable();
    rows.dedup();
    assert_eq!(rows.len(), found.len());
}

#[test]
fn on_a_lattice() {
    let mut rows = Vec::new();
    for (x, y) in (0..20).flat_map(|x| (0..20).map(move |y| (x, y))) {
        (0..20).for_each(|z| rows.extend([x, y, z].map(f64::from)));
    }
    for query in [
        [0.0, 0.0, 0.0],
        [9.5, 9.5, 9.5],
        [19.0, 3.0, 40.0],
        [10.0, 10.0, 10.0],
    ] {
        for k in [1, 7, 200, 9000] {
            compare(&rows, 3, &query, k);
        }
    }
}

#[test]
fn among_duplicates() {
    let rows: Vec<f64> = (0..3000).map(|i| f64::from(i / 3 % 4)).collect();
    for k in [1, 200, 1000] {
        compare(&rows, 3, &[1.0, 1.0, 1.0], k);
        compare(&rows, 6, &[1.0, 1.0, 1.0, 2.0, 2.0, 2.0], k);
    }
    compare(&[1.5; 600], 6, &[0.0; 6], 50);
}

proptest! {
    #[test]
    fn on_random_rows(
        dim in 1usize..=15,
        cells in prop::collection::vec(-3i8..4, 15..1200),
        query in prop::collection::vec(-4.0f64..4.0, 15),
        k in 1usize..60,
    ) {
        let rows: Vec<f64> = cells.iter().map(|c| f64::from(*c)).collect();
        let whole = rows.len() / dim * dim;
        compare(&rows[..whole], dim, &query[..dim], k);
    }
}

#[test]
fn refuses() {
    assert!(matches!(
        Neighbors::new(&[], 3),
        Err(VisionError::Core(CoreError::TooFew { .. }))
    ));
    assert!(Neighbors::new(&[0.0; 26], 0).is_err());
    assert!(Neighbors::new(&[0.0, f64::NAN, 0.0], 3).is_err());
    assert!(Neighbors::new(&[0.0; 4], 3).is_err());
    assert!(Neighbors::new(&[0.0, 1e200], 1).is_err());
}

/// In a tree as among rows that are looked at one by one.
#[test]
fn nothing_is_near_a_query_out_of_range() {
    for dim in [2, 13] {
        let tree = Neighbors::new(&vec![1.0; 5 * dim], dim).unwrap();
        for far in [f64::NAN, f64::INFINITY, -1e200] {
            let mut query = vec![0.0; dim];
            query[0] = far;
            let mut found = Vec::new();
            tree.nearest(&query, 2, &mut found);
            assert!(found.is_empty(), "{far}: {found:?}");
        }
        let mut found = Vec::new();
        tree.nearest(&vec![1e100; dim], 9, &mut found);
        assert_eq!(found.len(), 5);
        assert!(found.iter().all(|n| n.squared.is_finite()));
    }
}
