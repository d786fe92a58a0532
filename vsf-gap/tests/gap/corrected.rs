//! A corrected model outside of a diagnosis: observations of recordings, control loops, files.

use crate::common;

use common::campaign::{Rows, free_arm, free_arm_tared, plate, torques};
use nalgebra::Vector3;
use proptest::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use vsf_core::{Belief, Contacts, Estimator, Noise, Observation};
use vsf_data::Table;
use vsf_filter::DiagonalKalman;
use vsf_gap::effects::catalogue;
use vsf_gap::{
    Acts, Campaign, Corrector, EffectEntry, GapError, JointState, LiveCorrector, Model, ModelFile,
    ModelTerms, Motion, ParameterEstimate, Role, Touch,
};
use vsf_pipeline::Scene;
use vsf_pipeline::live::{Begins, Learner, Sample as LiveSample};

/// A block of points under the plate.
fn points() -> Vec<[f64; 3]> {
    let grid = |k: usize| [0.02 * (k % 5) as f64, 0.02 * (k / 5) as f64, 0.0];
    (0..20).map(grid).collect()
}

/// Presses to a depth (m) and back, sliding a little.
fn press(depth: f64) -> Rows {
    let row = |k: usize| {
        let t = k as f64 / 60.0;
        let z = 0.003 - depth * (std::f64::consts::PI * t).sin();
        (
            vec![0.02 * t, 0.0, z],
            vec![0.1 * t, -0.05, 3.0 * (1.0 - t)],
        )
    };
    (0..60).map(row).collect()
}

const DEPTHS: [f64; 3] = [0.01, 0.02, 0.015];

fn pressed() -> Campaign {
    plate(&points(), &DEPTHS.map(press))
}

fn swung() -> Campaign {
    free_arm(&[swing()])
}

fn swing() -> Rows {
    let row = |k: usize| {
        let t = k as f64 / 100.0;
        let q: Vec<f64> = (0..3).map(|j| (t * (1.0 + j as f64)).sin()).collect();
        let tau = vec![0.5 + t, 0.2 - t, 0.1];
        (q, tau)
    };
    (0..80).map(row).collect()
}

/// An effect with amplitudes of one scale each.
fn model(campaign: &Campaign, k: usize) -> Model {
    let effect = &catalogue()[k];
    let mut theta = effect.starts(campaign.site()).swap_remove(0);
    for (x, p) in theta.iter_mut().zip(effect.parameters(campaign.site())) {
        if p.role == Role::Amplitude {
            *x = p.scale;
        }
    }
    Model::of(effect, &theta)
}

#[test]
fn the_nominal_model_has_the_observations_of_the_pipeline() {
    let campaign = pressed();
    let scene = campaign.scene();
    let all = campaign.corrected(&Model::default()).unwrap();
    for (corrected, motion) in all.iter().zip(campaign.session()) {
        let (time, angles) = (motion.clock.clone(), motion.q.clone());
        let sequence =
            vsf_data::Sequence::new(motion.id.as_str(), time, angles, motion.reading.clone());
        let trace = scene.trace(&sequence).unwrap();
        assert!(trace.contact_samples() > 0);
        assert_eq!(trace.observations.len(), corrected.trace.observations.len());
        for (a, b) in trace.observations.iter().zip(&corrected.trace.observations) {
            assert_eq!(a.points(), b.points());
            assert_eq!(a.reading(), b.reading());
            for (a, b) in a.rows().iter().zip(b.rows()) {
                assert!((a - b).abs() < 1e-12, "{a} {b}");
            }
        }
        assert!(corrected.torques.data().iter().all(|a| *a == 0.0));
    }
}

