//! Recordings with one thing wrong each, and the warning of it.

use nalgebra::Point3;
use vsf_core::{Belief, FilterHealth, UpdateReport};
use vsf_data::{Dataset, RobotRef, Sequence, Table, TorqueKind};
use vsf_pipeline::{
    Approach, PipelineWarning, Scene, SceneOptions, add_noise, field_warnings, fit_warnings,
    health_warnings, motion_warnings, reading_warnings, robot_of, saturated_joints, scene_warnings,
    simulate, touch_warnings,
};

const ROWS: usize = 61;
const SECONDS: f64 = 3.0;

/// An arm of three links along x that swings up into a block above its end and back, by the first joint;
/// the second one moves a little, the third hardly. Velocities are right, torques zero.
fn swing() -> Sequence {
    swing_of(ROWS)
}

/// The same of so many samples.
fn swing_of(rows: usize) -> Sequence {
    let (mut angles, mut velocities) = (Vec::new(), Vec::new());
    let time: Vec<f64> = (0..rows)
        .map(|k| SECONDS * k as f64 / (rows - 1) as f64)
        .collect();
    let pace = std::f64::consts::TAU / SECONDS;
    for (k, t) in time.iter().enumerate() {
        let (sin, cos) = (pace * t).sin_cos();
        // An encoder that cannot make up its mind.
        let jitter = if k.is_multiple_of(2) { 1e-4 } else { 0.0 };
        angles.extend([-0.115 - 0.185 * cos, 0.02 * cos, jitter]);
        velocities.extend([0.185 * pace * sin, -0.02 * pace * sin, 0.0]);
    }
    let table = |data: Vec<f64>| Table::new(3, data).unwrap();
    Sequence {
        velocities: Some(table(velocities)),
        ..Sequence::new("0", time, table(angles), table(vec![0.0; 3 * rows]))
    }
}

fn scene(torque_kind: TorqueKind, tare_samples: usize) -> Scene {
    let block = (0..100).map(|i| {
        let at = |from: f64, k: usize| from + 0.015 * k as f64;
        Point3::new(at(0.75, i % 5), at(-0.02, i / 25), at(0.045, i / 5 % 5))
    });
    let robot = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
    let dataset = Dataset {
        torque_kind,
        tare_samples,
        rest_points: Some(block.collect()),
        ..Dataset::new(robot, vec![swing()])
    };
    Scene::open(&dataset, &SceneOptions::default()).unwrap()
}

/// The swing with the readings of an uneven block, as they are recorded.
fn touch(recorded: &Scene) -> Sequence {
    touch_along(recorded, &swing())
}

fn touch_along(recorded: &Scene, motion: &Sequence) -> Sequence {
    let stiffness: Vec<f64> = (0..100).map(|i| 50.0 * f64::from(i % 7)).collect();
    let traces = [recorded.trace(motion).unwrap()];
    let mut found = simulate(recorded, &stiffness, &[motion], &traces).unwrap();
    add_noise(&mut found, 0.02, 1).unwrap();
    found.remove(0)
}

#[test]
fn links_and_thresholds_that_are_not_in_meters() {
    let sphere = |radius: f64| {
        let urdf = format!(
            r#"<robot name="stick"><link name="base"/><link name="tip"><collision><geometry>
            <sphere radius="{radius}"/></geometry></collision></link>
            <joint name="j" type="prismatic"><parent link="base"/><child link="tip"/><axis xyz="1 0 0"/>
            <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#
        );
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("stick.urdf"), urdf).unwrap();
        let robot = RobotRef::resolve("stick.urdf", folder.path()).unwrap();
        let sequence = Sequence::new("0", vec![0.0], zeros(), zeros());
        let points: Vec<_> = (10..=20)
            .map(|k| Point3::new(0.01 * f64::from(k), 0.0, 0.0))
            .collect();
        let dataset = Dataset {
            rest_points: Some(points),
            ..Dataset::new(robot, vec![sequence])
        };
        move |threshold: f64| {
            let mut options = SceneOptions::default();
            options.contact.threshold = threshold;
            let _ = &folder;
            scene_warnings(&Scene::open(&dataset, &options).unwrap())
        }
    };
    fn zeros() -> Table {
        Table::new(1, vec![0.0]).unwrap()
    }
    assert_eq!(sphere(0.02)(0.002), []);
    let [huge] = &sphere(20.0)(0.002)[..] else {
        panic!()
    };
    assert!(huge.to_string().starts_with("link \"tip\" is 40 m across"));
    let [huge] = &sphere(6e5)(0.002)[..] else {
        panic!()
    };
    assert!(huge.to_string().contains("is 1.2e6 m across"), "{huge}");
    let [tiny] = &sphere(2e-5)(0.002)[..] else {
        panic!()
    };
    assert!(tiny.to_string().contains("is 4e-5 m across"), "{tiny}");
    // Up to four spacings of the points, 1 cm, or a quarter of the object are no mistake.
    assert_eq!(sphere(0.02)(0.035), []);
    let [afar] = &sphere(0.02)(0.05)[..] else {
        panic!()
    };
    let text = "reach 0.05 m beyond the robot's surface, and the object is 0.100 m across";
    assert!(afar.to_string().contains(text), "{afar}");
}

fn warned(taken: &Scene, sequence: &Sequence) -> Vec<PipelineWarning> {
    let traces = [taken.trace(sequence).unwrap()];
    let in_contact = traces[0].contact_samples();
    assert!((5..ROWS / 2).contains(&in_contact), "{in_contact}");
    reading_warnings(taken, &[sequence], &traces)
}

fn scaled(table: &Table, factor: f64) -> Table {
    let data = table.data().iter().map(|v| factor * v);
    Table::new(table.cols(), data.collect()).unwrap()
}

#[test]
fn right_readings_are_not_warned_of() {
    for kind in [TorqueKind::External, TorqueKind::Measured] {
        for tare_samples in [0, 5] {
            let scene = scene(kind, tare_samples);
            assert_eq!(warned(&scene, &touch(&scene)), []);
        }
    }
}

