//! A contact model, a sensor and an estimator defined outside the workspace run in a `Session`.

use std::sync::Arc;
use vsf_core::nalgebra::{Point3, Vector3};
use vsf_core::{
    Belief, ContactModel, Contacts, CoreError, Estimator, FilterHealth, LinkChains, Noise,
    Observation, Posture, Prediction, RestPoints, Sensor, Session, SymmetricFactor, UpdateReport,
};

/// A wall at height q that presses every point above it down. Remembers how often it has moved.
#[derive(Clone, Default)]
struct Wall {
    steps: usize,
}

impl ContactModel for Wall {
    fn reset(&mut self) {}
    fn step(
        &mut self,
        rest: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError> {
        posture.check()?;
        self.steps += 1;
        out.clear();
        for (i, p) in rest.positions().iter().enumerate() {
            let depth = p.z - posture.q()[0];
            if depth > 0.0 {
                out.push(i as u32, 0, -depth * Vector3::z(), -Vector3::z())?;
            }
        }
        Ok(())
    }
}

/// Measures the vertical force on the wall.
#[derive(Clone)]
struct Gauge;

impl Sensor<f64> for Gauge {
    fn dim(&self) -> usize {
        1
    }
    fn blank(&self) -> Observation<f64> {
        Observation::new(Noise::uniform(1, 0.1).unwrap())
    }
    fn observe(
        &self,
        rest: &RestPoints,
        _: &Posture,
        contacts: &Contacts,
        reading: &[f64],
        out: &mut Observation<f64>,
    ) -> Result<(), CoreError> {
        out.rebuild(rest.len(), contacts.points(), reading, |k, w| {
            w[0] = -contacts.displacements()[k].z;
        })
    }
}

/// Nudges all touched points by the same amount.
#[derive(Clone)]
struct Nudge(Belief<f64>);

impl Estimator for Nudge {
    type Scalar = f64;
    fn belief(&self) -> &Belief<f64> {
        &self.0
    }
    fn reset(&mut self, prior: Belief<f64>) -> Result<(), CoreError> {
        self.0 = prior;
        Ok(())
    }
    fn update(&mut self, obs: &Observation<f64>) -> Result<UpdateReport, CoreError> {
        obs.check_fits(self.0.len())?;
        for &p in obs.points() {
            self.0.parts_mut().0[p as usize] += 1.0;
        }
        Ok(UpdateReport {
            contacts: obs.len(),
            dof: 1,
            ..Default::default()
        })
    }
    fn whitened_residual(&self) -> &[f64] {
        &[]
    }
}

/// One joint that moves the only link.
fn chains() -> Arc<LinkChains> {
    Arc::new(LinkChains::new(1, vec![vec![0]]).unwrap())
}

#[test]
fn a_joint_is_once_in_a_chain() {
    let error = LinkChains::new(2, vec![vec![0], vec![0, 1, 0]]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "in the chain of a link, joint 0 occurs twice"
    );
    assert!(LinkChains::new(2, vec![vec![0, 2]]).is_err());
}

fn posture(q: f64) -> Posture {
    let mut posture = Posture::new(chains());
    posture.parts_mut().0[0] = q;
    posture
}

fn rest() -> Arc<RestPoints> {
    let points = vec![Point3::new(0.0, 0.0, 1.0), Point3::new(0.0, 0.0, 2.0)];
    Arc::new(RestPoints::new(points).unwrap())
}

fn nudge() -> Nudge {
    Nudge(Belief::uniform(2, 0.0, 2.0).unwrap())
}

type AnyEstimator = Box<dyn Estimator<Scalar = f64>>;

/// Of parts that are chosen at run time.
fn session() -> Session<Box<dyn ContactModel>, Box<dyn Sensor<f64>>, AnyEstimator> {
    let estimator: AnyEstimator = Box::new(nudge());
    let contact: Box<dyn ContactModel> = Box::new(Wall::default());
    let sensor: Box<dyn Sensor<f64>> = Box::new(Gauge);
    Session::new(chains(), rest(), contact, sensor, estimator).unwrap()
}

#[test]
fn parts_chosen_at_run_time_say_what_they_are() {
    let estimator: AnyEstimator = Box::new(nudge());
    let contact: Box<dyn ContactModel> = Box::new(Wall::default());
    let sensor: Box<dyn Sensor<f64>> = Box::new(Gauge);
    let text = format!("{estimator:?} {contact:?} {sensor:?}");
    assert!(
        text.contains("points: 2") && text.contains("channels: 1"),
        "{text}"
    );
}

#[test]
fn a_glance_aside_says_what_a_prediction_would_and_changes_nothing() {
    let mut session = session();
    session.step(&posture(1.5), &[3.0]).unwrap();
    let (mut aside, mut there) = (Prediction::default(), Prediction::default());
    session.predict_at(&posture(0.5), &mut aside).unwrap();
    assert_eq!(session.contacts().points(), [1]);
    assert_eq!(session.observation().points(), [1]);
    assert!(session.predict_at(&posture(f64::NAN), &mut there).is_err());
    session.predict(&posture(0.5), &mut there).unwrap();
    assert_eq!(aside, there);
    assert_eq!(session.contacts().points(), [0, 1]);
}

#[test]
fn a_clone_goes_its_own_way() {
    let mut session = session();
    session.step(&posture(1.5), &[3.0]).unwrap();
    let mut aside = session.clone();
    aside.step(&posture(0.5), &[3.0]).unwrap();
    assert_eq!(session.belief().mean(), [0.0, 1.0]);
    assert_eq!(session.contacts().points(), [1]);
    assert_eq!(session.health().updates(), 1);
    assert_eq!(aside.belief().mean(), [1.0, 2.0]);
    assert_eq!(aside.health().updates(), 2);
}

#[test]
fn postures_of_another_robot_or_of_none_are_refused() {
    let mut session = session();
    session.step(&posture(1.5), &[3.0]).unwrap();
    let before = session.belief().clone();
    let written = |joints, links: Vec<Vec<u32>>| {
        let mut posture = Posture::new(Arc::new(LinkChains::new(joints, links).unwrap()));
        posture.parts_mut().0[0] = 0.5;
        posture
    };
    let mut out = Prediction::default();
    for foreign in [
        written(2, vec![vec![0]]),
        written(1, vec![vec![0], vec![0]]),
        written(1, vec![vec![]]),
    ] {
        let (joints, links) = (foreign.q().len(), foreign.link_poses().len());
        let expected = CoreError::ForeignPosture {
            joints,
            links,
            expected_joints: 1,
            expected_links: 1,
        };
        assert_eq!(session.step(&foreign, &[3.0]).unwrap_err(), expected);
        assert_eq!(session.predict(&foreign, &mut out).unwrap_err(), expected);
        assert_eq!(session.predict_at(&foreign, &mut out), Err(expected));
    }
    let unwritten = Posture::new(chains());
    let expected = CoreError::UnwrittenPosture;
    assert_eq!(session.step(&unwritten, &[3.0]).unwrap_err(), expected);
    assert_eq!(session.predict(&unwritten, &mut out).unwrap_err(), expected);
    assert_eq!(session.predict_at(&unwritten, &mut out), Err(expected));
    assert_eq!(session.belief(), &before);
}

/// A sensor of a robot with two joints, and one whose observations are wider than it says.
#[derive(Clone)]
struct Wide {
    dim: usize,
    blank: usize,
}

impl Sensor<f64> for Wide {
    fn dim(&self) -> usize {
        self.dim
    }
    fn blank(&self) -> Observation<f64> {
        Observation::new(Noise::uniform(self.blank, 0.1).unwrap())
    }
    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        CoreError::check_len("joints of the robot", chains.joint_count(), self.dim)
    }
    fn observe(
        &self,
        _: &RestPoints,
        _: &Posture,
        _: &Contacts,
        _: &[f64],
        _: &mut Observation<f64>,
    ) -> Result<(), CoreError> {
        Ok(())
    }
}

