use crate::property::ask;
use vsf_core::nalgebra::{Point3, Vector3};
use vsf_core::{Contacts, Observation, Posture, RestPoints, Scalar, Sensor};

/// Number of points that the robot touches.
const POINTS: usize = 12;

type Property<'a, T> = fn(&Suite<'a, T>);

/// Checks that a sensor keeps the promises of [`Sensor`], for the robot that wrote `posture`.
///
/// The contacts are made up: 12 points, by all links in turn.
///
/// | property |
/// | --- |
/// | it is made for this robot |
/// | a blank observation is empty and as wide as the sensor |
/// | the touched points are observed, with the reading |
/// | observing again gives the same, whatever the observation held before |
/// | the column of a point is that of its own contact, and zero without a displacement |
/// | readings that are not finite or of another length are refused |
/// | contacts of nonexistent points or links are refused |
///
/// # Panics
/// With the name of the property that does not hold.
///
/// ```
/// use vsf_core::Noise;
/// let robot = vsf_robots::planar_arm(3, 0.3, 0.03)?;
/// let mut posture = robot.posture();
/// robot.update_posture(&[0.3, 0.5, -0.4], &mut posture)?;
/// let sensor = vsf_robots::JointTorques::new(Noise::uniform(3, 0.1)?);
/// vsf_testkit::check_sensor::<f32>(&sensor, &posture);
/// # Ok::<(), vsf_robots::RobotError>(())
/// ```
pub fn check_sensor<T: Scalar>(sensor: &dyn Sensor<T>, posture: &Posture) {
    let points = (0..POINTS).map(|i| wave(i, 0));
    let rest = RestPoints::new(points.map(|v| Point3::from(0.5 * v)).collect());
    let suite = Suite {
        sensor,
        posture,
        rest: rest.expect("points"),
    };
    let properties: [(&str, Property<'_, T>); 7] = [
        ("it is made for this robot", Suite::robot),
        ("a blank observation is empty", Suite::blank),
        ("touched points and reading are observed", Suite::observes),
        ("the same is observed again", Suite::again),
        ("columns are of their own contacts", Suite::columns),
        ("readings that cannot be are refused", Suite::bad_readings),
        ("contacts that do not fit are refused", Suite::bad_contacts),
    ];
    let who = format!("{} sensor", T::NAME);
    for (property, check) in properties {
        ask(&who, property, || check(&suite));
    }
}

struct Suite<'a, T: Scalar> {
    sensor: &'a dyn Sensor<T>,
    posture: &'a Posture,
    rest: RestPoints,
}

/// A vector that differs for every `i`, with entries of some 0.5 to 1.5.
fn wave(i: usize, phase: usize) -> Vector3<f64> {
    let x = i as f64 + 0.7 * phase as f64;
    Vector3::new(
        (1.3 * x).sin(),
        (2.1 * x + 1.0).cos(),
        (0.7 * x + 2.0).sin(),
    )
}

