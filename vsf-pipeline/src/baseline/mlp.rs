mod adam;
mod network;

use super::Predicted;
use super::features::Known;
use crate::PipelineError;
use adam::Adam;
use nalgebra::DMatrix;
use network::Network;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::ops::ControlFlow;
use vsf_core::CoreError;
use vsf_vision::{Features, Scaler};

/// Parameters of a multilayer perceptron ([`super::Baseline::Mlp`]).
///
/// One network outputs all torques. It is trained on the mean squared error by Adam in batches of 64
/// samples. The activation, which the paper does not name, is `tanh`: its outputs level off away from the
/// train samples, where rectified units continue in straight lines. Torques are scaled by one factor for
/// all joints, so that the loss is the square of the reported error.
///
/// Every fifth touch of the train samples, counted back from the last, is held out; of a single touch,
/// every fifth of 20 parts. Training ends after 5000 steps, or after 1000 steps without a new minimum of
/// the held-out error. Then the network is trained on all samples, for the number of passes that led to
/// that minimum. The same seed gives the same network, whatever the number of threads.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MlpConfig {
    /// Numbers of units of the hidden layers, 1 to 4096 each; 1 to 16 layers.
    ///
    /// `None` (default) searches as in the paper: two or three layers of 64, 128 or 256 units, choosing the
    /// one with the least held-out error.
    pub hidden: Option<Vec<usize>>,
    /// Seed of the initial weights and of the order of samples, default 0.
    pub seed: u64,
}

const BATCH: usize = 64;
const MOST_STEPS: usize = 5000;
const PATIENCE: usize = 1000;
/// One part in so many is held out.
const HELD_OUT: usize = 5;
/// Parts of a single touch.
const PARTS: usize = 20;
/// The paper's sizes.
const UNITS: [usize; 3] = [64, 128, 256];
const LAYERS: [usize; 2] = [2, 3];
/// More take memory that no training set of touches is worth.
const MOST_LAYERS: usize = 16;
const MOST_UNITS: usize = 4096;

/// Scaled samples, one per column.
struct Data {
    inputs: DMatrix<f64>,
    targets: DMatrix<f64>,
}

impl Data {
    fn len(&self) -> usize {
        self.inputs.ncols()
    }

    fn select(&self, samples: &[usize]) -> Self {
        Self {
            inputs: self.inputs.select_columns(samples),
            targets: self.targets.select_columns(samples),
        }
    }
}

pub fn predict(
    config: &MlpConfig,
    known: &Known,
    queries: &Features,
) -> Result<Predicted, PipelineError> {
    let sizes = config.sizes()?;
    let scaler = Scaler::of(&known.features)?;
    let width = known.features.width();
    let scaled = |features: &Features| {
        let rows = scaler.apply(features)?;
        Ok::<_, PipelineError>(DMatrix::from_vec(width, features.len(), rows))
    };
    let mean = known.torques.column_mean();
    let mut targets = known.torques.clone();
    targets.column_iter_mut().for_each(|mut c| c -= &mean);
    let scale = targets.norm() / (targets.len().max(1) as f64).sqrt();
    // Torques that never change are predicted as they are.
    let scale = if scale > 0.0 { scale } else { 1.0 };
    let data = Data {
        inputs: scaled(&known.features)?,
        targets: targets / scale,
    };

    let (held, kept) = held_out(known);
    if kept.is_empty() {
        return Err(CoreError::TooFew {
            what: "samples that a network is trained with, beside those that are held out",
            got: 0,
            least: 1,
        }
        .into());
    }
    let (held, kept) = (data.select(&held), data.select(&kept));
    let tried: Vec<_> = sizes
        .par_iter()
        .with_max_len(1)
        .map(|hidden| best_pass(hidden, config.seed, &kept, &held))
        .collect();
    let best = sizes
        .iter()
        .zip(tried)
        .min_by(|a, b| a.1.0.total_cmp(&b.1.0));
    let Some((hidden, (_, passes))) = best else {
        return Err(CoreError::TooFew {
            what: "sizes of the network",
            got: 0,
            least: 1,
        }
        .into());
    };
    let network = train(hidden, config.seed, &data, passes, |_, _| {
        ControlFlow::Continue(())
    });
    let outputs = network.predict(&scaled(queries)?);
    CoreError::check_finite("predictions of the mlp", outputs.as_slice())?;
    let row = |output: &[f64]| {
        let pairs = output.iter().zip(mean.iter());
        pairs.map(|(o, m)| o * scale + m).collect()
    };
    Ok(Predicted {
        mean: outputs.column_iter().map(|c| row(c.as_slice())).collect(),
        sd: Vec::new(),
    })
}

