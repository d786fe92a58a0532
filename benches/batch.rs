//! Wall time of the batch optimum: 10 pushes of 700 samples with 7 joint torques through a cube
//! of points, some 8000 of which are touched, a few hundred at a time. `build` makes the normal
//! equations, `solve` finds the optimum with its variances for an independent prior and for one
//! with a shared level, `leave_one_out` predicts every push from the others, `evidence` is the
//! log marginal likelihood.
//!
//! `cargo bench -p vsf-benches --bench batch`; with `-- --test` everything runs once, on an
//! eighth of the points.

#![allow(missing_docs)] // of the function that criterion's macro makes

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::time::Duration;
use vsf::core::nalgebra::{Point3, Vector3};
use vsf::core::{CoreError, Observation};
use vsf::filter::{BatchMap, FieldPrior};
use vsf::prelude::*;

const PUSHES: usize = 10;
const SAMPLES: usize = 700;
const JOINTS: usize = 7;
/// Points along an edge of the cube.
const SIDE: usize = 22;
const EDGE: f64 = 0.2;
/// Of the ball that pushes (m).
const RADIUS: f64 = 0.055;

/// A number in [0, 1) that depends on nothing but its index.
fn uniform(index: usize) -> f64 {
    let mut x = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (x >> 11) as f64 / (1u64 << 53) as f64
}

fn cube() -> Vec<Point3<f64>> {
    let side = if std::env::args().any(|a| a == "--test") {
        SIDE / 2
    } else {
        SIDE
    };
    let at = |i: usize| EDGE * (i as f64 + 0.5) / side as f64;
    (0..side.pow(3))
        .map(|i| Point3::new(at(i / side / side), at(i / side % side), at(i % side)))
        .collect()
}

/// Stiff and soft regions with rough stiffness, a part of it zero.
fn stiffness(i: usize, p: &Point3<f64>) -> f64 {
    let wave = (40.0 * p.x).sin() * (35.0 * p.y).cos() + (50.0 * p.z + 1.0).sin();
    (20.0 * wave).max(0.0) * (0.5 + uniform(i))
}

/// A ball goes into the cube and back, its path a little different each time; the torques are off
/// by a slow factor that no field explains, and by noise.
fn push(points: &[Point3<f64>], number: usize) -> Result<Vec<Observation<f64>>, CoreError> {
    let draw = |k: usize| uniform(10 * number + k);
    let enter = Vector3::new(-0.05, EDGE * draw(0), EDGE * draw(1));
    let along = Vector3::new(0.22, 0.1 * (draw(2) - 0.5), 0.1 * (draw(3) - 0.5));
    let sample = |t: usize| {
        let time = t as f64 / SAMPLES as f64;
        let center = enter + along * (time / 0.6).min((1.0 - time) / 0.4);
        let mut touched = Vec::new();
        let mut displaced = Vec::new();
        for (i, p) in points.iter().enumerate() {
            let out = p.coords - center;
            let depth = RADIUS - out.norm();
            if depth > 0.0 {
                touched.push(i as u32);
                displaced.push(out.normalize() * depth);
            }
        }
        let column = |k: usize, w: &mut [f64]| {
            for (j, w) in w.iter_mut().enumerate() {
                let j = j as f64;
                let axis = Vector3::new(j.sin(), (2.0 * j + 0.3 * time).cos(), (0.7 * j).sin());
                let origin = Vector3::new(-0.5 + 0.07 * j, 0.1, 0.3 - 0.03 * j);
                let place = points[touched[k] as usize].coords + displaced[k];
                *w = -axis.cross(&(place - origin)).dot(&displaced[k]);
            }
        };
        let mut tau = [0.0; JOINTS];
        let mut w = [0.0; JOINTS];
        for (k, &i) in touched.iter().enumerate() {
            column(k, &mut w);
            let stiffness = stiffness(i as usize, &points[i as usize]);
            tau.iter_mut().zip(w).for_each(|(t, w)| *t += w * stiffness);
        }
        for (j, tau) in tau.iter_mut().enumerate() {
            *tau *= 1.0 + 0.15 * (3.0 * number as f64 + 4.0 * time + j as f64).sin();
            *tau += 0.1 * (uniform((number * SAMPLES + t) * JOINTS + j) - 0.5);
        }
        let mut obs = Observation::new(Noise::uniform(JOINTS, 1.0)?);
        obs.rebuild(points.len(), &touched, &tau, column)?;
        Ok(obs)
    };
    (0..SAMPLES).map(sample).collect()
}

/// A bench has no caller to hand an error to.
#[allow(clippy::panic)]
fn must<T>(result: Result<T, CoreError>) -> T {
    result.unwrap_or_else(|error| panic!("{error}"))
}

fn batch(c: &mut Criterion) {
    let points = cube();
    let pushes: Vec<_> = (0..PUSHES).map(|s| must(push(&points, s))).collect();
    let build = || {
        must(BatchMap::new(
            points.len(),
            pushes.iter().map(Vec::as_slice),
        ))
    };
    let batch = build();
    let contacts: usize = pushes.iter().flatten().map(Observation::len).sum();
    eprintln!(
        "{} touched points, {} contacts a sample",
        batch.points().len(),
        contacts / (PUSHES * SAMPLES)
    );
    let independent = FieldPrior::from(must(Belief::<f64>::uniform(points.len(), 0.0, 10.0)));
    let level = must(independent.clone().with_level(10.0));

    let mut group = c.benchmark_group("batch");
    group
        .sample_size(10)
        .warm_up_time(Duration::from_millis(1))
        .measurement_time(Duration::from_secs(1));
    group.bench_function("build", |b| b.iter(|| black_box(build())));
    for (name, prior) in [("independent", &independent), ("level", &level)] {
        group.bench_function(format!("solve/{name}"), |b| {
            b.iter(|| must(must(batch.solve(prior, 0.1)).marginals(batch.points())));
        });
    }
    let fit = must(batch.solve(&independent, 0.1));
    eprintln!(
        "{} free points, {} factorizations, KKT residual {:.1e}",
        fit.free_points().count(),
        fit.factorizations(),
        fit.kkt_residual()
    );
    group.bench_function("leave_one_out", |b| b.iter(|| must(fit.leave_one_out())));
    group.bench_function("evidence", |b| {
        b.iter(|| must(batch.log_evidence(&independent, 0.1)));
    });
    group.finish();
}

criterion_group!(benches, batch);
criterion_main!(benches);
