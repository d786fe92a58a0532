use crate::estimate::touched_points;
use crate::evaluate::mean_error;
use crate::{
    EstimatorSpec, Experiment, FilterSpec, Hyper, PipelineError, Scene, Trace, estimate,
    estimate_online, evaluate,
};
use serde::Serialize;
use std::time::Instant;
use vsf_core::{Belief, Noise};
use vsf_filter::{DiagonalForm, DualConfig, Projection, ReplayConfig};

/// One estimator on one recording: a cell of Table I.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Table1Cell {
    /// `replay 0`, `replay 10`, `replay 20`, `dual 20`, `exact` or `batch`.
    pub estimator: String,
    /// The error of the paper: mean error over the samples of a train sequence, predicted by the field at
    /// the end of that sequence; averaged over the sequences. `batch` uses the field of all sequences.
    pub fit_error: f64,
    /// Standard deviation of that error over the sequences.
    pub fit_sd: f64,
    /// Mean error over the samples of the test sequences.
    pub test_error: f64,
    /// Standard deviation of that error over the samples.
    pub test_sd: f64,
    /// Samples per second, including those in the air, for contact and estimator together, on one thread
    /// (`exact` uses the threads of the rayon pool). `None` for `batch`, which is not recursive.
    pub rate_hz: Option<f64>,
}

/// One recording: a row of Table I.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Table1Row {
    /// Name of the recording.
    pub recording: String,
    /// Unit of the errors.
    pub unit: String,
    /// Mean number of contacts over the train samples in contact.
    pub mean_contacts: f64,
    /// Number of points that the train sequences touch.
    pub touched_points: usize,
    /// Prior and noise of all estimators.
    pub hyper: Hyper,
    /// Error of predicting zero torque on the test sequences.
    pub zero_error: f64,
    /// One cell per estimator.
    pub cells: Vec<Table1Cell>,
}

/// Compares estimation with and without memory replay, the exact posterior and the constrained optimum
/// (Table I). All use the same prior and noise, chosen from the train sequences.
///
/// # Errors
/// Train sequences that touch nothing, or failures of an estimator.
pub fn table1(experiment: &Experiment) -> Result<Table1Row, PipelineError> {
    let (scene, hyper) = (experiment.scene(), experiment.hyper()?);
    let (train, test) = (experiment.train_traces(), experiment.test_traces());
    let clock = Instant::now();
    for sequence in &experiment.train {
        scene.trace(sequence)?;
    }
    let samples: usize = train.iter().map(|t| t.observations.len()).sum();
    let contact_seconds = clock.elapsed().as_secs_f64() / samples.max(1) as f64;
    let run = Run {
        scene,
        train,
        test,
        hyper,
        contact_seconds,
    };
    let mut cells = Vec::new();
    for replays in [0, 10, 20] {
        let spec = FilterSpec::Replay {
            form: DiagonalForm::default(),
            config: ReplayConfig {
                replays,
                ..ReplayConfig::default()
            },
        };
        cells.push(run.online(format!("replay {replays}"), spec)?);
    }
    cells.push(run.online(
        "dual 20".to_owned(),
        FilterSpec::Dual(DualConfig::default()),
    )?);
    cells.push(run.online("exact".to_owned(), FilterSpec::Exact(Projection::default()))?);
    cells.push(run.batch()?);
    let zero = Belief::uniform(scene.rest().len(), 0.0, 1.0)?;
    let contacts: f64 = train.iter().map(Trace::mean_contacts).sum();
    Ok(Table1Row {
        recording: experiment.name.to_owned(),
        unit: scene.error_unit().to_owned(),
        mean_contacts: contacts / train.len() as f64,
        touched_points: touched_points(train, scene.rest().len())
            .iter()
            .filter(|t| **t)
            .count(),
        zero_error: evaluate(scene, &zero, test)?.mean_error,
        hyper: hyper.clone(),
        cells,
    })
}

struct Run<'a> {
    scene: &'a Scene,
    train: &'a [Trace],
    test: &'a [Trace],
    hyper: &'a Hyper,
    contact_seconds: f64,
}

impl Run<'_> {
    fn online(&self, name: String, filter: FilterSpec) -> Result<Table1Cell, PipelineError> {
        let prior = self
            .hyper
            .shape
            .prior(self.scene.rest(), self.hyper.prior_sd)?;
        let noise = Noise::per_channel(&self.hyper.noise_sd)?;
        let mut estimator = filter.build::<f64>(prior, None)?;
        let (mut fits, mut seconds, mut updates) = (Vec::new(), 0.0, 0usize);
        for trace in self.train {
            // Copied before the clock runs: on the robot noise comes with the readings.
            let trace = trace.with_noise(&noise)?;
            let clock = Instant::now();
            estimate_online(&mut *estimator, &trace, None, |_, _| {})?;
            seconds += clock.elapsed().as_secs_f64();
            updates += trace.observations.len();
            fits.push(mean_error(estimator.belief().mean(), [&trace]));
        }
        let step = self.contact_seconds + seconds / updates.max(1) as f64;
        self.cell(name, &fits, &estimator.field()?, Some(1.0 / step))
    }

    fn batch(&self) -> Result<Table1Cell, PipelineError> {
        let scene = self.scene;
        let field = estimate(
            scene.rest(),
            self.train,
            &EstimatorSpec::Batch,
            self.hyper,
            |_| {},
        )?;
        let of = |trace| mean_error(field.belief.mean(), [trace]);
        let fits: Vec<f64> = self.train.iter().map(of).collect();
        self.cell("batch".to_owned(), &fits, &field.belief, None)
    }

    fn cell(
        &self,
        estimator: String,
        fits: &[f64],
        belief: &Belief<f64>,
        rate_hz: Option<f64>,
    ) -> Result<Table1Cell, PipelineError> {
        let test = evaluate(self.scene, belief, self.test)?;
        let n = fits.len() as f64;
        let mean = fits.iter().sum::<f64>() / n;
        let variance = fits.iter().map(|f| (f - mean).powi(2)).sum::<f64>() / n;
        Ok(Table1Cell {
            estimator,
            fit_error: mean,
            fit_sd: variance.sqrt(),
            test_error: test.mean_error,
            test_sd: test.sd_error,
            rate_hz,
        })
    }
}
