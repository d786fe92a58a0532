use super::dense::{add_scaled, mirror, outer};
use faer::Mat;
use vsf_core::{CoreError, Noise, Observation, SymmetricFactor};

/// Marks a point without a place in a matrix.
pub(super) const NONE: u32 = u32::MAX;

/// Rows of a panel, enough for the speed of a matrix product.
const PANEL_ROWS: usize = 224;
/// A panel takes no further observation when its points would outnumber those of its largest
/// observation by this factor: zeros cost time too.
const PANEL_SPREAD: usize = 2;

/// Brings observations to unit noise: `L^-1 W` and `L^-1 tau` with `L L^T = R`.
#[derive(Debug)]
pub(super) struct Whitener<'a> {
    noise: Option<&'a Noise>,
    factor: SymmetricFactor,
    inverse: Vec<f64>,
}

impl<'a> Whitener<'a> {
    /// For observations that all have this noise, or each its own.
    pub(super) fn new(noise: Option<&'a Noise>) -> Self {
        Self {
            noise,
            factor: SymmetricFactor::default(),
            inverse: Vec::new(),
        }
    }

    /// Takes the noise of an observation.
    pub(super) fn set(&mut self, obs: &Observation<f64>) -> Result<(), CoreError> {
        let covariance = self.noise.unwrap_or(obs.noise()).covariance();
        (self.factor).factor("noise covariance", obs.dim(), covariance)
    }

    /// `log det R`.
    pub(super) fn log_det(&self) -> f64 {
        self.factor.log_det()
    }

    /// `L^-1 b` in place.
    pub(super) fn whiten(&self, b: &mut [f64]) {
        self.factor.solve_lower(b);
    }

    /// `L^-1 W`, row after row.
    fn rows(&mut self, obs: &Observation<f64>, out: &mut Vec<f64>) {
        let (d, n) = (obs.dim(), obs.len());
        out.clear();
        out.resize(d * n, 0.0);
        self.factor.inverse_lower(&mut self.inverse);
        for i in 0..d {
            let entries = self.inverse[i * d..].iter().enumerate().take(i + 1);
            for (j, &c) in entries.filter(|(_, c)| **c != 0.0) {
                add_scaled(&mut out[i * n..(i + 1) * n], c, obs.row(j));
            }
        }
    }
}

/// The whitened rows of observations, transposed: one column per row, one row per point that has a
/// `place` (below `n`).
pub(super) fn panel(
    observations: &[&Observation<f64>],
    place: &[u32],
    n: usize,
    whitener: &mut Whitener<'_>,
) -> Result<Mat<f64>, CoreError> {
    let touching = observations.iter().filter(|o| !o.is_empty());
    let rows = touching.clone().map(|o| o.dim()).sum();
    let mut out = Mat::zeros(n, rows);
    let mut white = Vec::new();
    let mut column = 0;
    for obs in touching {
        whitener.set(obs)?;
        whitener.rows(obs, &mut white);
        for row in white.chunks(obs.len()) {
            let to = out.col_as_slice_mut(column);
            for (&p, &w) in obs.points().iter().zip(row) {
                if place[p as usize] != NONE {
                    to[place[p as usize] as usize] = w;
                }
            }
            column += 1;
        }
    }
    Ok(out)
}

/// `W^T R^-1 W` over the points that have a `place` (below `n`, increasing with the point), both
/// triangles.
pub(super) fn gram<'a>(
    observations: impl IntoIterator<Item = &'a Observation<f64>>,
    place: &[u32],
    n: usize,
    whitener: &mut Whitener<'_>,
) -> Result<Mat<f64>, CoreError> {
    let mut total = Mat::zeros(n, n);
    let mut group = Group::new(place.len());
    for obs in observations.into_iter().filter(|o| !o.is_empty()) {
        if !group.admits(obs, place) {
            group.add_to(&mut total, place, whitener)?;
        }
        group.push(obs, place);
    }
    group.add_to(&mut total, place, whitener)?;
    mirror(&mut total);
    Ok(total)
}

/// Observations that touch much the same points, to be multiplied as one dense panel.
struct Group<'a> {
    observations: Vec<&'a Observation<f64>>,
    rows: usize,
    /// Most points of one observation.
    largest: usize,
    /// All points of the group.
    points: Vec<u32>,
    /// Their order in the panel.
    order: Vec<u32>,
}

impl<'a> Group<'a> {
    fn new(field_len: usize) -> Self {
        Self {
            observations: Vec::new(),
            rows: 0,
            largest: 0,
            points: Vec::new(),
            order: vec![NONE; field_len],
        }
    }

    fn is_new(&self, p: u32, place: &[u32]) -> bool {
        place[p as usize] != NONE && self.order[p as usize] == NONE
    }

    fn admits(&self, obs: &Observation<f64>, place: &[u32]) -> bool {
        let more = obs.points().iter().filter(|&&p| self.is_new(p, place));
        let limit = PANEL_SPREAD * self.largest.max(obs.len());
        self.rows + obs.dim() <= PANEL_ROWS && self.points.len() + more.count() <= limit
    }

    fn push(&mut self, obs: &'a Observation<f64>, place: &[u32]) {
        for &p in obs.points() {
            if self.is_new(p, place) {
                self.order[p as usize] = 0;
                self.points.push(p);
            }
        }
        self.rows += obs.dim();
        self.largest = self.largest.max(obs.len());
        self.observations.push(obs);
    }

    /// Adds the group to the lower triangle of `total` and empties it.
    fn add_to(
        &mut self,
        total: &mut Mat<f64>,
        place: &[u32],
        whitener: &mut Whitener<'_>,
    ) -> Result<(), CoreError> {
        self.points.sort_unstable();
        for (k, &p) in self.points.iter().enumerate() {
            self.order[p as usize] = k as u32;
        }
        let n = self.points.len();
        let part = outer(panel(&self.observations, &self.order, n, whitener)?.as_ref());
        for (k, &q) in self.points.iter().enumerate() {
            let to = total.col_as_slice_mut(place[q as usize] as usize);
            for (&p, v) in self.points.iter().zip(part.col_as_slice(k)).skip(k) {
                to[place[p as usize] as usize] += v;
            }
        }
        for p in self.points.drain(..) {
            self.order[p as usize] = NONE;
        }
        self.observations.clear();
        (self.rows, self.largest) = (0, 0);
        Ok(())
    }
}

/// `W^T R^-1 r` over the points that have a `place`; `residual(obs, r)` turns the reading in `r`
/// into `r`.
pub(super) fn project<'a>(
    observations: impl IntoIterator<Item = &'a Observation<f64>>,
    place: &[u32],
    n: usize,
    whitener: &mut Whitener<'_>,
    mut residual: impl FnMut(&Observation<f64>, &mut [f64]),
) -> Result<Vec<f64>, CoreError> {
    let mut out = vec![0.0; n];
    let mut r = Vec::new();
    for obs in observations.into_iter().filter(|o| !o.is_empty()) {
        whitener.set(obs)?;
        r.clear();
        r.extend_from_slice(obs.reading());
        residual(obs, &mut r);
        whitener.factor.solve(&mut r);
        for (i, &r) in r.iter().enumerate() {
            for (&p, &w) in obs.points().iter().zip(obs.row(i)) {
                if place[p as usize] != NONE {
                    out[place[p as usize] as usize] += w * r;
                }
            }
        }
    }
    Ok(out)
}
