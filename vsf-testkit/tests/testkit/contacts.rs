//! The suite of contact models passes a good one, and finds each of its faults by name.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use vsf_core::nalgebra::{Point3, Vector3};
use vsf_core::{ContactModel, Contacts, CoreError, Posture, RestPoints};
use vsf_robots::cartesian_stage;
use vsf_testkit::check_contact;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    None,
    DiffersFromItsLike,
    TouchesBeyondTheField,
    OfALinkThatThereIsNot,
    NormalsAreNotUnit,
    KeepsWhatWasThere,
    ResetsNothing,
    TakesNaN,
    TakesUnwritten,
    MovesBeforeItChecks,
    TouchesWithoutLinks,
}

static MADE: AtomicUsize = AtomicUsize::new(0);

/// A plate on the last link of a stage that presses points down, deeper with every sample; with a fault.
#[derive(Clone)]
struct Plate {
    fault: Fault,
    samples: usize,
    number: usize,
}

impl Plate {
    fn new(fault: Fault) -> Self {
        Self {
            fault,
            samples: 0,
            number: MADE.fetch_add(1, Ordering::Relaxed),
        }
    }

    fn is(&self, fault: Fault) -> bool {
        self.fault == fault
    }
}

impl ContactModel for Plate {
    fn reset(&mut self) {
        if !self.is(Fault::ResetsNothing) {
            self.samples = 0;
        }
    }

    fn step(
        &mut self,
        rest: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError> {
        if self.is(Fault::MovesBeforeItChecks) {
            self.samples += 1;
        }
        match posture.check() {
            Err(CoreError::NotFinite { .. }) if self.is(Fault::TakesNaN) => {}
            Err(CoreError::UnwrittenPosture) if self.is(Fault::TakesUnwritten) => {}
            checked => checked?,
        }
        let mut height = match posture.link_poses().get(3) {
            Some(pose) => pose.translation.z,
            None if self.is(Fault::TouchesWithoutLinks) => -1.0,
            None => {
                return Err(CoreError::OutOfRange {
                    what: "link",
                    index: 3,
                    len: 0,
                });
            }
        };
        self.samples += 1;
        height -= 1e-5 * self.samples as f64;
        if self.is(Fault::DiffersFromItsLike) {
            height -= 1e-6 * self.number as f64;
        }
        let kept = (self.is(Fault::KeepsWhatWasThere) && !out.is_empty()).then(|| out.clone());
        out.clear();
        if let Some(kept) = kept {
            *out = kept;
            return Ok(());
        }
        let (mut n_W, mut link) = (-Vector3::z(), 3);
        if self.is(Fault::NormalsAreNotUnit) {
            n_W *= 2.0;
        }
        if self.is(Fault::OfALinkThatThereIsNot) {
            link = 4;
        }
        for (i, p_W) in rest.positions().iter().enumerate() {
            if p_W.z > height {
                out.push(i as u32, link, (height - p_W.z) * Vector3::z(), n_W)?;
            }
        }
        if self.is(Fault::TouchesBeyondTheField) {
            out.push(rest.len() as u32, link, -Vector3::z(), n_W)?;
        }
        Ok(())
    }
}

fn rest() -> RestPoints {
    let points = (0..20).map(|i| Point3::new(0.004 * f64::from(i), 0.0, -5e-4 * f64::from(i)));
    RestPoints::new(points.collect()).unwrap()
}

/// The tool goes down and along the points, and up again.
fn path() -> Vec<Posture> {
    let robot = cartesian_stage(0.01).unwrap();
    let at = |k: i32| {
        let mut posture = robot.posture();
        let z = 4e-4 * f64::from((k - 15).abs()) - 0.005;
        robot
            .update_posture(&[0.002 * f64::from(k), 0.0, z], &mut posture)
            .unwrap();
        posture
    };
    (0..30).map(at).collect()
}

#[test]
fn good_models_pass() {
    check_contact(|| Plate::new(Fault::None), &rest(), &path());
    let boxed = || Box::new(Plate::new(Fault::None)) as Box<dyn ContactModel>;
    check_contact(boxed, &rest(), &path());
}

fn found(check: impl FnOnce()) -> String {
    let cause = catch_unwind(AssertUnwindSafe(check)).expect_err("nothing was found");
    cause.downcast_ref::<String>().unwrap().clone()
}

#[test]
fn every_fault_is_found_by_name() {
    for (fault, property) in [
        (Fault::DiffersFromItsLike, "two of a kind"),
        (
            Fault::TouchesBeyondTheField,
            "contacts fit points and links",
        ),
        (
            Fault::OfALinkThatThereIsNot,
            "contacts fit points and links",
        ),
        (Fault::NormalsAreNotUnit, "contacts fit points and links"),
        (Fault::KeepsWhatWasThere, "what was there before"),
        (Fault::ResetsNothing, "reset forgets"),
        (Fault::TakesNaN, "postures that cannot be"),
        (Fault::TakesUnwritten, "postures that cannot be"),
        (Fault::TouchesWithoutLinks, "postures that cannot be"),
        (
            Fault::MovesBeforeItChecks,
            "an error leaves the contact state",
        ),
    ] {
        let text = found(|| check_contact(|| Plate::new(fault), &rest(), &path()));
        assert!(text.contains(property), "{fault:?} was found as: {text}");
    }
}

#[test]
fn a_path_that_touches_nothing_is_told() {
    let far = RestPoints::new(vec![Point3::new(0.0, 0.0, -9.0)]).unwrap();
    let text = found(|| check_contact(|| Plate::new(Fault::None), &far, &path()));
    assert!(text.contains("nothing is touched"), "{text}");
    let text = found(|| check_contact(|| Plate::new(Fault::None), &rest(), &[]));
    assert!(text.contains("nothing is touched"), "{text}");
}