/// A stream of a recording's samples teaches what the recording does.
#[test]
fn a_stream_is_the_recording() {
    let campaign = pressed();
    let (site, d) = (campaign.site(), campaign.site().joints());
    let noise = Noise::uniform(d, 0.3).unwrap();
    let filter =
        || DiagonalKalman::new(Belief::<f64>::uniform(site.rest.len(), 0.0, 30.0).unwrap());
    let (mut seen, mut guarded) = (0, Vec::new());
    for (k, effect) in catalogue().iter().enumerate() {
        // Those of accelerations and means around a sample are others in a stream.
        if effect.follows_reading() || effect.name() == "inertia_drag" {
            continue;
        }
        // A stream is none of the sequences that a model knows.
        if (effect.parameters(site).iter()).any(|p| p.sequence.is_some()) {
            continue;
        }
        let model = model(&campaign, k);
        let mut offline = filter();
        for corrected in campaign.corrected(&model).unwrap() {
            offline.begin_sequence();
            for obs in &corrected.trace.observations {
                let mut obs = obs.clone();
                obs.set_noise(&noise).unwrap();
                offline.update(&obs).unwrap();
            }
        }
        let corrector = Corrector::new(site, campaign.scene(), &model).unwrap();
        let mut live = LiveCorrector::new(corrector, filter(), noise.clone()).unwrap();
        let mut skipped = false;
        for (number, motion) in (0..).zip(campaign.session()) {
            for row in 0..motion.clock.len() {
                let sample = LiveSample {
                    t: motion.clock[row],
                    q: motion.q[row].to_vec(),
                    tau: motion.reading[row].to_vec(),
                    qd: Some(motion.qd[row].to_vec()),
                    touch: 0,
                    sequence: number,
                };
                let begins = if row == 0 {
                    Begins::Sequence
                } else {
                    Begins::Nothing
                };
                skipped |= live.learn(&sample, begins).unwrap().is_none();
            }
        }
        // With another surface a touch may begin too deep.
        if skipped {
            guarded.push(effect.name().to_owned());
            continue;
        }
        let (a, b) = (live.estimator().belief(), offline.belief());
        let largest = b.mean().iter().copied().fold(0.0, f64::max);
        let means = a.mean().iter().zip(b.mean());
        for (a, b) in means.chain(a.variance().iter().zip(b.variance())) {
            let name = effect.name();
            // Accelerations of a stream lag.
            let accelerates = ["joint_coupling", "payload", "inertial_error"].contains(&name);
            let most = if accelerates { 1e-2 } else { 1e-6 };
            assert!((a - b).abs() < most * (1.0 + largest), "{name}: {a} {b}");
        }
        seen += 1;
    }
    assert!(seen > 20, "{seen}");
    assert!(guarded.is_empty(), "{guarded:?}");
}

/// Columns times stiffness and the model's torques are what the diagnosis predicts, for every
/// effect; and readings less torques with them put back are the readings.
#[test]
fn columns_and_torques_are_the_prediction() {
    const K: f64 = 40.0;
    let campaign = pressed();
    for k in 0..catalogue().len() {
        let model = model(&campaign, k);
        let mut all = Vec::new();
        // Train sequences before the test sequence: the order of `torques`.
        let mut corrected = campaign.corrected(&model).unwrap();
        corrected.sort_by_key(|c| campaign.test().iter().any(|m| m.id == c.trace.id));
        let field = vec![K; campaign.site().rest.len()];
        for c in &corrected {
            let recorded = c.recorded().unwrap();
            let readings = &campaign
                .session()
                .iter()
                .find(|m| m.id == c.trace.id)
                .unwrap()
                .reading;
            for (row, obs) in c.trace.observations.iter().enumerate() {
                let mut tau = vec![0.0; 3];
                obs.apply(&field, &mut tau);
                all.extend(tau.iter().zip(&c.torques[row]).map(|(t, a)| t + a));
                for (a, b) in recorded.observations[row]
                    .reading()
                    .iter()
                    .zip(&readings[row])
                {
                    assert!((a - b).abs() < 1e-12);
                }
            }
        }
        let name = model.parts[0].0.name().to_owned();
        // State that lasts goes by the session, where `torques` starts anew.
        if ["plastic_set", "damage_softening"].contains(&name.as_str()) {
            continue;
        }
        for (a, b) in all.iter().zip(torques(&campaign, &model, K)) {
            assert!((a - b).abs() < 1e-9, "{name}: {a} {b}");
        }
    }
}

/// What a touch leaves behind is felt by the next sequence.
#[test]
fn the_state_of_the_object_lasts() {
    let campaign = pressed();
    let effect = common::effect("damage_softening");
    let model = Model::of(&effect, &[0.9, 0.014, 0.002]);
    let stiffness = vec![50.0; campaign.site().rest.len()];
    let with = campaign.simulated(&model, &stiffness).unwrap();
    let alone = plate(&points(), &[press(0.015)]);
    let fresh = alone.simulated(&model, &stiffness).unwrap();
    // The last touch alone goes not deep enough to do damage; the one before it does.
    let peak = |t: &Table| t.data().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    assert!(peak(&with[2]) < 0.5 * peak(&fresh[0]));
}

/// Effects that go by the smooth reading, or by the force behind it.
const BY_READING: [&str; 3] = [
    "joint_elasticity",
    "joint_load_friction",
    "object_base_motion",
];

