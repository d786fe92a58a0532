use crate::VisionError;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZeroUsize;
use std::sync::Arc;
use vsf_core::CoreError;

/// Exact nearest neighbors among rows of numbers, by squared Euclidean distance.
///
/// Uses a k-d tree for up to 12 dimensions. Beyond that, where trees help little, a query compares with
/// every row: `O(rows x dimensions)`.
#[derive(Clone)]
pub struct Neighbors {
    search: Arc<dyn Search>,
    dimensions: usize,
    len: usize,
}

/// Numbers beyond have squares whose sums may overflow.
const REACH: f64 = 1e100;

/// Checks that squared distances between numbers like these are finite.
pub(crate) fn check_reach(name: &'static str, values: &[f64]) -> Result<(), CoreError> {
    CoreError::check_finite(name, values)?;
    match values.iter().find(|v| v.abs() > REACH) {
        None => Ok(()),
        Some(&value) => Err(CoreError::Parameter {
            name,
            value,
            range: "-1e100 to 1e100",
        }),
    }
}

/// A neighbor found by [`Neighbors::nearest`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Neighbor {
    /// Index of its row.
    pub index: usize,
    /// Squared distance to it.
    pub squared: f64,
}

trait Search: Send + Sync {
    fn nearest(&self, query: &[f64], k: NonZeroUsize, out: &mut Vec<Neighbor>);
}

/// The dimension of a k-d tree is part of its type.
struct Tree<const D: usize>(ImmutableKdTree<f64, D>);

impl<const D: usize> Search for Tree<D> {
    fn nearest(&self, query: &[f64], k: NonZeroUsize, out: &mut Vec<Neighbor>) {
        let mut point = [0.0; D];
        point.copy_from_slice(query);
        let found = self.0.query(&point).nearest_n::<SquaredEuclidean<f64>>(k);
        out.extend(found.execute().iter().map(|n| Neighbor {
            index: n.item as usize,
            squared: n.distance,
        }));
    }
}

/// All rows, with their dimension.
struct Exhaustive(Vec<f64>, usize);

impl Search for Exhaustive {
    fn nearest(&self, query: &[f64], k: NonZeroUsize, out: &mut Vec<Neighbor>) {
        let squared = |row: &[f64]| row.iter().zip(query).map(|(a, b)| (a - b) * (a - b)).sum();
        let rows = self.0.chunks_exact(self.1).map(squared).enumerate();
        out.extend(rows.map(|(index, squared)| Neighbor { index, squared }));
        let order = |a: &Neighbor, b: &Neighbor| a.squared.total_cmp(&b.squared);
        if k.get() < out.len() {
            out.select_nth_unstable_by(k.get() - 1, order);
            out.truncate(k.get());
        }
        out.sort_by(order);
    }
}

fn build<const D: usize>(rows: &[f64]) -> Result<Arc<dyn Search>, CoreError> {
    let (points, _) = rows.as_chunks::<D>();
    let tree = ImmutableKdTree::new_from_slice(points)
        .map_err(|e| CoreError::other(format!("nearest-neighbor tree: {e}")))?;
    Ok(Arc::new(Tree(tree)))
}

impl Neighbors {
    /// Builds the search structure over rows of `dimensions` numbers each (at least 1), within -1e100 to
    /// 1e100.
    ///
    /// # Errors
    /// No rows, an incomplete row, or a number out of range.
    pub fn new(rows: &[f64], dimensions: usize) -> Result<Self, VisionError> {
        check_reach("rows to search", rows)?;
        let len = rows.len() / dimensions.max(1);
        if len == 0 {
            return Err(CoreError::TooFew {
                what: "rows to search",
                got: 0,
                least: 1,
            }
            .into());
        }
        if len > u32::MAX as usize {
            return Err(CoreError::TooMany {
                what: "rows to search",
                got: len,
                max: u32::MAX as usize,
            }
            .into());
        }
        CoreError::check_len("rows to search", rows.len(), len * dimensions)?;
        let search = match dimensions {
            1 => build::<1>(rows)?,
            2 => build::<2>(rows)?,
            3 => build::<3>(rows)?,
            4 => build::<4>(rows)?,
            5 => build::<5>(rows)?,
            6 => build::<6>(rows)?,
            7 => build::<7>(rows)?,
            8 => build::<8>(rows)?,
            9 => build::<9>(rows)?,
            10 => build::<10>(rows)?,
            11 => build::<11>(rows)?,
            12 => build::<12>(rows)?,
            _ => Arc::new(Exhaustive(rows.to_vec(), dimensions)),
        };
        Ok(Self {
            search,
            dimensions,
            len,
        })
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Always false: a tree has rows.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Writes the `k` rows nearest to `query` into `out`, nearest first, or all rows if there are fewer.
    ///
    /// Of rows at equal distance, any may be left out. `out` is empty for a query with a number that is NaN
    /// or beyond the range of the rows.
    ///
    /// # Panics
    /// If `query` has a number of dimensions other than that of the rows.
    pub fn nearest(&self, query: &[f64], k: usize, out: &mut Vec<Neighbor>) {
        assert_eq!(query.len(), self.dimensions, "dimensions of a query");
        out.clear();
        let near = query.iter().all(|x| x.abs() <= REACH);
        if let Some(k) = NonZeroUsize::new(k.min(self.len)).filter(|_| near) {
            self.search.nearest(query, k, out);
        }
    }
}

impl std::fmt::Debug for Neighbors {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Neighbors")
            .field("dimensions", &self.dimensions)
            .field("len", &self.len)
            .finish_non_exhaustive()
    }
}
