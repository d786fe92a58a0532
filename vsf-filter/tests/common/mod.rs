//! Numbers made by other software (see `golden/README.md`).

use ndarray::{Array1, Array2, Array3};
use ndarray_npy::NpzReader;
use std::fs::File;
use vsf_core::{Noise, Observation};

pub fn archive(name: &str) -> NpzReader<File> {
    let path = format!("{}/tests/golden/{name}", env!("CARGO_MANIFEST_DIR"));
    NpzReader::new(File::open(path).unwrap()).unwrap()
}

/// The observations of `ekf_problem.npz`, and the field that they were made from.
pub fn golden_observations() -> (Vec<Observation<f64>>, Array1<f64>) {
    let mut file = archive("ekf_problem.npz");
    let w: Array3<f64> = file.by_name("W").unwrap();
    let mask: Array2<bool> = file.by_name("mask").unwrap();
    let z: Array2<f64> = file.by_name("z").unwrap();
    let n = mask.dim().1;
    let observation = |t: usize| {
        let points: Vec<u32> = (0..n as u32).filter(|&i| mask[[t, i as usize]]).collect();
        let mut obs = Observation::new(Noise::uniform(7, 1.0).unwrap());
        obs.rebuild(n, &points, &z.row(t).to_vec(), |k, column| {
            for (i, c) in column.iter_mut().enumerate() {
                *c = w[[t, i, points[k] as usize]];
            }
        })
        .unwrap();
        obs
    };
    let observations = (0..w.dim().0).map(observation).collect();
    (observations, file.by_name("x_true").unwrap())
}
