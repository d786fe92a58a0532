//! What several tests need: numbers made by other software (see `golden/README.md`), an estimator
//! that notes what it is given.

use ndarray::{Array1, Array2, Array3};
use ndarray_npy::NpzReader;
use std::fs::File;
use std::sync::{Arc, Mutex};
use vsf_core::{Belief, CoreError, Estimator, Noise, Observation, UpdateReport};
use vsf_filter::{DiagonalKalman, ReplayVariance, Revisit};

/// Notes what the diagonal filter takes in, and fails on demand: `fail_in` counts down to the correction
/// that does.
#[derive(Default)]
pub struct Orders {
    pub seen: Vec<Observation<f64>>,
    pub fail_in: Option<usize>,
}

/// The filter under orders, shared with the test because the replay owns its estimator.
#[derive(Clone)]
pub struct Probe(DiagonalKalman<f64>, Arc<Mutex<Orders>>);

impl Probe {
    pub fn new(prior: Belief<f64>) -> (Self, Arc<Mutex<Orders>>) {
        let orders = Arc::new(Mutex::new(Orders::default()));
        (Self(DiagonalKalman::new(prior), orders.clone()), orders)
    }
}

impl Estimator for Probe {
    type Scalar = f64;
    fn belief(&self) -> &Belief<f64> {
        self.0.belief()
    }
    fn reset(&mut self, prior: Belief<f64>) -> Result<(), CoreError> {
        self.0.reset(prior)
    }
    fn update(&mut self, obs: &Observation<f64>) -> Result<UpdateReport, CoreError> {
        self.0.update(obs)
    }
    fn diffuse(&mut self, variance: f64) -> Result<(), CoreError> {
        self.0.diffuse(variance)
    }
    fn whitened_residual(&self) -> &[f64] {
        self.0.whitened_residual()
    }
}

impl Revisit for Probe {
    fn correct(
        &mut self,
        obs: &Observation<f64>,
        variance: ReplayVariance,
    ) -> Result<UpdateReport, CoreError> {
        let mut orders = self.1.lock().unwrap();
        match &mut orders.fail_in {
            Some(0) => return Err(CoreError::other("on demand")),
            Some(calls) => *calls -= 1,
            None => {}
        }
        orders.seen.push(obs.clone());
        self.0.correct(obs, variance)
    }
    fn belief_mut(&mut self) -> &mut Belief<f64> {
        self.0.belief_mut()
    }
}

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
