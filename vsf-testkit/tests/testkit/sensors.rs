//! The suite of sensors passes a good one, and finds each of its faults by name.

use std::panic::catch_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use vsf_core::{
    Contacts, CoreError, LinkChains, Noise, Observation, Posture, RestPoints, Scalar, Sensor,
};
use vsf_robots::planar_arm;
use vsf_testkit::check_sensor;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    None,
    OfAnotherRobot,
    BlankIsWider,
    BlankHasPoints,
    ForgetsReading,
    DropsTheLastPoint,
    DriftsFromCallToCall,
    SharesColumns,
    PushesAtRest,
    TakesShortReadings,
    TakesNaN,
    TakesAnyPoint,
    TakesAnyLink,
}

/// Height and sideways force on the robot, with a fault.
#[derive(Clone)]
struct Gauge {
    fault: Fault,
    noise: Noise,
    calls: Arc<AtomicUsize>,
}

impl Gauge {
    fn new(fault: Fault) -> Self {
        Self {
            fault,
            noise: Noise::uniform(2, 0.1).unwrap(),
            calls: Arc::new(AtomicUsize::new(0)),
        }
    }

    fn is(&self, fault: Fault) -> bool {
        self.fault == fault
    }
}

impl<T: Scalar> Sensor<T> for Gauge {
    fn dim(&self) -> usize {
        2
    }

    fn blank(&self) -> Observation<T> {
        let wider = Noise::uniform(3, 0.1).unwrap();
        let noise = if self.is(Fault::BlankIsWider) {
            &wider
        } else {
            &self.noise
        };
        let mut blank = Observation::new(noise.clone());
        if self.is(Fault::BlankHasPoints) {
            blank.rebuild(1, &[0], &[0.0; 2], |_, _| {}).unwrap();
        }
        blank
    }

    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        let joints = if self.is(Fault::OfAnotherRobot) {
            7
        } else {
            chains.joint_count()
        };
        CoreError::check_len("joints of the robot", chains.joint_count(), joints)
    }

    fn observe(
        &self,
        rest: &RestPoints,
        posture: &Posture,
        contacts: &Contacts,
        reading: &[f64],
        out: &mut Observation<T>,
    ) -> Result<(), CoreError> {
        let fits = contacts.check_fits(rest, posture);
        let any_link = matches!(
            fits,
            Err(CoreError::OutOfRange {
                what: "touching link",
                ..
            })
        ) && self.is(Fault::TakesAnyLink);
        if !(any_link || self.is(Fault::TakesAnyPoint)) {
            fits?;
        }
        let mut reading = reading.to_vec();
        match self.fault {
            Fault::ForgetsReading => reading.fill(0.0),
            Fault::TakesShortReadings => reading.resize(2, 0.0),
            Fault::TakesNaN => reading
                .iter_mut()
                .filter(|x| x.is_nan())
                .for_each(|x| *x = 0.0),
            _ => {}
        }
        let calls = self.calls.fetch_add(1, Ordering::Relaxed);
        let mut points = contacts.points();
        if self.is(Fault::DropsTheLastPoint) && points.len() > 1 {
            points = &points[..points.len() - 1];
        }
        let len = if self.is(Fault::TakesAnyPoint) {
            1000
        } else {
            rest.len()
        };
        out.rebuild(len, points, &reading, |k, w| {
            let mut u = contacts.displacements()[k];
            if self.is(Fault::SharesColumns) {
                u = contacts.displacements()[0];
            }
            w[0] = -u.z;
            w[1] = -u.x;
            match self.fault {
                Fault::DriftsFromCallToCall => w[0] *= 1.0 + 1e-3 * calls as f64,
                Fault::PushesAtRest => w[0] += 1e-6,
                _ => {}
            }
        })
    }
}

fn posture() -> Posture {
    let robot = planar_arm(3, 0.3, 0.03).unwrap();
    let mut posture = robot.posture();
    robot
        .update_posture(&[0.3, 0.5, -0.4], &mut posture)
        .unwrap();
    posture
}

#[test]
fn good_sensors_pass() {
    let posture = posture();
    check_sensor::<f32>(&Gauge::new(Fault::None), &posture);
    check_sensor::<f64>(&Gauge::new(Fault::None), &posture);
    let boxed: Box<dyn Sensor<f64>> = Box::new(Gauge::new(Fault::None));
    check_sensor(&boxed, &posture);
}

#[test]
fn every_fault_is_found_by_name() {
    for (fault, property) in [
        (Fault::OfAnotherRobot, "made for this robot"),
        (Fault::BlankIsWider, "a blank observation"),
        (Fault::BlankHasPoints, "a blank observation"),
        (Fault::ForgetsReading, "touched points and reading"),
        (Fault::DropsTheLastPoint, "touched points and reading"),
        (Fault::DriftsFromCallToCall, "the same is observed again"),
        (Fault::SharesColumns, "columns are of their own"),
        (Fault::PushesAtRest, "columns are of their own"),
        (Fault::TakesShortReadings, "readings that cannot be"),
        (Fault::TakesNaN, "readings that cannot be"),
        (Fault::TakesAnyPoint, "contacts that do not fit"),
        (Fault::TakesAnyLink, "contacts that do not fit"),
    ] {
        let check = || check_sensor::<f64>(&Gauge::new(fault), &posture());
        let cause = catch_unwind(check).expect_err("nothing was found");
        let text = cause.downcast_ref::<String>().unwrap();
        assert!(text.contains(property), "{fault:?} was found as: {text}");
    }
}
