//! After warm-up neither effects nor a control loop with them allocate. What other threads allocate, as those of
//! a thread pool that starts, is not counted.

#![allow(clippy::unwrap_used)]
#![allow(unsafe_code)]

#[path = "gap/common/mod.rs"]
mod common;

use common::campaign::{free_arm, plate};
use nalgebra::{Point3, Vector3};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;
use vsf_core::{Belief, Contacts, Noise, Observation, Session};
use vsf_data::TorqueKind;
use vsf_filter::DiagonalKalman;
use vsf_gap::effects::{self, catalogue};
use vsf_gap::{Campaign, Corrector, JointState, LiveCorrector, Model, ModelTerms, Sample, Touch};
use vsf_pipeline::live::{self, Learner, LiveSession, Node, Options};
use vsf_robots::{JointTorques, planar_arm};

thread_local! {
    static CALLS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is passed on to the system's allocator with its arguments as they are; the
// counter does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        // SAFETY: `ptr` came from `System` with this layout.
        unsafe { System.dealloc(ptr, layout) }
    }
    unsafe fn realloc(&self, ptr: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        CALLS.set(CALLS.get() + 1);
        // SAFETY: `ptr` came from `System` with this layout.
        unsafe { System.realloc(ptr, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const POINTS: u32 = 40;
const TOUCHES: usize = 4;

#[test]
fn nothing_allocates_after_warm_up() {
    compensators();
    control_loop();
    streams();
}

/// Nodes that learn from streams of 1 kHz, with stamps that are not quite even.
fn streams() {
    let points: Vec<[f64; 3]> = (0..25)
        .map(|k| [0.02 * (k % 5) as f64, 0.02 * (k / 5) as f64, 0.0])
        .collect();
    let campaign = plate(&points, &[vec![(vec![0.0; 3], vec![0.0; 3]); 20]]);
    let (site, scene) = (campaign.site(), campaign.scene());
    let noise = Noise::uniform(3, 0.3).unwrap();
    let prior = || Belief::uniform(points.len(), 0.0, 100.0).unwrap();
    let gravity = Some(Vector3::new(0.0, 0.0, -9.81));
    let session = Session::new(
        site.robot.chains().clone(),
        site.rest.clone(),
        scene.contact_model().unwrap(),
        JointTorques::new(noise.clone()),
        DiagonalKalman::<f64>::new(prior()),
    );
    let nominal = LiveSession::new(site.robot.clone(), session.unwrap(), gravity).unwrap();
    stream(nominal);
    let friction = Model::of(
        &effects::named(&["joint_viscous_friction"]).unwrap()[0],
        &[0.1; 3],
    );
    let corrector = Corrector::new(site, scene, &friction).unwrap();
    let filter = DiagonalKalman::new(prior());
    stream(LiveCorrector::new(corrector, filter, noise).unwrap());
}

fn stream<L: Learner>(learner: L) {
    let mut node = Node::new(learner, Vec::new(), Options::default()).unwrap();
    let sample = |k: usize| {
        let jitter = 1e-5 * ((k * 7919) % 13) as f64;
        let t = 1e-3 * k as f64 + jitter;
        let z = 0.003 - 0.01 * (6.0 * t).sin();
        live::Sample {
            t,
            q: vec![0.02 * t, 0.0, z],
            tau: vec![0.1, -0.1, 10.0 * (6.0 * t).sin().max(0.0)],
            qd: None,
            touch: 0,
            sequence: 0,
        }
    };
    let samples: Vec<_> = (0..4000).map(sample).collect();
    let (warm_up, rest) = samples.split_at(2000);
    let mut touching = 0;
    let mut run = |samples: &[live::Sample]| {
        for sample in samples {
            node.take(sample).unwrap();
            touching += node.learner().touching().len();
            if node.is_due() {
                node.summary();
            }
        }
    };
    run(warm_up);
    let before = CALLS.get();
    run(rest);
    assert_eq!(CALLS.get() - before, 0);
    assert!(touching > 0);
}

/// A loop with an effect in its model: contact, columns, torques.
fn control_loop() {
    let points: Vec<[f64; 3]> = (0..25)
        .map(|k| [0.02 * (k % 5) as f64, 0.02 * (k / 5) as f64, 0.0])
        .collect();
    let press = |k: usize| {
        let t = k as f64 / 60.0;
        let z = 0.003 - 0.02 * (std::f64::consts::PI * t).sin();
        (vec![0.02 * t, 0.0, z], vec![0.1, -0.1, 3.0 * t])
    };
    let swing = |k: usize| {
        let t = k as f64 / 60.0;
        (vec![t, 2.0 * t, -t], vec![0.1, -0.1, 3.0 * t])
    };
    // Torques of the environment, and those of the actuators.
    let touching = plate(&points, &[(0..60).map(press).collect()]);
    torques_of_a_field(&touching);
    control_loop_on(&touching);
    control_loop_on(&free_arm(&[(0..60).map(swing).collect()]));
}

fn control_loop_on(campaign: &Campaign) {
    let motion = &campaign.train()[0];
    let mut obs = Observation::new(Noise::uniform(3, 1.0).unwrap());
    for effect in catalogue() {
        if effect.untestable(campaign).is_some() {
            continue;
        }
        let parameters = effect.parameters(campaign.site());
        let theta: Vec<f64> = parameters
            .iter()
            .map(|p| p.scale.min(p.bounds[1]))
            .collect();
        let model = Model::of(&effect, &theta);
        let mut online = Corrector::new(campaign.site(), campaign.scene(), &model).unwrap();
        for touch in 0..TOUCHES {
            let before = CALLS.get();
            online.begin_sequence(&motion.id);
            for row in 0..motion.len() {
                if row == 10 {
                    online.tare();
                }
                let state = JointState {
                    clock: motion.clock[row],
                    q: &motion.q[row],
                    qd: &motion.qd[row],
                    qdd: &motion.qdd[row],
                    torques: &motion.reading[row],
                };
                let torques = online.step(&state, &mut obs);
                assert_eq!(torques.unwrap().len(), 3);
            }
            let calls = CALLS.get() - before;
            assert!(touch == 0 || calls == 0, "{}: {calls}", effect.name());
        }
    }
}

/// What a field gives at the contacts of a sequence.
fn torques_of_a_field(campaign: &Campaign) {
    let motion = &campaign.train()[0];
    let log = campaign.contact_log(&Model::default(), motion).unwrap();
    let stiffness = vec![100.0; campaign.site().rest.len()];
    let (mut tau, mut touching) = ([0.0; 3], 0);
    let count = |_, _, touch: &Touch<'_>, terms: &ModelTerms| {
        let before = CALLS.get();
        terms.apply(touch, &stiffness, &mut tau);
        assert_eq!(CALLS.get(), before);
        touching += usize::from(tau[2] != 0.0);
    };
    let logs = [Arc::new(log)];
    (campaign.predict(&Model::default(), &[motion], &logs, count)).unwrap();
    assert!(touching > 0);
}

fn compensators() {
    let points: Vec<Point3<f64>> = (0..POINTS)
        .map(|k| Point3::new(0.5 + 1e-2 * k as f64, 0.0, 0.1))
        .collect();
    let site = common::site(
        planar_arm(3, 0.3, 0.03).unwrap(),
        &points,
        TorqueKind::Measured,
    );
    let link = site.robot.joints()[2].child() as u32;
    let mut contacts = Contacts::new();
    let mut posture = site.robot.posture();
    let mut springs = Vec::with_capacity(POINTS as usize);
    for effect in catalogue() {
        let theta: Vec<f64> = effect
            .parameters(&site)
            .iter()
            .map(|p| p.bounds[1])
            .collect();
        let mut c = effect.compensator(&site, &theta).unwrap();
        for touch in 0..TOUCHES {
            let before = CALLS.get();
            c.begin_sequence("1");
            c.begin_touch();
            for row in 0..100 {
                let t = 0.01 * row as f64;
                let recorded = [0.3 + t, -0.2 * t, 0.1];
                let (qd, qdd) = ([1.0, -0.2, 0.0], [0.0; 3]);
                contacts.clear();
                // A band that moves over the points.
                for p in (0..POINTS).filter(|p| p.abs_diff(row / 3) < 5) {
                    let u = Vector3::new(0.0, 0.0, -0.02 * t);
                    contacts.push(p, link, u, -Vector3::z()).unwrap();
                }
                let sample = Sample {
                    clock: t,
                    dt: if row > 0 { 0.01 } else { 0.0 },
                    q: &recorded,
                    qd: &qd,
                    qdd: &qdd,
                    reading: &[1.0, -1.0, 0.5],
                    load: &[2.0, 1.0, 0.1],
                    force_W: Vector3::x(),
                };
                let mut q = recorded;
                let (mut gains, mut torques) = ([1.0; 3], [0.0; 3]);
                c.joints(&sample, &mut q);
                site.robot.update_posture(&q, &mut posture).unwrap();
                let of_touch = Touch {
                    rest: &site.rest,
                    posture: &posture,
                    contacts: &contacts,
                };
                springs.clear();
                springs.extend_from_slice(contacts.displacements());
                c.object_shift(&sample);
                c.springs(&sample, &of_touch, &mut springs);
                c.gains(&sample, &of_touch, &mut gains);
                c.torques(&sample, &of_touch, &mut torques);
            }
            let calls = CALLS.get() - before;
            assert!(touch == 0 || calls == 0, "{}: {calls}", effect.name());
        }
    }
}
