use crate::VisionError;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZeroUsize;
use vsf_core::CoreError;

/// Most dimensions that are searched.
pub const MAX_DIMENSIONS: usize = 12;

/// Exact nearest neighbours among rows of numbers, by squared Euclidean distance.
///
/// The dimension of a k-d tree is part of its type; here it is chosen when the tree is built.
pub struct Neighbors {
    tree: Box<dyn Tree>,
    len: usize,
}

/// A neighbour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Its row.
    pub index: usize,
    /// Square of its distance.
    pub squared: f64,
}

trait Tree: Send + Sync {
    fn nearest(&self, query: &[f64], k: NonZeroUsize, out: &mut Vec<Neighbor>);
}

struct OfDimension<const D: usize>(ImmutableKdTree<f64, D>);

impl<const D: usize> Tree for OfDimension<D> {
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

fn build<const D: usize>(rows: &[f64]) -> Result<Box<dyn Tree>, CoreError> {
    let (points, _) = rows.as_chunks::<D>();
    let tree = ImmutableKdTree::new_from_slice(points)
        .map_err(|e| CoreError::Other(format!("nearest-neighbour tree: {e}")))?;
    Ok(Box::new(OfDimension(tree)))
}

impl Neighbors {
    /// A tree over rows of `dimensions` finite numbers each, 1 to [`MAX_DIMENSIONS`].
    ///
    /// # Errors
    /// No rows, more dimensions than are searched, a number that is not finite.
    pub fn new(rows: &[f64], dimensions: usize) -> Result<Self, VisionError> {
        CoreError::check_finite("rows to search", rows)?;
        let len = rows.len() / dimensions.max(1);
        if len == 0 {
            return Err(VisionError::TooFew {
                what: "rows to search",
                got: 0,
                least: 1,
            });
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
        let build = match dimensions {
            1 => build::<1>,
            2 => build::<2>,
            3 => build::<3>,
            4 => build::<4>,
            5 => build::<5>,
            6 => build::<6>,
            7 => build::<7>,
            8 => build::<8>,
            9 => build::<9>,
            10 => build::<10>,
            11 => build::<11>,
            MAX_DIMENSIONS => build::<MAX_DIMENSIONS>,
            _ => {
                return Err(CoreError::TooMany {
                    what: "dimensions of a nearest-neighbour search",
                    got: dimensions,
                    max: MAX_DIMENSIONS,
                }
                .into());
            }
        };
        Ok(Self {
            tree: build(rows)?,
            len,
        })
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Never true: a tree has rows.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Puts the `k` rows nearest to `query` into `out`, nearest first; all rows where there are
    /// fewer. Of rows equally far, any may be left out.
    ///
    /// # Panics
    /// If `query` has another dimension than the rows.
    pub fn nearest(&self, query: &[f64], k: usize, out: &mut Vec<Neighbor>) {
        out.clear();
        if let Some(k) = NonZeroUsize::new(k.min(self.len)) {
            self.tree.nearest(query, k, out);
        }
    }
}
