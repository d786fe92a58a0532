/// Tares the readings of a stream: their mean over the first samples of a sequence counts as zero.
#[derive(Debug, Clone)]
pub struct Tare {
    sum: Vec<f64>,
    samples: usize,
    zero: Vec<f64>,
}

impl Tare {
    /// Creates the state at the beginning of a sequence of `joints` joints, with a zero of 0.
    pub fn new(joints: usize) -> Self {
        Self {
            sum: vec![0.0; joints],
            samples: 0,
            zero: vec![0.0; joints],
        }
    }

    /// Starts a sequence.
    pub fn begin(&mut self) {
        self.sum.fill(0.0);
        self.samples = 0;
        self.zero.fill(0.0);
    }

    /// Adds a reading, one number per joint.
    pub fn add(&mut self, reading: &[f64]) {
        self.sum.iter_mut().zip(reading).for_each(|(s, x)| *s += x);
        self.samples += 1;
    }

    /// Makes the mean of the added readings the zero from here on.
    pub fn take(&mut self) {
        let each = 1.0 / self.samples.max(1) as f64;
        let means = self.sum.iter().map(|s| each * s);
        self.zero.iter_mut().zip(means).for_each(|(z, m)| *z = m);
    }

    /// Number of readings added since the sequence began.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// The present zero.
    pub fn zero(&self) -> &[f64] {
        &self.zero
    }

    /// Subtracts the zero from a reading.
    pub fn apply(&self, reading: &mut [f64]) {
        let pairs = reading.iter_mut().zip(&self.zero);
        pairs.for_each(|(tau, zero)| *tau -= zero);
    }
}
