use super::{CovarianceFilter, check_means, check_variances};
use crate::dense::projection::Projection;
use crate::dense::square::{BANDS, OCTET, Octet, Square, TILE, TILE_SQUARES};
use crate::dense::tiles::{Panel, Tiles};
use crate::dense::touched::Link;
use crate::prior::{FieldPrior, PriorParts};
use crate::values::all_finite;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use vsf_core::{Belief, CoreError, Scalar};

/// Numbers of a square.
const SQUARE: usize = OCTET * OCTET;
/// No filter counts as far as that.
const MOST_RANKS: u64 = 1 << 50;
/// Most squares of 8 ranks that are pending: noise has 4096 channels at most.
const MOST_RING: u64 = 4096 / 8;

/// What is saved of a [`CovarianceFilter`]: the matrix as it is, for what waits to be subtracted
/// decides how later sums are rounded.
#[derive(Serialize, Deserialize)]
#[serde(
    rename = "CovarianceFilter",
    bound(serialize = "T: Serialize", deserialize = "T: Deserialize<'de>")
)]
struct Parts<T: Scalar> {
    prior: PriorParts,
    projection: Projection,
    belief: Belief<T>,
    #[serde(deserialize_with = "crate::state::finite")]
    whitened: Vec<f64>,
    points: Vec<u32>,
    /// Precision that tells of a level, or the lower triangle of a prior's factor by rows.
    link: Vec<f64>,
    mean: Vec<T>,
    variance: Vec<T>,
    ring: u64,
    pushed: u64,
    applied: Vec<u64>,
    panels: Vec<Vec<T>>,
    ranks: Vec<T>,
    /// `x` and `lambda` of the mode.
    mode: Vec<(T, T)>,
}

impl<T: Scalar + Serialize> Serialize for CovarianceFilter<T> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let Tiles {
            panels,
            ring,
            pushed,
            ranks,
            ..
        } = &self.covariance;
        let slots = 0..self.touched.len();
        let parts = Parts {
            prior: PriorParts::from(self.touched.prior()),
            projection: self.shown.projection,
            belief: self.shown.belief.clone(),
            whitened: self.shown.whitened.clone(),
            points: self.touched.points().to_vec(),
            link: match &self.touched.link {
                Link::Nothing => Vec::new(),
                Link::Level { precision, .. } => vec![*precision],
                Link::Field { root } => {
                    let row = |i: usize| (0..=i).map(move |j| root[(i, j)]);
                    slots.clone().flat_map(row).collect()
                }
            },
            mean: self.mean.clone(),
            variance: self.variance.clone(),
            ring: *ring as u64,
            pushed: *pushed as u64,
            applied: panels.iter().map(|p| p.applied as u64).collect(),
            panels: panels.iter().map(|p| numbers(&p.tiles)).collect(),
            ranks: numbers(ranks),
            mode: match &self.mode {
                Some(mode) => slots.map(|s| (mode.x(s), mode.multiplier(s))).collect(),
                None => Vec::new(),
            },
        };
        parts.serialize(to)
    }
}

impl<'de, T: Scalar + Deserialize<'de>> Deserialize<'de> for CovarianceFilter<T> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let parts = Parts::<T>::deserialize(from)?;
        Self::try_from(parts).map_err(Error::custom)
    }
}

impl<T: Scalar> TryFrom<Parts<T>> for CovarianceFilter<T> {
    type Error = CoreError;

