use crate::lanes::{LANES, Row};
use crate::link_pose::beyond;
use crate::{Sdf, SdfSample};
use nalgebra::{Point3, Vector3};

/// Up to [`CAPACITY`](Self::CAPACITY) places in the frame of a body, each with the sample of the
/// surface that is nearest to it among those it has been shown to by [`Sdf::unite`].
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
    /// The most places in a batch.
    pub const CAPACITY: usize = LANES;

    /// A batch without places.
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

    /// Whether there is no place.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether there is room for no more places.
    pub fn is_full(&self) -> bool {
        self.len == Self::CAPACITY
    }

    /// Removes all places.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds a place that has been shown to no surface: its distance is `f64::MAX`, its normal +x.
    ///
    /// # Panics
    /// When the batch is full.
    pub fn push(&mut self, p_B: &Point3<f64>) {
        let i = self.len;
        for (row, x) in self.places.iter_mut().zip(p_B.coords.as_slice()) {
            row[i] = *x;
        }
        self.distances[i] = f64::MAX;
        self.set_normal(i, &Vector3::x());
        self.len += 1;
    }

    /// Makes the first `len` places ones that have been shown to no surface.
    pub(crate) fn start(&mut self, len: usize) {
        self.len = len;
        self.distances[..len].fill(f64::MAX);
        self.normals[0][..len].fill(1.0);
        self.normals[1][..len].fill(0.0);
        self.normals[2][..len].fill(0.0);
    }

    /// The place at an index below [`len`](Self::len).
    ///
    /// # Panics
    /// At an index of [`CAPACITY`](Self::CAPACITY) or more, as [`sample`](Self::sample) and [`offer`](Self::offer) do.
    pub fn place(&self, i: usize) -> Point3<f64> {
        let [x, y, z] = &self.places;
        Point3::new(x[i], y[i], z[i])
    }

    /// Distance from the nearest surface and its normal there, at an index below [`len`](Self::len).
    pub fn sample(&self, i: usize) -> SdfSample {
        let [x, y, z] = &self.normals;
        SdfSample {
            distance: self.distances[i],
            normal: Vector3::new(x[i], y[i], z[i]),
        }
    }

    /// Keeps the sample of a surface if that is nearer than all before, at an index below [`len`](Self::len).
    pub fn offer(&mut self, i: usize, sample: &SdfSample) {
        if sample.distance < self.distances[i] {
            self.distances[i] = sample.distance;
            self.set_normal(i, &sample.normal);
        }
    }

    /// Shows a body the places that may be nearer to it than to what they have been shown to before. They are no nearer
    /// to it than to its box, of this center and these half extents.
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

/// Distances of many places from a surface; every place comes with something to know it by.
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
