//! The suite of shapes passes a good one, and finds each of its faults by name.

use std::panic::{AssertUnwindSafe, catch_unwind};
use vsf_contact::{Batch, Sdf, SdfSample};
use vsf_core::nalgebra::{Point3, Vector3};
use vsf_testkit::check_sdf;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    NoNumber,
    LongNormal,
    OtherDistance,
    TooSteep,
    Inward,
    SmallBounds,
    InvertedBounds,
    NoSurface,
    Panics,
}

/// A ball of 2 cm.
struct Ball(Fault);

const RADIUS: f64 = 0.02;

impl Sdf for Ball {
    fn sample(&self, p_B: &Point3<f64>) -> SdfSample {
        let from = p_B.coords.norm();
        assert!(self.0 != Fault::Panics || from < 1e9, "so far away");
        let normal = if from > 0.0 {
            p_B.coords / from
        } else {
            Vector3::x()
        };
        let sample = SdfSample {
            distance: from - RADIUS,
            normal,
        };
        let SdfSample { distance, normal } = sample;
        match self.0 {
            Fault::NoNumber if distance > 0.0 => SdfSample {
                distance: f64::NAN,
                ..sample
            },
            Fault::LongNormal => SdfSample {
                normal: 1.1 * normal,
                ..sample
            },
            Fault::TooSteep => SdfSample {
                distance: 5.0 * distance,
                ..sample
            },
            Fault::Inward => SdfSample {
                normal: -normal,
                ..sample
            },
            _ => sample,
        }
    }

    fn distance(&self, p_B: &Point3<f64>) -> f64 {
        let off = if self.0 == Fault::OtherDistance {
            1e-3
        } else {
            0.0
        };
        self.sample(p_B).distance + off
    }

    fn unite(&self, batch: &mut Batch) {
        for i in 0..batch.len() {
            if self.0 != Fault::NoSurface {
                batch.offer(i, &self.sample(&batch.place(i)));
            }
        }
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let half = Point3::from(Vector3::repeat(RADIUS));
        match self.0 {
            Fault::SmallBounds => (-half * 0.5, half * 0.5),
            Fault::InvertedBounds => (half, -half),
            _ => (-half, half),
        }
    }
}

#[test]
fn faults_are_found_by_name() {
    check_sdf(&Ball(Fault::None));
    for (fault, property) in [
        (Fault::NoNumber, "distances and normals are finite"),
        (Fault::LongNormal, "distances and normals are finite"),
        (Fault::OtherDistance, "the distance alone"),
        (Fault::TooSteep, "no faster than places"),
        (Fault::Inward, "the normal is the gradient"),
        (Fault::SmallBounds, "inside lies within the bounds"),
        (Fault::InvertedBounds, "the bounds are a box"),
        (Fault::NoSurface, "many places"),
        (Fault::Panics, "not finite do no harm"),
    ] {
        let run = AssertUnwindSafe(|| check_sdf(&Ball(fault)));
        let cause = catch_unwind(run).unwrap_err();
        let text = cause.downcast_ref::<String>().unwrap();
        assert!(text.contains(property), "{fault:?}: {text}");
    }
}
