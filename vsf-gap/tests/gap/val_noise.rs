//! What is taken for the noise of readings, where contact changes the force from one sample to the next.

use crate::common::campaign::{self, Rows};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use vsf_gap::Campaign;

const NOISE: f64 = 1e-3;

/// A plate that presses points after so many samples in the air, where the force jumps by up to 0.1 N every sample.
fn pressing(samples_in_air: usize) -> Campaign {
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let mut rows = || -> Rows {
        let in_air = (0..samples_in_air).map(|_| (0.05, 0.0));
        let pressing = (0..300).map(|k| (-0.004, 0.05 * f64::from(k * k % 3)));
        let heights: Vec<(f64, f64)> = in_air.chain(pressing).collect();
        let row = |(z, force): (f64, f64)| {
            let torques = [0.0, 0.0, force].map(|t| t + NOISE * normal());
            (vec![0.0, 0.0, z], torques.to_vec())
        };
        heights.into_iter().map(row).collect()
    };
    campaign::plate(&[[0.0, 0.0, 0.0]], &[rows(), rows()])
}

#[test]
fn val_few_samples_in_the_air_tell_the_noise() {
    let campaign = pressing(60);
    for noise in campaign.noise() {
        assert!((noise.sd / NOISE - 1.0).abs() < 0.35, "{noise:?}");
    }
    assert!(!campaign.noise_is_bound());
}

#[test]
fn noise_read_in_contact_is_a_bound() {
    let campaign = pressing(0);
    assert!(campaign.noise().iter().all(|n| n.sd > 0.5 * NOISE));
    assert!(campaign.noise_is_bound());
}
