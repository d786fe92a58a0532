use crate::bench::{Push, Step};
use crate::{FilterSpec, PipelineError};
use serde::Serialize;
use vsf_core::Belief;
use vsf_filter::{DiagonalForm, DualConfig, Projection, ReplayConfig};

/// Rest points along each edge of the cube, and steps of the push into it: about 1.1 mm each, 4100
/// contacts at the end.
const SIDE: usize = 46;
const STEPS: usize = 150;
/// Number of groups of updates with similarly many contacts.
const GROUPS: usize = 12;

/// Time of one estimator's update against the number of contacts (a curve of Fig. 4).
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct UpdateTimes {
    /// What is timed: `contact`, or an estimator.
    pub stage: &'static str,
    /// Times, by number of contacts.
    pub times: Vec<UpdateTime>,
}

/// Times of updates with a similar number of contacts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct UpdateTime {
    /// Mean number of contacts.
    pub contacts: f64,
    /// Median (ms).
    pub median_ms: f64,
    /// First quartile (ms).
    pub low_ms: f64,
    /// Third quartile (ms).
    pub high_ms: f64,
}

/// Times the updates of several filters and the contact model while a Kinova Gen3 pushes 16 cm into a cube
/// of 97,336 points.
///
/// The filters are the diagonal one, with and without 20 replays, the dual one, and the dense (exact) one,
/// in `f32`. The dense filter may use the threads of the rayon pool, the others use one. It needs no
/// recording: those of plants have too few contacts.
///
/// # Errors
/// None with the built-in robot.
pub fn update_times() -> Result<Vec<UpdateTimes>, PipelineError> {
    let mut push = Push::new(SIDE, STEPS)?;
    let prior = Belief::<f64>::uniform(push.rest.len(), 0.0, 0.1)?;
    let diagonal = FilterSpec::Replay {
        form: DiagonalForm::default(),
        config: ReplayConfig {
            replays: 0,
            ..ReplayConfig::default()
        },
    };
    let filters = [
        ("diagonal", diagonal),
        ("diagonal, 20 replays", FilterSpec::replay()),
        ("dual, 20 replays", FilterSpec::Dual(DualConfig::default())),
        ("dense", FilterSpec::Exact(Projection::default())),
    ];
    let build = |filter: FilterSpec| filter.build::<f32>(prior.clone().into(), None);
    // Buffers and caches of contact warm up.
    push.run(&mut *build(diagonal)?)?;
    let mut found = Vec::new();
    for (name, filter) in filters {
        let mut estimator = build(filter)?;
        let steps = push.run(&mut *estimator)?;
        if found.is_empty() {
            found.push(times("contact", &steps, |s| s.ms[1]));
        }
        found.push(times(name, &steps, |s| s.ms[3]));
    }
    Ok(found)
}

fn times(stage: &'static str, steps: &[Step], of: impl Fn(&Step) -> f64) -> UpdateTimes {
    let mut steps: Vec<&Step> = steps.iter().filter(|s| s.contacts > 0).collect();
    steps.sort_by_key(|s| s.contacts);
    let group = |steps: &[&Step]| {
        let mut ms: Vec<f64> = steps.iter().map(|s| of(s)).collect();
        ms.sort_by(f64::total_cmp);
        let at = |share: f64| ms[(share * (ms.len() - 1) as f64).round() as usize];
        let contacts: usize = steps.iter().map(|s| s.contacts).sum();
        UpdateTime {
            contacts: contacts as f64 / steps.len() as f64,
            median_ms: at(0.5),
            low_ms: at(0.25),
            high_ms: at(0.75),
        }
    };
    let size = steps.len().div_ceil(GROUPS).max(1);
    UpdateTimes {
        stage,
        times: steps.chunks(size).map(group).collect(),
    }
}