/// What a loop has at a row, `torques` being those of the sensors.
fn state<'a>(motion: &'a Motion, row: usize, torques: &'a [f64]) -> JointState<'a> {
    JointState {
        clock: motion.clock[row],
        q: &motion.q[row],
        qd: &motion.qd[row],
        qdd: &motion.qdd[row],
        torques,
    }
}

/// The motion with readings that are averaged over those samples alone that a loop has had.
fn as_a_loop_has_it(motion: &Motion) -> Motion {
    let d = motion.reading.cols();
    let mean = |row: usize, j: usize| {
        let all = row.saturating_sub(2)..=row;
        let count = all.clone().count() as f64;
        all.map(|k| motion.reading[k][j]).sum::<f64>() / count
    };
    let rows = (0..motion.len()).flat_map(|row| (0..d).map(move |j| (row, j)));
    let means = rows.map(|(row, j)| mean(row, j)).collect();
    Motion {
        smooth: Table::new(d, means).unwrap(),
        ..motion.clone()
    }
}

#[test]
fn a_loop_has_the_observations_of_the_recording() {
    for (campaign, rows) in [
        (pressed(), DEPTHS.map(press).to_vec()),
        (swung(), vec![swing()]),
    ] {
        let session = campaign.session().into_iter();
        let session: Vec<Motion> = session.map(as_a_loop_has_it).collect();
        let session: Vec<&Motion> = session.iter().collect();
        let unit = Noise::uniform(campaign.site().joints(), 1.0).unwrap();
        for k in 0..catalogue().len() {
            let model = model(&campaign, k);
            if model.parts[0].0.untestable(&campaign).is_some() {
                continue;
            }
            let name = model.parts[0].0.name().to_owned();
            let corrected = campaign.corrected(&model).unwrap();
            let logs = campaign.contact_logs(&model, &session).unwrap();
            let mut online = Corrector::new(campaign.site(), campaign.scene(), &model).unwrap();
            let [mut obs, mut same] = [0, 1].map(|_| Observation::new(unit.clone()));
            let visit = |s: usize, row: usize, touch: &Touch<'_>, terms: &ModelTerms| {
                let motion = session[s];
                if row == 0 {
                    online.begin_sequence(&motion.id);
                }
                let state = state(motion, row, &rows[s][row].1);
                // A clone goes ahead by itself.
                let mut clone = online.clone();
                let ahead = clone.step(&state, &mut obs).unwrap().to_vec();
                let torques = online.step(&state, &mut obs).unwrap();
                assert_eq!(torques, ahead, "{name} row {row}");
                assert_eq!(torques, terms.torques, "{name} row {row}");
                let left = motion.reading[row].iter().zip(torques);
                let left: Vec<f64> = left.map(|(y, a)| y - a).collect();
                let points = touch.contacts.points();
                same.rebuild(touch.rest.len(), points, &left, |k, w| {
                    terms.column(touch, k, w)
                })
                .unwrap();
                let mut recorded = vec![&same];
                if !BY_READING.contains(&name.as_str()) {
                    recorded.push(&corrected[s].trace.observations[row]);
                }
                for same in recorded {
                    assert_eq!(obs.points(), same.points(), "{name} row {row}");
                    assert_eq!(obs.rows(), same.rows(), "{name} row {row}");
                    assert_eq!(obs.reading(), same.reading(), "{name} row {row}");
                }
            };
            campaign.predict(&model, &session, &logs, visit).unwrap();
        }
    }
}

/// A loop that tares when the recording has been tared goes on as the recording does.
#[test]
fn a_control_loop_tares_as_a_recording_does() {
    const TARE: usize = 10;
    let row = |k: usize| {
        let t = k as f64 / 100.0;
        let q: Vec<f64> = (0..3).map(|j| (t * (1.0 + j as f64)).cos()).collect();
        (q, vec![0.5 + t, 0.2 - t, 0.1])
    };
    let rows: Rows = (0..60).map(row).collect();
    let campaign = free_arm_tared(&[rows.clone(), rows.clone()], TARE);
    for name in ["payload", "torque_drift", "latency"] {
        let of_name = |e: &Arc<dyn vsf_gap::Effect>| e.name() == name;
        let k = catalogue().iter().position(of_name).unwrap();
        let model = model(&campaign, k);
        let mut online = Corrector::new(campaign.site(), campaign.scene(), &model).unwrap();
        let unit = Noise::uniform(3, 1.0).unwrap();
        let mut obs = Observation::new(unit);
        let corrected = campaign.corrected(&model).unwrap();
        for (motion, c) in campaign.session().into_iter().zip(&corrected) {
            online.begin_sequence(&motion.id);
            for (row, (_, torques)) in rows.iter().enumerate() {
                if row == TARE {
                    online.tare();
                }
                let torques = online.step(&state(motion, row, torques), &mut obs).unwrap();
                let offline = &c.trace.observations[row];
                let pairs = (torques.iter().zip(&c.torques[row]))
                    .chain(obs.reading().iter().zip(offline.reading()));
                for (a, b) in pairs.filter(|_| row >= TARE) {
                    assert!((a - b).abs() < 1e-12, "{name} row {row}: {a} {b}");
                }
            }
        }
    }
}

