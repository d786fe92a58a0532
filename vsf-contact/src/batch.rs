use crate::lanes::{LANES, Row};
use crate::link_pose::beyond;
use crate::{Sdf, SdfSample};
use nalgebra::{Point3, Vector3};

/// Up to [`CAPACITY`](Self::CAPACITY) places in the frame of a body, each with the sample of the
/// nearest surface so far. [`Sdf::unite`] updates the samples with another surface.
#[derive(Debug, Clone)]
pub struct Batch {
    len: usize,
    pub(crate) places: [Row; 3],
    pub(crate) distances: Row,
    pub(crate) normals: [Row; 3],
}

impl Default for Batch {
    fn default() -> Self {
        Self::new()
    }
}

impl Batch {
    /// The largest number of places in a batch.
    pub const CAPACITY: usize = LANES;

    /// Creates an empty batch.
    pub const fn new() -> Self {
        Self {
            len: 0,
            places: [[0.0; LANES]; 3],
            distances: [f64::MAX; LANES],
            normals: [[1.0; LANES], [0.0; LANES], [0.0; LANES]],
        }
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether the batch is empty.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether the batch is full.
    pub fn is_full(&self) -> bool {
        self.len == Self::CAPACITY
    }

    /// Removes all places.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds a place. Before any surface its distance is `f64::MAX` and its normal +x.
    ///
    /// # Panics
    /// If the batch is full.
    pub fn push(&mut self, p_B: &Point3<f64>) {
        let i = self.len;
        for (row, x) in self.places.iter_mut().zip(p_B.coords.as_slice()) {
            row[i] = *x;
        }
        self.distances[i] = f64::MAX;
        self.set_normal(i, &Vector3::x());
        self.len += 1;
    }

    /// Sets the number of places to `len` and resets their samples, as for [`push`](Self::push).
    pub(crate) fn start(&mut self, len: usize) {
        self.len = len;
        self.distances[..len].fill(f64::MAX);
        self.normals[0][..len].fill(1.0);
        self.normals[1][..len].fill(0.0);
        self.normals[2][..len].fill(0.0);
    }

    /// The place at index `i`, which must be below [`len`](Self::len).
    ///
    /// # Panics
    /// If `i` is [`CAPACITY`](Self::CAPACITY) or more, as in [`sample`](Self::sample) and [`offer`](Self::offer).
    pub fn place(&self, i: usize) -> Point3<f64> {
        let [x, y, z] = &self.places;
        Point3::new(x[i], y[i], z[i])
    }

    /// Sample of the nearest surface so far, for the place at index `i`, which must be below [`len`](Self::len).
    pub fn sample(&self, i: usize) -> SdfSample {
        let [x, y, z] = &self.normals;
        SdfSample {
            distance: self.distances[i],
            normal: Vector3::new(x[i], y[i], z[i]),
        }
    }

    /// Replaces the sample at index `i`, which must be below [`len`](Self::len), if the new distance is less.
    pub fn offer(&mut self, i: usize, sample: &SdfSample) {
        if sample.distance < self.distances[i] {
            self.distances[i] = sample.distance;
            self.set_normal(i, &sample.normal);
        }
    }

    /// Updates the samples of those places that may be nearer to `body` than to all surfaces so far. `center` and `half`
    /// are those of a box around the body: no place is nearer to the body than to the box.
    pub(crate) fn show(&mut self, body: &impl Sdf, (center, half): &(Point3<f64>, Vector3<f64>)) {
        let (mut near, mut count) = ([0; LANES], 0);
        for i in 0..self.len {
            near[count] = i;
            count += usize::from(beyond(&self.place(i), center, half) < self.distances[i]);
        }
        if count == self.len {
            return body.unite(self);
        }
        if count == 0 {
            return;
        }
        let mut own = Self::new();
        near[..count].iter().for_each(|&i| own.push(&self.place(i)));
        body.unite(&mut own);
        for (k, &i) in near[..count].iter().enumerate() {
            self.offer(i, &own.sample(k));
        }
    }

    fn set_normal(&mut self, i: usize, normal: &Vector3<f64>) {
        for (row, n) in self.normals.iter_mut().zip(normal.as_slice()) {
            row[i] = *n;
        }
    }
}

/// Computes the distances of many places from a surface. Each place comes with an identifier, which `found` gets
/// with the distance.
pub(crate) fn distances<T: Copy>(
    sdf: &dyn Sdf,
    places: impl Iterator<Item = (T, Point3<f64>)>,
    mut found: impl FnMut(T, f64),
) {
    let mut batch = Batch::new();
    let mut whose = [None; Batch::CAPACITY];
    let mut flush = |batch: &mut Batch, whose: &[Option<T>]| {
        sdf.unite(batch);
        for (whose, distance) in whose.iter().flatten().zip(&batch.distances) {
            found(*whose, *distance);
        }
        batch.clear();
    };
    for (id, place) in places {
        whose[batch.len()] = Some(id);
        batch.push(&place);
        if batch.is_full() {
            flush(&mut batch, &whose);
        }
    }
    let len = batch.len();
    flush(&mut batch, &whose[..len]);
}
