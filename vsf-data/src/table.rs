use crate::DataError;
use std::ops::Index;

/// A matrix of numbers, stored row by row: one row per sample, one column per joint.
///
/// Like a slice, it is read with [`get`](Self::get) or, if the row is known to exist, with `table[row]`, which panics
/// beyond the last row.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    cols: usize,
    data: Vec<f64>,
}

impl Table {
    /// Creates a table from `data`, row after row with `cols` numbers each.
    ///
    /// # Errors
    /// [`DataError::Argument`] if there are no columns, or if `data` does not fill its last row.
    ///
    /// ```
    /// let t = vsf_data::Table::new(2, vec![1.0, 2.0, 3.0, 4.0])?;
    /// assert_eq!(t.rows(), 2);
    /// assert_eq!(&t[1], [3.0, 4.0]);
    /// # Ok::<(), vsf_data::DataError>(())
    /// ```
    pub fn new(cols: usize, data: Vec<f64>) -> Result<Self, DataError> {
        if cols == 0 || !data.len().is_multiple_of(cols) {
            return Err(DataError::Argument {
                what: "table",
                problem: format!("{} numbers do not fill rows of {cols}", data.len()),
            });
        }
        Ok(Self { cols, data })
    }

    /// Number of rows `T`.
    pub fn rows(&self) -> usize {
        self.data.len() / self.cols
    }

    /// Number of columns `d`, at least 1.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// All numbers, row after row.
    pub fn data(&self) -> &[f64] {
        &self.data
    }

    /// All numbers, row after row, mutably.
    pub fn data_mut(&mut self) -> &mut [f64] {
        &mut self.data
    }

    /// Row `row`, or `None` beyond the last one.
    pub fn get(&self, row: usize) -> Option<&[f64]> {
        let start = row.checked_mul(self.cols)?;
        self.data.get(start..)?.get(..self.cols)
    }

    /// The rows in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[f64]> + Clone {
        self.data.chunks_exact(self.cols)
    }

    /// Column `col`, from 0; empty beyond the last one.
    pub fn column(&self, col: usize) -> impl Iterator<Item = f64> + Clone {
        let rows = if col < self.cols { self.rows() } else { 0 };
        (0..rows).map(move |row| self.data[row * self.cols + col])
    }

    /// First number that is NaN or infinite: row, column, value.
    pub(crate) fn first_not_finite(&self) -> Option<(usize, usize, f64)> {
        let i = self.data.iter().position(|v| !v.is_finite())?;
        Some((i / self.cols, i % self.cols, self.data[i]))
    }
}

impl<'a> IntoIterator for &'a Table {
    type Item = &'a [f64];
    type IntoIter = std::slice::ChunksExact<'a, f64>;

    fn into_iter(self) -> Self::IntoIter {
        self.data.chunks_exact(self.cols)
    }
}

/// Row by row.
///
/// # Panics
/// Beyond the last row.
impl Index<usize> for Table {
    type Output = [f64];

    fn index(&self, row: usize) -> &[f64] {
        &self.data[row * self.cols..][..self.cols]
    }
}
