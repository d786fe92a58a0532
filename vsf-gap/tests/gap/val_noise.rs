//! What is taken for the noise of readings, where contact changes the force from one sample to the next.

use crate::common::campaign::{self, Rows};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use vsf_gap::Campaign;

const NOISE: f64 = 1e-3;

/// A plate that presses points after so many samples in the air, with a force that jumps by 0.05 N in two samples of
/// three.
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
    for samples_in_air in [30, 60, 140] {
        let campaign = pressing(samples_in_air);
        for noise in campaign.noise() {
            let off = noise.sd / NOISE;
            assert!((0.7..1.5).contains(&off), "{samples_in_air}: {noise:?}");
        }
        assert!(!campaign.noise_is_bound());
    }
}

#[test]
fn noise_read_in_contact_is_a_bound() {
    for samples_in_air in [0, 20] {
        let campaign = pressing(samples_in_air);
        let [x, y, z] = campaign.noise() else {
            panic!("three axes");
        };
        assert!(x.sd > 0.8 * NOISE && y.sd > 0.8 * NOISE && z.sd > 10.0 * NOISE);
        assert!(campaign.noise_is_bound());
    }
}