/// Torques whose clock is another one.
#[test]
fn torques_that_come_later_than_touches() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    let step = right.time[1] - right.time[0];
    let shifted = |rows: isize, offset: f64| {
        let free = right.torques[0].to_vec();
        let of_row = |k: usize| {
            let at = k.checked_add_signed(-rows).filter(|k| *k < right.len());
            at.map_or(&free[..], |k| &right.torques[k])
        };
        let all = (0..right.len()).flat_map(|k| of_row(k).iter().map(move |tau| tau + offset));
        Sequence {
            torques: Table::new(right.torques.cols(), all.collect()).unwrap(),
            ..right.clone()
        }
    };
    let late = |rows: isize, offset: f64| {
        let warnings = warned(&scene, &shifted(rows, offset));
        warnings.into_iter().find_map(|w| match w {
            PipelineWarning::Late { seconds, left, .. } => Some((seconds, left)),
            _ => None,
        })
    };
    for offset in [0.0, 3.0] {
        let (seconds, left) = late(8, offset).unwrap();
        assert!((seconds - 8.0 * step).abs() < 1.5 * step, "{seconds}");
        assert!(left < 0.9, "{left}");
        // Nothing is late, or early, as that of a viscous object is.
        assert_eq!(late(0, offset), None);
        assert_eq!(late(-8, offset), None);
    }
    // Nearly as late as the touch is long.
    let (seconds, _) = late(12, 0.0).unwrap();
    assert!((seconds - 12.0 * step).abs() < 1.5 * step, "{seconds}");
}

/// Forces that grow faster or slower than springs' do, or fade while the arm waits, are not late.
#[test]
fn objects_that_are_no_springs_are_not_late() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    let largest = right
        .torques
        .data()
        .iter()
        .fold(0.0_f64, |a, b| a.max(b.abs()));
    for power in [0.5, 1.5, 3.0] {
        let curved = |tau: &f64| tau.signum() * largest * (tau.abs() / largest).powf(power);
        let data = right.torques.data().iter().map(curved).collect();
        for rows in [right.len(), right.len() / 2] {
            let torques: Vec<f64> = Vec::clone(&data);
            let cut = 3 * rows;
            let part = Sequence::new(
                "0",
                right.time[..rows].to_vec(),
                Table::new(3, right.angles.data()[..cut].to_vec()).unwrap(),
                Table::new(3, torques[..cut].to_vec()).unwrap(),
            );
            let traces = [scene.trace(&part).unwrap()];
            let warnings = reading_warnings(&scene, &[&part], &traces);
            let late = |w: &PipelineWarning| matches!(w, PipelineWarning::Late { .. });
            assert!(!warnings.iter().any(late), "{power}: {warnings:?}");
        }
    }
}

#[test]
fn torques_of_the_robot_on_the_object() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    let turned = Sequence {
        torques: scaled(&right.torques, -1.0),
        ..right
    };
    let warnings = warned(&scene, &turned);
    assert!(
        matches!(warnings[..], [PipelineWarning::OppositeTorques { correlation }] if correlation < -0.8),
        "{warnings:?}"
    );
    assert!(warnings[0].to_string().contains("check their sign"));
}

#[test]
fn torques_of_the_other_kind() {
    let (external, measured) = (TorqueKind::External, TorqueKind::Measured);
    for (was, taken) in [(external, measured), (measured, external)] {
        for tare_samples in [0, 5] {
            let taken = scene(taken, tare_samples);
            let warnings = warned(&taken, &touch(&scene(was, 0)));
            let found = warnings
                .iter()
                .find(|w| matches!(w, PipelineWarning::GravityLeft { size, .. } if (size - 1.0).abs() < 0.05));
            let text = found.unwrap().to_string();
            let asks = match was {
                TorqueKind::External => "check whether they are external",
                TorqueKind::Measured => "check whether they are measured",
            };
            assert!(text.contains(asks), "{text}");
        }
    }
}

/// The readings of the first joint, each of them changed.
fn first_joint(right: &Sequence, change: impl Fn(f64) -> f64) -> Sequence {
    let mut changed = right.clone();
    let rows = changed.torques.data_mut().chunks_exact_mut(3);
    rows.for_each(|row| row[0] = change(row[0]));
    changed
}

#[test]
fn sensors_that_are_stuck() {
    for kind in [TorqueKind::External, TorqueKind::Measured] {
        let scene = scene(kind, 0);
        let right = touch(&scene);
        let warnings = warned(&scene, &first_joint(&right, |_| -1.25));
        let stuck = |w: &PipelineWarning| matches!(w, PipelineWarning::StuckReadings { joint, value, .. } if joint == "joint_1" && *value == -1.25);
        assert!(warnings.iter().any(stuck), "{warnings:?}");
        // Nor does it take another joint that moves.
        let mut all = right.clone();
        all.torques.data_mut().fill(-1.25);
        let warnings = warned(&scene, &all);
        assert!(warnings.iter().any(stuck), "{warnings:?}");
        // Channels that were not measured are zeros, all of them where nothing was.
        let zero = |w: &PipelineWarning| matches!(w, PipelineWarning::ZeroReadings { joint } if joint == "joint_1");
        let none = Sequence {
            torques: scaled(&right.torques, 0.0),
            ..right.clone()
        };
        for (still, is_one) in [(first_joint(&right, |_| 0.0), true), (none, false)] {
            let warnings = warned(&scene, &still);
            let stuck = |w: &PipelineWarning| matches!(w, PipelineWarning::StuckReadings { .. });
            assert!(!warnings.iter().any(stuck), "{warnings:?}");
            assert_eq!(warnings.iter().any(zero), is_one, "{warnings:?}");
        }
    }
}

/// In free air the weight of the arm tells: what holds it changes, and a reading does not.
#[test]
fn actuators_that_are_still() {
    let robot = RobotRef::resolve("planar_arm", ".".as_ref()).unwrap();
    let dataset = Dataset {
        torque_kind: TorqueKind::Measured,
        ..Dataset::new(robot, vec![swing()])
    };
    let robot = robot_of(&dataset, &Default::default()).unwrap();
    let arm = Scene::in_air(&dataset, robot).unwrap();
    let traces = [arm.trace(&swing()).unwrap()];
    let mut right = simulate(&arm, &[], &[&swing()], &traces).unwrap();
    add_noise(&mut right, 0.02, 1).unwrap();
    let right = right.remove(0);
    let warned = |of: &Sequence| reading_warnings(&arm, &[of], &[arm.trace(of).unwrap()]);
    assert_eq!(warned(&right), []);
    let still = |changed: &Sequence| {
        warned(changed).into_iter().find_map(|w| match w {
            PipelineWarning::StillActuator {
                joint, row, count, ..
            } => Some((joint, row, count)),
            _ => None,
        })
    };
    for value in [0.0, -1.25] {
        let dead = first_joint(&right, |_| value);
        assert_eq!(still(&dead), Some(("joint_1".to_owned(), 0, ROWS)));
    }
    let mut frozen = right.clone();
    let rows = frozen.torques.data_mut().chunks_exact_mut(3).skip(20);
    rows.for_each(|row| row[0] = 3.5);
    assert_eq!(still(&frozen), Some(("joint_1".to_owned(), 20, ROWS - 20)));
    // Readings in coarse steps stay at a value as well.
    let rounded = first_joint(&right, |v| (10.0 * v).round() / 10.0);
    assert_eq!(still(&rounded), None);
}

