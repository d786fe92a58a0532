use std::f64::consts::PI;
use vsf_contact::ContactConfig;
use vsf_core::nalgebra::Vector3;
use vsf_core::{Contacts, Posture};
use vsf_gap::{Compensator, Sample, Site, Touch};
use vsf_robots::JointKind;

/// Samples of a touch, and of the part of it in contact.
const TOUCH: usize = 30;
const CONTACT: std::ops::Range<usize> = 6..24;
/// Time between samples (s).
const DT: f64 = 0.02;
/// Most points that are touched.
const TOUCHED: usize = 6;

/// A sample, and what is touched at it.
struct Row {
    clock: f64,
    dt: f64,
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
    reading: Vec<f64>,
    load: Vec<f64>,
    force_W: Vector3<f64>,
    /// Posture at the recorded positions, so that every method is tested on its own.
    posture: Posture,
    contacts: Contacts,
}

/// Changes by previous effects; 0 and 1 if there are none.
#[derive(Clone, Copy)]
pub(super) struct Others {
    /// Added to positions, velocities and accelerations.
    pub motion: f64,
    /// Factor of the springs.
    pub springs: f64,
    /// Factor of the gains.
    pub gains: f64,
    /// Added to the torques.
    pub torques: f64,
}

impl Others {
    pub const NONE: Self = Self {
        motion: 0.0,
        springs: 1.0,
        gains: 1.0,
        torques: 0.0,
    };
    pub const SOME: Self = Self {
        motion: 0.1,
        springs: 0.7,
        gains: 1.5,
        torques: 0.3,
    };
}

/// Output of a compensator for all samples, method by method.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Done {
    pub motion: Vec<f64>,
    pub shift: Vec<f64>,
    pub contact: ContactConfig,
    pub springs: Vec<f64>,
    pub gains: Vec<f64>,
    pub torques: Vec<f64>,
}

impl Done {
    /// All numbers, by kind.
    pub fn parts(&self) -> [(&'static str, Vec<f64>); 6] {
        let c = &self.contact;
        let contact = [
            c.threshold,
            c.friction,
            c.slip_step,
            f64::from(c.max_slip_iterations),
            c.padding,
            c.adhesion,
        ];
        [
            ("joints and motion", self.motion.clone()),
            ("object_shift", self.shift.clone()),
            ("contact", contact.to_vec()),
            ("springs", self.springs.clone()),
            ("gains", self.gains.clone()),
            ("torques", self.torques.clone()),
        ]
    }
}

/// Share of a touch from which on a point is pulled, and by how much (m).
const STICKS: f64 = 0.85;
const PULLED: f64 = 0.001;

/// Two touches in every sequence of a site, or in one sequence if it names none.
pub(super) struct Drive<'a> {
    site: &'a Site,
    /// Rows of each touch, by the name of its sequence.
    touches: Vec<(String, Vec<Row>)>,
}

impl<'a> Drive<'a> {
    pub fn new(site: &'a Site) -> Self {
        let mut names: Vec<String> = site.sequences.iter().take(2).cloned().collect();
        if names.is_empty() {
            names.push("1".to_owned());
        }
        let twice = names.into_iter().flat_map(|name| [name.clone(), name]);
        let touch = |(k, name)| (name, (0..TOUCH).map(|row| make(site, k, row)).collect());
        Self {
            site,
            touches: twice.enumerate().map(touch).collect(),
        }
    }

