//! A session, with contact of points or of cells, in which anything may come: numbers that are none, rows of any
//! length, jumps, touches that begin and end. Errors leave the belief alone, and a belief is always one.
#![no_main]

use libfuzzer_sys::arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use vsf::core::nalgebra::Vector3;
use vsf::core::{Belief, Estimator, Noise, Prediction, Session};
use vsf::filter::{CovarianceFilter, DiagonalForm, DiagonalKalman, InformationFilter};
use vsf::robots::JointTorques;
use vsf_fuzz::{JOINTS, WORLD, number, replay, row};

fn estimator(which: u8) -> Box<dyn Estimator<Scalar = f64>> {
    let prior = Belief::uniform(WORLD.rest.len(), 1.0, 10.0).expect("a prior");
    match which % 6 {
        0 => Box::new(DiagonalKalman::new(prior)),
        1 => Box::new(DiagonalKalman::with_form(
            prior,
            DiagonalForm::InnovationUpdated,
        )),
        2 => Box::new(DiagonalKalman::with_form(prior, DiagonalForm::Printed)),
        3 => Box::new(replay(prior).expect("a filter")),
        4 => Box::new(CovarianceFilter::new(prior).expect("a filter")),
        _ => Box::new(InformationFilter::new(prior).expect("a filter")),
    }
}

fn run(u: &mut Unstructured<'_>) -> Result<()> {
    let sensor = JointTorques::new(Noise::uniform(JOINTS, 0.1).expect("noise"));
    // The first byte chooses both: every estimator with either contact.
    let which: u8 = u.arbitrary()?;
    let contact = WORLD.contact(which / 6 % 2 == 1);
    let (chains, rest) = (WORLD.robot.chains().clone(), WORLD.rest.clone());
    let mut session =
        Session::new(chains, rest, contact, sensor, estimator(which)).expect("a session");
    let mut posture = WORLD.robot.posture();
    let mut predicted = Prediction::default();
    let start = WORLD.robot.update_posture(&[0.0; JOINTS], &mut posture);
    start.expect("a posture");
    while !u.is_empty() {
        let before = session.belief().clone();
        let refused = match u.arbitrary::<u8>()? {
            0 => {
                session.begin_sequence();
                false
            }
            1 => {
                session.begin_touch();
                false
            }
            2 => {
                let step = number(u)?;
                session.estimator_mut().diffuse(step).is_err()
            }
            3 => {
                // A posture from elsewhere, which need not be one of this robot.
                let (q, poses, screws) = posture.parts_mut();
                q[0] = number(u)?;
                let shift = Vector3::new(number(u)?, number(u)?, number(u)?);
                poses[JOINTS].translation.vector += shift;
                screws[0].angular *= number(u)?;
                false
            }
            4..32 => session.predict(&posture, &mut predicted).is_err(),
            op => {
                if op < 200 {
                    let _ = WORLD.robot.update_posture(&row(u, JOINTS)?, &mut posture);
                }
                session.step(&posture, &row(u, JOINTS)?).is_err()
            }
        };
        let after = session.belief();
        if refused {
            assert_eq!(*after, before);
        }
        Belief::new(after.mean().to_vec(), after.variance().to_vec()).expect("a belief");
    }
    Ok(())
}

fuzz_target!(|data: &[u8]| {
    let _ = run(&mut Unstructured::new(data));
});
