//! The pipeline with a sensor that is none of this workspace.

use nalgebra::{Point3, Vector2};
use vsf_core::{Contacts, CoreError, Noise, Observation, Posture, RestPoints, Sensor};
use vsf_data::{Dataset, RobotRef, Sequence, Table};
use vsf_pipeline::{
    EstimatorSpec, HyperMethod, PriorShape, Scene, SceneOptions, choose_hyper, estimate, predict,
};

/// What holds the tip measures the upward force on it, and that along the pad.
#[derive(Clone)]
struct ForceGauge(Noise);

impl Sensor<f64> for ForceGauge {
    fn dim(&self) -> usize {
        2
    }

    fn blank(&self) -> Observation<f64> {
        Observation::new(self.0.clone())
    }

    fn observe(
        &self,
        rest: &RestPoints,
        posture: &Posture,
        contacts: &Contacts,
        reading: &[f64],
        out: &mut Observation<f64>,
    ) -> Result<(), CoreError> {
        contacts.check_fits(rest, posture)?;
        out.rebuild(rest.len(), contacts.points(), reading, |k, column| {
            let force = -contacts.displacements()[k];
            column.copy_from_slice(&[force.z, force.x]);
        })
    }
}

/// A pad of two halves, of 100 and 300 N/m a point.
fn pad() -> Vec<Point3<f64>> {
    let at = |i: usize| 0.004 * i as f64;
    (0..200)
        .map(|i| Point3::new(at(i % 20), at(i / 20), 0.0))
        .collect()
}

fn stiffness() -> Vec<f64> {
    pad()
        .iter()
        .map(|p| if p.x < 0.039 { 100.0 } else { 300.0 })
        .collect()
}

/// Pokes of a stage in rows along the pad, from 2 mm above it to 4 mm below.
fn pokes(id: &str, y: f64) -> Sequence {
    let mut angles = Vec::new();
    let mut starts = Vec::new();
    for poke in 0..10 {
        starts.push(angles.len() / 3);
        for k in 0..13 {
            let depth = 0.006 * (std::f64::consts::PI * k as f64 / 12.0).sin();
            angles.extend([0.008 * poke as f64, y, 0.002 - depth]);
        }
    }
    let rows = angles.len() / 3;
    let time = (0..rows).map(|k| 0.1 * k as f64).collect();
    let table = |data| Table::new(3, data).unwrap();
    Sequence {
        touch_starts: starts,
        ..Sequence::new(id, time, table(angles), table(vec![0.0; 3 * rows]))
    }
}

#[test]
fn a_force_gauge_finds_the_field() {
    let train: Vec<Sequence> = (0..5)
        .map(|k| pokes(&k.to_string(), 0.008 * k as f64))
        .collect();
    let test = pokes("test", 0.012);
    let robot = RobotRef::resolve("cartesian_stage", ".".as_ref()).unwrap();
    let dataset = Dataset {
        rest_points: Some(pad()),
        ..Dataset::new(robot, train.clone())
    };
    let scene = Scene::open(&dataset, &SceneOptions::default()).unwrap();
    let gauge = ForceGauge(Noise::uniform(2, 1.0).unwrap());
    // Readings of the true field.
    let blank = |s: &Sequence| Table::new(2, vec![0.0; 2 * s.len()]).unwrap();
    let traced = |s: &Sequence| {
        let contacts = scene.observe(s, &gauge, &blank(s)).unwrap();
        let mut readings = blank(s);
        for (row, obs) in contacts.observations.iter().enumerate() {
            obs.apply(&stiffness(), &mut readings.data_mut()[2 * row..2 * row + 2]);
        }
        scene.observe(s, &gauge, &readings).unwrap()
    };
    let traces: Vec<_> = train.iter().map(traced).collect();
    assert!(traces.iter().all(|t| t.contact_samples() > 20));
    let (rest, shapes) = (scene.rest(), PriorShape::default().or_independent());
    let hyper = choose_hyper(rest, &traces, &shapes, HyperMethod::HeldOut)
        .unwrap()
        .hyper;
    assert_eq!(hyper.noise_sd.len(), 2);
    let found = estimate(rest, &traces, &EstimatorSpec::Batch, &hyper, |_| {}).unwrap();
    let held_out = traced(&test);
    let prediction = predict(&scene, &found.belief, &hyper.noise_sd, &held_out).unwrap();
    let (mut left, mut all) = (0.0, 0.0);
    for (mean, reading) in prediction.mean.iter().zip(held_out.readings()) {
        let [mean, reading] = [&mean[..], reading].map(Vector2::from_column_slice);
        left += (mean - reading).norm();
        all += reading.norm();
    }
    assert!(left < 0.05 * all, "{left} of {all}");
}

#[test]
fn readings_of_another_length_are_refused() {
    let sequence = pokes("0", 0.0);
    let robot = RobotRef::resolve("cartesian_stage", ".".as_ref()).unwrap();
    let dataset = Dataset {
        rest_points: Some(pad()),
        ..Dataset::new(robot, vec![sequence.clone()])
    };
    let scene = Scene::open(&dataset, &SceneOptions::default()).unwrap();
    let gauge = ForceGauge(Noise::uniform(2, 1.0).unwrap());
    let short = Table::new(2, vec![0.0; 6]).unwrap();
    let error = scene
        .observe(&sequence, &gauge, &short)
        .unwrap_err()
        .to_string();
    assert!(error.contains("rows of readings"), "{error}");
    let narrow = Table::new(1, vec![0.0; sequence.len()]).unwrap();
    assert!(scene.observe(&sequence, &gauge, &narrow).is_err());
}
