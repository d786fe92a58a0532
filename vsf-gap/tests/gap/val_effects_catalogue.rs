//! What holds for every effect: its promises, finite with contact run anew, and open to others.

use crate::common;

use common::campaign::{
    RATE, Rows, free_arm, free_arm_tared, free_jaws, free_link_tared, plate, torques,
};
use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use vsf_data::TorqueKind;
use vsf_gap::effects::{self, catalogue};
use vsf_gap::{
    Acts, Campaign, Compensator, Effect, GapError, Model, ModelFile, Need, Parameter, RandomWalk,
    Role, Sample, Site, Touch,
};
use vsf_robots::kinova_gen3;
use vsf_testkit::{check_effect, sites};

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

fn waves() -> Rows {
    let row = |k: usize| {
        let t = k as f64 / RATE;
        let q = vec![(2.0 * t).sin(), 0.3 - t, 0.5 * (4.0 * t).cos()];
        (q, vec![5.0 * (2.0 * t).cos(), 1.0, -0.2 * t])
    };
    (0..150).map(row).collect()
}

fn waving() -> Campaign {
    free_arm(&[waves(), waves()])
}

/// What runs in a control loop may be looked at from other threads, and a diagnosis kept.
#[test]
fn models_are_shared_and_kept() {
    fn shared<T: Send + Sync>() {}
    fn kept<T: Clone + Send + Sync>() {}
    shared::<vsf_gap::Corrector>();
    kept::<Campaign>();
    kept::<vsf_gap::Outcome>();
    kept::<vsf_pipeline::Experiment<'_>>();
    let effect = catalogue().swap_remove(0);
    assert_eq!(format!("{effect:?}"), "Effect(\"torque_bias\")");
}

#[test]
fn the_catalogue_is_whole() {
    let names: Vec<_> = catalogue().iter().map(|e| e.name().to_owned()).collect();
    assert_eq!(names, NAMES);
}

/// What every effect promises, here and from outside.
#[test]
fn the_catalogue_keeps_its_promises() {
    let sites = sites().unwrap();
    let drag: Arc<dyn Effect> = Arc::new(AirDrag);
    for effect in catalogue().iter().chain([&drag]) {
        check_effect(effect.as_ref(), &sites);
    }
}

/// Numbers that are none reach no compensator of the catalogue.
#[test]
fn parameters_that_are_not_finite_are_refused() {
    let site = pressing().site().clone();
    for effect in catalogue() {
        for mut theta in effect.starts(&site) {
            theta[0] = f64::NAN;
            assert!(
                effect.compensator(&site, &theta).is_err(),
                "{}",
                effect.name()
            );
        }
    }
}

