/// The Adam optimizer, with the step sizes and decay rates of its authors: D. P. Kingma, J. Ba, *Adam: a
/// method for stochastic optimization*, ICLR 2015, arXiv:1412.6980, algorithm 1.
pub struct Adam {
    mean: Vec<f64>,
    square: Vec<f64>,
    steps: i32,
}

const RATE: f64 = 1e-3;
const MEAN_DECAY: f64 = 0.9;
const SQUARE_DECAY: f64 = 0.999;
const EPSILON: f64 = 1e-8;

impl Adam {
    /// Creates an optimizer of `parameters` numbers.
    pub fn new(parameters: usize) -> Self {
        Self {
            mean: vec![0.0; parameters],
            square: vec![0.0; parameters],
            steps: 0,
        }
    }

    /// Moves the parameters against the gradient.
    pub fn step(&mut self, parameters: &mut [f64], gradient: &[f64]) {
        self.steps = self.steps.saturating_add(1);
        let unbiased = |decay: f64| 1.0 / (1.0 - decay.powi(self.steps));
        let (by_mean, by_square) = (unbiased(MEAN_DECAY), unbiased(SQUARE_DECAY));
        let moments = self.mean.iter_mut().zip(&mut self.square);
        for ((p, g), (mean, square)) in parameters.iter_mut().zip(gradient).zip(moments) {
            *mean += (1.0 - MEAN_DECAY) * (g - *mean);
            *square += (1.0 - SQUARE_DECAY) * (g * g - *square);
            *p -= RATE * *mean * by_mean / ((*square * by_square).sqrt() + EPSILON);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two steps on gradients 2 and -1, by hand.
    #[test]
    fn follows_its_formulas() {
        let mut adam = Adam::new(1);
        let mut p = [0.0];
        adam.step(&mut p, &[2.0]);
        // Bias correction makes the first step one of the rate's size.
        assert!((p[0] + 1e-3).abs() < 1e-10, "{p:?}");
        adam.step(&mut p, &[-1.0]);
        let mean = (0.9 * 0.2 - 0.1) / (1.0 - 0.81);
        let square: f64 = (0.999 * 0.004 + 0.001) / (1.0 - 0.998_001);
        let expected = -1e-3 - 1e-3 * mean / square.sqrt();
        assert!((p[0] - expected).abs() < 1e-10, "{p:?}, {expected}");
    }
}
