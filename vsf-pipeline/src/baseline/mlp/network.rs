use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Fully connected layers, with `tanh` after every one but the last.
///
/// The parameters of all layers lie in one vector, so that an optimizer need not know of layers. The
/// weights of a layer (outputs x inputs, column by column) precede its biases. Inputs, targets and outputs
/// are matrices with one column per sample.
#[derive(Clone)]
pub struct Network {
    layers: Vec<Layer>,
    pub parameters: Vec<f64>,
}

#[derive(Clone, Copy)]
struct Layer {
    inputs: usize,
    outputs: usize,
    /// Where its parameters begin.
    start: usize,
}

impl Layer {
    fn biases_at(&self) -> usize {
        self.start + self.inputs * self.outputs
    }

    fn end(&self) -> usize {
        self.biases_at() + self.outputs
    }

    fn weights<'a>(&self, of: &'a [f64]) -> DMatrixView<'a, f64> {
        let own = &of[self.start..self.biases_at()];
        DMatrixView::from_slice(own, self.outputs, self.inputs)
    }

    fn biases<'a>(&self, of: &'a [f64]) -> &'a [f64] {
        &of[self.biases_at()..self.end()]
    }
}

impl Network {
    /// Creates a network with the given layer widths, inputs first. Weights are drawn with the variance
    /// `1 / inputs`, which keeps units from saturating; biases are 0.
    pub fn new(widths: &[usize], random: &mut Pcg64Mcg) -> Self {
        let mut layers: Vec<Layer> = Vec::new();
        let mut parameters = Vec::new();
        for (&inputs, &outputs) in widths.iter().zip(&widths[1..]) {
            let start = parameters.len();
            let sd = (inputs as f64).sqrt().recip();
            let mut draw = || sd * Distribution::<f64>::sample(&StandardNormal, random);
            parameters.extend((0..inputs * outputs).map(|_| draw()));
            parameters.resize(parameters.len() + outputs, 0.0);
            layers.push(Layer {
                inputs,
                outputs,
                start,
            });
        }
        Self { layers, parameters }
    }

    /// What every layer puts out, the last one being the prediction.
    fn values(&self, inputs: &DMatrix<f64>) -> Vec<DMatrix<f64>> {
        let mut all: Vec<DMatrix<f64>> = Vec::with_capacity(self.layers.len());
        for (k, layer) in self.layers.iter().enumerate() {
            let below = all.last().unwrap_or(inputs);
            let biases = layer.biases(&self.parameters);
            let mut values = DMatrix::from_fn(layer.outputs, below.ncols(), |i, _| biases[i]);
            values.gemm(1.0, &layer.weights(&self.parameters), below, 1.0);
            if k + 1 < self.layers.len() {
                values.apply(|v| *v = v.tanh());
            }
            all.push(values);
        }
        all
    }

    /// One column of outputs per column of inputs.
    pub fn predict(&self, inputs: &DMatrix<f64>) -> DMatrix<f64> {
        let last = self.values(inputs).pop();
        last.unwrap_or_else(|| inputs.clone())
    }

    /// Half the mean over the samples of the squared error norm.
    pub fn loss(&self, inputs: &DMatrix<f64>, targets: &DMatrix<f64>) -> f64 {
        let error = self.predict(inputs) - targets;
        0.5 * error.norm_squared() / targets.ncols().max(1) as f64
    }

    /// Gradient of [`Network::loss`] with respect to the parameters, by back-propagation.
    pub fn gradient(&self, inputs: &DMatrix<f64>, targets: &DMatrix<f64>) -> Vec<f64> {
        let values = self.values(inputs);
        let mut gradient = vec![0.0; self.parameters.len()];
        let mut error = (values.last().unwrap_or(inputs) - targets) / targets.ncols().max(1) as f64;
        for (k, layer) in self.layers.iter().enumerate().rev() {
            let below = k.checked_sub(1).map_or(inputs, |k| &values[k]);
            let (weights, biases) =
                gradient[layer.start..layer.end()].split_at_mut(layer.inputs * layer.outputs);
            // Transposed copies: nalgebra has no fast product with a transpose.
            DMatrixViewMut::from_slice(weights, layer.outputs, layer.inputs).gemm(
                1.0,
                &error,
                &below.transpose(),
                0.0,
            );
            biases.copy_from_slice(error.column_sum().as_slice());
            if k > 0 {
                error = layer.weights(&self.parameters).transpose() * &error;
                error.zip_apply(below, |e, value| *e *= 1.0 - value * value);
            }
        }
        gradient
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn gradient_is_that_of_finite_differences() {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut network = Network::new(&[13, 9, 6, 7], &mut random);
        let mut draw = |rows, cols| -> DMatrix<f64> {
            DMatrix::from_fn(rows, cols, |_, _| StandardNormal.sample(&mut random))
        };
        // Biases begin at 0, where some mistakes do not show.
        let n = network.parameters.len();
        let shift = draw(n, 1);
        let shifted = network.parameters.iter_mut().zip(shift.iter());
        shifted.for_each(|(p, s)| *p += 0.1 * s);
        let (x, y) = (draw(13, 11), draw(7, 11));
        let gradient = network.gradient(&x, &y);
        assert_eq!(n, 13 * 9 + 9 + 9 * 6 + 6 + 6 * 7 + 7);
        for (k, slope) in gradient.iter().enumerate() {
            let step = 1e-6;
            let at = |by: f64| {
                let mut moved = network.clone();
                moved.parameters[k] += by;
                moved.loss(&x, &y)
            };
            let expected = (at(step) - at(-step)) / (2.0 * step);
            assert!((slope - expected).abs() < 1e-7, "{k}: {slope}, {expected}");
        }
    }

    /// One hidden layer, written out.
    #[test]
    fn predicts_by_its_parameters() {
        let mut network = Network::new(&[1, 2, 1], &mut Pcg64Mcg::seed_from_u64(0));
        network.parameters = vec![1.0, -2.0, 0.5, 0.0, 3.0, 4.0, -1.0];
        let y = |x: f64| 3.0 * (x + 0.5).tanh() + 4.0 * (-2.0 * x).tanh() - 1.0;
        let inputs = DMatrix::from_row_slice(1, 2, &[2.0, -1.0]);
        let found = network.predict(&inputs);
        assert!((found[0] - y(2.0)).abs() < 1e-14 && (found[1] - y(-1.0)).abs() < 1e-14);
        let targets = DMatrix::from_row_slice(1, 2, &[y(2.0), y(-1.0) - 2.0]);
        assert!((network.loss(&inputs, &targets) - 1.0).abs() < 1e-13);
    }
}