#[test]
fn sensors_of_the_wrong_width_are_refused_at_once() {
    let made = |sensor: Wide| {
        let sensor: Box<dyn Sensor<f64>> = Box::new(sensor);
        Session::new(chains(), rest(), Wall::default(), sensor, nudge())
    };
    for (dim, blank, what) in [(2, 2, "joints of the robot"), (1, 2, "blank observation")] {
        let error = made(Wide { dim, blank }).unwrap_err();
        assert!(error.to_string().starts_with(what), "{error}");
    }
    assert!(made(Wide { dim: 1, blank: 1 }).is_ok());
}

/// A contact of another robot, and an estimator that reports what is no number.
#[test]
fn foreign_parts_are_refused_by_what_they_say() {
    #[derive(Clone)]
    struct Elsewhere;
    impl ContactModel for Elsewhere {
        fn reset(&mut self) {}
        fn check_robot(&self, _: &LinkChains) -> Result<(), CoreError> {
            Err(CoreError::other("of another robot"))
        }
        fn step(&mut self, _: &RestPoints, _: &Posture, _: &mut Contacts) -> Result<(), CoreError> {
            Ok(())
        }
    }
    let contact: Box<dyn ContactModel> = Box::new(Elsewhere);
    let error = Session::new(chains(), rest(), contact, Gauge, nudge()).unwrap_err();
    assert_eq!(error, CoreError::other("of another robot"));

    #[derive(Clone)]
    struct Boundless(Nudge);
    impl Estimator for Boundless {
        type Scalar = f64;
        fn belief(&self) -> &Belief<f64> {
            self.0.belief()
        }
        fn reset(&mut self, prior: Belief<f64>) -> Result<(), CoreError> {
            self.0.reset(prior)
        }
        fn update(&mut self, obs: &Observation<f64>) -> Result<UpdateReport, CoreError> {
            let report = self.0.update(obs)?;
            let nis = f64::NAN;
            Ok(UpdateReport { nis, ..report })
        }
        fn whitened_residual(&self) -> &[f64] {
            &[]
        }
    }
    let parts = (Wall::default(), Gauge, Boundless(nudge()));
    let mut session = Session::new(chains(), rest(), parts.0, parts.1, parts.2).unwrap();
    let error = session.step(&posture(1.5), &[0.1]).unwrap_err();
    assert!(matches!(error, CoreError::NotFinite { .. }), "{error}");
    assert_eq!(session.health().updates(), 0);
    let mut health = FilterHealth::default();
    health.record(&UpdateReport {
        dof: 1,
        nis: f64::INFINITY,
        ..Default::default()
    });
    assert_eq!(health, FilterHealth::default());
}

