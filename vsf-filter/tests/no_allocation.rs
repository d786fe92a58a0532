//! After warm-up an update allocates nothing. One test alone in its process, so that no other
//! thread allocates while it counts.

#![allow(clippy::unwrap_used)]
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};
use vsf_core::{Belief, Estimator, Observation, Scalar};
use vsf_filter::{
    CovarianceFilter, DiagonalForm, DiagonalKalman, DualConfig, DualReplay, MemoryReplay,
    Projection, ReplayConfig, ReplayVariance, RobustLoss, RobustNoise,
};
use vsf_testkit::LinearWorld;

static CALLS: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: every call is passed on to the system's allocator with its arguments as they are; the
// counter does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: `ptr` came from `System` with this layout.
        unsafe { System.dealloc(ptr, layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: `ptr` came from `System` with this layout.
        unsafe { System.realloc(ptr, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const N: usize = 400;

/// Updates of the second half of `data`, for a field that drifts, must not allocate.
fn check<T: Scalar>(
    what: &str,
    estimator: &mut dyn Estimator<Scalar = T>,
    data: &[Observation<T>],
    drift: f64,
) {
    let (warm_up, rest) = data.split_at(data.len() / 2);
    let mut run = |data: &[Observation<T>]| {
        for obs in data {
            estimator.update(obs).unwrap();
            if drift > 0.0 {
                estimator.diffuse(T::from_f64(drift)).unwrap();
            }
        }
    };
    run(warm_up);
    let before = CALLS.load(Ordering::Relaxed);
    run(rest);
    let calls = CALLS.load(Ordering::Relaxed) - before;
    assert_eq!(calls, 0, "{what} ({}): {calls} allocations", T::NAME);
}

fn check_all<T: Scalar>() {
    let mut world = LinearWorld::new(N, 1.0, 1.0, 4);
    let data: Vec<Observation<T>> = (0..400)
        .map(|t| {
            let contacts = 20 + (t * 37) % 80;
            world
                .reading(N, contacts, 7, 0.02, 0.5)
                .observation(N)
                .unwrap()
        })
        .collect();
    let prior = || Belief::uniform(N, 0.0, 1.0).unwrap();
    for projection in [
        Projection::Constrained,
        Projection::OutputOnly,
        Projection::FedBack,
    ] {
        let mut filter = CovarianceFilter::<T>::with_projection(prior(), projection).unwrap();
        check(&format!("{projection:?}"), &mut filter, &data, 0.0);
        assert!(filter.belief().mean().contains(&T::ZERO));
    }
    // Memory that is reused is large enough for all of one size.
    let reading = |_| world.reading(N, 60, 7, 0.02, 0.5).observation(N).unwrap();
    let alike: Vec<Observation<T>> = (0..200).map(reading).collect();
    let config = DualConfig {
        byte_budget: 20 * alike[0].bytes(),
        ..DualConfig::default()
    };
    let mut filter = DualReplay::<T>::new(prior(), config).unwrap();
    check("dual", &mut filter, &alike, 0.0);
    assert!(filter.buffered() < alike.len() / 2);
    for form in [
        DiagonalForm::Innovation,
        DiagonalForm::InnovationUpdated,
        DiagonalForm::Printed,
    ] {
        let diagonal = || DiagonalKalman::<T>::with_form(prior(), form);
        let robust = || RobustNoise::new(diagonal(), RobustLoss::STUDENT_T).unwrap();
        check(&format!("{form:?}"), &mut diagonal(), &data, 0.0);
        check(&format!("robust {form:?}"), &mut robust(), &data, 1e-4);
        for (variance, drift) in [
            (ReplayVariance::Keep, 0.0),
            (ReplayVariance::Shrink, 0.0),
            (ReplayVariance::Keep, 1e-2),
        ] {
            // Room for about 20 observations: the second half replaces old ones.
            let config = ReplayConfig {
                variance,
                byte_budget: 20 * data[0].bytes(),
                ..ReplayConfig::default()
            };
            let what = format!("{form:?} with {variance:?} and drift {drift}");
            let mut filter = MemoryReplay::new(diagonal(), config).unwrap();
            check(&what, &mut filter, &data, drift);
            assert!(filter.buffered() < data.len() / 2);
            let mut filter = MemoryReplay::new(robust(), config).unwrap();
            check(&format!("robust {what}"), &mut filter, &data, drift);
            assert!(filter.inner().downweighted_share().unwrap() > 0.05);
        }
    }
}

#[test]
fn updates_do_not_allocate() {
    check_all::<f32>();
    check_all::<f64>();
}