impl<T: Scalar> Suite<'_, T> {
    /// Contacts of these points by all links in turn, displaced by some centimeters times `scale`.
    fn contacts(&self, points: impl IntoIterator<Item = usize>, scale: f64) -> Contacts {
        let (mut contacts, links) = (Contacts::new(), self.posture.link_poses().len());
        for p in points {
            let (u_W, n_W) = (0.03 * scale * wave(p, 1), wave(p, 2).normalize());
            let pushed = contacts.push(p as u32, (p % links.max(1)) as u32, u_W, n_W);
            pushed.expect("contacts in order");
        }
        contacts
    }

    fn reading(&self) -> Vec<f64> {
        (0..self.sensor.dim())
            .map(|i| 1.0 + 0.25 * i as f64)
            .collect()
    }

    /// The observation of these contacts.
    fn observed(&self, contacts: &Contacts) -> Observation<T> {
        let mut out = self.sensor.blank();
        self.observe(contacts, &mut out);
        out
    }

    fn observe(&self, contacts: &Contacts, out: &mut Observation<T>) {
        let reading = self.reading();
        let result = (self.sensor).observe(&self.rest, self.posture, contacts, &reading, out);
        result.unwrap_or_else(|error| panic!("good contacts were refused: {error}"));
    }

    fn refuses(&self, contacts: &Contacts, reading: &[f64], what: &str) {
        let mut out = self.sensor.blank();
        let result = (self.sensor).observe(&self.rest, self.posture, contacts, reading, &mut out);
        assert!(result.is_err(), "{what} was taken");
    }

    fn robot(&self) {
        if let Err(error) = self.sensor.check_robot(self.posture.chains()) {
            panic!("the robot of the posture was refused: {error}");
        }
    }

    fn blank(&self) {
        let blank = self.sensor.blank();
        assert!(self.sensor.dim() > 0, "it has no channel");
        assert_eq!(blank.dim(), self.sensor.dim(), "channels of a blank");
        assert!(blank.is_empty(), "a blank has points");
    }

    fn observes(&self) {
        for contacts in [
            Contacts::new(),
            self.contacts([3], 1.0),
            self.contacts(0..POINTS, 1.0),
        ] {
            let obs = self.observed(&contacts);
            assert_eq!(obs.points(), contacts.points(), "points");
            assert_eq!(obs.dim(), self.sensor.dim(), "channels");
            for (i, (got, given)) in obs.reading().iter().zip(self.reading()).enumerate() {
                let got = got.to_f64();
                assert!(
                    (got - given).abs() <= 4.0 * T::EPSILON.to_f64() * given,
                    "channel {i} of the reading is {got}, not {given}"
                );
            }
        }
    }

    fn again(&self) {
        let (few, many) = (self.contacts([1, 4], 1.0), self.contacts(0..POINTS, 0.5));
        let mut out = self.sensor.blank();
        for contacts in [&many, &few, &many, &Contacts::new(), &few] {
            self.observe(contacts, &mut out);
            let fresh = self.observed(contacts);
            let same = out == fresh;
            assert!(same, "another observation of {} contacts", contacts.len());
        }
    }

    fn columns(&self) {
        let all = self.observed(&self.contacts(0..POINTS, 1.0));
        for p in 0..POINTS {
            let alone = self.observed(&self.contacts([p], 1.0));
            let at_rest = self.observed(&self.contacts([p], 0.0));
            for i in 0..self.sensor.dim() {
                let (got, expected) = (all.row(i)[p].to_f64(), alone.row(i)[0].to_f64());
                assert!(
                    (got - expected).abs() <= 8.0 * T::EPSILON.to_f64() * expected.abs(),
                    "channel {i}: the entry of point {p} is {got} among others, {expected} alone"
                );
                let entry = at_rest.row(i)[0];
                assert!(
                    entry == T::ZERO,
                    "channel {i}: the entry of point {p} is {entry} without a displacement"
                );
            }
        }
    }

    fn bad_readings(&self) {
        let (contacts, good) = (self.contacts([2, 7], 1.0), self.reading());
        let longer = [&good[..], &[1.0]].concat();
        self.refuses(&contacts, &longer, "a longer reading");
        self.refuses(&contacts, &good[1..], "a shorter reading");
        for i in 0..good.len() {
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut reading = good.clone();
                reading[i] = bad;
                self.refuses(&contacts, &reading, &format!("{bad} in channel {i}"));
            }
        }
    }

    fn bad_contacts(&self) {
        let links = self.posture.link_poses().len() as u32;
        for (point, link, what) in [
            (POINTS as u32, 0, "a point that there is not"),
            (0, links, "a link that there is not"),
        ] {
            let mut contacts = Contacts::new();
            let pushed = contacts.push(point, link, 0.01 * wave(0, 1), Vector3::z());
            pushed.expect("a contact");
            self.refuses(&contacts, &self.reading(), what);
        }
    }
}