/// What a contact model knows of the world may change while the session runs.
#[test]
fn the_contact_model_is_within_reach() {
    let parts = (Wall::default(), Gauge, nudge());
    let mut session = Session::new(chains(), rest(), parts.0, parts.1, parts.2).unwrap();
    session.step(&posture(1.5), &[0.1]).unwrap();
    assert_eq!(session.contact().steps, 1);
    session.contact_mut().steps = 7;
    session.step(&posture(1.5), &[0.1]).unwrap();
    assert_eq!(session.contact().steps, 8);
}

#[test]
fn a_step_runs_all_three_parts() {
    let mut session = session();
    assert_eq!(session.step(&posture(1.5), &[3.0]).unwrap().contacts, 1);
    assert_eq!(session.step(&posture(0.5), &[3.0]).unwrap().contacts, 2);
    assert_eq!(session.belief().mean(), [1.0, 2.0]);
    assert_eq!(session.health().updates(), 2);
}

/// A session after a restart goes on counting.
#[test]
fn statistics_go_on_from_others() {
    let mut before = session();
    before.step(&posture(1.5), &[3.0]).unwrap();
    let mut after = session().with_health(*before.health());
    after.step(&posture(0.5), &[3.0]).unwrap();
    assert_eq!(after.health().updates(), 2);
}

#[test]
fn a_prediction_learns_nothing_and_carries_both_uncertainties() {
    let mut session = session();
    session.step(&posture(1.5), &[3.0]).unwrap();
    let mut prediction = Prediction::default();
    session.predict(&posture(0.5), &mut prediction).unwrap();
    assert_eq!(prediction.mean, [1.5]);
    let variance = 4.0 * (0.5f64.powi(2) + 1.5f64.powi(2)) + 0.01;
    assert!((prediction.sd[0] - variance.sqrt()).abs() < 1e-12);
    assert_eq!(session.belief().mean(), [0.0, 1.0]);
}

#[test]
fn bad_readings_and_postures_leave_the_belief() {
    let mut session = session();
    session.step(&posture(1.5), &[3.0]).unwrap();
    let before = session.belief().clone();
    assert!(session.step(&posture(0.5), &[f64::NAN]).is_err());
    assert!(session.step(&posture(0.5), &[1.0, 2.0]).is_err());
    for spike in [1e150, -1e13] {
        let error = session.step(&posture(0.5), &[spike]).unwrap_err();
        assert!(error.to_string().contains("beyond any robot"), "{error}");
    }
    assert!(session.step(&posture(f64::INFINITY), &[1.0]).is_err());
    assert_eq!(session.belief(), &before);
}

