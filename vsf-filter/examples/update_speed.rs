//! Time of one update at the size of the paper's data: 7 joint torques, 4100 contacts of 100 000
//! points. Run with `cargo run --release -p vsf-filter --example update_speed`.
//!
//! The yardstick is one pass over the same bytes in the same order: an update must read them all.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;
use vsf_core::{Belief, Estimator, Noise, Observation, Scalar};
use vsf_filter::{DiagonalKalman, DualConfig, DualReplay, MemoryReplay, ReplayConfig};

const POINTS: usize = 100_000;
const CONTACTS: usize = 4100;
const CHANNELS: usize = 7;
const OBSERVATIONS: usize = 200;
const UPDATES: usize = 400;

/// A number in [0, 1) that depends on nothing but its index.
fn noise(index: u64) -> f64 {
    let mut x = index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (x >> 11) as f64 / (1u64 << 53) as f64
}

/// Touches that wander through the field: runs of 41 neighbors, as layers of a point grid.
fn observations<T: Scalar>() -> Result<Vec<Observation<T>>, Box<dyn Error>> {
    (0..OBSERVATIONS)
        .map(|t| {
            let first = (t * 331) % (POINTS - 20_000);
            let points: Vec<u32> = (0..CONTACTS)
                .map(|k| (first + (k / 41) * 200 + k % 41) as u32)
                .collect();
            let reading: Vec<f64> = (0..CHANNELS).map(|i| noise((t * 7 + i) as u64)).collect();
            let mut obs = Observation::new(Noise::uniform(CHANNELS, 1.0)?);
            obs.rebuild(POINTS, &points, &reading, |k, w| {
                for (i, w) in w.iter_mut().enumerate() {
                    *w = 0.03 * (noise(((t * CONTACTS + k) * 7 + i) as u64) - 0.5);
                }
            })?;
            Ok(obs)
        })
        .collect()
}

/// Median and minimum time of `UPDATES` calls, in microseconds. The minimum is what to look at on
/// a machine with other work.
struct Times {
    median: f64,
    min: f64,
}

fn time(
    mut call: impl FnMut(usize) -> Result<(), Box<dyn Error>>,
) -> Result<Times, Box<dyn Error>> {
    let mut times = Vec::with_capacity(UPDATES);
    for t in 0..UPDATES {
        let start = Instant::now();
        call(t)?;
        times.push(start.elapsed().as_secs_f64() * 1e6);
    }
    times.sort_by(f64::total_cmp);
    Ok(Times {
        median: times[UPDATES / 2],
        min: times[0],
    })
}

fn measure<T: Scalar>() -> Result<(), Box<dyn Error>> {
    let data = observations::<T>()?;
    let prior = Belief::<T>::uniform(POINTS, 0.0, 0.1)?;

    let stream = time(|t| {
        let mut lanes = [T::ZERO; 32];
        for chunk in data[t % OBSERVATIONS].rows().chunks_exact(32) {
            for (lane, &w) in lanes.iter_mut().zip(chunk) {
                *lane += w;
            }
        }
        black_box(lanes);
        Ok(())
    })?;
    let mut filter = DiagonalKalman::new(prior.clone());
    let single = time(|t| {
        filter.update(&data[t % OBSERVATIONS])?;
        Ok(())
    })?;
    // Both replay 20 past observations.
    let inner = DiagonalKalman::new(prior.clone());
    let mut filter = MemoryReplay::new(inner, ReplayConfig::default())?;
    let replay = time(|t| {
        filter.update(&data[t % OBSERVATIONS])?;
        Ok(())
    })?;
    let mut filter = DualReplay::new(prior, DualConfig::default())?;
    let dual = time(|t| {
        filter.update(&data[t % OBSERVATIONS])?;
        Ok(())
    })?;
    for (what, times) in [
        ("one pass over the bytes", stream),
        ("update", single),
        ("update, 20 replays", replay),
        ("update, 20 dual replays", dual),
    ] {
        println!(
            "{} {what:24} median {:8.1} us, min {:8.1} us",
            T::NAME,
            times.median,
            times.min
        );
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("{CHANNELS} x {CONTACTS} contacts of {POINTS} points, {UPDATES} updates");
    measure::<f32>()?;
    measure::<f64>()
}
