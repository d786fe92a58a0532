//! Columns of the joint-torque observation against the Jacobian, and what bad input gets.

use nalgebra::{Point3, Vector3};
use vsf_core::{Contacts, CoreError, Noise, Observation, Posture, RestPoints, Scalar, Sensor};
use vsf_robots::{JointTorques, jacobian, kinova_gen3};
use vsf_testkit::check_sensor;

struct Scene {
    rest: RestPoints,
    posture: Posture,
    contacts: Contacts,
    sensor: JointTorques,
}

impl Scene {
    fn observe<T: Scalar>(&self, contacts: &Contacts, out: &mut Observation<T>) {
        self.sensor
            .observe(&self.rest, &self.posture, contacts, &READING, out)
            .unwrap();
    }
}

/// Points near the arm, some of them displaced by several links.
fn scene() -> Scene {
    let robot = kinova_gen3().unwrap();
    let mut posture = robot.posture();
    let q = [0.3, 0.8, -0.4, 1.1, 0.2, -0.7, 0.5];
    robot.update_posture(&q, &mut posture).unwrap();
    let points = (0..20).map(|i| Point3::new(0.02 * f64::from(i), 0.1, 0.4));
    let mut contacts = Contacts::new();
    for (point, link) in [(0, 1), (3, 3), (4, 8), (11, 5), (19, 9)] {
        let u_W = Vector3::new(0.01, -0.002 * f64::from(point), 0.005);
        contacts.push(point, link, u_W, Vector3::z()).unwrap();
    }
    Scene {
        rest: RestPoints::new(points.collect()).unwrap(),
        posture,
        contacts,
        sensor: JointTorques::new(Noise::uniform(7, 0.5).unwrap()),
    }
}

const READING: [f64; 7] = [1.0, -2.0, 3.0, 0.0, 0.25, 7.0, -1.0];

fn columns_are_minus_jacobian_times_displacement<T: Scalar>(tolerance: f64) {
    let scene = scene();
    let mut out: Observation<T> = scene.sensor.blank();
    scene.observe(&scene.contacts, &mut out);
    let Scene {
        rest,
        posture,
        contacts,
        sensor,
    } = scene;
    assert_eq!(out.points(), contacts.points());
    assert_eq!(out.noise(), sensor.noise());
    let mut columns = [Vector3::zeros(); 7];
    for k in 0..contacts.len() {
        let u = contacts.displacements()[k];
        let p_W = rest.positions()[contacts.points()[k] as usize] + u;
        jacobian(&posture, contacts.links()[k] as usize, &p_W, &mut columns).unwrap();
        for (i, column) in columns.iter().enumerate() {
            assert!((out.row(i)[k].to_f64() + column.dot(&u)).abs() < tolerance);
        }
    }
    for (r, expected) in out.reading().iter().zip(READING) {
        assert_eq!(r.to_f64(), expected);
    }
    // The base does not move: touching it loads no joint.
    assert!((0..7).all(|i| out.row(i)[0] == T::ZERO));
}

#[test]
fn columns_are_minus_jacobian_times_displacement_in_f64() {
    columns_are_minus_jacobian_times_displacement::<f64>(1e-15);
}

#[test]
fn columns_are_minus_jacobian_times_displacement_in_f32() {
    columns_are_minus_jacobian_times_displacement::<f32>(1e-9);
}

#[test]
fn joint_torques_keep_the_promises_of_a_sensor() {
    let Scene {
        posture, sensor, ..
    } = scene();
    check_sensor::<f32>(&sensor, &posture);
    check_sensor::<f64>(&sensor, &posture);
}

#[test]
fn what_does_not_fit_is_refused() {
    let Scene {
        rest,
        posture,
        contacts,
        sensor,
    } = scene();
    let mut out: Observation<f64> = sensor.blank();

    let mut broken = READING;
    broken[3] = f64::NAN;
    let nan = sensor.observe(&rest, &posture, &contacts, &broken, &mut out);
    assert!(matches!(nan, Err(CoreError::NotFinite { index: 3, .. })));

    let few = RestPoints::new(vec![Point3::origin(); 19]).unwrap();
    let beyond = sensor.observe(&few, &posture, &contacts, &READING, &mut out);
    assert!(matches!(
        beyond,
        Err(CoreError::OutOfRange {
            index: 19,
            len: 19,
            ..
        })
    ));

    let mut strange = Contacts::new();
    strange.push(0, 99, Vector3::z(), Vector3::z()).unwrap();
    let link = sensor.observe(&rest, &posture, &strange, &READING, &mut out);
    assert!(matches!(link, Err(CoreError::OutOfRange { index: 99, .. })));

    let other = JointTorques::new(Noise::uniform(3, 0.5).unwrap());
    let wide = Sensor::<f64>::check_robot(&other, posture.chains());
    assert!(matches!(
        wide,
        Err(CoreError::Length {
            what: "noise of the joint torques",
            got: 3,
            expected: 7,
        })
    ));
    let mut small: Observation<f64> = other.blank();
    assert!(
        other
            .observe(&rest, &posture, &contacts, &[0.0; 3], &mut small)
            .is_err()
    );
    assert!(
        sensor
            .observe(&rest, &posture, &contacts, &READING, &mut small)
            .is_err()
    );
}