#[test]
fn sensors_that_are_saturated() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    let (least, most) =
        (right.torques.column(0)).fold((0f64, 0f64), |(lo, hi), v| (lo.min(v), hi.max(v)));
    let (end, size) = if most > -least {
        (most, most)
    } else {
        (least, -least)
    };
    let clipped = |w: &PipelineWarning| matches!(w, PipelineWarning::ClippedReadings { joint, value, .. } if joint == "joint_1" && *value == 0.4 * end);
    let warnings = warned(
        &scene,
        &first_joint(&right, |v| v.clamp(-0.4 * size, 0.4 * size)),
    );
    assert!(warnings.iter().any(clipped), "{warnings:?}");
    // Coarse steps, and touches that are held, stay at a value without an end to it.
    for steps in [3.0, 10.0, 100.0] {
        let step = size / steps;
        let rounded = first_joint(&right, |v| (v / step).round() * step);
        assert_eq!(warned(&scene, &rounded), [], "{steps}");
    }
}

/// Noise that comes after the end of a sensor's range hides that its readings are equal.
#[test]
fn sensors_that_are_saturated_beneath_noise() {
    let scene = scene(TorqueKind::External, 0);
    let stiffness: Vec<f64> = (0..100).map(|i| 50.0 * f64::from(i % 7)).collect();
    // Touches reach so far.
    let told = |keep: f64, rows: usize, reach: &[f64]| {
        let swings = reach.iter().enumerate().map(|(k, reach)| {
            let mut swing = swing_of(rows);
            swing.id = k.to_string();
            let angles = swing.angles.data_mut().chunks_exact_mut(3);
            angles.for_each(|q| q[0] -= 0.185 * (1.0 - reach));
            swing
        });
        let swings: Vec<Sequence> = swings.collect();
        let swings: Vec<&Sequence> = swings.iter().collect();
        let traces: Vec<_> = swings.iter().map(|s| scene.trace(s).unwrap()).collect();
        let mut found = simulate(&scene, &stiffness, &swings, &traces).unwrap();
        let first = found[0].torques.column(0);
        let end = keep * first.fold(0.0, |end: f64, v| end.max(v.abs()));
        for sequence in &mut found {
            let rows = sequence.torques.data_mut().chunks_exact_mut(3);
            rows.for_each(|row| row[0] = row[0].clamp(-end, end));
        }
        add_noise(&mut found, 0.02, 1).unwrap();
        // One reading that is off hides nothing.
        found[0].torques.data_mut()[3 * (rows / 2)] *= 1.05;
        let traces: Vec<_> = found.iter().map(|s| scene.trace(s).unwrap()).collect();
        let found: Vec<&Sequence> = found.iter().collect();
        let warnings = reading_warnings(&scene, &found, &traces);
        let clipped = |w: &PipelineWarning| match w {
            PipelineWarning::SaturatedReadings { joint, level, .. } => {
                Some((joint.clone(), level.abs(), end))
            }
            _ => None,
        };
        warnings.iter().filter_map(clipped).collect::<Vec<_>>()
    };
    for rows in [10 * ROWS, 100 * ROWS] {
        let [(joint, value, end)] = &told(0.4, rows, &[1.0, 0.92])[..] else {
            panic!("{rows}")
        };
        assert!(
            joint == "joint_1" && (value - end).abs() < 0.02,
            "{value} {end}"
        );
    }
    assert_eq!(told(1.0, 10 * ROWS, &[1.0, 0.92]), []);
    // An object that yields does the same whenever it is touched alike.
    assert_eq!(told(0.4, 10 * ROWS, &[1.0]), []);
    assert_eq!(told(0.4, 10 * ROWS, &[1.0, 1.0]), []);
}

/// Rows that are exchanged, of all joints or of one, and an encoder that stops for a while.
#[test]
fn positions_that_leap_or_freeze() {
    let scene = scene(TorqueKind::External, 0);
    let right = Sequence {
        torques: Table::new(3, vec![0.0; 30 * ROWS]).unwrap(),
        ..swing_of(10 * ROWS)
    };
    let found = |change: &dyn Fn(&mut [f64]), velocities: bool| {
        let mut changed = right.clone();
        change(changed.angles.data_mut());
        if !velocities {
            changed.velocities = None;
        }
        motion_warnings(scene.robot(), &[&changed])
    };
    assert_eq!(found(&|_| (), true), []);
    let exchanged = |q: &mut [f64]| {
        let (a, b) = (3 * 150, 3 * 180);
        (0..3).for_each(|j| q.swap(a + j, b + j));
    };
    for velocities in [true, false] {
        let warnings = found(&exchanged, velocities);
        let leap = |w: &PipelineWarning| matches!(w, PipelineWarning::Leaps { row: 150, .. });
        assert!(warnings.iter().any(leap), "{warnings:?}");
    }
    let frozen = |q: &mut [f64]| {
        let value = q[3 * 150];
        (150..190).for_each(|row| q[3 * row] = value);
    };
    let warnings = found(&frozen, true);
    let told = |w: &PipelineWarning| match w {
        PipelineWarning::FrozenPositions {
            joint,
            row: 150,
            count: 40,
            way,
            ..
        } => joint == "joint_1" && *way > 0.02,
        _ => false,
    };
    assert!(warnings.iter().any(told), "{warnings:?}");
    // Of both joints that move.
    let both = |q: &mut [f64]| {
        let values = [q[3 * 110], q[3 * 110 + 1]];
        (110..200).for_each(|row| q[3 * row..][..2].copy_from_slice(&values));
    };
    let warnings = found(&both, true);
    let others = warnings.iter().find_map(|w| match w {
        PipelineWarning::FrozenPositions { others, .. } => Some(*others),
        _ => None,
    });
    assert_eq!(others, Some(1), "{warnings:?}");
}

/// Where the arm passes far from the points, the error says how far.
#[test]
fn val_nearest_approach() {
    let robot = RobotRef::resolve("cartesian_stage", ".".as_ref()).unwrap();
    let table = |rows: &[[f64; 3]]| Table::new(3, rows.concat()).unwrap();
    let (near, far) = ([0.0, 0.0, 0.05], [0.3, 0.0, 0.2]);
    let passes = Sequence::new(
        "7",
        vec![0.0, 0.1, 0.2],
        table(&[far, near, far]),
        table(&[[0.0; 3]; 3]),
    );
    let dataset = Dataset {
        rest_points: Some(vec![Point3::origin(), Point3::new(-1.0, 0.0, 0.0)]),
        ..Dataset::new(robot, vec![passes.clone()])
    };
    let scene = Scene::open(&dataset, &SceneOptions::default()).unwrap();
    let nearest = Approach::nearest(&scene, &[&passes]).unwrap().unwrap();
    // The lowest point of its ball is where the axes are.
    assert!((nearest.distance - 0.05).abs() < 1e-9, "{nearest}");
    assert_eq!((nearest.sequence.as_str(), nearest.row), ("7", 1));
    assert!(
        nearest.to_string().contains("0.050 m, in sequence 7 row 1"),
        "{nearest}"
    );
    assert_eq!(Approach::nearest(&scene, &[]).unwrap(), None);
}

