use crate::bench::{JOINTS, Push, quantiles};
use crate::{FilterSpec, PipelineError, ProcessMemory};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::Serialize;
use std::f64::consts::TAU;
use std::thread::sleep;
use std::time::{Duration, Instant};
use vsf_core::{Belief, CoreError};

/// Options of [`soak()`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoakOptions {
    /// Number of rest points in a cube of 0.33 m, default 100,000. It is rounded to a cube number.
    pub points: usize,
    /// The estimator, default [`FilterSpec::replay`].
    pub estimator: FilterSpec,
    /// Duration of the run (s), default 60, more than 0.
    pub seconds: f64,
}

impl Default for SoakOptions {
    fn default() -> Self {
        Self {
            points: 100_000,
            estimator: FilterSpec::replay(),
            seconds: 60.0,
        }
    }
}

/// One tenth of the run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SoakTenth {
    /// Number of steps in it.
    pub steps: usize,
    /// Largest number of contacts in a step.
    pub contacts: usize,
    /// Median of the step (ms).
    pub median_ms: f64,
    /// 99th percentile of the step (ms).
    pub p99_ms: f64,
    /// The longest step (ms).
    pub max_ms: f64,
    /// Resident memory of the process at its end (MB), if the system reports it.
    pub resident_mb: Option<f64>,
}

/// Performance of an online estimation over time, in `f32`, on one thread.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SoakReport {
    /// Rest points.
    pub points: usize,
    /// Samples due per second.
    pub rate_hz: f64,
    /// Number of steps of the run.
    pub steps: usize,
    /// Number of steps that had not ended when the next sample was due.
    pub late: usize,
    /// Resident memory of the process before the first step (MB), if the system reports it. The buffer of
    /// past observations for replays comes on top, up to [`vsf_filter::ReplayConfig::byte_budget`].
    pub resident_start_mb: Option<f64>,
    /// Resident memory of the process after the last step (MB), if the system reports it.
    pub resident_end_mb: Option<f64>,
    /// The run in ten parts of equal time.
    pub tenths: Vec<SoakTenth>,
}

const RATE_HZ: f64 = 1000.0;
/// One push and the way back (s).
const PERIOD: f64 = 20.0;
const NOISE_SD: f64 = 0.05;
/// Longest run (s).
const LONGEST: f64 = 1e9;
/// Half of the points have one of these, half the other (N/m).
const TRUTH: [f32; 2] = [10.0, 30.0];

/// Runs an online estimation at 1 kHz for a given time. A Kinova Gen3 repeatedly pushes slowly into a cube
/// of points of known stiffness and back, and learns from noisy torques. Needs no data.
///
/// # Errors
/// No points or more than [`RestPoints`](vsf_core::RestPoints) holds, or a time that is not positive or
/// beyond 1e9 s.
pub fn soak(options: &SoakOptions) -> Result<SoakReport, PipelineError> {
    let side = (options.points as f64).cbrt().round() as usize;
    if side == 0 {
        return Err(PipelineError::NoPoints);
    }
    let is_long = options.seconds <= LONGEST;
    let duration = Duration::try_from_secs_f64(options.seconds).unwrap_or_default();
    if duration.is_zero() || !is_long {
        let what = CoreError::Parameter {
            name: "seconds",
            value: options.seconds,
            range: "> 0 s, up to 1e9 s",
        };
        return Err(what.into());
    }
    let mut push = Push::new(side, 2)?;
    let points = push.rest.len();
    let truth: Vec<f32> = (0..points).map(|i| TRUTH[2 * i / points]).collect();
    let prior = Belief::<f64>::uniform(points, 0.0, 30.0)?;
    let mut estimator = options.estimator.build::<f32>(prior.into(), None)?;
    let mut buffers = push.buffers::<f32>();
    let mut rng = Pcg64Mcg::seed_from_u64(0);
    // A reading comes one sample late.
    let (mut torques, mut reading) = ([0.0f32; JOINTS], [0.0; JOINTS]);

    let resident_start_mb = resident_mb();
    let (mut steps, mut late) = (0, 0);
    let mut tenths = Vec::with_capacity(10);
    let mut times = Vec::new();
    let clock = Instant::now();
    for part in 1..=10 {
        let mut contacts = 0;
        times.clear();
        while clock.elapsed() < duration / 10 * part {
            let t = steps as f64 / RATE_HZ;
            if let Some(early) = Duration::from_secs_f64(t).checked_sub(clock.elapsed()) {
                sleep(early);
            }
            let share = 0.5 - 0.5 * (TAU * t / PERIOD).cos();
            let step = push.step(share, &reading, &mut *estimator, &mut buffers)?;
            late += usize::from(clock.elapsed().as_secs_f64() > t + 1.0 / RATE_HZ);
            steps += 1;
            times.push(step.total());
            contacts = step.contacts.max(contacts);
            buffers.obs.apply(&truth, &mut torques);
            reading = torques.map(|tau| {
                let noise: f64 = StandardNormal.sample(&mut rng);
                f64::from(tau) + NOISE_SD * noise
            });
        }
        let quantiles = quantiles(times.iter().copied());
        tenths.push(SoakTenth {
            steps: times.len(),
            contacts,
            median_ms: quantiles.median_ms,
            p99_ms: quantiles.p99_ms,
            max_ms: times.iter().copied().fold(0.0, f64::max),
            resident_mb: resident_mb(),
        });
    }
    Ok(SoakReport {
        points,
        rate_hz: RATE_HZ,
        steps,
        late,
        resident_start_mb,
        resident_end_mb: resident_mb(),
        tenths,
    })
}

fn resident_mb() -> Option<f64> {
    Some(ProcessMemory::now()?.resident_mb)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_step_is_counted_once() {
        let options = SoakOptions {
            points: 1000,
            seconds: 0.3,
            ..SoakOptions::default()
        };
        let report = soak(&options).unwrap();
        assert_eq!(report.points, 1000);
        assert!(report.steps > 0 && report.late <= report.steps);
        let in_tenths: usize = report.tenths.iter().map(|t| t.steps).sum();
        assert_eq!(in_tenths, report.steps);
        assert_eq!(report.tenths.len(), 10);
        for t in &report.tenths {
            assert!(t.median_ms <= t.p99_ms && t.p99_ms <= t.max_ms);
        }
        if cfg!(target_os = "linux") {
            assert!(report.resident_end_mb.unwrap() > 1.0);
        }
    }

    #[test]
    fn what_cannot_run_is_refused() {
        for (points, seconds) in [
            (0, 1.0),
            (8, 0.0),
            (8, -1.0),
            (8, f64::NAN),
            (8, f64::INFINITY),
        ] {
            let options = SoakOptions {
                points,
                seconds,
                ..SoakOptions::default()
            };
            assert!(soak(&options).is_err(), "{options:?}");
        }
    }
}
