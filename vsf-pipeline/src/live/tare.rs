/// What readings of a stream are taken as zero: their mean over the samples since their sequence began.
#[derive(Debug, Clone)]
pub struct Tare {
    sum: Vec<f64>,
    samples: usize,
    zero: Vec<f64>,
}

impl Tare {
    /// Of so many joints, at the beginning of a sequence: zero is zero.
    pub fn new(joints: usize) -> Self {
        Self {
            sum: vec![0.0; joints],
            samples: 0,
            zero: vec![0.0; joints],
        }
    }

    /// A sequence begins.
    pub fn begin(&mut self) {
        self.sum.fill(0.0);
        self.samples = 0;
        self.zero.fill(0.0);
    }

    /// Adds a reading, of each joint one number.
    pub fn add(&mut self, reading: &[f64]) {
        self.sum.iter_mut().zip(reading).for_each(|(s, x)| *s += x);
        self.samples += 1;
    }

    /// From here on the mean of what was added is zero.
    pub fn take(&mut self) {
        let each = 1.0 / self.samples.max(1) as f64;
        let means = self.sum.iter().map(|s| each * s);
        self.zero.iter_mut().zip(means).for_each(|(z, m)| *z = m);
    }

    /// Readings added since the sequence began.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// What is zero.
    pub fn zero(&self) -> &[f64] {
        &self.zero
    }

    /// Takes zero off a reading.
    pub fn apply(&self, reading: &mut [f64]) {
        let pairs = reading.iter_mut().zip(&self.zero);
        pairs.for_each(|(tau, zero)| *tau -= zero);
    }
}