/// Readings that come late stay at their largest while the arm withdraws, and are felt where nothing is touched.
#[test]
fn late_readings_are_not_saturated() {
    let scene = scene(TorqueKind::External, 0);
    let rows = 10 * ROWS;
    // Touches that stay at one depth for a while, and noise that makes up for the rest.
    let touch = |reach: f64| {
        let mut swing = swing_of(rows);
        swing.id = reach.to_string();
        let angles = swing.angles.data_mut().chunks_exact_mut(3);
        angles.for_each(|q| q[0] = (q[0] - 0.185 * (1.0 - reach)).min(0.055));
        swing.velocities = None;
        swing
    };
    let touches = [touch(1.0), touch(0.92)];
    let touches: Vec<&Sequence> = touches.iter().collect();
    let traces: Vec<_> = touches.iter().map(|s| scene.trace(s).unwrap()).collect();
    let felt = simulate(&scene, &[50.0; 100], &touches, &traces).unwrap();
    let mut looked_saturated = false;
    for (noise, later) in [(0.02, 152), (0.1, 30), (0.3, 76)] {
        let mut late = felt.clone();
        for sequence in &mut late {
            sequence.torques.data_mut().rotate_right(3 * later);
        }
        add_noise(&mut late, noise, 1).unwrap();
        let traces: Vec<_> = late.iter().map(|s| scene.trace(s).unwrap()).collect();
        let late: Vec<&Sequence> = late.iter().collect();
        looked_saturated |= !saturated_joints(&traces).is_empty();
        let warnings = reading_warnings(&scene, &late, &traces);
        assert!(
            matches!(warnings[..], [PipelineWarning::Late { .. }]),
            "{warnings:?}"
        );
    }
    assert!(looked_saturated);
}

/// All of them, from one sample to the next; a touch that ends is no loss.
#[test]
fn sensors_that_are_lost_in_a_touch() {
    let scene = scene(TorqueKind::External, 0);
    let mut lost = touch(&scene);
    let contact = &scene.trace(&lost).unwrap().observations;
    let first = contact.iter().position(|o| !o.is_empty()).unwrap();
    let last = contact.iter().rposition(|o| !o.is_empty()).unwrap();
    let from = first + (last - first) / 2;
    lost.torques.data_mut()[3 * from..].fill(0.0);
    let warnings = warned(&scene, &lost);
    let row = |w: &PipelineWarning| match w {
        PipelineWarning::FrozenReadings {
            row, value, others, ..
        } => Some((*row, *value, *others)),
        _ => None,
    };
    assert_eq!(
        warnings.iter().find_map(row),
        Some((from, 0.0, 2)),
        "{warnings:?}"
    );
    let mut over = touch(&scene);
    over.torques.data_mut()[3 * (last + 1)..].fill(0.0);
    assert_eq!(warned(&scene, &over), []);
}

/// A sensor that stops in the middle of a touch.
#[test]
fn sensors_that_freeze() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    let other = Sequence {
        id: "1".to_owned(),
        ..right.clone()
    };
    // The arm swings back from the middle on; frozen on the way in, a sensor reads no more than what it read last, as if
    // it were saturated, had not another sequence more.
    for (first, count) in [(ROWS / 2 + 2, 8), (ROWS / 2 - 4, 8), (ROWS / 2 - 4, ROWS)] {
        for joints in [1, 3] {
            let mut frozen = right.clone();
            let held = frozen.torques[first].to_vec();
            let rows = frozen.torques.data_mut().chunks_exact_mut(3);
            for row in rows.skip(first).take(count) {
                row[..joints].copy_from_slice(&held[..joints]);
            }
            let both = [&frozen, &other];
            let traces = both.map(|s| scene.trace(s).unwrap());
            let warnings = reading_warnings(&scene, &both, &traces);
            let count = count.min(ROWS - first);
            let is_told = |w: &PipelineWarning| matches!(w, PipelineWarning::FrozenReadings { joint, row, count: n, value, .. } if joint == "joint_1" && (*row, *n) == (first, count) && *value == held[0]);
            assert!(warnings.iter().any(is_told), "{first} {count} {warnings:?}");
        }
    }
}

/// One joint of the other sign, and columns of another order.
#[test]
fn readings_of_other_joints() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    for (turned, says) in [
        (&[0][..], "joint_1"),
        (&[1], "joint_2"),
        (&[2], "joint_3"),
        (&[0, 1], "joint_1, joint_2"),
        (&[0, 2], "joint_1, joint_3"),
    ] {
        let mut changed = right.clone();
        for row in changed.torques.data_mut().chunks_exact_mut(3) {
            turned.iter().for_each(|&j| row[j] = -row[j]);
        }
        let warnings = warned(&scene, &changed);
        let [PipelineWarning::OppositeJoints { joints, gain }] = &warnings[..] else {
            panic!("{warnings:?}");
        };
        assert!(joints == says && *gain > 100.0, "{warnings:?}");
    }

    let reordered = |order: [usize; 3]| {
        let mut changed = right.clone();
        for row in changed.torques.data_mut().chunks_exact_mut(3) {
            let own = [row[0], row[1], row[2]];
            row.iter_mut().zip(order).for_each(|(to, k)| *to = own[k]);
        }
        changed
    };
    for (order, says) in [
        ([2, 1, 0], "in reverse order"),
        ([2, 0, 1], "turned on (joint_1 in the column of joint_2)"),
        ([1, 0, 2], "of joint_1 and joint_2 exchanged"),
        ([0, 2, 1], "of joint_2 and joint_3 exchanged"),
    ] {
        let warnings = warned(&scene, &reordered(order));
        let [PipelineWarning::MixedColumns { order, .. }] = &warnings[..] else {
            panic!("{warnings:?}");
        };
        assert_eq!(order, says);
    }
    // Of torques of the robot on the object as well.
    let mut both = reordered([2, 1, 0]);
    both.torques.data_mut().iter_mut().for_each(|v| *v = -*v);
    let warnings = warned(&scene, &both);
    let [PipelineWarning::MixedColumns { order, .. }] = &warnings[..] else {
        panic!("{warnings:?}");
    };
    assert_eq!(order, "in reverse order");
}