/// In a scene without the points nothing would ever be touched.
#[test]
fn a_scene_of_another_campaign_is_refused() {
    let (campaign, other) = (plate(&points(), &[press(0.01)]), swung());
    let of = |scene: &Scene| Corrector::new(campaign.site(), scene, &Model::default());
    of(campaign.scene()).unwrap();
    let error = of(other.scene()).unwrap_err();
    assert!(
        matches!(error, GapError::OtherScene { what: "joints" }),
        "{error}"
    );
}

/// Neither time nor readings of the touch before count.
#[test]
fn a_touch_of_a_control_loop_begins_anew() {
    let (campaign, rows) = (swung(), swing());
    let model = Model::of(&common::effect("joint_elasticity"), &[1e-2; 3]);
    let of = || Corrector::new(campaign.site(), campaign.scene(), &model).unwrap();
    let (mut fresh, mut online) = (of(), of());
    let unit = Noise::uniform(3, 1.0).unwrap();
    let [mut first, mut again] = [0, 1].map(|_| Observation::new(unit.clone()));
    let motion = &campaign.train()[0];
    let state = |row: usize| state(motion, row, &rows[row].1);
    for row in 0..20 {
        online.step(&state(row), &mut again).unwrap();
    }
    online.begin_touch();
    for row in 0..20 {
        let fresh = fresh.step(&state(row), &mut first).unwrap();
        let online = online.step(&state(row), &mut again).unwrap();
        assert_eq!(fresh, online, "row {row}");
        assert_eq!(first.reading(), again.reading(), "row {row}");
    }
}

#[test]
fn a_control_loop_refuses_states_that_do_not_fit() {
    for campaign in [pressed(), swung()] {
        let model = Model::default();
        let of = || Corrector::new(campaign.site(), campaign.scene(), &model).unwrap();
        let (mut online, mut other) = (of(), of());
        let unit = Noise::uniform(campaign.site().joints(), 1.0).unwrap();
        let [mut obs, mut same] = [0, 1].map(|_| Observation::new(unit.clone()));
        let motion = campaign.session()[0];
        let good = |row: usize| state(motion, row, &motion.reading[row]);
        let now = good(1);
        online.step(&good(0), &mut obs).unwrap();
        other.step(&good(0), &mut same).unwrap();
        let bad = [f64::NAN, 0.0, 0.0];
        let infinite = [0.0, 0.0, f64::INFINITY];
        for row in [&now.q[..2], &[], &bad, &infinite] {
            for state in [
                JointState { q: row, ..now },
                JointState { qd: row, ..now },
                JointState { qdd: row, ..now },
                JointState {
                    torques: row,
                    ..now
                },
            ] {
                let refused = online.step(&state, &mut obs).unwrap_err();
                assert!(matches!(refused, GapError::Core(_)), "{refused}");
                assert!(
                    refused.to_string().contains("of the joint state"),
                    "{refused}"
                );
            }
        }
        for clock in [f64::NAN, f64::INFINITY] {
            let refused = online.step(&JointState { clock, ..now }, &mut obs);
            assert!(matches!(refused, Err(GapError::Core(_))));
        }
        let begin = motion.clock[0];
        for clock in [begin, begin - 0.01] {
            let refused = online.step(&JointState { clock, ..now }, &mut obs);
            assert!(matches!(refused, Err(GapError::TimeBackwards { dt }) if dt <= 0.0));
        }
        // All is as before.
        assert_eq!(obs.reading(), same.reading());
        let torques = online.step(&now, &mut obs).unwrap();
        assert_eq!(torques, other.step(&now, &mut same).unwrap());
        assert_eq!(obs.rows(), same.rows());
        assert_eq!(obs.reading(), same.reading());
    }
}

