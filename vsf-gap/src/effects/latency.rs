use crate::GapError;
use crate::effect::{Acts, Compensator, Effect, Need, Parameter, Probe, Sample, Site, check};
use std::collections::VecDeque;
use std::sync::Arc;
use vsf_robots::RobotModel;

/// Readings that come late: the reading at time `t` belongs to posture and motion at `t - delta`.
///
/// One parameter, `delta` (s). Motion between samples is interpolated linearly, for continuous joints along the shorter way
/// round. Before the first sample of a touch, the motion is taken to be that of the first sample. Tell-tale: a lag by the
/// same time at every speed, also of the arm's weight in free motion. A viscous object leads instead.
///
/// # Reference
/// P. Furgale, J. Rehder, R. Siegwart, "Unified temporal and spatial calibration for multi-sensor
/// systems", IROS 2013, doi:10.1109/IROS.2013.6696514.
#[derive(Debug, Clone, Copy)]
pub struct Latency;

#[derive(Clone)]
struct Delay {
    robot: Arc<RobotModel>,
    delta: f64,
    clock: f64,
    /// Times of the samples kept (s), oldest first.
    times: VecDeque<f64>,
    /// Positions, velocities and accelerations at these times, one after the other.
    kept: VecDeque<f64>,
    /// Positions, velocities and accelerations at the wanted time.
    then: Vec<f64>,
}

impl Effect for Latency {
    fn name(&self) -> &str {
        "latency"
    }

    fn summary(&self) -> &str {
        "torques are read late by `delta`"
    }

    fn acts(&self) -> Acts {
        Acts::Contact
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn response(&self, probe: Probe) -> Option<&str> {
        matches!(probe, Probe::TouchFaster | Probe::MoveInAir).then_some(self.name())
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        vec![Parameter::amplitude("delta", "s", [0.0, 0.5], 0.05)]
    }

    fn compensator(&self, site: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        check(self.name(), theta, 1)?;
        Ok(Box::new(Delay {
            robot: site.robot.clone(),
            delta: theta[0],
            clock: 0.0,
            times: VecDeque::new(),
            kept: VecDeque::new(),
            then: vec![0.0; 3 * site.joints()],
        }))
    }
}

impl Compensator for Delay {
    fn begin_touch(&mut self) {
        self.times.clear();
        self.kept.clear();
        self.clock = 0.0;
    }

    fn joints(&mut self, sample: &Sample<'_>, q: &mut [f64]) {
        if self.delta <= 0.0 {
            return;
        }
        self.clock += sample.dt;
        self.times.push_back(self.clock);
        self.kept
            .extend(q.iter().chain(sample.qd).chain(sample.qdd));
        let wanted = self.clock - self.delta;
        // Keep one sample at or before the wanted time.
        while self.times.get(1).is_some_and(|t| *t <= wanted) {
            self.times.pop_front();
            self.kept.drain(..self.then.len());
        }
        let (t0, t1) = (self.times[0], self.times.get(1).copied());
        let share = t1.map_or(0.0, |t1| ((wanted - t0) / (t1 - t0)).clamp(0.0, 1.0));
        let width = self.then.len();
        for (j, x) in self.then.iter_mut().enumerate() {
            let from = self.kept[j];
            let to = *self.kept.get(j + width).unwrap_or(&from);
            let change = match self.robot.joints().get(j) {
                Some(joint) => joint.change(from, to),
                None => to - from,
            };
            *x = from + change * share;
        }
        q.copy_from_slice(&self.then[..q.len()]);
    }

    fn motion(&mut self, _: &Sample<'_>, qd: &mut [f64], qdd: &mut [f64]) {
        if self.delta > 0.0 {
            let d = qd.len();
            qd.copy_from_slice(&self.then[d..2 * d]);
            qdd.copy_from_slice(&self.then[2 * d..]);
        }
    }
}
