//! A corrected model outside of a diagnosis: observations of recordings, control loops, files.

#![allow(clippy::unwrap_used)]

mod common;

use common::campaign::{Rows, free_arm, free_arm_tared, plate, torques};
use nalgebra::Vector3;
use proptest::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use vsf_core::{Contacts, Noise, Observation};
use vsf_data::Table;
use vsf_gap::effects::catalogue;
use vsf_gap::{
    Acts, Campaign, Corrector, EffectEntry, GapError, Model, ModelFile, Motion, ParameterEstimate,
    Role,
};

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

fn pressed() -> Campaign {
    plate(&points(), &[press(0.01), press(0.02), press(0.015)])
}

fn swung() -> Campaign {
    let row = |k: usize| {
        let t = k as f64 / 100.0;
        let q: Vec<f64> = (0..3).map(|j| (t * (1.0 + j as f64)).sin()).collect();
        let tau = vec![0.5 + t, 0.2 - t, 0.1];
        (q, tau)
    };
    free_arm(&[(0..80).map(row).collect()])
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

#[test]
fn a_loop_has_the_observations_of_the_recording() {
    for campaign in [pressed(), swung()] {
        for k in 0..catalogue().len() {
            let model = model(&campaign, k);
            if model.parts[0].0.untestable(&campaign).is_some() {
                continue;
            }
            let name = model.parts[0].0.name().to_owned();
            let offline = campaign.corrected(&model).unwrap();
            let mut online = Corrector::new(campaign.site(), campaign.scene(), &model).unwrap();
            let unit = Noise::uniform(campaign.site().joints(), 1.0).unwrap();
            let mut obs = Observation::new(unit);
            for (c, motion) in offline.iter().zip(campaign.session()) {
                online.begin_sequence(&motion.id);
                for row in 0..motion.len() {
                    let sample = motion.sample(row, 0, Vector3::zeros());
                    let torques = online
                        .step(&sample, &motion.reading[row], &mut obs)
                        .unwrap();
                    assert_eq!(torques, &c.torques[row], "{name} row {row}");
                    let same = &c.trace.observations[row];
                    assert_eq!(obs.points(), same.points(), "{name} row {row}");
                    assert_eq!(obs.rows(), same.rows(), "{name} row {row}");
                    assert_eq!(obs.reading(), same.reading(), "{name} row {row}");
                }
            }
        }
    }
}

/// A loop that tares when the recording has been tared goes on as the recording does.
#[test]
fn val_a_control_loop_tares_as_a_recording_does() {
    const TARE: usize = 10;
    let row = |k: usize| {
        let t = k as f64 / 100.0;
        let q: Vec<f64> = (0..3).map(|j| (t * (1.0 + j as f64)).cos()).collect();
        (q, vec![0.5 + t, 0.2 - t, 0.1])
    };
    let rows: Rows = (0..60).map(row).collect();
    let campaign = free_arm_tared(&[rows.clone(), rows], TARE);
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
            for row in 0..motion.len() {
                if row == TARE {
                    online.tare();
                }
                let sample = motion.sample(row, 0, Vector3::zeros());
                let reading = &motion.reading[row];
                let torques = online.step(&sample, reading, &mut obs).unwrap();
                let offline = &c.torques[row];
                for (a, b) in torques.iter().zip(offline).filter(|_| row >= TARE) {
                    assert!((a - b).abs() < 1e-12, "{name} row {row}: {a} {b}");
                }
            }
        }
    }
}

#[test]
fn a_control_loop_refuses_samples_that_do_not_fit() {
    for campaign in [pressed(), swung()] {
        let model = Model::default();
        let mut online = Corrector::new(campaign.site(), campaign.scene(), &model).unwrap();
        let unit = Noise::uniform(campaign.site().joints(), 1.0).unwrap();
        let mut obs = Observation::new(unit);
        let motion = campaign.session()[0];
        let good = motion.sample(0, 0, Vector3::zeros());
        let reading = &motion.reading[0];
        let bad = [f64::NAN, 0.0, 0.0];
        for row in [&reading[..2], &[], &bad] {
            let samples = [
                vsf_gap::Sample { q: row, ..good },
                vsf_gap::Sample { qd: row, ..good },
                vsf_gap::Sample { qdd: row, ..good },
                vsf_gap::Sample { load: row, ..good },
                vsf_gap::Sample {
                    reading: row,
                    ..good
                },
            ];
            for sample in samples {
                let refused = online.step(&sample, reading, &mut obs).unwrap_err();
                assert!(matches!(refused, GapError::Core(_)), "{refused}");
                assert!(refused.to_string().contains("of the sample"), "{refused}");
            }
            let refused = online.step(&good, row, &mut obs).unwrap_err();
            assert!(refused.to_string().contains("reading of the sample"));
        }
        let dt = f64::INFINITY;
        let late = vsf_gap::Sample { dt, ..good };
        online.step(&late, reading, &mut obs).unwrap_err();
        online.step(&good, reading, &mut obs).unwrap();
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
            .contains("\"eps\" (m/s) is missing")
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
    type Change = dyn Fn(&mut EffectEntry);
    let cases: [(&Change, &str); 9] = [
        (&|e| e.effect = "torque_boas".into(), "torque_bias"),
        (&|e| drop(e.parameters.pop()), "\"b_2\" (N) is missing"),
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
        (&|e| e.parameters[0].sd = -1.0, "must be >= 0"),
        (&|e| e.parameters[0].sd = f64::INFINITY, "must be >= 0"),
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
            "parameters",
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
        let visit = |_, _, _: &vsf_gap::Touch<'_>, p: &vsf_gap::Prediction| {
            all.extend_from_slice(&p.torques);
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