#[test]
fn simulated_readings_are_explained_by_their_model() {
    for (campaign, name, theta) in [
        (pressed(), "torque_bias", vec![0.1, -0.2, 0.3]),
        (swung(), "joint_viscous_friction", vec![0.2, 0.1, 0.0]),
    ] {
        let model = Model::of(&common::effect(name), &theta);
        let stiffness = vec![30.0; campaign.site().rest.len()];
        let readings = campaign.simulated(&model, &stiffness).unwrap();
        let corrected = campaign.corrected(&model).unwrap();
        for ((table, c), motion) in readings.iter().zip(&corrected).zip(campaign.session()) {
            for (row, obs) in c.trace.observations.iter().enumerate() {
                let mut tau = vec![0.0; campaign.site().joints()];
                obs.apply(&stiffness, &mut tau);
                for j in 0..tau.len() {
                    let load = tau[j] + c.torques[row][j];
                    let reading = match campaign.site().torque_kind {
                        vsf_data::TorqueKind::External => load,
                        vsf_data::TorqueKind::Measured => motion.load[row][j] - load,
                    };
                    assert!((table[row][j] - reading).abs() < 1e-12);
                }
            }
        }
    }
    let campaign = pressed();
    assert!(campaign.simulated(&Model::default(), &[1.0]).is_err());
}

proptest! {
    #[test]
    fn a_file_gives_the_model_back(k in 0..27usize, share in 0.0..1.0f64, sd in 0.0..1e3f64) {
        let campaign = pressed();
        let effect = &catalogue()[k];
        let parameters = effect.parameters(campaign.site());
        let theta: Vec<f64> = parameters.iter()
            .map(|p| p.bounds[0] + share * (p.bounds[1] - p.bounds[0]))
            .map(|v| if v.is_finite() { v } else { 0.0 })
            .collect();
        let model = Model::of(effect, &theta);
        let file = ModelFile::new(campaign.site(), &model, &vec![sd; theta.len()]).unwrap();
        let read = ModelFile::from_json(&file.to_json()).unwrap();
        prop_assert_eq!(&read, &file);
        let again = read.model(campaign.site(), &catalogue()).unwrap();
        prop_assert_eq!(&again.parts[0].1, &theta);
        prop_assert_eq!(again.parts[0].0.name(), effect.name());
    }
}

/// Of all pairs of joints, files hold those that drag each other.
#[test]
fn amplitudes_that_may_not_act_are_left_out_of_files() {
    let campaign = pressed();
    let coupling = common::effect("joint_coupling");
    let parameters = coupling.parameters(campaign.site());
    let value = |name: &str| match name {
        "c_1_3" => 0.4,
        "d_1_3" => -2.0,
        "eps" => 0.01,
        _ => 0.0,
    };
    let theta: Vec<f64> = parameters.iter().map(|p| value(&p.name)).collect();
    let sd: Vec<f64> = theta.iter().map(|t| 0.1 * t.abs()).collect();
    let model = Model::of(&coupling, &theta);
    let file = ModelFile::new(campaign.site(), &model, &sd).unwrap();
    let names: Vec<_> = (file.effects[0].parameters.iter())
        .map(|p| p.name.as_str())
        .collect();
    assert_eq!(names, ["c_1_3", "d_1_3", "i_1_3", "eps"]);
    let again = file.model(campaign.site(), &catalogue()).unwrap();
    assert_eq!(again.parts[0].1, theta);
    let mut without = file.clone();
    without.effects[0].parameters.pop();
    let error = without.model(campaign.site(), &catalogue()).err();
    assert!(
        error
            .unwrap()
            .to_string()
            .contains("\"eps\" (m/s) is missing, give \"eps\" from 0.001 to 0.2 m/s")
    );
    for taken in 0..3 {
        let mut part = file.clone();
        let taken = part.effects[0].parameters.remove(taken).name;
        let error = part.model(campaign.site(), &catalogue()).err().unwrap();
        let missing = format!("{taken:?} (");
        assert!(error.to_string().contains(&missing), "{error}");
    }
    let mut nothing = file;
    nothing.effects[0].parameters.drain(..3);
    let error = nothing.model(campaign.site(), &catalogue()).err();
    assert!(error.unwrap().to_string().contains("missing"));
}

