//! Effects on rows of a recording that a test writes by hand, and the parameters that explain them.
#![allow(dead_code, clippy::unwrap_used, clippy::panic)]

pub mod campaign;

use nalgebra::{DMatrix, DVector, Point3, Vector3};
use std::sync::Arc;
use vsf_core::{Contacts, RestPoints};
use vsf_data::TorqueKind;
use vsf_gap::effects::catalogue;
use vsf_gap::{Compensator, Effect, Role, Sample, Site, Touch};
use vsf_robots::RobotModel;

pub const GRAVITY: f64 = 9.81;

/// The effect of that name.
pub fn effect(name: &str) -> Arc<dyn Effect> {
    let found = catalogue().into_iter().find(|e| e.name() == name);
    found.unwrap_or_else(|| panic!("no effect {name}"))
}

pub fn site(robot: RobotModel, points: &[Point3<f64>], torque_kind: TorqueKind) -> Site {
    Site {
        robot: Arc::new(robot),
        rest: Arc::new(RestPoints::new(points.to_vec()).unwrap()),
        gravity: Vector3::new(0.0, 0.0, -GRAVITY),
        torque_kind,
        friction: 0.15,
        sequences: vec!["0".into(), "1".into()],
        duration: 10.0,
        sequence_duration: 5.0,
    }
}

/// One sample.
#[derive(Clone, Default)]
pub struct Row {
    pub clock: f64,
    pub dt: f64,
    pub q: Vec<f64>,
    pub qd: Vec<f64>,
    pub qdd: Vec<f64>,
    pub reading: Vec<f64>,
    pub load: Vec<f64>,
    pub force: Vector3<f64>,
    /// Points touched by the last moving link, with displacement and normal.
    pub touched: Vec<(u32, Vector3<f64>, Vector3<f64>)>,
    /// A sequence or a touch begins.
    pub begins: Option<Begins>,
}

#[derive(Clone, Copy, PartialEq)]
pub enum Begins {
    Sequence,
    Touch,
}

/// Rows at `rate` Hz over `seconds` with joint positions `q(t)`, whose derivatives are differences.
pub fn motion(seconds: f64, rate: f64, q: impl Fn(f64) -> Vec<f64>) -> Vec<Row> {
    let h = 1e-4;
    let row = |k: usize| {
        let t = k as f64 / rate;
        let (before, here, after) = (q(t - h), q(t), q(t + h));
        let d = here.len();
        let first = |j: usize| (after[j] - before[j]) / (2.0 * h);
        let second = |j: usize| (after[j] - 2.0 * here[j] + before[j]) / (h * h);
        Row {
            clock: t,
            dt: if k > 0 { 1.0 / rate } else { 0.0 },
            qd: (0..d).map(first).collect(),
            qdd: (0..d).map(second).collect(),
            q: here,
            reading: vec![0.0; d],
            load: vec![0.0; d],
            ..Row::default()
        }
    };
    (0..(seconds * rate) as usize).map(row).collect()
}

/// Torques of all rows with the effect, where every point has the stiffness `k` (N/m).
pub fn predict(site: &Site, effect: &dyn Effect, theta: &[f64], k: f64, rows: &[Row]) -> Vec<f64> {
    let mut compensator = effect.compensator(site, theta).unwrap();
    run(site, compensator.as_mut(), k, rows)
}