impl MlpConfig {
    /// Hidden layers that are tried.
    fn sizes(&self) -> Result<Vec<Vec<usize>>, CoreError> {
        let Some(hidden) = &self.hidden else {
            let sizes = LAYERS.iter().flat_map(|l| UNITS.map(|u| vec![u; *l]));
            return Ok(sizes.collect());
        };
        let refused = |name, value: usize, range| CoreError::Parameter {
            name,
            value: value as f64,
            range,
        };
        if !(1..=MOST_LAYERS).contains(&hidden.len()) {
            return Err(refused("hidden layers", hidden.len(), "1 to 16"));
        }
        let odd = |units: &&usize| !(1..=MOST_UNITS).contains(*units);
        if let Some(units) = hidden.iter().find(odd) {
            return Err(refused("units of a hidden layer", *units, "1 to 4096"));
        }
        Ok(vec![hidden.clone()])
    }
}

/// Samples held out, and the others.
fn held_out(known: &Known) -> (Vec<usize>, Vec<usize>) {
    let samples = known.features.len();
    let parts = if known.touches.len() > 1 {
        known.touches.clone()
    } else {
        let at = |part: usize| part * samples / PARTS;
        (0..PARTS).map(|p| at(p)..at(p + 1)).collect()
    };
    let mut of = (Vec::new(), Vec::new());
    for (k, part) in parts.into_iter().rev().enumerate() {
        if k % HELD_OUT == 0 {
            &mut of.0
        } else {
            &mut of.1
        }
        .extend(part);
    }
    of
}

/// The least error on the samples held out, and the number of passes that lead to it.
fn best_pass(hidden: &[usize], seed: u64, kept: &Data, held: &Data) -> (f64, usize) {
    let steps = |passes: usize| passes * kept.len().div_ceil(BATCH);
    let most = MOST_STEPS / steps(1).max(1);
    let mut best = (f64::INFINITY, 1);
    train(hidden, seed, kept, most, |pass, network| {
        let loss = network.loss(&held.inputs, &held.targets);
        if loss < best.0 {
            best = (loss, pass);
        }
        if steps(pass - best.1) >= PATIENCE {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    best
}

/// A network after some passes over the data, in a new order each; `after` may end it earlier.
fn train(
    hidden: &[usize],
    seed: u64,
    data: &Data,
    passes: usize,
    mut after: impl FnMut(usize, &Network) -> ControlFlow<()>,
) -> Network {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (inputs, outputs) = (data.inputs.nrows(), data.targets.nrows());
    let mut network = Network::new(&[&[inputs], hidden, &[outputs]].concat(), &mut random);
    let mut adam = Adam::new(network.parameters.len());
    let mut order: Vec<usize> = (0..data.len()).collect();
    for pass in 1..=passes.max(1) {
        order.shuffle(&mut random);
        for batch in order.chunks(BATCH) {
            let batch = data.select(batch);
            let gradient = network.gradient(&batch.inputs, &batch.targets);
            adam.step(&mut network.parameters, &gradient);
        }
        if after(pass, &network).is_break() {
            break;
        }
    }
    network
}
