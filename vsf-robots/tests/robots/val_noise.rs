//! Noise of the joint-torque sensor, set through its public interface: the posterior is that of the
//! formula written out.

use nalgebra::{DMatrix, DVector, Point3, Vector3};
use std::sync::Arc;
use vsf_core::{
    Belief, ContactModel, Contacts, CoreError, Noise, Posture, RestPoints, Session, SymmetricFactor,
};
use vsf_filter::DiagonalKalman;
use vsf_robots::{JointTorques, jacobian, kinova_gen3};

const D: usize = 7;
const RESIDUAL: [f64; D] = [0.1, -0.2, 0.3, 0.05, 0.02, 0.2, -0.1];

/// Always the same five touched points.
#[derive(Clone)]
struct Fixed;

impl ContactModel for Fixed {
    fn reset(&mut self) {}
    fn step(
        &mut self,
        _: &RestPoints,
        posture: &Posture,
        out: &mut Contacts,
    ) -> Result<(), CoreError> {
        posture.check()?;
        out.clear();
        for (point, link) in [(0u32, 3u32), (1, 4), (2, 8), (3, 5), (4, 9)] {
            let u_W = Vector3::new(0.1, 0.02 * f64::from(point), -0.05);
            out.push(point, link, u_W, Vector3::z())?;
        }
        Ok(())
    }
}

fn rest() -> RestPoints {
    let points = (0..5).map(|i| Point3::new(0.1 * f64::from(i), 0.1, 0.4));
    RestPoints::new(points.collect()).unwrap()
}

/// `W = -J^T u` from Jacobians.
fn matrix(posture: &Posture) -> DMatrix<f64> {
    let rest = rest();
    let mut contacts = Contacts::new();
    Fixed.step(&rest, posture, &mut contacts).unwrap();
    let mut w = DMatrix::zeros(D, 5);
    for k in 0..5 {
        let u = contacts.displacements()[k];
        let p_W = rest.positions()[k] + u;
        let mut columns = [Vector3::zeros(); D];
        jacobian(posture, contacts.links()[k] as usize, &p_W, &mut columns).unwrap();
        for i in 0..D {
            w[(i, k)] = -columns[i].dot(&u);
        }
    }
    w
}

/// Posterior mean `(P^-1 + W^T R^-1 W)^-1 (P^-1 m + W^T R^-1 tau)`.
fn posterior(
    prior: &Belief<f64>,
    w: &DMatrix<f64>,
    r: &DMatrix<f64>,
    tau: &DVector<f64>,
) -> DVector<f64> {
    let r_inv = r.clone().try_inverse().unwrap();
    let p_inv = DVector::from_iterator(5, prior.variance().iter().map(|v| 1.0 / v));
    let p_inv = DMatrix::from_diagonal(&p_inv);
    let rhs = &p_inv * DVector::from_column_slice(prior.mean()) + w.transpose() * &r_inv * tau;
    (p_inv + w.transpose() * r_inv * w)
        .lu()
        .solve(&rhs)
        .unwrap()
}

#[test]
fn correlated_noise_that_changes_while_a_session_runs() {
    let robot = kinova_gen3().unwrap();
    let mut posture = robot.posture();
    let q = [0.3, 0.8, -0.4, 1.1, 0.2, -0.7, 0.5];
    robot.update_posture(&q, &mut posture).unwrap();
    let w = matrix(&posture);
    let sensor = JointTorques::new(Noise::uniform(D, 0.3).unwrap());
    let prior = Belief::<f64>::uniform(5, 50.0, 10.0).unwrap();
    let filter = DiagonalKalman::new(prior);
    let mut session = Session::new(
        robot.chains().clone(),
        Arc::new(rest()),
        Fixed,
        sensor,
        filter,
    )
    .unwrap();

    let mix = DMatrix::from_fn(D, D, |i, j| {
        if i == j {
            0.3
        } else {
            0.02 * (i + 2 * j) as f64
        }
    });
    let full = &mix * mix.transpose();
    let mut noise = Noise::uniform(D, 1.0).unwrap();
    noise
        .set_full(D, full.as_slice(), &mut SymmetricFactor::default())
        .unwrap();
    let sd = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7];
    for (noise, r) in [
        (None, DMatrix::identity(D, D) * 0.09),
        (
            Some(Noise::per_channel(&sd).unwrap()),
            DMatrix::from_diagonal(&DVector::from_iterator(D, sd.iter().map(|s| s * s))),
        ),
        (Some(noise), full),
    ] {
        if let Some(noise) = &noise {
            session.sensor_mut().set_noise(noise).unwrap();
        }
        let before = session.belief().clone();
        // Near the prediction, so that no stiffness is projected to 0.
        let mean = DVector::from_column_slice(before.mean());
        let tau = &w * mean + DVector::from_column_slice(&RESIDUAL);
        let expected = posterior(&before, &w, &r, &tau);
        session.step(&posture, tau.as_slice()).unwrap();
        assert_eq!(session.observation().noise(), session.sensor().noise());
        for (k, e) in expected.iter().enumerate() {
            let got = session.belief().mean()[k];
            assert!(
                (got - e.max(0.0)).abs() < 1e-9,
                "point {k}: {got}, formula {e}"
            );
            assert!(
                (got - before.mean()[k]).abs() > 1e-6,
                "point {k} learned nothing"
            );
        }
    }

    let other = Noise::uniform(3, 0.1).unwrap();
    assert!(session.sensor_mut().set_noise(&other).is_err());
    assert_eq!(session.sensor().noise().dim(), D);
}