    /// Runs a compensator over all samples, after `others`.
    pub fn run(&self, c: &mut dyn Compensator, others: Others) -> Done {
        let d = self.site.joints();
        let mut done = Done {
            motion: Vec::new(),
            shift: Vec::new(),
            contact: ContactConfig::default(),
            springs: Vec::new(),
            gains: Vec::new(),
            torques: Vec::new(),
        };
        c.contact(&mut done.contact);
        let mut before = None;
        for (name, rows) in &self.touches {
            if before != Some(name) {
                c.begin_sequence(name);
                before = Some(name);
            }
            c.begin_touch();
            for row in rows {
                let sample = row.sample();
                let moved = |x: &[f64]| x.iter().map(|v| v + others.motion).collect();
                let [mut q, mut qd, mut qdd]: [Vec<f64>; 3] =
                    [&row.q, &row.qd, &row.qdd].map(|x| moved(x));
                c.joints(&sample, &mut q);
                c.motion(&sample, &mut qd, &mut qdd);
                done.shift.extend(c.object_shift(&sample).iter());
                let touch = Touch {
                    rest: &self.site.rest,
                    posture: &row.posture,
                    contacts: &row.contacts,
                };
                let displacements = row.contacts.displacements().iter();
                let mut springs: Vec<_> = displacements.map(|u| u * others.springs).collect();
                let mut gains = vec![others.gains; d];
                let mut torques: Vec<f64> = (1..=d).map(|j| others.torques * j as f64).collect();
                c.springs(&sample, &touch, &mut springs);
                c.gains(&sample, &touch, &mut gains);
                c.torques(&sample, &touch, &mut torques);
                [q, qd, qdd].iter().for_each(|x| done.motion.extend(x));
                (springs.iter()).for_each(|s| done.springs.extend(s.iter()));
                done.gains.extend(gains);
                done.torques.extend(torques);
            }
        }
        done
    }
}

impl Row {
    fn sample(&self) -> Sample<'_> {
        Sample {
            clock: self.clock,
            dt: self.dt,
            q: &self.q,
            qd: &self.qd,
            qdd: &self.qdd,
            reading: &self.reading,
            load: &self.load,
            force_W: self.force_W,
        }
    }
}

/// A row of a touch. Joints swing, points are pressed down and dragged aside (deeper the second time), and one is pulled at
/// the end.
fn make(site: &Site, touch: usize, row: usize) -> Row {
    let t = DT * row as f64;
    let joints = || site.robot.joints().iter().enumerate();
    let swing = |order: i32| -> Vec<f64> {
        let one = |(j, joint): (usize, &vsf_robots::Joint)| {
            let size = match joint.kind() {
                JointKind::Prismatic => 0.05,
                JointKind::Revolute | JointKind::Continuous => 0.5,
            };
            let (w, phase) = (4.0 + 1.3 * j as f64, 0.9 * j as f64 + 0.4 * touch as f64);
            size * w.powi(order) * (w * t + phase + 0.5 * PI * f64::from(order)).sin()
        };
        joints().map(one).collect()
    };
    let wave = |size: f64, w: f64| -> Vec<f64> {
        let one = |j: usize| size * (w * t + 0.8 * j as f64 + 0.3 * touch as f64).sin();
        (0..site.joints()).map(one).collect()
    };
    let mut contacts = Contacts::new();
    let pressed = if CONTACT.contains(&row) {
        ((row - CONTACT.start) as f64 + 0.5) / CONTACT.len() as f64
    } else {
        0.0
    };
    let link = site.robot.last_link();
    if pressed > 0.0 {
        let depth = (0.02 + 0.01 * (touch % 2) as f64) * (PI * pressed).sin();
        for p in 0..site.rest.len().min(TOUCHED) {
            let aside = 0.004 * (2.0 * PI * pressed + p as f64).sin();
            // The first one sticks to the link as that leaves.
            let down = if p == 0 && pressed > STICKS {
                -PULLED
            } else {
                depth
            };
            let u_W = Vector3::new(aside, 0.3 * aside, -down * (1.0 + 0.1 * p as f64));
            let pushed = contacts.push(p as u32, link as u32, u_W, -Vector3::z());
            pushed.expect("contacts in order");
        }
    }
    let force_W = if contacts.is_empty() {
        Vector3::zeros()
    } else {
        Vector3::new(0.5 * (9.0 * t).cos(), 0.2, 4.0 * pressed)
    };
    let (q, mut posture) = (swing(0), site.robot.posture());
    let placed = site.robot.update_posture(&q, &mut posture);
    placed.expect("positions of the robot");
    Row {
        // Touches follow one another after a pause.
        clock: (DT * TOUCH as f64 + 0.5) * touch as f64 + t,
        dt: if row > 0 { DT } else { 0.0 },
        q,
        qd: swing(1),
        qdd: swing(2),
        reading: wave(3.0, 5.0),
        load: wave(8.0, 3.0),
        force_W,
        posture,
        contacts,
    }
}
