//! What holds for every effect: nothing at zero, finite within the bounds, and open to others.
#![allow(clippy::unwrap_used)]

mod common;

use common::campaign::{RATE, Rows, free_arm, plate, torques};
use std::sync::Arc;
use vsf_gap::effects::catalogue;
use vsf_gap::{
    Acts, Campaign, Compensator, Effect, GapError, Model, Need, Parameter, Role, Sample, Site,
    Touch,
};

const NAMES: [&str; 27] = [
    "torque_bias",
    "torque_drift",
    "torque_gain",
    "joint_coulomb_friction",
    "joint_viscous_friction",
    "joint_stribeck_friction",
    "joint_load_friction",
    "payload",
    "gravity_tilt",
    "inertial_error",
    "joint_coupling",
    "encoder_offset",
    "joint_elasticity",
    "latency",
    "registration_offset",
    "geometry_padding",
    "contact_friction",
    "adhesion",
    "object_base_motion",
    "viscoelastic",
    "stress_relaxation",
    "plastic_set",
    "damage_softening",
    "strain_stiffening",
    "spatial_coupling",
    "anisotropy",
    "inertia_drag",
];

/// The plate presses a few points twice and drags them along.
fn pressing() -> Campaign {
    let row = |k: usize| {
        let t = k as f64 / RATE;
        let q = vec![
            3e-3 * (5.0 * t).sin(),
            1e-3 * t,
            4e-3 - 0.02 * (3.0 * t).sin().max(-0.2),
        ];
        (q, vec![1.0 - t, 0.3, 3.0 * (3.0 * t).sin().max(0.0)])
    };
    let rows: Rows = (0..220).map(row).collect();
    let points: Vec<[f64; 3]> = (0..9)
        .map(|k| {
            [
                0.01 * (k % 3) as f64,
                0.01 * (k / 3) as f64,
                1e-3 * k as f64,
            ]
        })
        .collect();
    plate(&points, &[rows.clone(), rows])
}

fn waving() -> Campaign {
    let row = |k: usize| {
        let t = k as f64 / RATE;
        let q = vec![(2.0 * t).sin(), 0.3 - t, 0.5 * (4.0 * t).cos()];
        (q, vec![5.0 * (2.0 * t).cos(), 1.0, -0.2 * t])
    };
    let rows: Rows = (0..150).map(row).collect();
    free_arm(&[rows.clone(), rows])
}

#[test]
fn the_catalogue_is_whole() {
    let names: Vec<_> = catalogue().iter().map(|e| e.name().to_owned()).collect();
    assert_eq!(names, NAMES);
}

#[test]
fn amplitudes_at_zero_change_nothing() {
    for campaign in [pressing(), waving()] {
        let nominal = torques(&campaign, &Model::default(), 300.0);
        for effect in catalogue() {
            for start in effect.starts(&campaign.site) {
                let found = torques(&campaign, &Model::of(&effect, &start), 300.0);
                assert_eq!(found, nominal, "{}", effect.name());
            }
        }
    }
}

#[test]
fn parameters_are_well_formed() {
    for campaign in [pressing(), waving()] {
        for effect in catalogue() {
            let parameters = effect.parameters(&campaign.site);
            let starts = effect.starts(&campaign.site);
            assert!(
                !parameters.is_empty() && !starts.is_empty(),
                "{}",
                effect.name()
            );
            for (i, p) in parameters.iter().enumerate() {
                let what = format!("{} {}", effect.name(), p.name);
                assert!(parameters[..i].iter().all(|q| q.name != p.name), "{what}");
                let [low, high] = p.bounds;
                assert!(
                    low < high && p.scale > 0.0 && p.scale < high - low,
                    "{what}"
                );
                if p.role == Role::Amplitude {
                    assert!(low <= 0.0 && high > 0.0, "{what}");
                }
                for start in &starts {
                    assert_eq!(start.len(), parameters.len(), "{what}");
                    assert!(low <= start[i] && start[i] <= high, "{what}");
                }
            }
            let site = &campaign.site;
            let wrong = vec![0.0; parameters.len() + 1];
            assert!(
                effect.compensator(site, &wrong).is_err(),
                "{}",
                effect.name()
            );
            let mut nan = starts[0].clone();
            nan[0] = f64::NAN;
            assert!(effect.compensator(site, &nan).is_err(), "{}", effect.name());
        }
    }
}

#[test]
fn corners_of_the_bounds_are_finite() {
    for campaign in [pressing(), waving()] {
        for effect in catalogue() {
            let parameters = effect.parameters(&campaign.site);
            let lowest: Vec<f64> = parameters.iter().map(|p| p.bounds[0]).collect();
            let highest: Vec<f64> = parameters.iter().map(|p| p.bounds[1]).collect();
            // Large amplitudes with shapes at either end.
            let mixed = parameters.iter().map(|p| match p.role {
                Role::Amplitude => p.bounds[1],
                Role::Shape => p.bounds[0],
            });
            for theta in [mixed.collect(), lowest, highest] {
                let found = torques(&campaign, &Model::of(&effect, &theta), 300.0);
                assert!(
                    found.iter().all(|t| t.is_finite()),
                    "{} {theta:?}",
                    effect.name()
                );
            }
        }
    }
}

/// Drag of the air on the first joint, from outside the crate.
struct AirDrag;

struct Drag(f64);

impl Effect for AirDrag {
    fn name(&self) -> &str {
        "air_drag"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![Parameter::amplitude("k", "N m s^2/rad^2", [0.0, 10.0], 0.1).of_joint(0)]
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        Ok(Box::new(Drag(theta[0])))
    }
}

impl Compensator for Drag {
    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        tau[0] -= self.0 * sample.qd[0] * sample.qd[0].abs();
    }
}

#[test]
fn an_effect_from_outside_joins_the_model() {
    let campaign = waving();
    let drag: Arc<dyn Effect> = Arc::new(AirDrag);
    let bias = catalogue().swap_remove(0);
    let model = Model::of(&drag, &[0.5]).with(&bias, &[1.0, 0.0, 0.0]);
    let found = torques(&campaign, &model, 0.0);
    let motions = campaign.train.iter().chain(&campaign.test);
    let velocities = motions.flat_map(|m| m.qd.iter().map(|row| row[0]));
    for (tau, v) in found.chunks_exact(3).zip(velocities) {
        assert!((tau[0] - (1.0 - 0.5 * v * v.abs())).abs() < 1e-12);
    }
}