/// Points that do not cover all that was touched.
#[test]
fn touches_of_nothing() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    let mut away = Sequence {
        id: "1".to_owned(),
        ..right.clone()
    };
    let angles = away.angles.data_mut().iter_mut();
    angles.step_by(3).for_each(|q| *q -= 1.0);
    let warned = |away: &Sequence| {
        let sequences = [&right, away];
        let traces: Vec<_> = (sequences.iter())
            .map(|s| scene.trace(s).unwrap())
            .collect();
        assert!(traces[0].contact_samples() > 0 && traces[1].contact_samples() == 0);
        reading_warnings(&scene, &sequences, &traces)
    };
    let warnings = warned(&away);
    let [PipelineWarning::NothingTouched { sequence, .. }] = &warnings[..] else {
        panic!("{warnings:?}");
    };
    assert_eq!(sequence, "1");
    assert!(
        warnings[0]
            .to_string()
            .contains("the points may not cover what was touched")
    );
    // Motion that feels little is none.
    away.torques.data_mut().iter_mut().for_each(|t| *t *= 0.1);
    assert_eq!(warned(&away), []);
}

/// Points that are elsewhere than what was touched: part of the touch is in the air.
#[test]
fn touches_beside_the_points() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch_along(&scene, &swing_of(200));
    let warned = |sequence: &Sequence| {
        let trace = scene.trace(sequence).unwrap();
        let free = trace.observations.iter().filter(|o| o.is_empty()).count();
        assert!(trace.contact_samples() > 16 && free > 16);
        reading_warnings(&scene, &[sequence], &[trace])
    };
    assert_eq!(warned(&right), []);
    // Readings of samples some way before.
    let mut early = right.clone();
    let joints = scene.robot().joint_count();
    early.torques.data_mut().rotate_left(20 * joints);
    let warnings = warned(&early);
    let [
        PipelineWarning::FeltOutside {
            share, sequence, ..
        },
    ] = &warnings[..]
    else {
        panic!("{warnings:?}");
    };
    assert!(*share > 0.05 && *share < 1.0 && sequence == "0", "{share}");
}

/// Rows of zeros where readings were lost; what begins and ends a touch is none.
#[test]
fn readings_that_were_lost() {
    let scene = scene(TorqueKind::External, 0);
    let warned = |sequence: &Sequence| {
        let trace = scene.trace(sequence).unwrap();
        reading_warnings(&scene, &[sequence], &[trace])
    };
    let mut sequence = touch_along(&scene, &swing_of(200));
    let free = scene.trace(&sequence).unwrap().observations;
    for (row, _) in free.iter().enumerate().filter(|(_, o)| o.is_empty()) {
        sequence.torques.data_mut()[3 * row..3 * row + 3].fill(0.0);
    }
    assert_eq!(warned(&sequence), []);
    for row in [95, 100, 101] {
        sequence.torques.data_mut()[3 * row..3 * row + 3].fill(0.0);
    }
    let warnings = warned(&sequence);
    let [
        PipelineWarning::LostReadings {
            row: 95, others: 2, ..
        },
    ] = &warnings[..]
    else {
        panic!("{warnings:?}");
    };
    // Where a touch begins, nothing was lost.
    sequence.touch_starts = vec![0, 95, 101];
    assert_eq!(warned(&sequence), []);
}

/// A log that writes every sample three times.
#[test]
fn samples_that_are_repeated() {
    let scene = scene(TorqueKind::External, 0);
    let once = touch_along(&scene, &swing_of(100));
    let thrice = |table: &Table| {
        let rows = table.iter().flat_map(|row| [row; 3].concat());
        Table::new(table.cols(), rows.collect()).unwrap()
    };
    let time = (0..300).map(|k| 0.01 * f64::from(k)).collect();
    let (angles, torques) = (thrice(&once.angles), thrice(&once.torques));
    let sequence = Sequence::new("0", time, angles, torques);
    let trace = scene.trace(&sequence).unwrap();
    let warnings = reading_warnings(&scene, &[&sequence], &[trace]);
    assert!(
        warnings.iter().any(|w| matches!(
            w,
            PipelineWarning::RepeatedSamples {
                count: 200,
                rows: 300,
                others: 0,
                ..
            }
        )),
        "{warnings:?}"
    );
}

/// Noise that readings cannot bear leaves them as they were.
#[test]
fn noise_without_bounds() {
    let before = [touch(&scene(TorqueKind::External, 0))];
    let mut after = before.clone();
    assert!(add_noise(&mut after, 1.7e308, 0).is_err());
    assert_eq!(after, before);
}

/// Readings that are rounded stay where they are as long as they change by less than a step: no sensor is frozen.
#[test]
fn readings_that_are_rounded() {
    let scene = scene(TorqueKind::External, 0);
    let exact = touch_along(&scene, &swing_of(400));
    for step in [0.05, 0.1, 0.2, 0.5] {
        let mut rounded = exact.clone();
        let readings = rounded.torques.data_mut().iter_mut();
        readings.for_each(|t| *t = (*t / step).round() * step);
        let trace = scene.trace(&rounded).unwrap();
        let warnings = reading_warnings(&scene, &[&rounded], &[trace]);
        let frozen = |w: &PipelineWarning| matches!(w, PipelineWarning::FrozenReadings { .. });
        assert!(!warnings.iter().any(frozen), "{step}: {warnings:?}");
    }
}

/// Offsets that nobody took off.
#[test]
fn readings_that_are_not_tared() {
    let (plain, tared) = (
        scene(TorqueKind::External, 0),
        scene(TorqueKind::External, 5),
    );
    // Of one joint, and of all of them.
    let mut all = touch(&plain);
    all.torques.data_mut().iter_mut().for_each(|v| *v += 30.0);
    let one = first_joint(&touch(&plain), |v| v + 30.0);
    for (readings, size) in [(one, 30.0), (all, 30.0 * 3f64.sqrt())] {
        let warnings = warned(&plain, &readings);
        let [PipelineWarning::NotTared { mean, offset, .. }] = &warnings[..] else {
            panic!("{warnings:?}");
        };
        assert!((mean - 30.0).abs() < 0.1 && (offset - size).abs() < 0.1);
        assert_eq!(warned(&tared, &readings), []);
    }
    // One of two fifths of what is felt in contact.
    let [PipelineWarning::NotTared { touch: felt, .. }] =
        warned(&plain, &first_joint(&touch(&plain), |v| v + 30.0))[..]
    else {
        panic!("an offset that is not told of");
    };
    let readings = first_joint(&touch(&plain), |v| v + 0.4 * felt);
    assert!(matches!(
        warned(&plain, &readings)[..],
        [PipelineWarning::NotTared { .. }]
    ));
    // A tenth of it, if it is the same all the time and long enough in the air.
    let long = |offset: &dyn Fn(usize) -> f64| {
        let swings = [swing_of(10 * ROWS)];
        let swings: Vec<&Sequence> = swings.iter().collect();
        let traces: Vec<_> = swings.iter().map(|s| plain.trace(s).unwrap()).collect();
        let mut readings = simulate(&plain, &[50.0; 100], &swings, &traces).unwrap();
        let rows = readings[0].torques.data_mut().chunks_exact_mut(3);
        rows.enumerate().for_each(|(k, row)| row[0] += offset(k));
        let trace = plain.trace(&readings[0]).unwrap();
        reading_warnings(&plain, &[&readings[0]], &[trace])
    };
    assert_eq!(long(&|_| 0.0), []);
    let [PipelineWarning::NotTared { touch: felt, .. }] = long(&|_| 30.0)[..] else {
        panic!("an offset that is not told of");
    };
    let constant = long(&|_| 0.1 * felt);
    assert!(
        matches!(constant[..], [PipelineWarning::NotTared { .. }]),
        "{constant:?}"
    );
    let drifting = long(&|k| 0.2 * felt * k as f64 / (10 * ROWS) as f64);
    let not_tared = |w: &PipelineWarning| matches!(w, PipelineWarning::NotTared { .. });
    assert!(!drifting.iter().any(not_tared), "{drifting:?}");
    // A small one is for the diagnosis.
    assert_eq!(
        warned(&plain, &first_joint(&touch(&plain), |v| v + 0.1)),
        []
    );
}

