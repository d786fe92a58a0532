//! Wall time of one update of the exact dense filters: 7 joint torques, most of the touched points
//! in contact as at the end of a push (4100 of 4300), or one place of many (410 of 4300).
//!
//! `cargo bench -p vsf-filter --bench dense`; with `-- --test` everything runs once.

#![allow(missing_docs)] // of the function that criterion's macro makes

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::time::Duration;
use vsf_core::{Belief, Estimator, Observation, Scalar};
use vsf_filter::{CovarianceFilter, InformationFilter, Projection};
use vsf_testkit::LinearWorld;

const CHANNELS: usize = 7;
const OBSERVATIONS: usize = 16;

/// A bench has no caller to hand an error to.
#[allow(clippy::panic)]
fn must<T, E: std::fmt::Display>(result: Result<T, E>) -> T {
    result.unwrap_or_else(|error| panic!("{error}"))
}

/// Observations of `contacts` of the first `21 / 20 contacts` points, after a first one that
/// touches all `n`. About half of the true field is zero.
fn observations<T: Scalar>(n: usize, contacts: usize) -> Vec<Observation<T>> {
    let mut world = LinearWorld::new(n, 0.0, 2.0, 1);
    let mut observe = |limit, contacts| {
        let reading = world.reading(limit, contacts, CHANNELS, 0.03, 0.3);
        must(reading.observation(n))
    };
    let first = observe(n, n);
    let later = (0..OBSERVATIONS).map(|_| observe(contacts * 21 / 20, contacts));
    std::iter::once(first).chain(later).collect()
}

fn bench<T: Scalar>(
    c: &mut Criterion,
    name: &str,
    pool: &ThreadPool,
    (n, contacts): (usize, usize),
    make: impl Fn(Belief<T>) -> Box<dyn Estimator<Scalar = T>>,
) {
    let data = observations::<T>(n, contacts);
    let mut filter = make(must(Belief::uniform(n, 0.0, 2.0)));
    must(filter.update(&data[0]));
    let mut turn = data[1..].iter().cycle();
    let mut group = c.benchmark_group(format!("{name}/{}", T::NAME));
    group.sample_size(50).warm_up_time(Duration::from_secs(1));
    let threads = pool.current_num_threads();
    let case = format!("{contacts} of {n} points, {threads} threads");
    group.bench_function(BenchmarkId::from_parameter(case), |b| {
        pool.install(|| {
            b.iter(|| turn.next().map(|obs| must(filter.update(obs))));
        });
    });
    group.finish();
}

/// The covariance filter, without constraint and with one that holds about half of the points.
fn covariance<T: Scalar>(c: &mut Criterion, pool: &ThreadPool, size: (usize, usize)) {
    for (name, projection) in [
        ("covariance", Projection::OutputOnly),
        ("constrained", Projection::Constrained),
    ] {
        bench::<T>(c, name, pool, size, |prior| {
            Box::new(must(CovarianceFilter::with_projection(prior, projection)))
        });
    }
}

fn dense(c: &mut Criterion) {
    for threads in [1, 2] {
        let pool = must(ThreadPoolBuilder::new().num_threads(threads).build());
        for size in [(1000, 950), (2000, 1900), (4300, 4100), (4300, 410)] {
            covariance::<f32>(c, &pool, size);
            covariance::<f64>(c, &pool, size);
        }
    }
    let pool = must(ThreadPoolBuilder::new().num_threads(1).build());
    bench::<f64>(c, "information", &pool, (1000, 950), |prior| {
        Box::new(must(InformationFilter::new(prior)))
    });
}

criterion_group!(benches, dense);
criterion_main!(benches);
