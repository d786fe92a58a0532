//! After warm-up a step allocates nothing, and points far from links take little memory. One test
//! alone in its process, so that no other thread allocates while it counts.

#![allow(clippy::unwrap_used)]
#![allow(unsafe_code)]

use nalgebra::{Isometry3, Point3, Vector3};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use vsf_contact::{ContactConfig, LinkSdf, ShapeSdf, StickSlip, UnionSdf};
use vsf_core::{ContactModel, Contacts, LinkChains, Posture, RestPoints, Shape};

static CALLS: AtomicUsize = AtomicUsize::new(0);
static BYTES: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: every call is passed on to the system's allocator with its arguments as they are; the
// counters do not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        BYTES.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        BYTES.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: `ptr` came from `System` with this layout.
        unsafe { System.dealloc(ptr, layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        BYTES.fetch_add(size, Ordering::Relaxed);
        BYTES.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: `ptr` came from `System` with this layout.
        unsafe { System.realloc(ptr, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Two capsules that cross: points slip, are handed over and come and go.
fn links() -> Vec<LinkSdf> {
    let capsule = |angle: f64| {
        let shape = Shape::Capsule {
            radius: 0.03,
            half_length: 0.08,
        };
        ShapeSdf::new(&shape, &Isometry3::rotation(Vector3::x() * angle)).unwrap()
    };
    let sdf = || Arc::new(UnionSdf::new(vec![capsule(0.0), capsule(1.0)]));
    vec![
        LinkSdf {
            link: 0,
            sdf: sdf(),
        },
        LinkSdf {
            link: 1,
            sdf: sdf(),
        },
    ]
}

/// `n`³ points, 8 mm apart, whose corner is the origin.
fn lattice(n: usize) -> RestPoints {
    let point = |i| Point3::new((i / n / n) as f64, (i / n % n) as f64, (i % n) as f64) * 8e-3;
    RestPoints::new((0..n * n * n).map(point).collect()).unwrap()
}

/// Pushes the links into the corner and out again.
fn push(
    model: &mut StickSlip,
    rest: &RestPoints,
    posture: &mut Posture,
    out: &mut Contacts,
) -> usize {
    let mut most = 0;
    for i in 0..120 {
        let depth = 0.1 * (f64::from(i) * 0.05).sin();
        let shift = |side: f64| Isometry3::translation(depth, 0.1 + side * depth, 0.1);
        posture
            .parts_mut()
            .1
            .copy_from_slice(&[shift(0.3), shift(-0.3)]);
        model.step(rest, posture, out).unwrap();
        most = most.max(out.len());
    }
    most
}

#[test]
fn steps_do_not_allocate_and_untouched_points_take_little_memory() {
    let (mut out, n) = (Contacts::new(), 60);
    let chains = LinkChains::new(0, vec![Vec::new(); 2]).unwrap();
    let mut posture = Posture::new(Arc::new(chains));
    let mut model = StickSlip::new(links(), ContactConfig::default()).unwrap();
    let before = BYTES.load(Ordering::Relaxed);
    let rest = lattice(n);
    assert!(push(&mut model, &rest, &mut posture, &mut out) > 1000);
    let bytes = (BYTES.load(Ordering::Relaxed) - before) as f64 / rest.len() as f64;
    eprintln!("{bytes:.1} bytes per point");
    assert!(bytes < 48.0, "{bytes} bytes per point");

    model.reset();
    let before = CALLS.load(Ordering::Relaxed);
    push(&mut model, &rest, &mut posture, &mut out);
    let calls = CALLS.load(Ordering::Relaxed) - before;
    assert_eq!(calls, 0, "{calls} allocations");
}
