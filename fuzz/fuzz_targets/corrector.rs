//! A corrected model in a control loop in which anything may come.
#![no_main]

use libfuzzer_sys::arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use std::sync::{Arc, LazyLock};
use vsf::core::{Noise, Observation};
use vsf::data::TorqueKind;
use vsf::gap::effects::catalogue;
use vsf::gap::{Corrector, Effect, JointState, Model, Site};
use vsf::pipeline::{Scene, SceneOptions};
use vsf_fuzz::{JOINTS, number, recording, row, site};

struct World {
    site: Site,
    scene: Scene,
    air: Scene,
    effects: Vec<Arc<dyn Effect>>,
}

static WORLD: LazyLock<World> = LazyLock::new(|| World {
    site: site(),
    scene: Scene::open(&recording(), &SceneOptions::default()).expect("a scene"),
    air: Scene::in_air(&recording(), (*site().robot).clone()).expect("no points"),
    effects: catalogue(),
});

fn run(u: &mut Unstructured<'_>) -> Result<()> {
    let effect = u.choose(&WORLD.effects)?;
    let mut site = WORLD.site.clone();
    if u.arbitrary()? {
        site.torque_kind = TorqueKind::Measured;
    }
    let mut theta = Vec::new();
    for p in effect.parameters(&site) {
        let [low, high] = p.bounds;
        theta.push(match u.arbitrary::<u8>()? {
            0 => number(u)?,
            share => low + (high - low) * f64::from(share) / 255.0,
        });
    }
    let scene = if u.arbitrary()? {
        &WORLD.scene
    } else {
        &WORLD.air
    };
    if u.ratio(15, 16)? {
        site.rest = scene.rest().clone();
    }
    let Ok(mut corrector) = Corrector::new(&site, scene, &Model::of(effect, &theta)) else {
        return Ok(());
    };
    let mut obs = Observation::new(Noise::uniform(JOINTS, 0.1).expect("noise"));
    corrector.begin_sequence("1");
    let mut clock = 0.0;
    while !u.is_empty() {
        match u.arbitrary::<u8>()? {
            0 => corrector.begin_sequence("2"),
            1 => corrector.begin_touch(),
            2 => corrector.tare(),
            step => {
                // Seldom any time, or else one that goes on.
                clock += 0.01;
                let state = JointState {
                    clock: if step == 3 { number(u)? } else { clock },
                    q: &row(u, JOINTS)?,
                    qd: &row(u, JOINTS)?,
                    qdd: &row(u, JOINTS)?,
                    torques: &row(u, JOINTS)?,
                };
                if let Ok(torques) = corrector.step(&state, &mut obs) {
                    assert!(torques.iter().all(|t| t.is_finite()));
                    assert!(obs.rows().iter().all(|w| w.is_finite()));
                }
            }
        }
    }
    Ok(())
}

fuzz_target!(|data: &[u8]| {
    let _ = run(&mut Unstructured::new(data));
});