/// Friction that nobody models: as large one way as the other.
#[test]
fn friction_in_the_air() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    let of = |size: f64| {
        let mut rubbing = right.clone();
        let speeds = right.velocities.clone().unwrap();
        let rows = rubbing.torques.data_mut().chunks_exact_mut(3);
        rows.zip(speeds.iter())
            .for_each(|(t, qd)| t[0] -= size * qd[0].signum());
        warned(&scene, &rubbing)
    };
    assert_eq!(of(0.02), []);
    let warnings = of(30.0);
    let [PipelineWarning::FeltInAir { joint, size, .. }] = &warnings[..] else {
        panic!("{warnings:?}")
    };
    assert!(joint == "joint_1" && (size - 30.0).abs() < 3.0, "{size}");
}

/// A clock that counts milliseconds.
#[test]
fn time_in_milliseconds() {
    let scene = scene(TorqueKind::External, 0);
    let right = Sequence {
        velocities: None,
        ..swing()
    };
    assert_eq!(motion_warnings(scene.robot(), &[&right]), []);
    let slow = Sequence {
        time: right.time.iter().map(|t| 1000.0 * t).collect(),
        ..right.clone()
    };
    let warnings = motion_warnings(scene.robot(), &[&slow]);
    let [PipelineWarning::SlowClock { step, .. }] = &warnings[..] else {
        panic!("{warnings:?}");
    };
    assert!((step - 50.0).abs() < 1e-9);
    // Nor does it matter that one step is brisk.
    let mut brisk = slow.clone();
    brisk.angles.data_mut()[3 * ROWS - 3] += 0.15;
    assert!(matches!(
        motion_warnings(scene.robot(), &[&brisk])[..],
        [PipelineWarning::SlowClock { .. }]
    ));
    let fast = Sequence {
        time: right.time.iter().map(|t| 1e-3 * t).collect(),
        ..right.clone()
    };
    // That of the scene states no limits.
    let stage = vsf_robots::cartesian_stage(0.004).unwrap();
    let of = |sequence: &Sequence| motion_warnings(&stage, &[sequence]);
    let is_fast = |w: &PipelineWarning| matches!(w, PipelineWarning::FastClock { speed, limit, .. } if *speed > 3.0 * limit);
    assert!(of(&fast).iter().any(is_fast), "{:?}", of(&fast));
    assert!(!of(&right).iter().any(is_fast));
    // Nothing moves, whatever the clock.
    let mut still = slow.clone();
    still.angles.data_mut().fill(0.1);
    assert_eq!(motion_warnings(scene.robot(), &[&still]), []);
}

/// An encoder that stops.
#[test]
fn positions_that_stand_still() {
    let scene = scene(TorqueKind::External, 0);
    for from in [0, ROWS / 2] {
        let mut stuck = swing();
        let held = stuck.angles[from][0];
        let rows = stuck.angles.data_mut().chunks_exact_mut(3).skip(from);
        rows.for_each(|row| row[0] = held);
        let warnings = motion_warnings(scene.robot(), &[&stuck]);
        assert!(
            matches!(&warnings[..], [PipelineWarning::StillPositions { joint, others: 0 }] if joint == "joint_1"),
            "{warnings:?}"
        );
    }
}

#[test]
fn fields_that_explain_nothing() {
    let scene = scene(TorqueKind::External, 0);
    let traces = [scene.trace(&touch(&scene)).unwrap()];
    let told = |stiffness: f64| {
        let belief = Belief::new(vec![stiffness; 100], vec![1.0; 100]).unwrap();
        field_warnings(&belief, &traces)
    };
    assert_eq!(told(150.0), []);
    let warnings = told(0.5);
    assert!(
        matches!(warnings[..], [PipelineWarning::ExplainsNothing { share }] if (0.0..0.02).contains(&share)),
        "{warnings:?}"
    );
    assert_eq!(
        field_warnings(&Belief::uniform(0, 0.0, 1.0).unwrap(), &[]),
        []
    );
    let short = field_warnings(&Belief::uniform(9, 0.0, 1.0).unwrap(), &traces);
    assert!(matches!(short[..], [PipelineWarning::Malformed { .. }]));
}

/// One whose readings are of the other sign, among others.
#[test]
fn sequences_that_a_field_explains_nothing_of() {
    let scene = scene(TorqueKind::External, 0);
    let belief = Belief::new(vec![150.0; 100], vec![1.0; 100]).unwrap();
    let warnings = |factor: f64| {
        let other = Sequence {
            id: "1".to_owned(),
            torques: scaled(&touch(&scene).torques, factor),
            ..touch(&scene)
        };
        let right = scene.trace(&touch(&scene)).unwrap();
        let wrong = scene.trace(&other).unwrap();
        let mut traces = vec![right; 11];
        traces.push(wrong);
        field_warnings(&belief, &traces)
    };
    let told = warnings(-0.6);
    assert!(
        matches!(&told[..], [PipelineWarning::ExplainsNothingOf { sequence, others: 0, .. }] if sequence == "1"),
        "{told:?}"
    );
    assert_eq!(warnings(0.9), []);
    // Next to nothing was read in it.
    assert_eq!(warnings(-0.1), []);
}

