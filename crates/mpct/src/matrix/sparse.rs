//! Sparse matrices in compressed rows.

use super::Matrix;
use crate::error::DesignError;
use rayon::prelude::*;

/// Columns and values.
type Row = Vec<(u32, f64)>;

/// Rows of a product that one task computes: enough to pay for its scratch vectors.
const ROWS_PER_TASK: usize = 256;

/// A sparse real matrix in compressed row storage; columns ascend within a row.
///
/// ```
/// use mpct::{Matrix, SparseMatrix};
/// let a = SparseMatrix::from_triplets(2, 2, &[(0, 0, 1.0), (0, 1, 1.0), (1, 1, 1.0)])?;
/// assert_eq!(a.to_dense(), Matrix::from_rows(&[[1.0, 1.0], [0.0, 1.0]]));
/// assert_eq!(a.mul_vec(&[2.0, 3.0]), vec![5.0, 3.0]);
/// # Ok::<(), mpct::DesignError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Default)]
pub struct SparseMatrix {
    rows: usize,
    cols: usize,
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl SparseMatrix {
    /// The zero matrix.
    pub fn zeros(rows: usize, cols: usize) -> Self {
        Self {
            rows,
            cols,
            starts: vec![0; rows + 1],
            columns: Vec::new(),
            values: Vec::new(),
        }
    }

    /// The identity matrix of order `n`.
    pub fn identity(n: usize) -> Self {
        Self::from_diagonal(&vec![1.0; n])
    }

    /// The diagonal matrix with the given diagonal.
    pub fn from_diagonal(diagonal: &[f64]) -> Self {
        let n = diagonal.len();
        Self::from_row_lists(
            n,
            n,
            diagonal
                .iter()
                .enumerate()
                .map(|(i, &v)| vec![(i as u32, v)]),
        )
    }

    /// A matrix from `(row, column, value)` entries, 0-based, in any order. Entries at the same place add up.
    ///
    /// # Errors
    /// [`DesignError::OutOfRange`] when an entry lies outside the matrix.
    pub fn from_triplets(
        rows: usize,
        cols: usize,
        entries: &[(usize, usize, f64)],
    ) -> Result<Self, DesignError> {
        let mut lists = vec![Vec::new(); rows];
        for (k, &(i, j, v)) in entries.iter().enumerate() {
            if !(i < rows && j < cols) {
                return Err(DesignError::OutOfRange {
                    what: format!("position of entry {k} of a sparse matrix"),
                    expected: format!("row < {rows} and column < {cols} (0-based)"),
                    found: format!("row {i}, column {j}"),
                });
            }
            lists[i].push((j as u32, v));
        }
        for list in &mut lists {
            list.sort_by_key(|e| e.0);
            list.dedup_by(|later, first| {
                let same = later.0 == first.0;
                if same {
                    first.1 += later.1;
                }
                same
            });
        }
        Ok(Self::from_row_lists(rows, cols, lists))
    }

    /// Rows given as lists of `(column, value)` with ascending columns; zeros are dropped.
    pub(crate) fn from_row_lists(
        rows: usize,
        cols: usize,
        lists: impl IntoIterator<Item = Vec<(u32, f64)>>,
    ) -> Self {
        let mut m = Self {
            rows,
            cols,
            starts: Vec::with_capacity(rows + 1),
            columns: Vec::new(),
            values: Vec::new(),
        };
        m.starts.push(0);
        for list in lists {
            for (j, v) in list {
                // A NaN is kept: the checks at the door must see it.
                if v != 0.0 {
                    m.columns.push(j);
                    m.values.push(v);
                }
            }
            m.starts.push(m.columns.len());
        }
        debug_assert_eq!(m.starts.len(), rows + 1);
        m
    }

    /// The sparse form of a dense matrix; zeros are dropped.
    pub fn from_dense(m: &Matrix) -> Self {
        Self::from_row_lists(
            m.rows(),
            m.cols(),
            (0..m.rows()).map(|i| {
                m.row(i)
                    .iter()
                    .enumerate()
                    .map(|(j, &v)| (j as u32, v))
                    .collect()
            }),
        )
    }

    /// The dense form.
    pub fn to_dense(&self) -> Matrix {
        let mut m = Matrix::zeros(self.rows, self.cols);
        for i in 0..self.rows {
            for (j, v) in self.row(i) {
                m.set(i, j, v);
            }
        }
        m
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Number of stored entries.
    pub fn nonzeros(&self) -> usize {
        self.values.len()
    }

    /// The stored entries `(column, value)` of row `i`, columns ascending.
    pub fn row(&self, i: usize) -> impl ExactSizeIterator<Item = (usize, f64)> + '_ {
        let (columns, values) = self.row_slices(i);
        columns.iter().zip(values).map(|(&j, &v)| (j as usize, v))
    }

    /// Columns and values of row `i`.
    pub(crate) fn row_slices(&self, i: usize) -> (&[u32], &[f64]) {
        let range = self.starts[i]..self.starts[i + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// The entry in row `i`, column `j`; zero when it is not stored.
    pub fn get(&self, i: usize, j: usize) -> f64 {
        let (columns, values) = self.row_slices(i);
        columns
            .binary_search(&(j as u32))
            .map_or(0.0, |k| values[k])
    }

    /// All entries `(row, column, value)`, row by row.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
        (0..self.rows).flat_map(move |i| self.row(i).map(move |(j, v)| (i, j, v)))
    }

    /// Row `i` times a vector.
    pub(crate) fn row_dot(&self, i: usize, x: &[f64]) -> f64 {
        self.row(i).map(|(j, v)| v * x[j]).sum()
    }

    /// The product M x, of length `rows`.
    ///
    /// # Panics
    /// When `x.len() != cols`.
    pub fn mul_vec(&self, x: &[f64]) -> Vec<f64> {
        assert_eq!(x.len(), self.cols, "length of the vector");
        (0..self.rows).map(|i| self.row_dot(i, x)).collect()
    }

    /// The product Mᵀ y, of length `cols`.
    ///
    /// # Panics
    /// When `y.len() != rows`.
    pub fn mul_vec_transposed(&self, y: &[f64]) -> Vec<f64> {
        assert_eq!(y.len(), self.rows, "length of the vector");
        let mut out = vec![0.0; self.cols];
        for (i, &yi) in y.iter().enumerate() {
            if yi != 0.0 {
                for (j, v) in self.row(i) {
                    out[j] += v * yi;
                }
            }
        }
        out
    }

    /// The transpose.
    pub fn transpose(&self) -> Self {
        let mut lists = vec![Vec::new(); self.cols];
        for (i, j, v) in self.entries() {
            lists[j].push((i as u32, v));
        }
        Self::from_row_lists(self.cols, self.rows, lists)
    }

    /// The product of two matrices; exact zeros are dropped.
    ///
    /// # Panics
    /// When the inner dimensions differ.
    pub fn mul(&self, other: &Self) -> Self {
        assert_eq!(self.cols, other.rows, "inner dimensions");
        let mut sum = vec![0.0; other.cols];
        let mut touched = vec![false; other.cols];
        let mut list: Vec<u32> = Vec::new();
        let rows = (0..self.rows).map(|i| {
            for (k, a) in self.row(i) {
                for (j, b) in other.row(k) {
                    if !touched[j] {
                        touched[j] = true;
                        list.push(j as u32);
                    }
                    sum[j] += a * b;
                }
            }
            list.sort_unstable();
            list.drain(..)
                .map(|j| {
                    touched[j as usize] = false;
                    (j, std::mem::take(&mut sum[j as usize]))
                })
                .collect::<Vec<_>>()
        });
        Self::from_row_lists(self.rows, other.cols, rows)
    }

    /// The product of two matrices, rows in parallel. `finish` sees each row of the product, columns ascending, may
    /// drop entries, and returns a number that is kept for the row.
    pub(crate) fn mul_with(
        &self,
        other: &Self,
        finish: impl Fn(usize, &mut Vec<(u32, f64)>) -> f64 + Sync,
    ) -> (Self, Vec<f64>) {
        assert_eq!(self.cols, other.rows, "inner dimensions");
        let starts: Vec<usize> = (0..self.rows).step_by(ROWS_PER_TASK).collect();
        let blocks: Vec<Vec<(Row, f64)>> = starts
            .into_par_iter()
            .map(|start| {
                let mut sum = vec![0.0; other.cols];
                let mut touched = vec![false; other.cols];
                let mut list: Vec<u32> = Vec::new();
                (start..self.rows.min(start + ROWS_PER_TASK))
                    .map(|i| {
                        let (ca, va) = self.row_slices(i);
                        for (&k, &a) in ca.iter().zip(va) {
                            let (cb, vb) = other.row_slices(k as usize);
                            for (&j, &b) in cb.iter().zip(vb) {
                                let at = j as usize;
                                if !touched[at] {
                                    touched[at] = true;
                                    list.push(j);
                                }
                                sum[at] += a * b;
                            }
                        }
                        list.sort_unstable();
                        let mut row: Vec<(u32, f64)> = list
                            .drain(..)
                            .map(|j| {
                                touched[j as usize] = false;
                                (j, std::mem::take(&mut sum[j as usize]))
                            })
                            .collect();
                        let kept = finish(i, &mut row);
                        (row, kept)
                    })
                    .collect()
            })
            .collect();
        let numbers = blocks.iter().flatten().map(|r| r.1).collect();
        let rows = blocks.into_iter().flatten().map(|r| r.0);
        (Self::from_row_lists(self.rows, other.cols, rows), numbers)
    }

    /// Share of the entries that are stored.
    pub(crate) fn share(&self) -> f64 {
        self.nonzeros() as f64 / (self.rows * self.cols).max(1) as f64
    }

    /// The matrix without the entries for which `keep` is false.
    pub(crate) fn filtered(&self, keep: impl Fn(usize, usize, f64) -> bool) -> Self {
        Self::from_row_lists(
            self.rows,
            self.cols,
            (0..self.rows).map(|i| {
                self.row(i)
                    .filter(|&(j, v)| keep(i, j, v))
                    .map(|(j, v)| (j as u32, v))
                    .collect()
            }),
        )
    }

    /// `alpha * self + beta * other`.
    ///
    /// # Panics
    /// When the shapes differ.
    pub fn combine(&self, alpha: f64, other: &Self, beta: f64) -> Self {
        assert_eq!((self.rows, self.cols), (other.rows, other.cols), "shapes");
        Self::from_row_lists(
            self.rows,
            self.cols,
            (0..self.rows).map(|i| {
                let (ca, va) = self.row_slices(i);
                let (cb, vb) = other.row_slices(i);
                let (mut a, mut b) = (0, 0);
                let mut list = Vec::with_capacity(ca.len() + cb.len());
                while a < ca.len() || b < cb.len() {
                    let ja = ca.get(a).copied().unwrap_or(u32::MAX);
                    let jb = cb.get(b).copied().unwrap_or(u32::MAX);
                    let j = ja.min(jb);
                    let mut v = 0.0;
                    if ja == j {
                        v += alpha * va[a];
                        a += 1;
                    }
                    if jb == j {
                        v += beta * vb[b];
                        b += 1;
                    }
                    list.push((j, v));
                }
                list
            }),
        )
    }

    /// The rows with the given indices, in that order.
    pub(crate) fn select_rows(&self, indices: &[usize]) -> Self {
        Self::from_row_lists(
            indices.len(),
            self.cols,
            indices
                .iter()
                .map(|&i| self.row(i).map(|(j, v)| (j as u32, v)).collect()),
        )
    }

    /// First entry that is NaN or infinite, as `(row, column, value)`.
    pub(crate) fn first_not_finite(&self) -> Option<(usize, usize, f64)> {
        self.entries().find(|e| !e.2.is_finite())
    }
}

impl From<&Matrix> for SparseMatrix {
    fn from(m: &Matrix) -> Self {
        Self::from_dense(m)
    }
}

impl From<Matrix> for SparseMatrix {
    fn from(m: Matrix) -> Self {
        Self::from_dense(&m)
    }
}
