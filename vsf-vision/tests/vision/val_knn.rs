//! The weighted mean of neighbors against its formula, near the samples and far away.

use vsf_vision::{Features, KnnConfig, KnnRegressor, Regressor, Samples, Width};

/// Nadaraya's formula over the three nearest of five samples on a line.
#[test]
fn without_shrinkage_it_is_the_weighted_mean() {
    let at = [0.0, 1.0, 2.0, 3.0, 4.0];
    let targets = [5.0, -1.0, 2.0, 7.0, 4.0];
    let column = |values: &[f64]| {
        Features::new(values.len())
            .with_column("x", values)
            .unwrap()
    };
    let config = KnnConfig {
        neighbors: 3,
        width: Width::Fixed(0.8),
        shrink: false,
    };
    let mut knn = KnnRegressor::new(config).unwrap();
    let samples = Samples::new(column(&at), targets.to_vec(), vec![0.0; 5]).unwrap();
    knn.fit(&samples).unwrap();
    // Deviation of the places: sqrt(2).
    for (x, nearest) in [(1.2, [0, 1, 2]), (3.4, [2, 3, 4]), (30.0, [2, 3, 4])] {
        let square = |i: usize| f64::powi(x - at[i], 2) / 2.0;
        // Relative to the nearest, since all weights vanish far away.
        let least = nearest.map(square).into_iter().fold(f64::MAX, f64::min);
        let weight = |i: usize| (-(square(i) - least) / (2.0 * 0.64)).exp();
        let total: f64 = nearest.map(weight).iter().sum();
        let sum: f64 = nearest.map(|i| weight(i) * targets[i]).iter().sum();
        let found = knn.predict(&column(&[x])).unwrap().mean[0];
        assert!((found - sum / total).abs() < 1e-10, "{x}: {found}");
    }
}