/// Contact anew, with the parameters of every effect at their ends.
#[test]
fn corners_of_the_bounds_are_finite() {
    for campaign in [pressing(), waving()] {
        for effect in catalogue() {
            let parameters = effect.parameters(campaign.site());
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

#[derive(Clone)]
struct Drag(f64);

impl Effect for AirDrag {
    fn name(&self) -> &str {
        "air_drag"
    }

    fn summary(&self) -> &str {
        "the air resists the first joint by `k`"
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
        let &[k] = theta else {
            return Err(GapError::Parameters {
                effect: self.name().to_owned(),
                got: theta.len(),
                expected: 1,
            });
        };
        Ok(Box::new(Drag(k)))
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
    let motions = campaign.train().iter().chain(campaign.test());
    let velocities = motions.flat_map(|m| m.qd.iter().map(|row| row[0]));
    for (tau, v) in found.chunks_exact(3).zip(velocities) {
        // The bias of an actuator's reading.
        assert!((tau[0] - (-1.0 - 0.5 * v * v.abs())).abs() < 1e-12);
    }
}

/// What the tare takes off the readings it takes off the torques of an effect as well.
#[test]
fn val_torques_are_tared_as_readings_are() {
    const TARE: usize = 20;
    let (plain, tared) = (waving(), free_arm_tared(&[waves(), waves()], TARE));
    for name in ["torque_bias", "gravity_tilt", "payload", "latency"] {
        let effect = common::effect(name);
        let theta: Vec<f64> = (effect.parameters(plain.site()).iter())
            .map(|p| 0.2 * p.bounds[1].min(1.0))
            .collect();
        let model = Model::of(&effect, &theta);
        let [with, without] = [&tared, &plain].map(|c| torques(c, &model, 0.0));
        let sequence = with.len() / 2;
        for (with, without) in with.chunks(sequence).zip(without.chunks(sequence)) {
            for j in 0..3 {
                let mean = (0..TARE).map(|k| without[3 * k + j]).sum::<f64>() / TARE as f64;
                for (a, b) in with.iter().zip(without).skip(j).step_by(3) {
                    assert!((a - (b - mean)).abs() < 1e-12, "{name}: {a} {b} {mean}");
                }
            }
        }
    }
}

/// Late readings of the actuators are those of an earlier motion, not of earlier positions alone.
#[test]
fn val_late_readings_have_the_dynamics_of_then() {
    let campaign = waving();
    let late = 7;
    let model = Model::of(&common::effect("latency"), &[late as f64 / RATE]);
    let found = torques(&campaign, &model, 0.0);
    let motion = &campaign.train()[0];
    for k in late..motion.len() {
        for j in 0..3 {
            let change = motion.load[k][j] - motion.load[k - late][j];
            let of = found[3 * k + j];
            assert!((of - change).abs() < 1e-9, "{k} {j}: {of} {change}");
        }
    }
}

/// So has what acts beside the delay: a late reading has the friction of then.
#[test]
fn val_late_readings_have_the_friction_of_then() {
    let campaign = waving();
    let late = 7;
    let drag: Arc<dyn Effect> = Arc::new(AirDrag);
    for delay_first in [true, false] {
        let delay = [late as f64 / RATE];
        let model = if delay_first {
            Model::of(&common::effect("latency"), &delay).with(&drag, &[0.5])
        } else {
            Model::of(&drag, &[0.5]).with(&common::effect("latency"), &delay)
        };
        let found = torques(&campaign, &model, 0.0);
        let motion = &campaign.train()[0];
        for k in late..motion.len() {
            let v = motion.qd[k - late][0];
            let change = motion.load[k][0] - motion.load[k - late][0];
            let of = found[3 * k];
            assert!(
                (of - (change - 0.5 * v * v.abs())).abs() < 1e-9,
                "{k}: {of}"
            );
        }
    }
}

/// The first joint of a Gen3 turns on past half a turn, where its encoder begins anew: what comes late is between
/// two samples, not a turn away.
#[test]
fn late_readings_of_a_joint_that_turns_on() {
    let site = common::site(kinova_gen3().unwrap(), &[], TorqueKind::External);
    let (dt, late) = (0.01, 0.025);
    let mut delay = common::effect("latency")
        .compensator(&site, &[late])
        .unwrap();
    delay.begin_touch();
    let zeros = [0.0; 7];
    for k in 0..60 {
        let turn = 3.0 + f64::from(k) * dt;
        let mut q = zeros;
        q[0] = (turn + PI).rem_euclid(TAU) - PI;
        let sample = Sample {
            clock: f64::from(k) * dt,
            dt,
            q: &q.clone(),
            qd: &zeros,
            qdd: &zeros,
            reading: &zeros,
            load: &zeros,
            force_W: Vector3::zeros(),
        };
        delay.joints(&sample, &mut q);
        if k > 3 {
            let off = (q[0] - (turn - late)) / TAU;
            assert!((off - off.round()).abs() < 1e-9, "{k}: {q:?}");
        }
    }
}

/// An effect that is not what it says, or cannot be.
struct Odd {
    name: &'static str,
    parameter: Parameter,
    starts: Vec<Vec<f64>>,
    acting: Vec<usize>,
    /// Sizes of its random walks.
    walk: Option<Vec<f64>>,
    null_gain: f64,
    /// Per parameter.
    torque: f64,
    /// Whatever the parameter is.
    always: f64,
}

impl Default for Odd {
    fn default() -> Self {
        Self {
            name: "odd",
            parameter: Parameter::amplitude("k", "1", [0.0, 1.0], 0.1),
            starts: vec![vec![0.0]],
            acting: vec![0],
            walk: None,
            null_gain: 12.0,
            torque: 1.0,
            always: 0.0,
        }
    }
}

impl Effect for Odd {
    fn name(&self) -> &str {
        self.name
    }

    fn summary(&self) -> &str {
        "an effect that is not what it says"
    }

    fn acts(&self) -> Acts {
        Acts::Torques
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![self.parameter.clone()]
    }

    fn starts(&self, _: &Site) -> Vec<Vec<f64>> {
        self.starts.clone()
    }

    fn acting(&self, _: &Site, _: usize) -> Vec<usize> {
        self.acting.clone()
    }

    fn random_walk(&self, _: &Site, _: &[f64]) -> Option<RandomWalk> {
        self.walk.clone().map(|sizes| RandomWalk {
            of_session: sizes.clone(),
            of_sequence: sizes,
        })
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        // Panics without parameters: the model has to check their number.
        Ok(Box::new(Moves(self.torque * theta[0] + self.always)))
    }

    fn null_gain(&self) -> f64 {
        self.null_gain
    }
}

/// Moves joints, which effects on torques do not.
#[derive(Clone)]
struct Moves(f64);

impl Compensator for Moves {
    fn joints(&mut self, _: &Sample<'_>, q: &mut [f64]) {
        q[0] += 0.1;
    }

    fn torques(&mut self, _: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        tau[0] += self.0;
    }
}

/// Why a diagnosis with these candidates is refused.
fn refused(candidates: &[Arc<dyn Effect>]) -> String {
    let error = vsf_gap::diagnose(&waving(), candidates, 0, |_| {}).err();
    error.unwrap().to_string()
}

#[test]
fn effects_that_cannot_be_are_refused() {
    let good = Odd::default().parameter;
    let of = |bounds: [f64; 2], scale: f64| Parameter::amplitude("k", "1", bounds, scale);
    let start = vec![vec![0.0]];
    let cases = [
        (of([1.0, 0.0], 0.1), start.clone(), "bounds"),
        (of([0.1, 1.0], 0.1), start.clone(), "bounds"),
        (of([0.0, f64::NAN], 0.1), start.clone(), "bounds"),
        (of([0.0, f64::INFINITY], 0.1), start.clone(), "bounds"),
        (of([0.0, 1.0], 0.0), start.clone(), "scale"),
        (good.clone().of_joint(3), start.clone(), "joint"),
        (good.clone().of_sequence(2), start.clone(), "sequence"),
        (
            Parameter::shape("k", "1", [0.0, 1.0], 0.1),
            start.clone(),
            "amplitude",
        ),
        (good.clone(), vec![], "start"),
        (good.clone(), vec![vec![]], "takes 1 parameters, got 0"),
        (good.clone(), vec![vec![f64::NAN]], "parameter 0 is NaN"),
    ];
    let check = |effect: Odd, problem: &str| {
        let text = refused(&[Arc::new(effect)]);
        assert!(text.contains("odd") && text.contains(problem), "{text}");
    };
    for (parameter, starts, problem) in cases {
        let effect = Odd {
            parameter,
            starts,
            ..Odd::default()
        };
        check(effect, problem);
    }
    for always in [3.0, 1e-3] {
        let effect = Odd {
            always,
            ..Odd::default()
        };
        check(effect, "though all of its amplitudes are zero");
    }
    for acting in [vec![], vec![1], vec![0, 0]] {
        let effect = Odd {
            acting,
            ..Odd::default()
        };
        check(effect, "may act");
    }
}

#[test]
fn walks_of_another_robot_or_without_a_size_are_refused() {
    let joints = waving().site().joints();
    for (sizes, problem) in [
        (vec![0.1; joints + 1], "joints of a random walk"),
        (vec![f64::NAN; joints], "random walk"),
    ] {
        let effect = Odd {
            walk: Some(sizes),
            ..Odd::default()
        };
        let text = refused(&[Arc::new(effect)]);
        assert!(text.contains("odd") && text.contains(problem), "{text}");
    }
}

#[test]
fn effects_that_are_not_what_they_say_are_refused() {
    let bias = || common::effect("torque_bias");
    let odd = |name, null_gain, torque| -> Arc<dyn Effect> {
        Arc::new(Odd {
            name,
            null_gain,
            torque,
            ..Odd::default()
        })
    };
    for (effects, problem) in [
        (vec![bias(), odd("torque_bias", 12.0, 1.0)], "two effects"),
        (vec![odd("", 12.0, 1.0)], "name"),
        (vec![odd("stiffness_field", 12.0, 1.0)], "name"),
        (vec![odd("odd", f64::NAN, 1.0)], "null gain"),
        (vec![odd("odd", f64::NEG_INFINITY, 1.0)], "null gain"),
        (
            vec![bias(), odd("odd", 12.0, f64::NAN)],
            "effect odd: sequence",
        ),
        (
            vec![odd("odd", 12.0, f64::INFINITY)],
            "every value must be finite",
        ),
    ] {
        let text = refused(&effects);
        assert!(text.contains(problem), "{text}");
    }
    let few = Model::of(&odd("odd", 12.0, 1.0), &[]);
    let error = few.compensator(waving().site()).err().unwrap().to_string();
    assert!(error.contains("takes 1 parameters, got 0"), "{error}");
}

/// An effect on torques that moves joints does so nowhere: contacts are those of the nominal model.
#[test]
fn effects_reach_no_deeper_than_they_say() {
    let campaign = waving();
    let odd: Arc<dyn Effect> = Arc::new(Odd::default());
    let model = Model::of(&odd, &[0.5]);
    let motion = &campaign.train()[0];
    let [with, without] = [&model, &Model::default()].map(|m| {
        let log = campaign.contact_log(m, motion).unwrap();
        log.postures[0].link_poses().to_vec()
    });
    assert_eq!(with, without);
}

/// A plate that never comes near the points, and one that touches each of them once.
#[test]
fn what_is_not_touched_is_not_testable() {
    let heights = |z: fn(f64) -> f64| -> Rows {
        let row = |k: usize| (vec![0.0, 0.0, z(k as f64 / 50.0)], vec![0.0; 3]);
        (0..50).map(row).collect()
    };
    let away = plate(&[[0.0; 3]], &[heights(|_| 0.1)]);
    let once = plate(&[[0.0; 3]], &[heights(|t| 0.01 - 0.02 * t)]);
    let again = plate(&[[0.0; 3]], &[heights(|t| 0.01 * (12.0 * t).cos())]);
    // Let off and pressed anew without losing contact.
    let deeper = plate(&[[0.0; 3]], &[heights(|t| -0.02 + 0.01 * (12.0 * t).cos())]);
    let lacks = |campaign: &Campaign, need: Need| campaign.lacks(need).is_some();
    assert!(lacks(&away, Need::Contact) && lacks(&away, Need::Retouch));
    assert!(!lacks(&once, Need::Contact) && lacks(&once, Need::Retouch));
    assert!(!lacks(&again, Need::Contact) && !lacks(&again, Need::Retouch));
    assert!(!lacks(&deeper, Need::Retouch));
    // A wrong place may be why nothing is touched.
    let testable = |name: &str| common::effect(name).untestable(&away).is_none();
    assert!(testable("registration_offset") && !testable("strain_stiffening"));
}

/// Effects that choose contacts may be why nothing is touched, but not those which change what is touched alone, nor
/// gains of readings that are all zero.
#[test]
fn what_changes_no_reading_is_not_testable() {
    let waves = |s: u32| -> Rows {
        let row = |k: u32| {
            let phase = f64::from(k + 7 * s) / 20.0;
            let place = vec![0.02 * phase.sin(), 0.02 * phase.cos(), 0.1];
            (place, vec![1e-3 * (31.0 * phase).sin(); 3])
        };
        (0..80).map(row).collect()
    };
    let away = plate(&[[0.0; 3]], &[0, 1, 2].map(waves));
    let names = [
        "contact_friction",
        "anisotropy",
        "torque_gain",
        "torque_bias",
    ];
    let candidates = effects::named(&names).unwrap();
    let outcome = vsf_gap::diagnose(&away, &candidates, 0, |_| {}).unwrap();
    for report in &outcome.diagnosis.effects {
        assert_eq!(
            report.testable,
            report.effect == "torque_bias",
            "{}",
            report.effect
        );
    }
}

/// Joints of separate branches have no neighbors, and drag each other all the same.
#[test]
fn joints_of_separate_branches_are_diagnosed() {
    let row = |k: usize| {
        let t = k as f64 / RATE;
        let noise = 0.01 * (977.0 * t).sin();
        let speeds = [2.1 * (3.0 * t).cos(), 1.5 * (5.0 * t).cos()];
        let angles = vec![0.7 * (3.0 * t).sin(), 0.3 * (5.0 * t).sin()];
        (angles, speeds.map(|v| 0.4 * v + noise).to_vec())
    };
    let rows: Rows = (0..200).map(row).collect();
    let campaign = free_jaws(&[rows.clone(), rows]);
    let few = effects::named(&["joint_coupling", "joint_viscous_friction"]).unwrap();
    let outcome = vsf_gap::diagnose(&campaign, &few, 0, |_| {}).unwrap();
    assert!(outcome.diagnosis.effects.iter().all(|e| e.testable));
}

/// A gauge on one axis: whatever needs more joints is untestable, nothing fails.
#[test]
fn a_robot_of_one_joint_is_diagnosed() {
    let row = |k: usize| {
        let t = k as f64 / RATE;
        (
            vec![(3.0 * t).sin()],
            vec![0.4 * (3.0 * t).cos() + 0.01 * (977.0 * t).sin()],
        )
    };
    let rows: Rows = (0..200).map(row).collect();
    let campaign = free_link_tared(&[rows.clone(), rows], 20);
    let outcome = vsf_gap::diagnose(&campaign, &catalogue(), 0, |_| {}).unwrap();
    let reason = |name: &str| {
        let mut all = outcome.diagnosis.effects.iter();
        all.find(|e| e.effect == name).unwrap().reason.clone()
    };
    assert!(reason("joint_coupling").unwrap().contains("one joint"));
    // A model of it may come from a file.
    let text = r#"{"schema": 1, "effects": [{"effect": "joint_coupling", "parameters":
        [{"name": "eps", "value": 0.02, "std": 0, "unit": "rad/s"}]}]}"#;
    let file = ModelFile::from_json(text).unwrap();
    assert!(file.model(campaign.site(), &catalogue()).is_ok());
    assert!(
        reason("torque_bias")
            .unwrap()
            .contains("relative to their mean")
    );
}