pub fn run(site: &Site, c: &mut dyn Compensator, k: f64, rows: &[Row]) -> Vec<f64> {
    let d = site.joints();
    let link = site.robot.joints()[d - 1].child();
    let mut posture = site.robot.posture();
    let mut contacts = Contacts::new();
    let mut all = Vec::new();
    c.begin_sequence("0");
    c.begin_touch();
    for row in rows {
        match row.begins {
            Some(Begins::Sequence) => {
                c.begin_sequence("1");
                c.begin_touch();
            }
            Some(Begins::Touch) => c.begin_touch(),
            None => {}
        }
        contacts.clear();
        for (p, u, n) in &row.touched {
            contacts.push(*p, link as u32, *u, *n).unwrap();
        }
        let sample = Sample {
            clock: row.clock,
            dt: row.dt,
            q: &row.q,
            qd: &row.qd,
            qdd: &row.qdd,
            reading: &row.reading,
            load: &row.load,
            force_W: row.force,
        };
        let mut q = row.q.clone();
        c.joints(&sample, &mut q);
        site.robot.update_posture(&q, &mut posture).unwrap();
        let touch = Touch {
            rest: &site.rest,
            posture: &posture,
            contacts: &contacts,
        };
        let mut springs = contacts.displacements().to_vec();
        let (mut gains, mut torques) = (vec![1.0; d], vec![0.0; d]);
        c.springs(&sample, &touch, &mut springs);
        c.gains(&sample, &touch, &mut gains);
        c.torques(&sample, &touch, &mut torques);
        for ((p, u, _), s) in row.touched.iter().zip(&springs) {
            let place = site.rest.positions()[*p as usize] + u;
            let mut of_point = vec![0.0; d];
            posture.joint_torques(link, &place, &(s * -k), &mut of_point);
            for j in 0..d {
                torques[j] += gains[j] * of_point[j];
            }
        }
        all.extend(torques);
    }
    all
}

/// Parameters that explain `data` best, where every point has the stiffness `k`.
pub fn fit(site: &Site, effect: &dyn Effect, k: f64, rows: &[Row], data: &[f64]) -> Vec<f64> {
    fit_with(site, effect, data, |theta| {
        predict(site, effect, theta, k, rows)
    })
}

/// Parameters with which `model` explains `data` best (Levenberg-Marquardt within the bounds), from
/// all starts of the effect with all amplitudes a little above zero.
pub fn fit_with(
    site: &Site,
    effect: &dyn Effect,
    data: &[f64],
    model: impl Fn(&[f64]) -> Vec<f64>,
) -> Vec<f64> {
    let parameters = effect.parameters(site);
    let n = parameters.len();
    let residual = |theta: &[f64]| DVector::from_column_slice(data) - DVector::from(model(theta));
    let mut best = (f64::INFINITY, Vec::new());
    for mut theta in effect.starts(site) {
        for (x, p) in theta.iter_mut().zip(&parameters) {
            if p.role == Role::Amplitude {
                *x = p.scale;
            }
        }
        let mut r = residual(&theta);
        let mut damping = 1e-3;
        for _ in 0..60 {
            // Columns per scale, so that the damping means the same for all.
            let mut tangent = DMatrix::zeros(data.len(), n);
            for (i, p) in parameters.iter().enumerate() {
                let mut moved = theta.clone();
                moved[i] += 1e-4 * p.scale;
                tangent.set_column(i, &((&r - residual(&moved)) * 1e4));
            }
            let normal = tangent.tr_mul(&tangent);
            let gradient = tangent.tr_mul(&r);
            let better = loop {
                let ridge = damping * normal.trace() / n as f64 + 1e-14;
                let lhs = &normal + DMatrix::identity(n, n) * ridge;
                let step = lhs.cholesky().unwrap().solve(&gradient);
                let tried: Vec<f64> = (theta.iter().zip(&parameters).zip(step.iter()))
                    .map(|((x, p), s)| (x + s * p.scale).clamp(p.bounds[0], p.bounds[1]))
                    .collect();
                let tried_r = residual(&tried);
                if tried_r.norm() < r.norm() {
                    damping *= 0.2;
                    break Some((tried, tried_r));
                }
                damping *= 5.0;
                if damping > 1e6 {
                    break None;
                }
            };
            let Some((tried, tried_r)) = better else {
                break;
            };
            let gained = r.norm() - tried_r.norm();
            (theta, r) = (tried, tried_r);
            if gained < 1e-9 * r.norm() || r.norm() < 1e-9 {
                break;
            }
        }
        if r.norm() < best.0 {
            best = (r.norm(), theta);
        }
    }
    best.1
}

/// Asserts that each parameter is within `tolerance` scales of the truth; NaN is not compared.
pub fn close(effect: &dyn Effect, site: &Site, found: &[f64], truth: &[f64], tolerance: f64) {
    let parameters = effect.parameters(site);
    assert_eq!(found.len(), truth.len());
    for ((p, f), t) in parameters.iter().zip(found).zip(truth) {
        let off = (f - t).abs() / p.scale;
        assert!(
            off < tolerance || t.is_nan(),
            "{}: {} is {f}, not {t}",
            effect.name(),
            p.name
        );
    }
}