/// Whatever is wrong with a file is refused with a word about it.
#[test]
fn files_that_are_no_models() {
    let campaign = pressed();
    let parameter = |name: &str, value: f64| ParameterEstimate {
        name: name.to_owned(),
        value,
        sd: 0.1,
        unit: "N".to_owned(),
    };
    let good = |change: &dyn Fn(&mut EffectEntry)| {
        let mut entry = EffectEntry {
            effect: "torque_bias".to_owned(),
            parameters: vec![
                parameter("b_3", 0.3),
                parameter("b_1", 0.1),
                parameter("b_2", 0.2),
            ],
        };
        change(&mut entry);
        let mut file = ModelFile::from_json(r#"{"schema": 1, "effects": []}"#).unwrap();
        file.effects.push(entry);
        file.model(campaign.site(), &catalogue())
    };
    // In any order.
    assert_eq!(good(&|_| {}).unwrap().parts[0].1, [0.1, 0.2, 0.3]);
    // Of an effect of which one part may act alone, the others rest.
    let fewer = good(&|e| drop(e.parameters.pop())).unwrap();
    assert_eq!(fewer.parts[0].1, [0.1, 0.0, 0.3]);
    type Change = dyn Fn(&mut EffectEntry);
    let cases: [(&Change, &str); 10] = [
        (&|e| e.effect = "torque_boas".into(), "torque_bias"),
        (
            &|e| {
                e.effect = "joint_viscous_friction".to_owned();
                e.parameters.pop();
                for p in &mut e.parameters {
                    (p.name, p.unit) = (p.name.replace('b', "d"), "N s/m".to_owned());
                }
            },
            "\"d_2\" (N s/m) is missing",
        ),
        (
            &|e| e.parameters[0].name = "b_9".into(),
            "no parameter \"b_9\"",
        ),
        (&|e| e.parameters[0].name = "b_1".into(), "twice"),
        (
            &|e| e.parameters[0].unit = "N m".into(),
            "is in \"N m\", not \"N\"",
        ),
        (&|e| e.parameters[0].value = f64::NAN, "NaN"),
        (&|e| e.parameters[0].value = 1e9, "must be in"),
        (&|e| e.parameters[0].sd = -1.0, "must be in 0 .. 1e16"),
        (&|e| e.parameters[0].sd = 1e300, "must be in 0 .. 1e16"),
        (
            &|e| e.parameters[0].sd = f64::INFINITY,
            "must be in 0 .. 1e16",
        ),
    ];
    for (change, part) in cases {
        let error = good(change).err().unwrap().to_string();
        assert!(error.contains(part), "{error}");
    }
    for (text, part) in [
        ("", "EOF"),
        ("{\"schema\": 1}", "effects"),
        ("{\"schema\": 2, \"effects\": []}", "schema 2"),
        ("{\"schema\": 1, \"effects\": [], \"more\": 1}", "more"),
        (
            "{\"schema\": 1, \"effects\": [{\"effect\": \"latency\"}]}",
            "effects[0]: missing field `parameters`",
        ),
        (
            "{\"schema\": 1, \"effects\": [7]}",
            "effects[0]: invalid type: integer `7`, expected an effect",
        ),
        (
            "{\"schema\": 1, \"effects\": [{\"effect\": \"latency\", \"parameters\": [{\"name\": \"delta\", \
             \"value\": NaN, \"std\": 0, \"unit\": \"s\"}]}]}",
            "expected",
        ),
    ] {
        let error = ModelFile::from_json(text).unwrap_err();
        assert!(matches!(error, GapError::ModelFile(_)), "{error}");
        assert!(error.to_string().contains(part), "{error}");
    }
    let twice = "{\"schema\": 1, \"effects\": [
        {\"effect\": \"latency\", \"parameters\": [{\"name\": \"delta\", \"value\": 0.01, \"std\": 0, \"unit\": \"s\"}]},
        {\"effect\": \"latency\", \"parameters\": [{\"name\": \"delta\", \"value\": 0.01, \"std\": 0, \"unit\": \"s\"}]}]}";
    let error = ModelFile::from_json(twice)
        .unwrap()
        .model(campaign.site(), &catalogue());
    let error = error.err().unwrap().to_string();
    assert!(
        error.contains("latency") && error.contains("twice"),
        "{error}"
    );
}

/// An offset that was found in another recording, or written by hand, is one of all sequences.
#[test]
fn offsets_of_single_sequences_may_be_left_out() {
    let campaign = pressed();
    let text = r#"{"schema": 1, "effects": [{"effect": "registration_offset", "parameters": [
        {"name": "dx", "value": 0.001, "unit": "m"}, {"name": "dy", "value": 0, "unit": "m"},
        {"name": "dz", "value": -0.01, "unit": "m"}]}]}"#;
    let file = ModelFile::from_json(text).unwrap();
    let model = file.model(campaign.site(), &catalogue()).unwrap();
    let (common, own) = model.parts[0].1.split_at(3);
    assert_eq!(common, [0.001, 0.0, -0.01]);
    assert!(!own.is_empty() && own.iter().all(|offset| *offset == 0.0));
    let mut part = file;
    part.effects[0].parameters.pop();
    let error = part.model(campaign.site(), &catalogue()).err().unwrap();
    assert!(
        error.to_string().contains("\"dz\" (m) is missing"),
        "{error}"
    );
}

