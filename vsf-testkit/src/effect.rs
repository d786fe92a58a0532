mod drive;
mod suite;

use crate::property::ask;
use std::sync::Arc;
use suite::Suite;
use vsf_core::RestPoints;
use vsf_core::nalgebra::{Point3, Vector3};
use vsf_data::TorqueKind;
use vsf_gap::{Effect, Need, Site};
use vsf_robots::{RobotError, RobotModel, cartesian_stage, kinova_gen3, planar_arm};

type Property<'a> = fn(&Suite<'a>);

/// Checks that an effect and its compensators keep the promises of [`Effect`] and [`vsf_gap::Compensator`] at each of the
/// sites, such as [`sites`].
///
/// The check uses two sequences of two touches each, with made-up motions, readings and contacts. Sites that cannot meet
/// the effect's needs (points to touch, several joints) are skipped.
///
/// | property |
/// | --- |
/// | name, parameters, bounds, scales, starts and null gain are valid ([`vsf_gap::check_declaration`]) |
/// | the summary names all parameters in backquotes, numbered ones up to their first `_` |
/// | a wrong number of parameters is refused |
/// | amplitudes at zero change nothing, neither alone nor after other effects |
/// | it acts on what it says, at one of the sites at least, and no deeper |
/// | torques are added, gains multiplied, springs changed: what other effects did stays |
/// | two of a kind behave the same, bit for bit |
/// | everything is finite within the bounds, and contact parameters are in range |
/// | it is continuous in its parameters: a jump is at most half of the change over a parameter's scale |
///
/// It does not check that nothing is allocated after the first samples.
///
/// # Panics
/// With the names of the effect, the site and the property that does not hold.
///
/// ```
/// use vsf_gap::effects::Payload;
/// vsf_testkit::check_effect(&Payload, &vsf_testkit::sites()?);
/// # Ok::<(), vsf_robots::RobotError>(())
/// ```
pub fn check_effect(effect: &dyn Effect, sites: &[Site]) {
    let mut acts = false;
    let fit: Vec<_> = (sites.iter().enumerate())
        .filter(|(_, site)| holds(site, effect.needs()))
        .collect();
    for &(k, site) in &fit {
        let robot = site.robot.name();
        let who = format!("effect {:?}, site {k} ({robot})", effect.name());
        // The other properties take parameters from it.
        ask(&who, "it declares what can be", || {
            if let Err(error) = vsf_gap::check_declaration(effect, site) {
                panic!("{error}");
            }
        });
        let suite = Suite::new(effect, site);
        let properties: [(&str, Property<'_>); 8] = [
            ("its summary names all parameters", Suite::summary),
            ("parameters of another number are refused", Suite::numbers),
            ("amplitudes at zero change nothing", Suite::neutral),
            ("it acts no deeper than it says", Suite::depth),
            ("what other effects did stays", Suite::composes),
            ("two of a kind behave the same", Suite::determinism),
            ("all is finite within the bounds", Suite::finite),
            ("it is continuous in its parameters", Suite::continuous),
        ];
        for (property, check) in properties {
            ask(&who, property, || check(&suite));
        }
        acts |= suite.acts();
    }
    ask(&format!("effect {:?}", effect.name()), "it acts", || {
        assert!(
            acts,
            "with all amplitudes at their scales nothing that it says it acts on changes at any of {} sites that have what it needs",
            fit.len()
        );
    });
}

/// Whether a site can meet all needs. Those for motion are met by the made-up motion.
fn holds(site: &Site, needs: &[Need]) -> bool {
    needs.iter().all(|need| match need {
        Need::Contact | Need::Retouch => !site.rest.is_empty(),
        Need::Joints => site.joints() > 1,
        Need::Weight | Need::FreeMotion => true,
    })
}

/// Sites of all kinds: revolute and prismatic joints, readings with and without the arm's weight, with and without points
/// to touch.
///
/// One arm has a single joint, the others have three. An effect needs parameters for the existing joints, and none where
/// its joint is missing. Otherwise, check it only at the sites that can have it ([`Site::joints`](vsf_gap::Site::joints)).
///
/// # Errors
/// None in practice: the robots are built in.
pub fn sites() -> Result<Vec<Site>, RobotError> {
    let all = [
        (planar_arm(3, 0.3, 0.03)?, TorqueKind::External, 3),
        (planar_arm(3, 0.3, 0.03)?, TorqueKind::Measured, 3),
        (planar_arm(1, 0.3, 0.03)?, TorqueKind::Measured, 0),
        (cartesian_stage(0.01)?, TorqueKind::External, 2),
        (kinova_gen3()?, TorqueKind::Measured, 2),
    ];
    let site = |(robot, kind, edge)| site(robot, kind, edge);
    all.into_iter().map(site).collect()
}

/// A cube of points 1 cm apart, with `edge` points along an edge.
fn site(robot: RobotModel, torque_kind: TorqueKind, edge: usize) -> Result<Site, RobotError> {
    let axis = || (0..edge).map(|i| 0.01 * i as f64);
    let points = axis().flat_map(|x| {
        axis().flat_map(move |y| axis().map(move |z| Point3::new(0.4 + x, y, 0.1 + z)))
    });
    Ok(Site {
        robot: Arc::new(robot),
        rest: Arc::new(RestPoints::new(points.collect())?),
        gravity: Vector3::new(0.0, 0.0, -9.81),
        torque_kind,
        friction: 0.15,
        sequences: vec!["1".to_owned(), "2".to_owned()],
        duration: 10.0,
        sequence_duration: 5.0,
    })
}