    fn try_from(parts: Parts<T>) -> Result<Self, CoreError> {
        let prior = FieldPrior::try_from(parts.prior)?;
        CoreError::check_len("belief", parts.belief.len(), prior.len())?;
        let mut filter = Self::with_projection(prior, parts.projection)?;
        let n = parts.points.len();
        let touched = &mut filter.touched;
        if touched.unseen(&parts.points)?.len() < n {
            return Err(CoreError::other("a point was touched first twice"));
        }
        for (slot, &p) in parts.points.iter().enumerate() {
            touched.slots[p as usize] = slot as u32;
        }
        touched.points = parts.points;
        let linked = match &touched.link {
            Link::Nothing => 0,
            Link::Level { .. } => 1,
            Link::Field { .. } => n * (n + 1) / 2,
        };
        CoreError::check_len("link of the touched points", parts.link.len(), linked)?;
        CoreError::check_finite("link of the touched points", &parts.link)?;
        let entry = |i: usize, j: usize| parts.link[i * (i + 1) / 2 + j];
        match &mut touched.link {
            Link::Nothing => {}
            Link::Level { precision, .. } => {
                if parts.link[0] < 0.0 {
                    return Err(CoreError::Parameter {
                        name: "precision of the common level",
                        value: parts.link[0],
                        range: ">= 0",
                    });
                }
                *precision = parts.link[0];
            }
            Link::Field { root } => {
                let capacity = n.next_power_of_two();
                root.reserve(capacity, capacity);
                root.resize_with(n, n, |i, j| if j <= i { entry(i, j) } else { 0.0 });
                if let Some(pivot) = (0..n).find(|&i| root[(i, i)] <= 0.0) {
                    return Err(CoreError::NotPositiveDefinite {
                        what: "prior covariance of the touched points",
                        pivot,
                        value: root[(pivot, pivot)],
                    });
                }
            }
        }

        CoreError::check_len("means of the touched points", parts.mean.len(), n)?;
        CoreError::check_len("variances of the touched points", parts.variance.len(), n)?;
        check_means(&parts.mean)?;
        check_variances(&parts.variance, filter.touched.points())?;
        let held = if filter.mode.is_some() { n } else { 0 };
        CoreError::check_len("constrained mean", parts.mode.len(), held)?;
        if let Some(mode) = &mut filter.mode {
            let prior = filter.touched.prior();
            for ((&(x, lambda), &v), &p) in parts
                .mode
                .iter()
                .zip(&parts.variance)
                .zip(filter.touched.points())
            {
                if !(all_finite(&[x, lambda]) && lambda >= T::ZERO) {
                    return Err(CoreError::Parameter {
                        name: "multiplier of K >= 0",
                        value: lambda.to_f64(),
                        range: ">= 0 and finite, and so the constrained mean",
                    });
                }
                let prior_sd = prior.covariance(p as usize, p as usize).sqrt();
                mode.push(x, v, prior_sd);
                mode.set_multiplier(lambda);
            }
            mode.measure();
        }
        filter.covariance = tiles(
            n,
            [parts.ring, parts.pushed],
            &parts.applied,
            &parts.panels,
            &parts.ranks,
        )?;
        filter.mean = parts.mean;
        filter.variance = parts.variance;
        filter.shown.belief = parts.belief;
        filter.shown.whitened = parts.whitened;
        Ok(filter)
    }
}

fn tiles<T: Scalar>(
    len: usize,
    [ring, pushed]: [u64; 2],
    applied: &[u64],
    panels: &[Vec<T>],
    ranks: &[T],
) -> Result<Tiles<T>, CoreError> {
    let blocks = len.div_ceil(TILE);
    CoreError::check_len("blocks of a covariance", panels.len(), blocks)?;
    CoreError::check_len("blocks of a covariance", applied.len(), blocks)?;
    let counts = (1..=MOST_RING).contains(&ring) && ring <= pushed && pushed <= MOST_RANKS;
    if !counts
        || applied
            .iter()
            .any(|a| !(pushed - ring..=pushed).contains(a))
    {
        return Err(CoreError::other(
            "a covariance lacks more ranks than it keeps",
        ));
    }
    let rank = (ring as usize).saturating_mul(blocks * BANDS * SQUARE);
    CoreError::check_len("ranks of a covariance", ranks.len(), rank)?;
    for (block, panel) in panels.iter().enumerate() {
        let entries = (block + 1) * TILE_SQUARES * SQUARE;
        CoreError::check_len("entries of a covariance", panel.len(), entries)?;
    }
    if !(panels.iter().all(|panel| all_finite(panel)) && all_finite(ranks)) {
        return Err(CoreError::Overflow {
            what: "covariance of two points",
        });
    }
    let panel = |(panel, &applied): (&Vec<T>, &u64)| Panel {
        tiles: squares(panel),
        applied: applied as usize,
    };
    Ok(Tiles::restored(
        len,
        panels.iter().zip(applied).map(panel).collect(),
        [ring as usize, pushed as usize],
        squares(ranks),
    ))
}

fn numbers<T: Scalar>(squares: &[Square<T>]) -> Vec<T> {
    squares.iter().flatten().flat_map(|octet| octet.0).collect()
}

fn squares<T: Scalar>(numbers: &[T]) -> Vec<Square<T>> {
    let octet = |s: &[T], c: usize| Octet(std::array::from_fn(|l| s[c * OCTET + l]));
    let squares = numbers.chunks_exact(SQUARE);
    squares
        .map(|s| std::array::from_fn(|c| octet(s, c)))
        .collect()
}