#[test]
fn residuals_are_of_the_session_and_of_a_field_of_its_points() {
    let campaign = pressed();
    let field = vec![100.0; campaign.site().rest.len()];
    let model = model(&campaign, 0);
    let mut foreign = campaign.train()[0].clone();
    foreign.id = "elsewhere".to_owned();
    let unknown = campaign.residuals(&model, &field, &[&foreign]);
    assert!(matches!(unknown, Err(GapError::UnknownSequence { id }) if id == "elsewhere"));
    let short = campaign.residuals(&model, &field[1..], &campaign.session());
    assert!(matches!(short, Err(GapError::Core(_))));
    let nan = vec![f64::NAN; field.len()];
    assert!(matches!(
        campaign.residuals(&model, &nan, &campaign.session()),
        Err(GapError::Core(_))
    ));
    assert!(matches!(
        campaign.simulated(&model, &nan),
        Err(GapError::Core(_))
    ));
}

#[test]
fn motions_and_contacts_that_do_not_belong_together_are_refused() {
    let campaign = pressed();
    let nominal = Model::default();
    let motion = &campaign.train()[0];
    let mut short = motion.clone();
    short.clock.pop();
    let mut beyond = motion.clone();
    beyond.touches[0].end = 1000;
    let mut wide = motion.clone();
    wide.q = Table::new(2, vec![0.0; 2 * motion.len()]).unwrap();
    for motion in [&short, &beyond, &wide] {
        let log = campaign.contact_log(&nominal, motion);
        assert!(matches!(log, Err(GapError::Core(_))));
        let residuals =
            campaign.residuals(&nominal, &vec![1.0; campaign.site().rest.len()], &[motion]);
        assert!(matches!(residuals, Err(GapError::Core(_))));
    }
    let log = campaign.contact_log(&nominal, motion).unwrap();
    let at = log.contacts.iter().position(|c| !c.is_empty()).unwrap();
    let (mut fewer, mut rigid, mut point, mut link) =
        (log.clone(), log.clone(), log.clone(), log.clone());
    fewer.contacts.pop();
    rigid.rigid.push(0.0);
    let touched = |point, link| {
        let mut contacts = Contacts::new();
        let (u, n) = (Vector3::zeros(), Vector3::z());
        contacts.push(point, link, u, n).unwrap();
        contacts
    };
    point.contacts[at] = touched(campaign.site().rest.len() as u32, 0);
    link.contacts[at] = touched(0, campaign.site().robot.link_count() as u32);
    for log in [fewer, rigid, point, link] {
        let phases = campaign.phases(motion, &log);
        assert!(matches!(phases, Err(GapError::Core(_))));
        let predicted = campaign.predict(&nominal, &[motion], &[Arc::new(log)], |_, _, _, _| ());
        assert!(matches!(predicted, Err(GapError::Core(_))));
    }
    assert_eq!(campaign.phases(motion, &log).unwrap().len(), motion.len());
    assert!(
        campaign
            .predict(&nominal, &[motion], &[], |_, _, _, _| ())
            .is_err()
    );
}

#[test]
fn effects_that_leave_contacts_as_they_are_share_those_of_the_nominal_model() {
    let campaign = pressed();
    let session = campaign.session();
    let nominal = campaign.contact_logs(&Model::default(), &session).unwrap();
    for k in 0..catalogue().len() {
        let model = model(&campaign, k);
        let name = model.parts[0].0.name();
        let shared = campaign.contact_logs(&model, &session).unwrap();
        for ((nominal, shared), motion) in nominal.iter().zip(&shared).zip(&session) {
            if model.acts() == Acts::Contact {
                assert!(!Arc::ptr_eq(nominal, shared), "{name}");
                continue;
            }
            assert!(Arc::ptr_eq(nominal, shared), "{name}");
            let own = campaign.contact_log(&model, motion).unwrap();
            for (row, (n, o)) in nominal.contacts.iter().zip(&own.contacts).enumerate() {
                assert_eq!(n.points(), o.points(), "{name}, row {row}");
                assert_eq!(n.displacements(), o.displacements(), "{name}, row {row}");
            }
            assert_eq!(nominal.forces, own.forces, "{name}");
        }
    }
}