#[test]
fn an_estimator_changed_from_outside_has_to_fit() {
    let mut session = session();
    session.step(&posture(1.5), &[3.0]).unwrap();
    let longer = Belief::uniform(3, 0.0, 2.0).unwrap();
    let before = (session.belief().clone(), *session.health());
    assert!(session.reset(longer.clone()).is_err());
    assert_eq!((session.belief().clone(), *session.health()), before);
    session.estimator_mut().reset(longer).unwrap();
    let mut out = Prediction::default();
    assert!(session.step(&posture(1.5), &[3.0]).is_err());
    assert!(session.predict(&posture(1.5), &mut out).is_err());
}

#[test]
fn a_reset_starts_over() {
    let mut session = session();
    session.step(&posture(0.5), &[3.0]).unwrap();
    let prior = Belief::uniform(2, 5.0, 1.0).unwrap();
    session.reset(prior.clone()).unwrap();
    assert_eq!(session.belief(), &prior);
    assert_eq!(session.health().updates(), 0);
    assert!(session.contacts().is_empty());
}

#[test]
fn observations_are_checked_on_building() {
    let mut obs = Observation::<f32>::new(Noise::uniform(1, 1.0).unwrap());
    let one = |_: usize, w: &mut [f64]| w[0] = 1.0;
    assert!(obs.rebuild(3, &[0, 2], &[1.0], one).is_ok());
    for (points, reading) in [
        (&[2u32, 0][..], &[1.0][..]),
        (&[1, 1][..], &[1.0][..]),
        (&[0, 3][..], &[1.0][..]),
        (&[0][..], &[1.0, 2.0][..]),
        (&[0][..], &[f64::NAN][..]),
        (&[0][..], &[1e300][..]),
    ] {
        assert!(
            obs.rebuild(3, points, reading, one).is_err(),
            "{points:?} {reading:?}"
        );
        assert!(obs.is_empty());
    }
    assert!(
        obs.rebuild(3, &[0], &[1.0], |_, w| w[0] = f64::INFINITY)
            .is_err()
    );
    assert!(
        obs.rebuild(3, &[0], &[1.0], |_, w| w[0] = 1e300).is_err(),
        "beyond f32"
    );
    let mut obs = Observation::<f64>::new(Noise::uniform(1, 0.1).unwrap());
    assert!(
        obs.rebuild(3, &[0], &[1e160], one).is_err(),
        "its square overflows"
    );
}

#[test]
fn beliefs_and_noise_are_checked_on_building() {
    // Memory that nothing could give is not asked for.
    assert!(matches!(
        Noise::uniform(1 << 33, 1.0),
        Err(CoreError::TooMany { .. })
    ));
    assert!(matches!(
        Belief::<f64>::uniform(usize::MAX, 1.0, 1.0),
        Err(CoreError::TooMany { .. })
    ));
    assert!(Belief::<f64>::uniform(3, 0.0, 0.0).is_err());
    assert!(Belief::<f64>::uniform(3, -1.0, 1.0).is_err());
    assert!(
        Belief::<f32>::uniform(3, 0.0, 1e-30).is_err(),
        "variance underflows f32"
    );
    assert!(Belief::new(vec![0.0], vec![f64::NAN]).is_err());
    assert!(Belief::new(vec![0.0], vec![1.0, 1.0]).is_err());
    assert!(Noise::uniform(2, f64::NAN).is_err());
    assert!(
        Noise::full(2, vec![1.0, 0.5, 0.4, 1.0]).is_err(),
        "asymmetric"
    );
    assert!(
        Noise::full(2, vec![1.0, 2.0, 2.0, 1.0]).is_err(),
        "indefinite"
    );
    assert!(Noise::full(2, vec![2.0, 1.0, 1.0, 2.0]).is_ok());
}

