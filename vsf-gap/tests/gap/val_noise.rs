//! What is taken for the noise of readings, where contact changes the force from one sample to the next.

use crate::common::campaign::{self, Rows};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use vsf_gap::Campaign;

const NOISE: f64 = 1e-3;

/// A plate that presses points after so many samples in the air, with a noise and a force (N) in contact by sample.
fn plate_presses(
    samples_in_air: usize,
    seed: u64,
    noise: impl Fn(bool) -> f64,
    mut force: impl FnMut(u32, &mut Pcg64Mcg) -> f64,
) -> Campaign {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut rows = || -> Rows {
        let in_air = (0..samples_in_air).map(|_| None);
        let pressing = (0..300).map(Some);
        let row = |touch: Option<u32>| {
            let force = touch.map_or(0.0, |k| force(k, &mut random));
            let mut reading = |force: f64| force + noise(touch.is_some()) * normal(&mut random);
            let torques = [0.0, 0.0, force].map(&mut reading).to_vec();
            (vec![0.0, 0.0, touch.map_or(0.05, |_| -0.004)], torques)
        };
        in_air.chain(pressing).map(row).collect()
    };
    campaign::plate(&[[0.0, 0.0, 0.0]], &[rows(), rows()])
}

fn normal(random: &mut Pcg64Mcg) -> f64 {
    StandardNormal.sample(random)
}

/// The force jumps by 0.05 N in two samples of three.
fn pressing(samples_in_air: usize) -> Campaign {
    let jumps = |k: u32, _: &mut Pcg64Mcg| 0.05 * f64::from(k * k % 3);
    plate_presses(samples_in_air, 3, |_| NOISE, jumps)
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

/// Jumps that are hardly larger than noise pass for it in contact.
#[test]
fn val_few_samples_in_the_air_tell_the_noise_from_small_jumps() {
    // Deviations of noise, and how often.
    for (size, share) in [(3.0, 1.0), (10.0, 1.0), (3.0, 0.1), (10.0, 0.1)] {
        let mut off: Vec<f64> = (0..9)
            .map(|seed| {
                let mut force = 0.0;
                let walk = |_: u32, random: &mut Pcg64Mcg| {
                    if random.random_bool(share) {
                        force += size * NOISE * normal(random);
                    }
                    force
                };
                let campaign = plate_presses(100, seed, |_| NOISE, walk);
                assert!(!campaign.noise_is_bound());
                campaign.noise()[2].of_means(5).sd / (NOISE / 5.0_f64.sqrt())
            })
            .collect();
        off.sort_by(f64::total_cmp);
        // A correlation comes out of a few samples wrong now and then.
        let most = &off[..7];
        let told = (0.8..1.4).contains(&off[4]) && most.iter().all(|off| (0.5..2.5).contains(off));
        assert!(told, "{size} {share}: {off:?}");
    }
}

/// Sensors with a dead band, or torques that others set to zero.
#[test]
fn readings_that_are_zero_in_the_air_tell_no_noise() {
    let only_in_contact = |is_touching: bool| if is_touching { NOISE } else { 0.0 };
    for samples_in_air in [60, 200] {
        let campaign = plate_presses(samples_in_air, 3, only_in_contact, |_, _| 0.0);
        for noise in campaign.noise() {
            assert!((0.7..1.5).contains(&(noise.sd / NOISE)), "{noise:?}");
        }
        assert!(campaign.noise_is_bound());
    }
}

/// Without jumps a few samples in the air, whose correlation comes out wrong, take nothing from what contact tells.
#[test]
fn val_smooth_noise_is_not_taken_for_less() {
    const SMOOTH: f64 = 0.4;
    let expected = NOISE * ((1.0 + SMOOTH) / (1.0 - SMOOTH)).sqrt() / 20.0_f64.sqrt();
    let mut off: Vec<f64> = (0..12)
        .flat_map(|seed| {
            let mut random = Pcg64Mcg::seed_from_u64(100 + seed);
            let rows: [Rows; 2] = std::array::from_fn(|_| {
                let mut last = [0.0; 3];
                let row = |k: usize| {
                    let fresh = NOISE * (1.0 - SMOOTH * SMOOTH).sqrt();
                    last = last.map(|e| SMOOTH * e + fresh * normal(&mut random));
                    let height = if k < 60 { 0.05 } else { -0.004 };
                    (vec![0.0, 0.0, height], last.to_vec())
                };
                (0..360).map(row).collect()
            });
            let campaign = campaign::plate(&[[0.0, 0.0, 0.0]], &rows);
            let of_means = campaign.noise().iter().map(|n| n.of_means(20).sd);
            of_means.map(|sd| sd / expected).collect::<Vec<_>>()
        })
        .collect();
    off.sort_by(f64::total_cmp);
    let low = off.iter().filter(|off| **off < 0.7).count();
    assert!(10 * low <= off.len(), "{low}: {off:?}");
    let middle = off[off.len() / 2];
    assert!((0.85..1.3).contains(&middle), "{off:?}");
}