#[test]
fn contacts_that_effects_change_are_remembered_and_not_mixed_up() {
    let campaign = pressed();
    let session = campaign.session();
    let named = vsf_gap::effects::named(&["geometry_padding", "torque_bias"]).unwrap();
    let bias = vec![0.1; named[1].parameters(campaign.site()).len()];
    let padded = |by: f64| Model::of(&named[0], &[by]);
    let logs = |model: &Model| campaign.contact_logs(model, &session).unwrap();
    let first = logs(&padded(1e-3));
    for again in [padded(1e-3), padded(1e-3).with(&named[1], &bias)] {
        let again = logs(&again);
        assert!(first.iter().zip(&again).all(|(a, b)| Arc::ptr_eq(a, b)));
    }
    // Others in between, and back.
    for by in [2e-3, 1e-3, -1e-3, 0.0, 3e-3, 1e-3] {
        let model = padded(by);
        for (known, motion) in logs(&model).iter().zip(&session) {
            let own = campaign.contact_log(&model, motion).unwrap();
            assert!(format!("{known:?}") == format!("{own:?}"), "{by}");
        }
    }
    // A clone has the same; the same sequences elsewhere do not.
    let last = logs(&padded(1e-3));
    let of = |campaign: &Campaign| {
        campaign
            .contact_logs(&padded(1e-3), &campaign.session())
            .unwrap()
    };
    assert!(
        last.iter()
            .zip(of(&campaign.clone()))
            .all(|(a, b)| Arc::ptr_eq(a, &b))
    );
    assert!(
        last.iter()
            .zip(of(&pressed()))
            .all(|(a, b)| !Arc::ptr_eq(a, &b))
    );
    // What effects refuse is refused, known contacts or not.
    let wrong = padded(1e-3).with(&named[1], &bias[1..]);
    assert!(campaign.contact_logs(&wrong, &session).is_err());
}

/// Rows of a motion.
fn cut(motion: &Motion, rows: Range<usize>) -> Motion {
    let table = |of: &Table| {
        let data = &of.data()[rows.start * of.cols()..rows.end * of.cols()];
        Table::new(of.cols(), data.to_vec()).unwrap()
    };
    Motion {
        clock: motion.clock[rows.clone()].to_vec(),
        q: table(&motion.q),
        qd: table(&motion.qd),
        qdd: table(&motion.qdd),
        reading: table(&motion.reading),
        smooth: table(&motion.smooth),
        load: table(&motion.load),
        touches: std::iter::once(0..rows.len()).collect(),
        ..motion.clone()
    }
}

/// What begins with a sequence does not begin anew with a further part of it.
#[test]
fn parts_of_a_sequence_are_predicted_as_the_whole() {
    let campaign = swung();
    let effects = catalogue();
    let drift = effects.iter().find(|e| e.name() == "torque_drift").unwrap();
    // From the start of the session, and of the sequence, on.
    let model = Model::of(drift, &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 2.0]);
    let of = |motions: &[&Motion]| -> Vec<f64> {
        let logs = campaign.contact_logs(&model, motions).unwrap();
        let mut all = Vec::new();
        let visit = |_, _, _: &Touch<'_>, terms: &ModelTerms| {
            all.extend_from_slice(&terms.torques);
        };
        campaign.predict(&model, motions, &logs, visit).unwrap();
        all
    };
    let whole = &campaign.train()[0];
    let [first, second] = [0..30, 30..whole.len()].map(|rows| cut(whole, rows));
    let (parts, whole) = (of(&[&first, &second]), of(&[whole]));
    assert_eq!(parts.len(), whole.len());
    for (a, b) in parts.iter().zip(&whole) {
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }
    assert!(whole[whole.len() - 3].abs() > 0.2, "{whole:?}");
}

/// A drift that was found in several sequences acts in a single one, too.
#[test]
fn a_drift_of_every_sequence_is_read_where_there_is_one() {
    let campaign = swung();
    let effects = catalogue();
    let drift = effects.iter().find(|e| e.name() == "torque_drift").unwrap();
    let theta = [0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 2.0];
    let model = Model::of(drift, &theta);
    let sd = theta.map(|v| 0.1 * v);
    let file = ModelFile::new(campaign.site(), &model, &sd).unwrap();
    let names: Vec<&str> = (file.effects[0].parameters.iter())
        .map(|p| p.name.as_str())
        .collect();
    assert_eq!(names, ["s_1", "s_2", "s_3", "T"]);
    let back = ModelFile::from_json(&file.to_json()).unwrap();
    let back = back.model(campaign.site(), &effects).unwrap();
    assert_eq!(back.theta(), theta);
}