/// Of actuators, which read what is right, on a rail that lifts a mass.
#[test]
fn masses_of_a_urdf_that_cannot_be() {
    let told = |mass: f64, read: f64| {
        let urdf = format!(
            r#"<robot name="lift"><link name="base"/><link name="tip"><inertial><mass value="{mass}"/>
            <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
            <joint name="j" type="prismatic"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
            <limit lower="-1" upper="1" effort="10" velocity="1"/></joint></robot>"#
        );
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("lift.urdf"), urdf).unwrap();
        let robot = RobotRef::resolve("lift.urdf", folder.path()).unwrap();
        let table = |of: &dyn Fn(f64) -> f64| {
            let data = (0..50).map(|k| of(f64::from(k) / 50.0)).collect();
            Table::new(1, data).unwrap()
        };
        let time = (0..50).map(|k| f64::from(k) / 50.0).collect();
        let sequence = Sequence::new("0", time, table(&|t| 0.1 * t), table(&|_| read));
        let dataset = Dataset {
            torque_kind: TorqueKind::Measured,
            ..Dataset::new(robot, vec![sequence.clone()])
        };
        let robot = robot_of(&dataset, &Default::default()).unwrap();
        let scene = Scene::in_air(&dataset, robot).unwrap();
        let traces = [scene.trace(&sequence).unwrap()];
        reading_warnings(&scene, &[&sequence], &traces)
    };
    let is_heavy = |w: &PipelineWarning| matches!(w, PipelineWarning::HeavyArm { .. });
    let is_strong = |w: &PipelineWarning| matches!(w, PipelineWarning::BeyondEffort { .. });
    let is_weightless = |w: &PipelineWarning| matches!(w, PipelineWarning::Weightless { .. });
    let count = |all: &[PipelineWarning], of: &dyn Fn(&PipelineWarning) -> bool| {
        all.iter().filter(|w| of(w)).count()
    };
    for (mass, read, expected) in [
        (0.5, 4.9, [0, 0, 0]),
        (500.0, 4.9, [1, 0, 0]),
        (0.5, 4900.0, [0, 1, 0]),
        (0.0, 4.9, [0, 0, 1]),
    ] {
        let all = told(mass, read);
        let found = [
            count(&all, &is_heavy),
            count(&all, &is_strong),
            count(&all, &is_weightless),
        ];
        assert_eq!(found, expected, "{mass} {read}: {all:?}");
    }
}

/// A payload that is not in the model weighs like the arm, but less.
#[test]
fn a_payload_is_no_gravity_left() {
    let (external, measured) = (
        scene(TorqueKind::External, 0),
        scene(TorqueKind::Measured, 0),
    );
    let gravity = touch(&measured);
    let loaded = Sequence {
        torques: scaled(&gravity.torques, 0.4),
        ..gravity
    };
    let warnings = warned(&external, &loaded);
    let left = |w: &PipelineWarning| matches!(w, PipelineWarning::GravityLeft { .. });
    assert!(!warnings.iter().any(left), "{warnings:?}");
}

/// What is right in most sequences hides what is wrong in one.
#[test]
fn one_sequence_of_the_other_sign() {
    let scene = scene(TorqueKind::Measured, 0);
    let right = touch(&scene);
    let of = |id: &str, reading: f64, speed: f64| Sequence {
        id: id.to_owned(),
        torques: scaled(&right.torques, reading),
        velocities: right.velocities.as_ref().map(|v| scaled(v, speed)),
        ..right.clone()
    };
    let told = |wrong: &Sequence| {
        let all = [
            of("a", 1.0, 1.0),
            of("b", 1.0, 1.0),
            wrong.clone(),
            of("d", 1.0, 1.0),
        ];
        let all: Vec<&Sequence> = all.iter().collect();
        let traces: Vec<_> = all.iter().map(|s| scene.trace(s).unwrap()).collect();
        let mut warnings = motion_warnings(scene.robot(), &all);
        warnings.extend(reading_warnings(&scene, &all, &traces));
        warnings
    };
    assert_eq!(told(&of("c", 1.0, 1.0)), []);
    for (wrong, is) in [
        (of("c", -1.0, 1.0), "2.00 times"),
        (of("c", 0.001, 1.0), "0.001"),
        (of("c", 1.0, -1.0), "velocities"),
    ] {
        let warnings = told(&wrong);
        let of_c = |w: &PipelineWarning| matches!(w, PipelineWarning::InSequence { sequence, .. } if sequence == "c");
        assert!(
            !warnings.is_empty() && warnings.iter().all(of_c),
            "{warnings:?}"
        );
        assert!(warnings[0].to_string().contains(is), "{warnings:?}");
    }
}

/// Nor does the field tell, of which the diagnosis knows nothing.
#[test]
fn one_sequence_of_another_unit_in_contact() {
    let scene = scene(TorqueKind::External, 0);
    let right = touch(&scene);
    let told = |factors: &[f64]| {
        let of = |(k, factor): (usize, &f64)| Sequence {
            id: k.to_string(),
            torques: scaled(&right.torques, *factor),
            ..right.clone()
        };
        let all: Vec<Sequence> = factors.iter().enumerate().map(of).collect();
        let traces: Vec<_> = all.iter().map(|s| scene.trace(s).unwrap()).collect();
        let all: Vec<&Sequence> = all.iter().collect();
        let warnings = reading_warnings(&scene, &all, &traces);
        let [warning] = &warnings[..] else {
            assert_eq!(warnings, [], "{factors:?}");
            return String::new();
        };
        warning.to_string()
    };
    // Ten times as stiff is another place, not another unit.
    for right in [&[1.0, 1.0, 1.0][..], &[1.0, 10.0, 0.1], &[1.0]] {
        assert_eq!(told(right), "");
    }
    for (wrong, is) in [
        (
            &[1.0, 1.0, 1e-3, 1.0][..],
            "sequence 2: torques in contact are 0.001 times",
        ),
        (
            &[1.0, 1e3, 1.0, 1e3, 1.0],
            "sequence 1: torques in contact are 1000.000 times",
        ),
        (&[1.0, 1e-3], "sequence 1: torques in contact are"),
        (
            &[1.0, -1.0, 1.0],
            "sequence 1: torques in contact are opposite",
        ),
        (&[-1.0, -1.0], "torques in contact are opposite"),
        (&[1e-9, 1e-9], "no sensor resolves"),
    ] {
        assert!(told(wrong).contains(is), "{}", told(wrong));
    }
    assert!(told(&[1.0, 1e3, 1.0, 1e3, 1.0]).contains("1 more sequence"));
}