#[test]
fn noise_is_replaced_within_its_memory_or_not_at_all() {
    let mut noise = Noise::uniform(2, 1.0).unwrap();
    let mut workspace = SymmetricFactor::default();
    let mut set = |noise: &mut Noise, dim, r: &[f64]| noise.set_full(dim, r, &mut workspace);
    for (dim, bad) in [
        (2, &[1.0, 0.5, 0.4, 1.0][..]),
        (2, &[1.0, 2.0, 2.0, 1.0]),
        (2, &[1.0, f64::NAN, f64::NAN, 1.0]),
        (3, &[1.0, 0.0, 0.0, 1.0]),
        (usize::MAX, &[1.0]),
    ] {
        assert!(set(&mut noise, dim, bad).is_err(), "{dim}: {bad:?}");
        assert_eq!(noise, Noise::uniform(2, 1.0).unwrap());
    }
    let r = [2.0, 1.0, 1.0, 2.0];
    set(&mut noise, 2, &r).unwrap();
    assert_eq!(noise, Noise::full(2, r.to_vec()).unwrap());
    set(&mut noise, 1, &[4.0]).unwrap();
    assert_eq!(noise, Noise::uniform(1, 2.0).unwrap());
    for bad in [&[1.0, 0.0][..], &[1.0, f64::NAN], &[-1.0], &[1e-200]] {
        assert!(noise.set_per_channel(bad).is_err(), "{bad:?}");
        assert_eq!(noise, Noise::uniform(1, 2.0).unwrap());
    }
    noise.set_per_channel(&[1.0, 2.0]).unwrap();
    assert_eq!(noise, Noise::per_channel(&[1.0, 2.0]).unwrap());
    let mut obs = Observation::<f64>::new(noise);
    assert!(obs.set_noise_sd(&[1.0]).is_err());
    obs.set_reading(&[1e9, 0.0]).unwrap();
    let before = obs.clone();
    for (refused, overflows) in [
        ([1.0, 0.0], false),
        ([f64::NAN, 1.0], false),
        ([1e-150, 1e-150], true),
    ] {
        let error = obs.set_noise_sd(&refused).unwrap_err();
        assert_eq!(matches!(error, CoreError::Overflow { .. }), overflows);
        assert!(obs == before, "{refused:?}");
    }
    obs.set_noise_sd(&[3.0, 4.0]).unwrap();
    assert_eq!(obs.noise(), &Noise::per_channel(&[3.0, 4.0]).unwrap());
}

/// Observations in another number type are the same, or say that they cannot be.
#[test]
fn observations_change_their_number_type() {
    let mut obs = Observation::<f64>::new(Noise::uniform(1, 1.0).unwrap());
    let column = |k: usize, w: &mut [f64]| w[0] = 0.5 + k as f64;
    obs.rebuild(3, &[0, 2], &[1.5], column).unwrap();
    let mut cast = Observation::<f32>::new(Noise::uniform(2, 7.0).unwrap());
    cast.cast_from(&obs).unwrap();
    let mut expected = Observation::<f32>::new(Noise::uniform(1, 1.0).unwrap());
    expected.rebuild(3, &[0, 2], &[1.5], column).unwrap();
    assert_eq!(cast, expected);
    obs.rebuild(3, &[0], &[1.5], |_, w| w[0] = 1e300).unwrap();
    assert!(matches!(
        cast.cast_from(&obs),
        Err(CoreError::Overflow { .. })
    ));
    assert!(cast.is_empty() && cast.reading() == [0.0]);
}

#[test]
fn a_belief_diffuses_or_stays() {
    let mut belief = Belief::<f32>::new(vec![1.0, 2.0], vec![1.0, f32::MAX]).unwrap();
    let before = belief.clone();
    for bad in [-1.0, f32::NAN, f32::INFINITY, f32::MAX] {
        assert!(belief.diffuse(bad).is_err(), "{bad}");
        assert_eq!(belief, before);
    }
    belief.diffuse(0.0).unwrap();
    assert_eq!(belief, before);
    let mut belief = Belief::new(vec![1.0, 2.0], vec![1.0, 3.0]).unwrap();
    belief.diffuse(0.5).unwrap();
    assert_eq!(belief, Belief::new(vec![1.0, 2.0], vec![1.5, 3.5]).unwrap());
}

#[test]
fn an_estimator_of_a_constant_field_says_so() {
    let mut estimator: AnyEstimator = Box::new(Nudge(Belief::uniform(2, 0.0, 2.0).unwrap()));
    let error = estimator.diffuse(1.0).unwrap_err();
    assert!(matches!(error, CoreError::Unsupported { .. }));
    let text = error.to_string();
    assert!(
        text.contains("Estimator::diffuse") && text.contains("Nudge"),
        "{text}"
    );
    assert_eq!(estimator.belief(), &Belief::uniform(2, 0.0, 2.0).unwrap());
}