#[test]
fn velocities_of_another_unit() {
    let (scene, right) = (scene(TorqueKind::External, 0), swing());
    let robot = scene.robot();
    assert_eq!(motion_warnings(robot, &[&right]), []);
    let velocities = |factor: f64| Sequence {
        velocities: right.velocities.as_ref().map(|v| scaled(v, factor)),
        ..right.clone()
    };
    let in_ms = Sequence {
        time: right.time.iter().map(|t| 1e3 * t).collect(),
        ..right.clone()
    };
    for (sequence, expected, cause) in [
        (velocities(1f64.to_degrees()), 57.3, "degrees a second"),
        (in_ms, 1e3, "milliseconds"),
        (velocities(1e-3), 1e-3, "millisecond"),
        (velocities(2e3), 2e3, "unit and order"),
        (velocities(-1.0), -1.0, "sign"),
        (velocities(0.0), 0.0, "unit and order"),
    ] {
        let warnings = motion_warnings(robot, &[&sequence]);
        let [
            PipelineWarning::Velocities {
                factor, others: 1, ..
            },
        ] = &warnings[..]
        else {
            panic!("{expected}: {warnings:?}");
        };
        assert!(
            (factor - expected).abs() <= 0.01 * f64::abs(expected),
            "{factor}"
        );
        let text = warnings[0].to_string();
        assert!(
            text.contains(cause) && text.contains("1 more joint"),
            "{text}"
        );
    }
}

#[test]
fn samples_that_are_missing() {
    let scene = scene(TorqueKind::External, 0);
    let whole = swing();
    let keep: Vec<usize> = (0..ROWS).filter(|k| !(20..32).contains(k)).collect();
    let rows = |table: &Table| {
        let rows: Vec<f64> = keep.iter().flat_map(|k| table[*k].to_vec()).collect();
        Table::new(3, rows).unwrap()
    };
    let mut thinned = Sequence::new(
        "0",
        keep.iter().map(|k| whole.time[*k]).collect(),
        rows(&whole.angles),
        rows(&whole.torques),
    );
    let warned = |s: &Sequence| motion_warnings(scene.robot(), &[s]);
    let [gap @ PipelineWarning::TimeGap { row: 20, .. }] = &warned(&thinned)[..] else {
        panic!("{:?}", warned(&thinned));
    };
    let text = "sequence 0 row 20 comes 0.650 s after the row before, others 0.050 s";
    assert!(gap.to_string().starts_with(text), "{gap}");
    thinned.touch_starts = vec![0, 20];
    assert_eq!(warned(&thinned), []);
}

/// Where a recording goes from one touch to the next, the arm jumps.
#[test]
fn jumps_between_touches_are_no_moves() {
    let scene = scene(TorqueKind::External, 0);
    let robot = scene.robot();
    let mut sequence = swing();
    let jump = 3 * ROWS / 2;
    sequence.angles.data_mut()[jump / 3 * 3..]
        .iter_mut()
        .for_each(|q| *q += 1.0);
    sequence.touch_starts = vec![0, jump / 3];
    assert_eq!(motion_warnings(robot, &[&sequence]), []);
}

#[test]
fn touches_that_begin_inside_of_the_object() {
    let scene = scene(TorqueKind::External, 0);
    let mut sequence = swing();
    assert_eq!(touch_warnings(&scene, &[&sequence]), []);
    // Where the arm barely touches, as held at the end of a touch; deepest in the middle.
    let deepest = ROWS / 2;
    let traces = scene.trace(&sequence).unwrap();
    let first = traces.observations.iter().position(|o| !o.is_empty());
    sequence.touch_starts = vec![0, first.unwrap()];
    assert_eq!(touch_warnings(&scene, &[&sequence]), []);
    sequence.touch_starts = vec![0, deepest];
    let [
        warning @ PipelineWarning::StartsInside {
            row, depth, others, ..
        },
    ] = &touch_warnings(&scene, &[&sequence, &sequence])[..]
    else {
        panic!()
    };
    assert_eq!((*row, *others), (deepest, 1));
    assert!((0.017..0.03).contains(depth), "{depth}");
    let text = warning.to_string();
    assert!(text.contains("in 1 more touch"), "{text}");
    sequence.angles.data_mut()[0] = f64::NAN;
    assert!(matches!(
        touch_warnings(&scene, &[&sequence])[..],
        [PipelineWarning::Malformed { .. }]
    ));
}

/// A tip that is not much wider than cells are: sub-points go to all of its sides, and their means hardly anywhere.
#[test]
fn touches_that_begin_with_a_small_tip_inside() {
    let bed = (0..3072).map(|i| {
        let at = |k: i32, from: i32| 0.006 * f64::from(k - from);
        Point3::new(at(i % 16, 8), at(i / 16 % 16, 8), at(i / 256, 11))
    });
    for subdivision in [1, 2, 3] {
        let options = SceneOptions {
            subdivision,
            ..SceneOptions::default()
        };
        let robot = vsf_robots::cartesian_stage(0.012).unwrap();
        let scene = Scene::new(robot, bed.clone().collect(), &options).unwrap();
        let warned = |depth: f64| {
            let row = Table::new(3, vec![0.0, 0.0, -depth]).unwrap();
            let still = Table::new(3, vec![0.0; 3]).unwrap();
            let sequence = Sequence::new("0", vec![0.0], row, still);
            touch_warnings(&scene, &[&sequence])
        };
        assert_eq!(warned(0.003), [], "{subdivision}");
        for depth in [0.014, 0.02] {
            let warnings = warned(depth);
            let [PipelineWarning::StartsInside { .. }] = &warnings[..] else {
                panic!("{subdivision}: {warnings:?}");
            };
        }
    }
}

#[test]
fn fields_that_miss_what_they_have_learned_from() {
    let scene = scene(TorqueKind::External, 0);
    let traces = [scene.trace(&touch(&scene)).unwrap()];
    let truth: Vec<f64> = (0..100).map(|i| 50.0 * f64::from(i % 7)).collect();
    let belief = |mean: &[f64]| Belief::new(mean.to_vec(), vec![1.0; mean.len()]).unwrap();
    // Readings have a noise of 0.02 N m.
    let ratio = |sd: f64| match &fit_warnings(&belief(&truth), &[sd; 3], &traces)[..] {
        [] => None,
        [PipelineWarning::Misfit { ratio }] => Some(*ratio),
        other => panic!("{other:?}"),
    };
    assert_eq!((ratio(0.02), ratio(0.004)), (None, None));
    assert!((50.0..200.0).contains(&ratio(0.002).unwrap()));
    let short = fit_warnings(&belief(&truth[..9]), &[1.0; 3], &traces);
    assert!(matches!(short[..], [PipelineWarning::Malformed { .. }]));
}

#[test]
fn estimators_that_are_far_too_sure() {
    let after = |ratio: f64| {
        let mut health = FilterHealth::default();
        for _ in 0..10 {
            health.record(&UpdateReport {
                dof: 7,
                nis: 7.0 * ratio,
                ..UpdateReport::default()
            });
        }
        health_warnings(&health)
    };
    assert_eq!(health_warnings(&FilterHealth::default()), []);
    assert_eq!(after(3.0), []);
    let warnings = after(400.0);
    assert!(
        matches!(warnings[..], [PipelineWarning::Overconfident { ratio }] if (ratio - 400.0).abs() < 1e-9)
    );
    assert!(warnings[0].to_string().contains("larger noise sd"));
}
